"""What belongs to a camera, as messages: Foxglove's for intrinsics, poses and images, ours for the rest."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_messages import (
    of_topic,
    rotation,
    rotation_message,
    set_timestamp,
    time_ns_of,
    vector,
    vector_message,
)
from vip_factors.io.mcap_writer import NS_PER_S, MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.scene import Camera, CameraMount, Video

if TYPE_CHECKING:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

    from vip_factors.io.mcap_contents import McapMessages

WORLD = "world"
IMAGE_FORMATS = {b"\xff\xd8": "jpeg", b"\x89P": "png", b"RI": "webp"}  # by their first two bytes


def intrinsics_message(model: CameraModel, name: str, time_ns: int) -> "CameraCalibration":
    """``foxglove.CameraCalibration`` of a camera."""
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration

    kind = {0: "", 4: "plumb_bob", 5: "plumb_bob", 8: "rational_polynomial"}[len(model.distortion)]
    message = CameraCalibration(
        frame_id=name,
        width=model.width,
        height=model.height,
        distortion_model=kind,
        D=model.distortion,
        K=model.K.ravel(),
        R=np.eye(3).ravel(),
        P=np.hstack([model.K, np.zeros((3, 1))]).ravel(),
    )
    set_timestamp(message.timestamp, time_ns)
    return message


def intrinsics_of(message: "CameraCalibration") -> CameraModel:
    """The camera of a message.

    Raises:
        FileFormatError: for a message without a camera matrix.
        InputError: for numbers that no camera has.
    """
    if len(message.K) != 9:
        raise FileFormatError(f"camera matrix K has {len(message.K)} numbers: expected 9")
    fx, _, cx, _, fy, cy, *_ = message.K
    return CameraModel(message.width, message.height, (fx, fy), (cx, cy), tuple(message.D))


def path_messages(
    writer: MessageWriter, topic: str, path: CameraPath, start_ns: int, frame_id: str = WORLD
) -> Iterator[TimedMessage]:
    """The poses of a camera as ``foxglove.PoseInFrame``, serialised, in the order of time."""
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

    channel = writer.channel(topic, PoseInFrame)
    xyzw = quaternion_from_matrix(path.R_world_camera, Order.XYZW).tolist()
    message = PoseInFrame(frame_id=frame_id)
    for time_ns, q, p in zip(nanoseconds(path.time, start_ns), xyzw, path.p_world_camera.tolist(), strict=True):
        set_timestamp(message.timestamp, time_ns)
        turn, at = message.pose.orientation, message.pose.position
        turn.x, turn.y, turn.z, turn.w = q
        at.x, at.y, at.z = p
        yield time_ns, channel, message.SerializeToString()


def path_of(path: Path, messages: "Sequence[McapMessages]", topic: str, start_ns: int) -> CameraPath | None:
    """The poses on a topic, times to the nanosecond; None if there are none."""
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

    poses = of_topic(path, messages, topic, PoseInFrame)
    if not poses:
        return None
    time = np.array([(time_ns_of(one.timestamp) - start_ns) / NS_PER_S for one in poses])
    turns = [one.pose.orientation for one in poses]
    xyzw = np.array([(q.x, q.y, q.z, q.w) for q in turns])
    places = [one.pose.position for one in poses]
    p_world_camera = np.array([(p.x, p.y, p.z) for p in places])
    return CameraPath(time, matrix_from_quaternion(xyzw, Order.XYZW), p_world_camera)


def camera_info_message(camera: Camera, mcap_path: Path) -> CameraInfo:
    """Everything but intrinsics, detections, samples and images."""
    keypoints = camera.detections.keypoints
    message = CameraInfo(
        name=camera.name,
        moving=camera.moving,
        time_offset_s=camera.time_offset,
        time_drift=camera.time_drift,
        known_poses=len(camera.known_path) if camera.known_path is not None else 0,
        keypoint_set=keypoints.name,
        keypoints=keypoints.keypoints,
        frames=len(camera.detections.time),
    )
    if camera.mount is not None:
        message.mount.imu = camera.mount.imu.name
        message.mount.mounting_wxyz.CopyFrom(rotation_message(camera.mount.R_camera_imu))
        message.mount.p_camera_imu.CopyFrom(vector_message(camera.mount.p_camera_imu))
        message.mount.mounting_sigma_rad = camera.mount.mounting_sigma
    if camera.video is not None:
        message.video.SetInParent()
        if camera.video.path is not None:
            message.video.path = _stored_path(camera.video.path, mcap_path)
        message.video.image_frames.extend(sorted(camera.video.images))
    return message


def mount_of(message: CameraInfo.Mount, imu: ImuStream) -> CameraMount:
    """The mount of a message, with the samples that belong to it."""
    return CameraMount(
        imu, rotation(message.mounting_wxyz), vector(message.p_camera_imu), float(message.mounting_sigma_rad)
    )


def image_messages(writer: MessageWriter, topic: str, camera: Camera, start_ns: int) -> Iterator[TimedMessage]:
    """The embedded frames as ``foxglove.CompressedImage``, serialised, in the order of their index."""
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    images = dict(sorted(camera.video.images.items())) if camera.video is not None else {}
    if not images:
        return
    channel = writer.channel(topic, CompressedImage)
    times = camera.clock.at(frame_times(camera.detections.time, np.array(list(images))))
    for time_ns, data in zip(nanoseconds(times, start_ns), images.values(), strict=True):
        message = CompressedImage(frame_id=camera.name, data=data, format=IMAGE_FORMATS.get(data[:2], ""))
        set_timestamp(message.timestamp, time_ns)
        yield time_ns, channel, message.SerializeToString()


def video_of(message: CameraInfo.Video, images: Sequence[Any], mcap_path: Path) -> Video:
    """The video of a message and the ``foxglove.CompressedImage`` of its embedded frames."""
    path = mcap_path.parent / message.path if message.path else None  # an absolute path stays as it is
    return Video(path, {int(index): one.data for index, one in zip(message.image_frames, images, strict=False)})


def frame_times(time: Array, index: np.ndarray) -> Array:
    """Seconds of video frames by index; those after the last known one follow at the video's rate."""
    if len(time) == 0:
        return np.asarray(index, float)
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    beyond = np.maximum(index - (len(time) - 1), 0)
    return time[np.minimum(index, len(time) - 1)] + beyond * step


def _stored_path(video: Path, mcap_path: Path) -> str:
    """Relative to the folder of the MCAP file if the video lies there, so that both can move together."""
    folder, absolute = Path(os.path.abspath(mcap_path)).parent, Path(os.path.abspath(video))
    return absolute.relative_to(folder).as_posix() if absolute.is_relative_to(folder) else str(absolute)
