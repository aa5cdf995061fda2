"""Messages of every sample or frame, written and read fast: samples of IMUs, poses, residuals.

Viewers of MCAP files show a motion by Foxglove's transforms of all joints, which are not read back.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import ceil
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS
from vip_factors.errors import FileFormatError
from vip_factors.estimate import PoseCovariance
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import MOTION, NS_PER_S, set_timestamp, time_ns_of, vector_message
from vip_factors.io.mcap_messages import MessageWriter, TimedMessage, nanoseconds, parsed, warn
from vip_factors.io.mcap_reader import McapMessages
from vip_factors.io.schemas.body_pose_pb2 import BodyPose, MotionInfo
from vip_factors.io.schemas.camera_estimate_pb2 import CameraEstimateInfo, CameraPose
from vip_factors.io.schemas.estimate_info_pb2 import Residuals
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.imu_stream import ImuStream, rotations_of

WORLD = "world"
SHOWN_HZ = 30.0  # enough for the eye; every shown frame takes about 2 kB compressed
MODEST_FRAMES = 20_000  # eleven minutes of shown frames, some 40 MB: of longer ones there are none
MOST_HELD = 120_000  # frames without a pose, an hour at 30 Hz: their poses and covariances take 0.4 GB of memory
REPROJECTION = "reprojection_px"  # the kind of a camera's residuals


def sample_messages(writer: MessageWriter, topic: str, stream: ImuStream) -> Iterator[TimedMessage]:
    """The samples of a stream, serialised, in the order of time."""
    R = stream.R_inertial_sensor
    wxyz = None if R is None else quaternion_from_matrix(R, Order.WXYZ)
    measurements = [
        [None] * len(stream) if values is None else values.tolist()
        for values in (stream.specific_force, wxyz, stream.angular_rate)
    ]

    def samples() -> Iterator[ImuSample]:
        message = ImuSample(sensor=stream.name)
        for message.seconds, *measured in zip(stream.time.tolist(), *measurements, strict=True):
            fill_sample(message, *measured)
            yield message

    return writer.stamped(topic, ImuSample, stream.time, samples())


def fill_sample(
    message: ImuSample, force: list[float] | None, wxyz: list[float] | None, rate: list[float] | None = None
) -> None:
    """Fill a message with measurements; None is left out."""
    for values, vector in ((force, message.specific_force), (rate, message.angular_rate)):
        if values is not None:
            vector.x, vector.y, vector.z = values
            vector.SetInParent()  # present even if all zero
    if wxyz is not None:
        turn = message.orientation_wxyz
        turn.w, turn.x, turn.y, turn.z = wxyz


def read_streams(path: Path, channels: Sequence[McapMessages], start_ns: int) -> dict[str, ImuStream]:
    """The streams of all channels of samples, by sensor."""
    streams: dict[str, ImuStream] = {}
    for messages in channels:
        samples = parsed(path, messages, ImuSample)
        if not samples:
            continue
        name = samples[0].sensor or messages.channel.topic.rpartition("/")[2]
        if name in streams or any(sample.sensor not in ("", name) for sample in samples):
            raise FileFormatError(
                f"{path}: sensor '{name}' and topic {messages.channel.topic}: expected one topic per sensor and one "
                "sensor per topic"
            )
        streams[name] = _stream(path, name, samples, start_ns)
    return streams


def _stream(path: Path, name: str, samples: Sequence[ImuSample], start_ns: int) -> ImuStream:
    time = np.array([sample_time(sample, start_ns) for sample in samples])
    order = np.argsort(time, kind="stable")  # other writers may log out of order
    samples = [samples[row] for row in order]
    force, rate = (_measured(samples, field, "xyz") for field in ("specific_force", "angular_rate"))
    wxyz = _measured(samples, "orientation_wxyz", "wxyz")
    stream = ImuStream.from_samples(name, time[order], force, None if wxyz is None else rotations_of(wxyz), rate)
    if len(stream) < len(samples):
        warn(path, f"sensor '{name}': {len(samples) - len(stream)} incomplete samples are left out")
    return stream


def sample_time(sample: ImuSample, start_ns: int) -> float:
    """Seconds from the recording's start."""
    return sample.seconds if sample.HasField("seconds") else (time_ns_of(sample.timestamp) - start_ns) / NS_PER_S


def _measured(samples: Sequence[ImuSample], field: str, axes: str) -> Array | None:
    """``(N, axes)``, NaN where a message lacks the field; None where all lack it."""
    present = np.array([sample.HasField(field) for sample in samples])
    if not present.any():
        return None
    values = columns(samples, field, axes)
    values[~present] = np.nan
    return values


def columns(messages: Iterable[Any], field: str, axes: str) -> Array:
    """``(N, axes)``: the numbers of a field of each message, zero where it lacks the field."""
    numbers = attrgetter(*(f"{field}.{axis}" for axis in axes))
    return np.array([numbers(message) for message in messages], float).reshape(-1, len(axes))


def pose_messages(
    writer: MessageWriter,
    topic: str,
    motion: Motion,
    covariance: PoseCovariance | None = None,
    first_frame: int = 0,
) -> Iterator[TimedMessage]:
    """The frames of a motion, serialised, in the order of time, numbered from ``first_frame``."""
    wxyz = quaternion_from_matrix(motion.R_parent_child, Order.WXYZ).reshape(len(motion), 4 * JOINT_COUNT)
    messages = (
        BodyPose(
            frame=first_frame + row,
            joint_rotations_wxyz=wxyz[row],
            p_world_pelvis=vector_message(p_world_pelvis),
            joint_covariance=() if covariance is None else covariance.joints[row].ravel(),
            root_covariance=() if covariance is None else covariance.root[row].ravel(),
        )
        for row, p_world_pelvis in enumerate(motion.p_world_pelvis)
    )
    return writer.stamped(topic, BodyPose, motion.time, messages)


def motion_of(path: Path, info: MotionInfo, poses: Sequence[BodyPose]) -> tuple[Motion, PoseCovariance | None]:
    """The motion of its messages, and its covariance if all frames have one.

    The last pose is held over gaps, with a warning; before a longer gap the motion ends.
    """
    poses = _held_over_gaps(path, info, poses)
    frames = len(poses)
    wxyz = _rows("joint rotations", [pose.joint_rotations_wxyz for pose in poses], (JOINT_COUNT, 4))
    motion = Motion(
        R_parent_child=matrix_from_quaternion(wxyz, Order.WXYZ),
        p_world_pelvis=columns(poses, "p_world_pelvis", "xyz"),
        **MOTION.values(info),
    )
    if frames < info.frames:
        warn(path, f"motion '{info.name}': {frames} of {info.frames} frames are left")
    if not poses or not all(pose.joint_covariance and pose.root_covariance for pose in poses):
        return motion, None
    joints = _rows("joint covariances", [pose.joint_covariance for pose in poses], (JOINT_COUNT, 3, 3))
    return motion, PoseCovariance(joints, _rows("root covariances", [pose.root_covariance for pose in poses], (3, 3)))


def _held_over_gaps(path: Path, info: MotionInfo, poses: Sequence[BodyPose]) -> list[BodyPose]:
    """A pose for each frame from the first on: where a frame has none, the one before it."""
    filled: list[BodyPose] = []
    missing = 0
    for read, pose in enumerate(poses):
        gap = pose.frame - len(filled)
        if gap < 0 or (gap and not filled) or missing + gap > MOST_HELD:
            lost = f"its frames {len(filled):,} to {pose.frame - 1:,} are missing"
            ends = f"motion '{info.name}' ends after {len(filled) / info.rate_hz:.2f} s: {lost}"
            warn(path, f"{ends}: what follows, {len(poses) - read:,} poses, is not read")
            break
        missing += gap
        filled += [*filled[-1:] * gap, pose]
    if missing:
        warn(path, f"motion '{info.name}': {missing:,} frames are missing: the last pose before them is held")
    return filled


def _rows(quantity: str, rows: Sequence[Any], shape: tuple[int, ...]) -> Array:
    size = int(np.prod(shape))
    for frame, row in enumerate(rows):
        if len(row) != size:
            raise FileFormatError(f"frame {frame} has {len(row)} numbers of {quantity}: expected {size}")
    return np.array(rows, float).reshape(len(rows), *shape)


def residual_messages(
    writer: MessageWriter, topic: str, time: Array, residuals: Mapping[str, Array], first_frame: int = 0
) -> Iterator[TimedMessage]:
    """The residuals of frames at ``time`` ``(T,)`` s, serialised, numbered from ``first_frame``."""
    messages = (
        Residuals(
            frame=first_frame + row,
            kinds=[Residuals.Kind(name=kind, values=values[row]) for kind, values in residuals.items()],
        )
        for row in range(len(time))
    )
    return writer.stamped(topic, Residuals, time, messages)


def camera_pose_messages(
    writer: MessageWriter, topic: str, path: CameraPath, covariance: Array | None = None, first_frame: int = 0
) -> Iterator[TimedMessage]:
    """The poses of a camera, serialised, in the order of time, numbered from ``first_frame``."""
    messages = camera_poses(path, writer.start_ns, covariance, first_frame)
    return writer.stamped(topic, CameraPose, path.time, messages)


def camera_poses(
    path: CameraPath, start_ns: int, covariance: Array | None = None, first_frame: int = 0
) -> Iterator[CameraPose]:
    """The messages of the poses of a camera."""
    turns = quaternion_from_matrix(path.R_world_camera, Order.WXYZ).tolist()
    for row, (time_ns, seconds) in enumerate(zip(nanoseconds(path.time, start_ns), path.time.tolist(), strict=True)):
        message = CameraPose(
            frame=first_frame + row,
            seconds=seconds,
            rotation_wxyz=dict(zip("wxyz", turns[row], strict=True)),
            p_world_camera=vector_message(path.p_world_camera[row]),
            covariance=covariance[row].ravel() if covariance is not None else (),
        )
        set_timestamp(message.timestamp, time_ns)
        yield message


def residuals_of(kinds: Iterable[str], columns: int, messages: Sequence[Residuals], frames: int) -> dict[str, Array]:
    """Residuals ``(frames, columns)`` by kind; NaN where a frame's message is lost."""
    residuals = {kind: np.full((frames, columns), np.nan) for kind in kinds}
    for message in messages:
        for kind in message.kinds:
            if kind.name not in residuals or len(kind.values) != columns:
                raise FileFormatError(
                    f"frame {message.frame} has {len(kind.values)} residuals '{kind.name}': expected {columns}, of "
                    f"{', '.join(residuals) or 'no kind'}"
                )
            if message.frame < frames:
                residuals[kind.name][message.frame] = kind.values
    return residuals


def camera_path_of(poses: Sequence[CameraPose]) -> CameraPath:
    """The path of poses, one at least."""
    R_world_camera = matrix_from_quaternion(columns(poses, "rotation_wxyz", "wxyz"), Order.WXYZ)
    time = np.array([pose.seconds for pose in poses])
    return CameraPath(time, R_world_camera, columns(poses, "p_world_camera", "xyz"))


def camera_residuals_of(path: Path, info: CameraEstimateInfo, messages: Sequence[Residuals]) -> Array | None:
    """``(T, wearers)``; NaN where a frame's message is lost."""
    if not info.has_residuals:
        return None
    largest_size = 20_000_000  # nine hours at 60 Hz, ten wearers
    if info.residual_frames * info.wearers > largest_size:
        raise FileFormatError(
            f"{path}: reprojection errors in {info.residual_frames} frames of {info.wearers} wearers: expected "
            f"{largest_size:,} at most; the file is damaged, copy it again"
        )
    return residuals_of((REPROJECTION,), info.wearers, messages, info.residual_frames)[REPROJECTION]


def transform_messages(writer: MessageWriter, topic: str, motion: Motion) -> Iterator[TimedMessage]:
    """``foxglove.FrameTransforms`` of all joints, serialised, in the order of time, thinned to :data:`SHOWN_HZ`."""
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

    channel = writer.channel(topic, FrameTransforms)
    step = shown_step(motion)
    xyzw = quaternion_from_matrix(motion.R_parent_child[::step], Order.XYZW).tolist()
    times = nanoseconds(motion.time[::step], writer.start_ns)
    message = FrameTransforms()
    frames = [f"{motion.name}/{joint}" for joint in JOINT_NAMES]
    for joint, (parent, p) in enumerate(zip(PARENTS, motion.skeleton.p_parent_joint.tolist(), strict=True)):
        parent_frame = frames[parent] if parent >= 0 else WORLD
        transform = message.transforms.add(parent_frame_id=parent_frame, child_frame_id=frames[joint])
        transform.translation.x, transform.translation.y, transform.translation.z = p
    root = message.transforms[0].translation
    for time_ns, rotations, p in zip(times, xyzw, motion.p_world_pelvis[::step].tolist(), strict=True):
        root.x, root.y, root.z = p
        seconds, nanos = divmod(time_ns, NS_PER_S)
        for transform, turn in zip(message.transforms, rotations, strict=True):
            q = transform.rotation
            q.x, q.y, q.z, q.w = turn
            transform.timestamp.seconds, transform.timestamp.nanos = seconds, nanos
        yield time_ns, channel, message.SerializeToString()


def shown_step(motion: Motion) -> int:
    """Step between the frames for viewers."""
    return max(1, ceil(motion.rate / SHOWN_HZ - 1e-9))
