"""A motion as Foxglove's own messages, so that viewers of MCAP files show a moving skeleton. Never read back.

The transforms of all joints move frame by frame; the bones are lines fixed to them, sent once.
"""

from collections.abc import Iterator
from math import ceil
from typing import TYPE_CHECKING, Any

from vip_factors.body.motion import Motion
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage, nanoseconds

if TYPE_CHECKING:
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

WORLD = "world"
SHOWN_HZ = 30.0  # enough for the eye; every frame's transforms take about 1 kB compressed
MODEST_FRAMES = 20_000  # eleven minutes of shown frames, some 20 MB: beyond it only on request
BONE_THICKNESS_M = 0.025
BONE_COLOUR = (0.95, 0.55, 0.15, 1.0)  # an orange that shows on Foxglove's dark and light grounds


def scene_wanted(scene: bool | None, motion: Motion) -> bool:
    """Whether to write the scene: as asked, or else if it is small and Foxglove's messages are installed.

    Raises:
        InputError: if it is asked for and they are not.
    """
    if scene is False or (scene is None and len(motion) / _step(motion) > MODEST_FRAMES):
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
    offsets = motion.skeleton.p_parent_joint
    ends = [(name, PARENTS[joint], offsets[joint]) for joint, name in enumerate(JOINT_NAMES) if PARENTS[joint] >= 0]
    ends += [(name, one.bone, one.p_bone_point) for name, one in motion.skeleton.landmarks.items()]
    for name, bone, p_bone_end in ends:
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
    step = _step(motion)
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


def _set_rotations(message: "FrameTransforms", rotations: list[list[float]], time_ns: int) -> None:
    seconds, nanos = divmod(time_ns, 1_000_000_000)
    for transform, xyzw in zip(message.transforms, rotations, strict=True):
        q = transform.rotation
        q.x, q.y, q.z, q.w = xyzw
        transform.timestamp.seconds, transform.timestamp.nanos = seconds, nanos


def _set(message: Any, xyz: Array) -> None:
    message.x, message.y, message.z = (float(value) for value in xyz)


def _frame(motion: Motion, joint: int) -> str:
    return f"{motion.name}/{JOINT_NAMES[joint]}"


def _step(motion: Motion) -> int:
    return max(1, ceil(motion.rate / SHOWN_HZ - 1e-9))
