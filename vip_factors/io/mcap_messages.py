"""Between the package's objects and their protobuf messages (data_schemas): the parts that several files share."""

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from vip_factors.body.hinges import HingeEstimate
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import BodyEstimate, DetectorEstimate, PoseCovariance, SensorPlaceEstimate
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_reader import McapChannel, McapMessages, McapWarning
from vip_factors.io.mcap_writer import NS_PER_S, MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.body_estimate_pb2 import BodyEstimate as BodyEstimateMessage
from vip_factors.io.schemas.body_pose_pb2 import BodyPose, MotionInfo
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz, Vector3
from vip_factors.io.schemas.place_estimates_pb2 import DetectorEstimate as DetectorEstimateMessage
from vip_factors.io.schemas.place_estimates_pb2 import SensorPlaceEstimates
from vip_factors.io.schemas.subject_pb2 import Skeleton as SkeletonMessage
from vip_factors.sensors.calibration import Calibration, SensorCalibration

if TYPE_CHECKING:
    from google.protobuf.message import Message
    from google.protobuf.timestamp_pb2 import Timestamp

LATEST_NS = 2**63  # 2262: what a signed number of 64 bits holds
PACKAGE = "vip_factors."  # of our schemas
PROTOBUF = "protobuf"
M = TypeVar("M", bound="Message")


def vector_message(v: Array) -> Vector3:
    """A message of three numbers."""
    x, y, z = (float(value) for value in v)
    return Vector3(x=x, y=y, z=z)


def vector(message: Vector3) -> Array:
    """``(3,)`` of a message."""
    return np.array([message.x, message.y, message.z])


def rotation_message(R: Array) -> QuaternionWxyz:
    """A message of one rotation matrix."""
    w, x, y, z = quaternion_from_matrix(R, Order.WXYZ).tolist()
    return QuaternionWxyz(w=w, x=x, y=y, z=z)


def rotation(message: QuaternionWxyz) -> Array:
    """``(3, 3)`` of a message.

    Raises:
        InputError: if it is no unit quaternion.
    """
    return matrix_from_quaternion([message.w, message.x, message.y, message.z], Order.WXYZ)


def set_timestamp(message: "Timestamp", time_ns: int) -> None:
    """Write an absolute time into a message in place.

    Raises:
        InputError: for a time that no clock shows.
    """
    if not abs(time_ns) < LATEST_NS:
        raise InputError(f"a time of {time_ns / NS_PER_S:.4g} s since 1970: expected one before 2262")
    message.seconds, message.nanos = divmod(time_ns, NS_PER_S)


def time_ns_of(message: "Timestamp") -> int:
    """Absolute nanoseconds."""
    return message.seconds * NS_PER_S + message.nanos


def is_ours(channel: McapChannel, message_class: "type[Message] | None" = None) -> bool:
    """Whether a channel carries this message, or any of package ``vip_factors``."""
    name = message_class.DESCRIPTOR.full_name if message_class else None
    ours = channel.schema_name == name if name else channel.schema_name.startswith(PACKAGE)
    return ours and channel.encoding == channel.schema_encoding == PROTOBUF


def decode(path: Path, messages: McapMessages, message_class: type[M]) -> list[M]:
    """All messages of a channel.

    Raises:
        FileFormatError: if one does not decode, naming it.
    """
    from google.protobuf.message import DecodeError

    read: list[M] = []
    try:
        for data in messages.data:
            read.append(message_class.FromString(data))
    except DecodeError as error:
        raise FileFormatError(
            f"{path}: message {len(read)} of topic {messages.channel.topic} is not a "
            f"{message_class.DESCRIPTOR.full_name} ({error})"
        ) from error
    return read


def of_topic(path: Path, messages: Sequence[McapMessages], topic: str, message_class: type[M]) -> list[M]:
    """All messages of one kind on one topic; none if there is no such channel."""
    found = [one for one in messages if one.channel.topic == topic and is_ours(one.channel, message_class)]
    return [message for one in found for message in decode(path, one, message_class)]


def warn(path: Path, sentence: str) -> None:
    """Say what of a file was left out."""
    warnings.warn(McapWarning(f"{path}: {sentence}"), stacklevel=3)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file's name before the message of whatever is wrong with its contents."""
    try:
        yield
    except InputError as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"{path}: {error}") from error


def skeleton_message(skeleton: Skeleton) -> SkeletonMessage:
    """A skeleton with the names of its joints."""
    message = SkeletonMessage(source=skeleton.source)
    for joint, name in enumerate(JOINT_NAMES):
        parent = JOINT_NAMES[PARENTS[joint]] if PARENTS[joint] >= 0 else ""
        offset = vector_message(skeleton.p_parent_joint[joint])
        message.joints.add(name=name, parent=parent, p_parent_joint=offset)
    for name, landmark in skeleton.landmarks.items():
        point = vector_message(landmark.p_bone_point)
        message.landmarks.add(name=name, bone=JOINT_NAMES[landmark.bone], p_bone_point=point)
    return message


def skeleton_of(message: SkeletonMessage) -> Skeleton:
    """The skeleton of a message.

    Raises:
        FileFormatError: if a joint is missing.
    """
    offsets = {joint.name: vector(joint.p_parent_joint) for joint in message.joints}
    missing = [name for name in JOINT_NAMES if name not in offsets]
    if missing:
        raise FileFormatError(f"the skeleton lacks {', '.join(missing)}: expected all of {', '.join(JOINT_NAMES)}")
    landmarks = {one.name: Landmark(joint_index(one.bone), vector(one.p_bone_point)) for one in message.landmarks}
    return Skeleton(np.array([offsets[name] for name in JOINT_NAMES]), landmarks, message.source)


def calibration_message(calibration: Calibration) -> CalibrationEstimate:
    """Headings and mountings of all sensors."""
    message = CalibrationEstimate()
    for sensor, one in calibration.items():
        message.sensors.add(
            sensor=sensor,
            heading_rad=float(one.heading),
            mounting_wxyz=rotation_message(one.R_bone_sensor),
            heading_sigma_rad=float(one.heading_sigma),
            mounting_sigma_rad=vector_message(one.mounting_sigma),
            heading_time_s=one.heading_time,
            heading_path_rad=one.heading_path,
            bone=one.bone,
        )
    return message


def calibration_of(message: CalibrationEstimate) -> dict[str, SensorCalibration]:
    """Calibrations by sensor of a message."""
    return {
        one.sensor: SensorCalibration(
            one.heading_rad, rotation(one.mounting_wxyz), one.heading_sigma_rad, vector(one.mounting_sigma_rad),
            np.array(one.heading_time_s), np.array(one.heading_path_rad), one.bone,
        )
        for one in message.sensors
    }  # fmt: skip


def motion_message(motion: Motion) -> MotionInfo:
    """What all frames of a motion share."""
    return MotionInfo(
        name=motion.name,
        rate_hz=float(motion.rate),
        start_s=float(motion.start),
        frames=len(motion),
        skeleton=skeleton_message(motion.skeleton),
    )


def pose_messages(
    writer: MessageWriter,
    topic: str,
    motion: Motion,
    start_ns: int,
    covariance: PoseCovariance | None = None,
    first: int = 0,
) -> Iterator[TimedMessage]:
    """The frames of a motion, serialised, in the order of time; the first of them has the number ``first``."""
    channel = writer.channel(topic, BodyPose)
    wxyz = quaternion_from_matrix(motion.R_parent_child, Order.WXYZ).reshape(len(motion), 4 * JOINT_COUNT)
    for row, time_ns in enumerate(nanoseconds(motion.time, start_ns)):
        message = BodyPose(
            frame=first + row, joint_rotations_wxyz=wxyz[row], p_world_pelvis=vector_message(motion.p_world_pelvis[row])
        )
        set_timestamp(message.timestamp, time_ns)
        if covariance is not None:
            message.joint_covariance.extend(covariance.joints[row].ravel())
            message.root_covariance.extend(covariance.root[row].ravel())
        yield time_ns, channel, message.SerializeToString()


def motion_of(info: MotionInfo, poses: Sequence[BodyPose]) -> tuple[Motion, PoseCovariance | None]:
    """The motion of its messages, and its covariance if all frames have one; it ends before the first lost frame.

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
        skeleton_of(info.skeleton),
        matrix_from_quaternion(wxyz, Order.WXYZ),
        np.array(root, float).reshape(-1, 3),
        info.rate_hz,
        info.start_s,
        info.name,
    )
    if not poses or not all(one.joint_covariance and one.root_covariance for one in poses):
        return motion, None
    joints = _rows("joint covariances", [one.joint_covariance for one in poses], (JOINT_COUNT, 3, 3))
    return motion, PoseCovariance(joints, _rows("root covariances", [one.root_covariance for one in poses], (3, 3)))


def tell_lost_frames(path: Path, info: MotionInfo, motion: Motion) -> None:
    """Warn if a motion has fewer frames than were written."""
    if len(motion) < info.frames:
        warn(path, f"motion '{info.name}': {len(motion)} of {info.frames} frames are left")


def _rows(what: str, rows: Sequence[Any], shape: tuple[int, ...]) -> Array:
    size = int(np.prod(shape))
    for frame, row in enumerate(rows):
        if len(row) != size:
            raise FileFormatError(f"frame {frame} has {len(row)} numbers of {what}: expected {size}")
    return np.array(rows, float).reshape(len(rows), *shape)


def body_message(body: BodyEstimate) -> BodyEstimateMessage:
    """Lengths and hinges, with what was taken for likely beforehand."""
    return BodyEstimateMessage(
        lengths=body.names,
        prior_m=body.prior,
        found_m=body.found,
        prior_covariance_m2=body.prior_covariance.ravel(),
        covariance_m2=body.covariance.ravel(),
        hinges=hinge_messages(body.hinges),
        prior_hinges=hinge_messages(body.prior_hinges),
    )


def hinge_messages(hinges: Iterable[HingeEstimate]) -> list[BodyEstimateMessage.Hinge]:
    """Hinges one by one."""
    return [
        BodyEstimateMessage.Hinge(
            joint=one.joint,
            axis=vector_message(one.axis),
            tilt_sigma_rad=one.sigma,
            carrying_angle_rad=one.carrying_angle,
            carrying_sigma_rad=one.carrying_sigma,
            variables_rad=one.variables,
            covariance_rad2=one.covariance.ravel(),
        )
        for one in hinges
    ]


def body_of(message: BodyEstimateMessage) -> BodyEstimate:
    """The body of a message.

    Raises:
        FileFormatError: if it has not as many numbers as lengths.
        InputError: for a joint that is no hinge.
    """
    names = tuple(message.lengths)
    B = len(names)
    return BodyEstimate(
        names,
        _numbers("prior lengths", message.prior_m, (B,)),
        _numbers("lengths", message.found_m, (B,)),
        _numbers("the prior's covariance", message.prior_covariance_m2, (B, B)),
        _numbers("the lengths' covariance", message.covariance_m2, (B, B)),
        hinges_of(message.hinges),
        hinges_of(message.prior_hinges),
    )


def hinges_of(messages: Iterable[BodyEstimateMessage.Hinge]) -> tuple[HingeEstimate, ...]:
    """The hinges of messages.

    Raises:
        FileFormatError: if one has not as many covariances as variables.
        InputError: for a joint that is no hinge.
    """
    found = []
    for one in messages:
        count = len(one.variables_rad)
        covariance = _numbers(f"the covariance of {one.joint}", one.covariance_rad2, (count, count))
        found.append(HingeEstimate(one.joint, np.array(one.variables_rad, float), covariance))
    return tuple(found)


def _numbers(what: str, values: Sequence[float], shape: tuple[int, ...]) -> Array:
    if len(values) != int(np.prod(shape)):
        raise FileFormatError(f"the body has {len(values)} numbers of {what}: expected {int(np.prod(shape))}")
    return np.array(values, float).reshape(shape)


def sensor_places_message(places: Sequence[SensorPlaceEstimate]) -> SensorPlaceEstimates:
    """Of one wearer's sensors."""
    message = SensorPlaceEstimates()
    for one in places:
        message.sensors.add(
            sensor=one.sensor,
            bone=one.bone,
            prior_m=vector_message(one.prior),
            found_m=vector_message(one.found),
            prior_sigma_m=vector_message(one.prior_sigma),
            sigma_m=vector_message(one.sigma),
        )
    return message


def sensor_places_of(message: SensorPlaceEstimates) -> tuple[SensorPlaceEstimate, ...]:
    """The places of a message."""
    return tuple(
        SensorPlaceEstimate(
            one.sensor, one.bone, vector(one.prior_m), vector(one.found_m), vector(one.prior_sigma_m),
            vector(one.sigma_m),
        )
        for one in message.sensors
    )  # fmt: skip


def detector_message(detector: DetectorEstimate) -> DetectorEstimateMessage:
    """Where a detector puts its keypoints."""
    message = DetectorEstimateMessage()
    rows = zip(detector.keypoints, detector.prior, detector.found, detector.prior_sigma, detector.sigma, strict=True)
    for name, *vectors in rows:
        prior, found, prior_sigma, sigma = (vector_message(one) for one in vectors)
        message.keypoints.add(keypoint=name, prior_m=prior, found_m=found, prior_sigma_m=prior_sigma, sigma_m=sigma)
    return message


def detector_of(message: DetectorEstimateMessage) -> DetectorEstimate:
    """The detector of a message."""
    vectors = [
        [vector(each) for each in (one.prior_m, one.found_m, one.prior_sigma_m, one.sigma_m)]
        for one in message.keypoints
    ]
    prior, found, prior_sigma, sigma = np.array(vectors, float).reshape(-1, 4, 3).swapaxes(0, 1)
    return DetectorEstimate(tuple(one.keypoint for one in message.keypoints), prior, found, prior_sigma, sigma)
