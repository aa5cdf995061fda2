"""What an estimate or a truth has of every frame, to and from messages, quickly: poses, residuals.

A motion is there as Foxglove's own messages too, so that viewers of MCAP files show a moving skeleton; these are never
read back.

The transforms of all joints move frame by frame; the bones are lines fixed to them, sent once. Rerun does not draw
such lines (0.41), so points along the bones are written for it as well.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Skeleton
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import PoseCovariance
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import NS_PER_S, set_timestamp, vector_message
from vip_factors.io.mcap_messages import MOTION, warn
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.body_pose_pb2 import BodyPose, MotionInfo
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose, CameraResiduals
from vip_factors.io.schemas.estimate_info_pb2 import EstimateInfo
from vip_factors.io.schemas.residuals_pb2 import Residuals
from vip_factors.sensors.camera_path import CameraPath

if TYPE_CHECKING:
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

WORLD = "world"
FLOAT32_BYTES = 4
SHOWN_HZ = 30.0  # enough for the eye; every shown frame takes about 2 kB compressed
MODEST_FRAMES = 20_000  # eleven minutes of shown frames, some 40 MB: beyond it only on request
POINTS_PER_BONE = 3
BONE_THICKNESS_M = 0.025
BONE_COLOUR = (0.95, 0.55, 0.15, 1.0)  # an orange that shows on Foxglove's dark and light grounds
MOST_HELD = 120_000  # frames without a pose, an hour at 30 Hz: their poses and covariances take 0.4 GB of memory
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

    The last pose is held over gaps, of which a warning tells; before a gap that is too long for that the motion ends.

    Raises:
        FileFormatError: for frames of another skeleton.
    """
    poses = _held_over_gaps(path, info, poses)
    frames = len(poses)
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


def _held_over_gaps(path: Path, info: MotionInfo, poses: Sequence[BodyPose]) -> list[BodyPose]:
    """A pose for each frame from the first on: where a frame has none, the one before it."""
    held: list[BodyPose] = []
    missing = 0
    for read, pose in enumerate(poses):
        gap = pose.frame - len(held)
        if gap < 0 or (gap and not held) or missing + gap > MOST_HELD:
            lost = (
                f"its frames {len(held):,} to {pose.frame - 1:,} are missing: what follows, {len(poses) - read:,} poses"
            )
            warn(path, f"motion '{info.name}' ends after {len(held) / info.rate_hz:.2f} s: {lost}, is not read")
            break
        missing += gap
        held += [*held[-1:] * gap, pose]
    if missing:
        warn(path, f"motion '{info.name}': {missing:,} frames are missing: the last pose before them is held")
    return held


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
    writer: MessageWriter, topic: str, path: CameraPath, start_ns: int, covariance: Array | None = None, first: int = 0
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


def scene_wanted(scene: bool | None, motion: Motion, frames: int | None = None) -> bool:
    """Whether to write the scene: as asked, or else if it is small and Foxglove's messages are installed.

    Args:
        scene: whether it is asked for; None if nobody said.
        motion: that is to be shown.
        frames: that there will be; those of the motion if None.

    Raises:
        InputError: if it is asked for and they are not.
    """
    if scene is False or (
        scene is None and (len(motion) if frames is None else frames) / shown_step(motion) > MODEST_FRAMES
    ):
        return False
    try:
        import foxglove_schemas_protobuf  # noqa: F401
    except ImportError as error:
        if scene is None:
            return False
        raise InputError(
            "a scene for viewers needs Foxglove's messages: pip install foxglove-schemas-protobuf"
        ) from error
    return True


def skeleton_scene(motion: Motion) -> Any:
    """A ``foxglove.SceneUpdate`` with a line for every bone and landmark, each fixed to its joint's frame."""
    from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    scene = SceneUpdate()
    for name, bone, p_bone_end in _bone_ends(motion.skeleton):
        entity = scene.entities.add(id=f"{motion.name}/to_{name}", frame_id=_frame(motion, bone), frame_locked=True)
        line = entity.lines.add(type=LinePrimitive.LINE_LIST, thickness=BONE_THICKNESS_M, scale_invariant=False)
        line.pose.orientation.w = 1.0
        line.color.r, line.color.g, line.color.b, line.color.a = BONE_COLOUR
        line.points.add()
        _set(line.points.add(), p_bone_end)
    return scene


def transform_messages(writer: MessageWriter, topic: str, motion: Motion, start_ns: int) -> Iterator[TimedMessage]:
    """``foxglove.FrameTransforms`` of all joints, serialised, in the order of time, thinned to :data:`SHOWN_HZ`."""
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

    channel = writer.channel(topic, FrameTransforms)
    step = shown_step(motion)
    xyzw = quaternion_from_matrix(motion.R_parent_child[::step], Order.XYZW).tolist()
    times = nanoseconds(motion.time[::step], start_ns)
    message = FrameTransforms()
    for joint, parent in enumerate(PARENTS):
        transform = message.transforms.add(
            parent_frame_id=_frame(motion, parent) if parent >= 0 else WORLD, child_frame_id=_frame(motion, joint)
        )
        _set(transform.translation, motion.skeleton.p_parent_joint[joint])
    for time_ns, rotations, root in zip(times, xyzw, motion.p_world_pelvis[::step], strict=True):
        _set(message.transforms[0].translation, root)
        _set_rotations(message, rotations, time_ns)
        yield time_ns, channel, message.SerializeToString()


def point_messages(writer: MessageWriter, topic: str, motion: Motion, start_ns: int) -> Iterator[TimedMessage]:
    """``foxglove.PointCloud`` of points along all bones, serialised, in the order of time, thinned likewise."""
    from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
    from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

    message = PointCloud(frame_id=WORLD, point_stride=3 * FLOAT32_BYTES)
    message.pose.orientation.w = 1.0
    for axis, name in enumerate("xyz"):
        message.fields.add(name=name, offset=axis * FLOAT32_BYTES, type=PackedElementField.FLOAT32)
    shown = motion.frames(slice(None, None, shown_step(motion)))

    def messages() -> Iterator[PointCloud]:
        for points in _points(shown):
            message.data = points.astype("<f4").tobytes()
            yield message

    return writer.stamped(topic, PointCloud, nanoseconds(shown.time, start_ns), messages())


def _points(motion: Motion) -> Array:
    """World positions ``(T, points, 3)`` along all bones, in metres."""
    ends = _bone_ends(motion.skeleton)
    bones = [bone for _, bone, _ in ends]
    p_bone_end = np.array([end for _, _, end in ends])
    p_world_joint = motion.state.p_world_joint[:, bones]
    along = (motion.state.R_world_bone[:, bones] @ p_bone_end[..., None])[..., 0]
    shares = np.arange(1, POINTS_PER_BONE + 1) / POINTS_PER_BONE
    return np.concatenate([p_world_joint + share * along for share in shares], axis=1)


def _bone_ends(skeleton: Skeleton) -> list[tuple[str, int, Array]]:
    """Name, bone and position on the bone of the next joints and the landmarks: where the drawn bones end."""
    offsets = skeleton.p_parent_joint
    ends = [(name, PARENTS[joint], offsets[joint]) for joint, name in enumerate(JOINT_NAMES) if PARENTS[joint] >= 0]
    return ends + [(name, one.bone, one.p_bone_point) for name, one in skeleton.landmarks.items()]


def _set_rotations(message: "FrameTransforms", rotations: list[list[float]], time_ns: int) -> None:
    seconds, nanos = divmod(time_ns, NS_PER_S)
    for transform, xyzw in zip(message.transforms, rotations, strict=True):
        q = transform.rotation
        q.x, q.y, q.z, q.w = xyzw
        transform.timestamp.seconds, transform.timestamp.nanos = seconds, nanos


def _set(message: Any, xyz: Array) -> None:
    message.x, message.y, message.z = (float(value) for value in xyz)


def _frame(motion: Motion, joint: int) -> str:
    return f"{motion.name}/{JOINT_NAMES[joint]}"


def shown_step(motion: Motion) -> int:
    """Every so-manieth frame is shown."""
    return max(1, ceil(motion.rate / SHOWN_HZ - 1e-9))
