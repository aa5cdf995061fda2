"""What must be known before the first sample, to and from its messages."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.mcap_camera import intrinsics_message, intrinsics_of
from vip_factors.io.mcap_messages import rotation, rotation_message, set_timestamp, time_ns_of, vector, vector_message
from vip_factors.io.mcap_recording import placement_message, placement_of, subject_message, subject_of
from vip_factors.io.mcap_samples import keypoint_set_of
from vip_factors.io.mcap_writer import nanoseconds
from vip_factors.io.schemas.camera_estimate_pb2 import CameraPose
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.live_message_pb2 import LiveCamera as CameraMessage
from vip_factors.io.schemas.live_message_pb2 import LiveHeader, LiveMessage
from vip_factors.io.schemas.sensor_placement_pb2 import SensorPlacement
from vip_factors.io.schemas.subject_pb2 import Subject as SubjectMessage
from vip_factors.sensors.calibration import PRESETS, preset
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.live import LiveCamera, LiveMount, LiveSetup, LiveWearer
from vip_factors.sensors.scene import CAMERA_MOUNTING_SIGMA

if TYPE_CHECKING:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

INITIAL_POSES = ("t-pose", "n-pose", "none")


def header_message(setup: LiveSetup, token: str = "") -> LiveMessage:
    """The message that a sender begins with; ``token`` is the secret that the receiver was given, if it was."""
    header = LiveHeader(name=setup.name, token=token)
    set_timestamp(header.start, setup.start_ns)
    for wearer in setup.wearers:
        header.wearers.add(
            subject=subject_message(wearer.subject),
            placement=placement_message(wearer.placement),
            initial_pose=wearer.initial_pose,
        )
    header.cameras.extend(_camera_message(camera, setup.start_ns) for camera in setup.cameras)
    return LiveMessage(header=header)


def setup_of(header: LiveHeader) -> LiveSetup:
    """The set-up that a header describes.

    Raises:
        InputError: for what no wearer or camera can be.
    """
    return LiveSetup(
        header.name,
        tuple(wearer_of(one.subject, one.placement, one.initial_pose) for one in header.wearers),
        tuple(_camera(one) for one in header.cameras),
        time_ns_of(header.start),
    )


def wearer_of(subject: SubjectMessage, placement: SensorPlacement, initial_pose: str) -> LiveWearer:
    """One wearer; a preset without sites is fitted to the body.

    Raises:
        InputError: for an implausible body, a bone or a pose that is not known, a mounting that is no rotation.
    """
    wearer = subject_of(subject)
    body = wearer.body()
    placed = placement_of(placement)
    if not placed.sites and placed.name in PRESETS:
        placed = preset(placed.name, body)
    pose = initial_pose or "none"
    if pose not in INITIAL_POSES:
        raise InputError(f"wearer '{wearer.name}': initial pose '{pose}': expected {', '.join(INITIAL_POSES)}")
    return LiveWearer(wearer, placed, pose)


def camera_of(info: CameraInfo, calibration: "CameraCalibration", known_path: CameraPath | None) -> LiveCamera:
    """One camera.

    Raises:
        InputError: for intrinsics that no camera has, no keypoints, a mounting that is no rotation.
    """
    if not info.keypoints:
        raise FileFormatError(f"camera '{info.name}' names no keypoints: expected those of its detector, in order")
    mount = None
    if info.HasField("mount"):
        sigma = info.mount.mounting_sigma_rad or CAMERA_MOUNTING_SIGMA
        mount = LiveMount(
            info.mount.imu, rotation(info.mount.mounting_wxyz), vector(info.mount.p_camera_imu), float(sigma)
        )
    model, keypoints = intrinsics_of(calibration), keypoint_set_of(info)
    return LiveCamera(info.name, model, keypoints, info.moving, known_path, mount)


def _camera(message: CameraMessage) -> LiveCamera:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from google.protobuf.message import DecodeError

    name = message.info.name
    try:
        calibration = CameraCalibration.FromString(message.calibration)
    except DecodeError as error:
        raise FileFormatError(f"camera '{name}': its calibration is no foxglove.CameraCalibration ({error})") from error
    return camera_of(message.info, calibration, _path(message.known_poses))


def _camera_message(camera: LiveCamera, start_ns: int) -> CameraMessage:
    keypoints, path, mount = camera.keypoints, camera.known_path, camera.mount
    message = CameraMessage(calibration=intrinsics_message(camera.model, camera.name, start_ns).SerializeToString())
    info = message.info
    info.name, info.moving = camera.name, camera.moving
    info.keypoint_set = keypoints.name
    info.keypoints.extend(keypoints.keypoints)
    if mount is not None:
        info.mount.imu = mount.sensor
        info.mount.mounting_wxyz.CopyFrom(rotation_message(mount.R_camera_imu))
        info.mount.p_camera_imu.CopyFrom(vector_message(mount.p_camera_imu))
        info.mount.mounting_sigma_rad = mount.mounting_sigma
    if path is not None:
        info.known_poses = len(path)
        for frame, time_ns in enumerate(nanoseconds(path.time, start_ns)):
            pose = message.known_poses.add(
                frame=frame,
                seconds=float(path.time[frame]),
                rotation_wxyz=rotation_message(path.R_world_camera[frame]),
                p_world_camera=vector_message(path.p_world_camera[frame]),
            )
            set_timestamp(pose.timestamp, time_ns)
    return message


def _path(poses: Sequence[CameraPose]) -> CameraPath | None:
    if not poses:
        return None
    time = np.array([one.seconds for one in poses])
    R_world_camera = np.stack([rotation(one.rotation_wxyz) for one in poses])
    return CameraPath(time, R_world_camera, np.stack([vector(one.p_world_camera) for one in poses]))
