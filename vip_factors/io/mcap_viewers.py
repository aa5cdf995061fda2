"""A motion as Foxglove's own messages, so that viewers of MCAP files show a moving skeleton. Never read back.

The transforms of all joints move frame by frame; the bones are lines fixed to them, sent once. Rerun does not draw
such lines (0.41), so points along the bones are written for it as well.
"""

from collections.abc import Iterator
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import NS_PER_S
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage, nanoseconds

if TYPE_CHECKING:
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

WORLD = "world"
FLOAT32_BYTES = 4
SHOWN_HZ = 30.0  # enough for the eye; every shown frame takes about 2 kB compressed
MODEST_FRAMES = 20_000  # eleven minutes of shown frames, some 40 MB: beyond it only on request
POINTS_PER_BONE = 3
BONE_THICKNESS_M = 0.025
BONE_COLOUR = (0.95, 0.55, 0.15, 1.0)  # an orange that shows on Foxglove's dark and light grounds


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
