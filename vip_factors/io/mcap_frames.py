"""What an estimate or a truth has of every frame, to and from messages, quickly: poses, residuals."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.errors import FileFormatError
from vip_factors.estimate import PoseCovariance
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import set_timestamp, vector_message
from vip_factors.io.mcap_messages import MOTION, warn
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.body_pose_pb2 import BodyPose, MotionInfo
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose, CameraResiduals
from vip_factors.io.schemas.estimate_info_pb2 import EstimateInfo
from vip_factors.io.schemas.residuals_pb2 import Residuals
from vip_factors.sensors.camera_path import CameraPath

MOST_RESIDUALS = 20_000_000  # nine hours at 60 Hz, of ten wearers


def pose_messages(
    writer: MessageWriter,
    topic: str,
    motion: Motion,
    start_ns: int,
    covariance: PoseCovariance | None = None,
    first: int = 0,
) -> Iterator[TimedMessage]:
    """The frames of a motion, serialised, in the order of time; the first of them has the number ``first``."""
    wxyz = quaternion_from_matrix(motion.R_parent_child, Order.WXYZ).reshape(len(motion), 4 * JOINT_COUNT)
    messages = (
        BodyPose(
            frame=first + row,
            joint_rotations_wxyz=wxyz[row],
            p_world_pelvis=vector_message(p_world_pelvis),
            joint_covariance=() if covariance is None else covariance.joints[row].ravel(),
            root_covariance=() if covariance is None else covariance.root[row].ravel(),
        )
        for row, p_world_pelvis in enumerate(motion.p_world_pelvis)
    )
    return writer.stamped(topic, BodyPose, nanoseconds(motion.time, start_ns), messages)


def motion_of(path: Path, info: MotionInfo, poses: Sequence[BodyPose]) -> tuple[Motion, PoseCovariance | None]:
    """The motion of its messages, and its covariance if all frames have one.

    It ends before the first lost frame, of which a warning says.

    Raises:
        FileFormatError: for frames of another skeleton.
    """
    frames = 0
    while frames < len(poses) and poses[frames].frame == frames:
        frames += 1
    poses = poses[:frames]
    wxyz = _rows("joint rotations", [one.joint_rotations_wxyz for one in poses], (JOINT_COUNT, 4))
    root = [(one.p_world_pelvis.x, one.p_world_pelvis.y, one.p_world_pelvis.z) for one in poses]
    motion = Motion(
        R_parent_child=matrix_from_quaternion(wxyz, Order.WXYZ),
        p_world_pelvis=np.array(root, float).reshape(-1, 3),
        **MOTION.values(info),
    )
    if frames < info.frames:
        warn(path, f"motion '{info.name}': {frames} of {info.frames} frames are left")
    if not poses or not all(one.joint_covariance and one.root_covariance for one in poses):
        return motion, None
    joints = _rows("joint covariances", [one.joint_covariance for one in poses], (JOINT_COUNT, 3, 3))
    return motion, PoseCovariance(joints, _rows("root covariances", [one.root_covariance for one in poses], (3, 3)))


def _rows(what: str, rows: Sequence[Any], shape: tuple[int, ...]) -> Array:
    size = int(np.prod(shape))
    for frame, row in enumerate(rows):
        if len(row) != size:
            raise FileFormatError(f"frame {frame} has {len(row)} numbers of {what}: expected {size}")
    return np.array(rows, float).reshape(len(rows), *shape)


def residual_messages(
    writer: MessageWriter, topic: str, time: Array, residuals: Mapping[str, Array], start_ns: int, first: int = 0
) -> Iterator[TimedMessage]:
    """The residuals of frames at ``time`` ``(T,)``, serialised; the first of them has the number ``first``."""
    messages = (
        Residuals(
            frame=first + row,
            kinds=[Residuals.Kind(name=kind, values=values[row]) for kind, values in residuals.items()],
        )
        for row in range(len(time))
    )
    return writer.stamped(topic, Residuals, nanoseconds(time, start_ns), messages)


def camera_pose_messages(
    writer: MessageWriter,
    topic: str,
    path: CameraPath,
    start_ns: int,
    covariance: Array | None = None,
    first: int = 0,
) -> Iterator[TimedMessage]:
    """The poses of a camera, serialised, in the order of time; the first of them has the number ``first``."""
    times_ns = nanoseconds(path.time, start_ns)
    return writer.stamped(topic, CameraPose, times_ns, camera_poses(path, start_ns, covariance, first))


def camera_poses(
    path: CameraPath, start_ns: int, covariance: Array | None = None, first: int = 0
) -> Iterator[CameraPose]:
    """The messages of the poses of a camera."""
    turns = quaternion_from_matrix(path.R_world_camera, Order.WXYZ).tolist()
    for row, (time_ns, seconds) in enumerate(zip(nanoseconds(path.time, start_ns), path.time.tolist(), strict=True)):
        message = CameraPose(
            frame=first + row,
            seconds=seconds,
            rotation_wxyz=dict(zip("wxyz", turns[row], strict=True)),
            p_world_camera=vector_message(path.p_world_camera[row]),
            covariance=covariance[row].ravel() if covariance is not None else (),
        )
        set_timestamp(message.timestamp, time_ns)
        yield message


def camera_residual_messages(
    writer: MessageWriter, topic: str, time: Array, residual: Array, start_ns: int, first: int = 0
) -> Iterator[TimedMessage]:
    """Reprojection errors ``(T, wearers)`` of frames at ``time`` ``(T,)``, numbered from ``first`` on."""
    messages = (CameraResiduals(frame=frame, pixels=pixels) for frame, pixels in enumerate(residual, first))
    return writer.stamped(topic, CameraResiduals, nanoseconds(time, start_ns), messages)


def residuals_of(info: EstimateInfo, messages: Sequence[Residuals], frames: int) -> dict[str, Array]:
    """By kind ``(frames, sensors)``; NaN where a frame's message is lost."""
    residuals = {kind: np.full((frames, len(info.sensors)), np.nan) for kind in info.residual_kinds}
    for message in messages:
        for kind in message.kinds:
            if kind.name not in residuals or len(kind.values) != len(info.sensors):
                raise FileFormatError(
                    f"frame {message.frame} has {len(kind.values)} residuals '{kind.name}': expected "
                    f"{len(info.sensors)}, of {', '.join(residuals) or 'no kind'}"
                )
            if message.frame < frames:
                residuals[kind.name][message.frame] = kind.values
    return residuals


def camera_path_of(poses: Sequence[CameraPose]) -> CameraPath:
    """The path of poses, one at least."""
    turns = [one.rotation_wxyz for one in poses]
    places = [one.p_world_camera for one in poses]
    return CameraPath(
        np.array([one.seconds for one in poses]),
        matrix_from_quaternion([(q.w, q.x, q.y, q.z) for q in turns], Order.WXYZ),
        np.array([(p.x, p.y, p.z) for p in places]),
    )


def camera_covariance_of(poses: Sequence[CameraPose]) -> Array | None:
    """``(T, 6, 6)`` if all poses have one."""
    if not all(len(one.covariance) == 36 for one in poses):
        return None
    return np.array([one.covariance for one in poses]).reshape(-1, 6, 6)


def camera_residuals_of(path: Path, info: CameraEstimateInfo, messages: Sequence[CameraResiduals]) -> Array | None:
    """``(T, wearers)``; NaN where a frame's message is lost."""
    if not info.has_residuals:
        return None
    if info.residual_frames * info.wearers > MOST_RESIDUALS:
        raise FileFormatError(
            f"{path}: tells of reprojection errors in {info.residual_frames} frames of {info.wearers} wearers: "
            f"expected {MOST_RESIDUALS:,} at most; the file is damaged, copy it again"
        )
    residual = np.full((info.residual_frames, info.wearers), np.nan)
    for message in messages:
        if len(message.pixels) != info.wearers or message.frame >= len(residual):
            raise FileFormatError(
                f"{path}: frame {message.frame} has {len(message.pixels)} reprojection errors: expected "
                f"{info.wearers}, in frames 0 to {len(residual) - 1}"
            )
        residual[message.frame] = message.pixels
    return residual
