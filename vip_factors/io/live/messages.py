"""Conversion between live messages and set-ups, and from live messages to samples."""

from dataclasses import replace

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import UNIT_TOLERANCE
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import NS_PER_S, PLACEMENT, SUBJECT, Codec, time_ns_of
from vip_factors.io.mcap_camera import (
    camera_info_message,
    intrinsics_message,
    intrinsics_of,
    keypoint_set_of,
    mount_of,
)
from vip_factors.io.mcap_frames import camera_path_of, camera_poses
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample as ImuMessage
from vip_factors.io.schemas.live_message_pb2 import LiveCamera as CameraMessage
from vip_factors.io.schemas.live_message_pb2 import LiveHeader, LiveMessage
from vip_factors.io.schemas.live_message_pb2 import LiveWearer as WearerMessage
from vip_factors.sensors.calibration import PRESETS, preset
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import ImuSample, VideoFrame, checked_head
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import CAMERA_MOUNTING_SIGMA, Camera, Scene

WEARER = Codec(WearerMessage, Recording)
HEADER = Codec(LiveHeader, Scene, {"start": "start_ns"})
INITIAL_POSES = ("t-pose", "n-pose", "none")


def imu_sample_of(message: ImuMessage, carrier: str, start_ns: int, sensor: str = "") -> ImuSample:
    """Convert one IMU sample; ``sensor`` is its name where the message has none.

    Raises:
        FileFormatError: if it has no time, or its orientation is no unit quaternion.
    """
    name = message.sensor or sensor
    if message.HasField("seconds"):
        time = message.seconds
    elif message.HasField("timestamp"):
        time = (time_ns_of(message.timestamp) - start_ns) / NS_PER_S
    else:
        raise FileFormatError(f"'{carrier}', sensor '{name}': a sample has no time: expected seconds or a timestamp")
    R = None
    if message.HasField("orientation_wxyz"):
        R = rotation_of(message.orientation_wxyz)
        if R is None:
            raise FileFormatError(
                f"'{carrier}', sensor '{name}': a sample's orientation at {time:.3f} s is no unit quaternion (within "
                f"{UNIT_TOLERANCE:.0%}): it is left out"
            )
    force, rate = (
        np.array((vector.x, vector.y, vector.z)) if message.HasField(field) else None
        for field, vector in (("specific_force", message.specific_force), ("angular_rate", message.angular_rate))
    )
    return ImuSample(carrier, name, time, R, force, rate)


def rotation_of(message: QuaternionWxyz) -> Array | None:
    """``(3, 3)``, normalised first; None if it is no unit quaternion.

    The same as :func:`~vip_factors.geometry.quaternions.matrix_from_quaternion` of one, at a tenth of its time.
    """
    w, x, y, z = message.w, message.x, message.y, message.z
    square = w * w + x * x + y * y + z * z
    if not abs(square**0.5 - 1) < UNIT_TOLERANCE:
        return None
    s = 2 / square
    xx, yy, zz, xy, xz, yz = s * x * x, s * y * y, s * z * z, s * x * y, s * x * z, s * y * z
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    return np.array(((1 - yy - zz, xy - wz, xz + wy), (xy + wz, 1 - xx - zz, yz - wx), (xz - wy, yz + wx, 1 - xx - yy)))


def video_frame_of(
    message: Detections2D, camera: str, start_ns: int, keypoints: int | None = None, clock: VideoClock | None = None
) -> VideoFrame:
    """Convert one video frame.

    Args:
        message: of the frame; where its ``seconds`` are zero, the timestamp counts if there is one.
        camera: its name.
        start_ns: absolute time of t = 0.
        keypoints: number for every person; None if unknown.
        clock: offset and drift of the video clock against that of the IMUs; None for the same clock.

    Raises:
        FileFormatError: if a person has another number of keypoints.
    """
    if message.seconds == 0 and message.HasField("timestamp"):
        time = (time_ns_of(message.timestamp) - start_ns) / NS_PER_S
    else:
        time = message.seconds + (0.0 if clock is None else clock.late(message.seconds))
    people = message.people
    K = keypoints if keypoints is not None else (len(people[0].confidence) if people else 0)
    for person in people:
        if len(person.pixels) != 2 * K or len(person.confidence) != K:
            raise FileFormatError(
                f"camera '{camera}': a person at {time:.3f} s has {len(person.pixels) // 2} keypoints and "
                f"{len(person.confidence)} confidences: expected {K} of each; this video frame is left out"
            )
    pixels = np.array([person.pixels for person in people], dtype=float).reshape(len(people), K, 2)
    confidence = np.array([person.confidence for person in people], dtype=float).reshape(len(people), K)
    return VideoFrame(camera, time, pixels, confidence)


def header_message(setup: Scene) -> LiveMessage:
    """Make the first message of a sender."""
    cameras = [_camera_message(camera, setup.start_ns) for camera in setup.cameras]
    return LiveMessage(header=HEADER.encode(setup, cameras=cameras))


def setup_of(header: LiveHeader) -> Scene:
    """Make the set-up that a header describes.

    Raises:
        InputError: for what no wearer or camera can be, and for a name that two of them share.
    """
    wearers = tuple(_wearer(header.name, wearer, time_ns_of(header.start)) for wearer in header.wearers)
    return checked_head(Scene(header.name, wearers, tuple(map(_camera, header.cameras))))


def _wearer(name: str, message: WearerMessage, start_ns: int) -> Recording:
    """One wearer of a stream of this name; a preset without sites is fitted to the body."""
    wearer, placed = SUBJECT.decode(message.subject), PLACEMENT.decode(message.placement)
    body = wearer.body()
    if not placed.sites and placed.name in PRESETS:
        placed = preset(placed.name, body)
    pose = message.initial_pose or "none"
    if pose not in INITIAL_POSES:
        raise InputError(f"wearer '{wearer.name}': initial pose '{pose}': expected {', '.join(INITIAL_POSES)}")
    return Recording(name, wearer, {}, placed, pose, start_ns=start_ns)


def _camera(message: CameraMessage) -> Camera:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from google.protobuf.message import DecodeError

    info = message.info
    if not info.keypoints:
        raise FileFormatError(f"camera '{info.name}' names no keypoints: expected those of its detector, in order")
    try:
        model = intrinsics_of(CameraCalibration.FromString(message.calibration))
    except DecodeError as error:
        what = f"its calibration is no foxglove.CameraCalibration ({error})"
        raise FileFormatError(f"camera '{info.name}': {what}") from error
    mount = mount_of(info.mount, ImuStream(info.mount.imu, np.zeros(0))) if info.HasField("mount") else None
    if mount is not None and not mount.mounting_sigma:
        mount = replace(mount, mounting_sigma=CAMERA_MOUNTING_SIGMA)
    path = camera_path_of(message.known_poses) if message.known_poses else None
    detections = Detections.none(keypoint_set_of(info))
    return Camera(info.name, model, detections, info.moving, mount, path, focal_sigma=info.focal_sigma)


def _camera_message(camera: Camera, start_ns: int) -> CameraMessage:
    poses = [] if camera.known_path is None else list(camera_poses(camera.known_path, start_ns))
    return CameraMessage(
        info=camera_info_message(camera),
        calibration=intrinsics_message(camera.model, camera.name, start_ns).SerializeToString(),
        known_poses=poses,
    )
