"""Which message stands for which class (data_schemas), and the messages of a file by topic."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from vip_factors.body.anthropometry import LengthPrior
from vip_factors.body.hinges import HingeEstimate
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import (
    BodyEstimate,
    DetectorEstimate,
    Iteration,
    SensorPlaceEstimate,
    SolveReport,
    StartChoice,
)
from vip_factors.io.codec import Codec, DataclassCodec, vector, vector_message
from vip_factors.io.mcap_reader import McapChannel, McapContents, McapMessages, McapWarning
from vip_factors.io.schemas.body_pose_pb2 import MotionInfo
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.estimate_info_pb2 import BodyEstimate as BodyEstimateMessage
from vip_factors.io.schemas.estimate_info_pb2 import DetectorEstimate as DetectorEstimateMessage
from vip_factors.io.schemas.estimate_info_pb2 import SensorPlaceEstimate as SensorPlaceMessage
from vip_factors.io.schemas.estimate_info_pb2 import SolveReport as SolveReportMessage
from vip_factors.io.schemas.estimate_info_pb2 import StartChoice as StartChoiceMessage
from vip_factors.io.schemas.sensor_placement_pb2 import SensorPlacement
from vip_factors.io.schemas.subject_pb2 import Hinge as HingeMessage
from vip_factors.io.schemas.subject_pb2 import LengthPrior as LengthPriorMessage
from vip_factors.io.schemas.subject_pb2 import Skeleton as SkeletonMessage
from vip_factors.io.schemas.subject_pb2 import Subject as SubjectMessage
from vip_factors.sensors.calibration import Calibration, Placement, SensorCalibration, SensorSite
from vip_factors.sensors.recording import Subject

if TYPE_CHECKING:
    from google.protobuf.message import Message

PACKAGE = "vip_factors."  # of our schemas
PROTOBUF = "protobuf"
M = TypeVar("M", bound="Message")
T = TypeVar("T")


def _joints_and_landmarks(skeleton: Skeleton) -> dict[str, Any]:
    joints = [
        SkeletonMessage.Joint(
            name=name, parent=JOINT_NAMES[parent] if parent >= 0 else "", p_parent_joint=vector_message(offset)
        )
        for name, parent, offset in zip(JOINT_NAMES, PARENTS, skeleton.p_parent_joint, strict=True)
    ]
    landmarks = [
        SkeletonMessage.Landmark(
            name=name, bone=JOINT_NAMES[landmark.bone], p_bone_point=vector_message(landmark.p_bone_point)
        )
        for name, landmark in skeleton.landmarks.items()
    ]
    return {"joints": joints, "landmarks": landmarks}


def _skeleton(message: SkeletonMessage, read: dict[str, Any]) -> dict[str, Any]:
    offsets = {joint.name: vector(joint.p_parent_joint) for joint in message.joints}
    missing = [name for name in JOINT_NAMES if name not in offsets]
    if missing:
        raise FileFormatError(f"the skeleton lacks {', '.join(missing)}: expected all of {', '.join(JOINT_NAMES)}")
    landmarks = {
        landmark.name: Landmark(joint_index(landmark.bone), vector(landmark.p_bone_point))
        for landmark in message.landmarks
    }
    return read | {"p_parent_joint": np.array([offsets[name] for name in JOINT_NAMES]), "landmarks": landmarks}


def _subject(message: SubjectMessage, read: dict[str, Any]) -> dict[str, Any]:
    skeleton = SKELETON.decode(message.skeleton) if message.skeleton_given else None
    return read | {"stature_m": message.stature_m or None, "skeleton": skeleton}  # absent is zero


SKELETON = DataclassCodec(SkeletonMessage, Skeleton, more=_joints_and_landmarks, mend=_skeleton)
LENGTH_PRIOR = DataclassCodec(
    LengthPriorMessage,
    LengthPrior,
    {"lengths": "names", "covariance_m2": "covariance"},
    shapes={"covariance_m2": ("lengths", "lengths")},
)
HINGE = DataclassCodec(
    HingeMessage,
    HingeEstimate,
    {
        "tilt_sigma_rad": "sigma",
        "carrying_angle_rad": "carrying_angle",
        "carrying_sigma_rad": "carrying_sigma",
        "variables_rad": "variables",
        "covariance_rad2": "covariance",
    },
    shapes={"covariance_rad2": ("variables_rad", "variables_rad")},
)
SUBJECT = DataclassCodec(
    SubjectMessage,
    Subject,
    {"skeleton": "given_or_likely"},
    more=lambda subject: {"given_or_likely": subject.body(), "skeleton_given": subject.skeleton is not None},
    mend=_subject,
)
SITE = DataclassCodec(
    SensorPlacement.Site, SensorSite, {"mounting_wxyz": "R_bone_sensor", "mounting_sigma_rad": "mounting_sigma"}
)
PLACEMENT = DataclassCodec(SensorPlacement, Placement, {"preset": "name"})
BODY = DataclassCodec(
    BodyEstimateMessage,
    BodyEstimate,
    {
        "lengths": "names",
        "prior_m": "prior",
        "found_m": "posterior",
        "prior_covariance_m2": "prior_covariance",
        "covariance_m2": "covariance",
    },
    shapes={
        "prior_m": ("lengths",),
        "found_m": ("lengths",),
        "prior_covariance_m2": ("lengths", "lengths"),
        "covariance_m2": ("lengths", "lengths"),
    },
)
SENSOR_CALIBRATION = DataclassCodec(
    CalibrationEstimate.Sensor,
    SensorCalibration,
    {
        "heading_rad": "heading",
        "mounting_wxyz": "R_bone_sensor",
        "heading_sigma_rad": "heading_sigma",
        "mounting_sigma_rad": "mounting_sigma",
        "heading_time_s": "heading_time",
        "heading_path_rad": "heading_path",
    },
)
ITERATION = DataclassCodec(SolveReportMessage.Iteration, Iteration)
_PLACE = {"prior_m": "prior", "found_m": "posterior", "prior_sigma_m": "prior_sigma", "sigma_m": "sigma"}
SENSOR_PLACE = DataclassCodec(SensorPlaceMessage, SensorPlaceEstimate, _PLACE)
START_CHOICE = DataclassCodec(StartChoiceMessage, StartChoice)
MOTION = DataclassCodec(
    MotionInfo, Motion, {"rate_hz": "rate", "start_s": "start"}, more=lambda motion: {"frames": len(motion)}
)


REPORT = DataclassCodec(SolveReportMessage, SolveReport)
"""How one solve went."""


def _keypoint_messages(detector: DetectorEstimate) -> dict[str, Any]:
    rows = []
    for row, name in enumerate(detector.keypoints):
        vectors = {field: vector_message(getattr(detector, attribute)[row]) for field, attribute in _PLACE.items()}
        rows.append(DetectorEstimateMessage.Keypoint(keypoint=name, **vectors))
    return {"keypoints": rows}


def _keypoints(message: DetectorEstimateMessage, read: dict[str, Any]) -> dict[str, Any]:
    rows = message.keypoints
    columns = {
        attribute: np.array([vector(getattr(row, field)) for row in rows]).reshape(-1, 3)
        for field, attribute in _PLACE.items()
    }
    return {"keypoints": tuple(row.keypoint for row in rows), **columns}


CALIBRATION: Codec[CalibrationEstimate, Calibration] = Codec(
    CalibrationEstimate,
    lambda calibration: CalibrationEstimate(
        sensors=[SENSOR_CALIBRATION.encode(sensor, sensor=name) for name, sensor in calibration.items()]
    ),
    lambda message: {sensor.sensor: SENSOR_CALIBRATION.decode(sensor) for sensor in message.sensors},
)
"""Headings and mountings of all sensors."""
DETECTOR = DataclassCodec(DetectorEstimateMessage, DetectorEstimate, more=_keypoint_messages, mend=_keypoints)
"""Where a detector puts its keypoints."""


def is_ours(channel: McapChannel, message_class: "type[Message] | None" = None) -> bool:
    """Whether a channel carries this message, or any of package ``vip_factors``."""
    name = message_class.DESCRIPTOR.full_name if message_class else None
    is_of_schema = channel.schema_name == name if name else channel.schema_name.startswith(PACKAGE)
    return is_of_schema and channel.encoding == channel.schema_encoding == PROTOBUF


def parsed(path: Path, messages: McapMessages, message_class: type[M]) -> list[M]:
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


class Topics:
    """The messages of a file by topic.

    Args:
        contents: of the file.
        prefix: what every topic that is asked for begins with.
    """

    def __init__(self, contents: McapContents, prefix: str = "") -> None:
        self.contents, self.path, self._prefix = contents, contents.path, prefix
        self._channels = dict[str, list[McapMessages]]()
        for messages in contents.messages.values():
            self._channels.setdefault(messages.channel.topic, []).append(messages)

    def channels(self, topic: str, message_class: "type[Message]") -> list[McapMessages]:
        """The channels of a topic that carry these messages: one, unless several programs wrote the file."""
        channels = self._channels.get(self._prefix + topic, ())
        return [messages for messages in channels if is_ours(messages.channel, message_class)]

    def all(self, topic: str, message_class: type[M]) -> list[M]:
        """All messages of one kind on one topic; none if there is no such channel.

        Raises:
            FileFormatError: if one does not decode.
        """
        channels = self.channels(topic, message_class)
        return [message for messages in channels for message in parsed(self.path, messages, message_class)]

    def last(self, topic: str, message_class: type[M]) -> M | None:
        """The last of them: of what comes several times the last one counts."""
        messages = self.all(topic, message_class)
        return messages[-1] if messages else None

    def objects(self, topic: str, codec: Codec[Any, T]) -> tuple[T, ...]:
        """The objects of all messages of one kind on one topic.

        Raises:
            FileFormatError, InputError: for what no such object can be.
        """
        return tuple(codec.decode(message) for message in self.all(topic, codec.message))

    def object(self, topic: str, codec: Codec[Any, T]) -> T | None:
        """The object of the last of them; raises likewise."""
        message = self.last(topic, codec.message)
        return None if message is None else codec.decode(message)


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
