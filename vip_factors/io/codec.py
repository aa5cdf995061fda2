"""Declared conversions between dataclasses and Protobuf messages.

A :class:`Codec` assigns a type of messages to a class. A field holds the attribute of its name, with or without a
unit behind it, or the one that is declared. How a value is written follows from the type of its field (data_schemas):

=====================  ==========================================================
field                  attribute
=====================  ==========================================================
``Vector3``            ``(3,)`` array
``QuaternionWxyz``     ``(3, 3)`` rotation matrix
``Timestamp``          absolute time in nanoseconds
other message          object of the class of that message's codec; None if absent
                       and None is the attribute's default
repeated message       tuple of such objects
repeated text          tuple
repeated number        array, flattened row by row
map                    dictionary
optional number, text  None if absent
=====================  ==========================================================

What comes with every sample or frame is written by loops of its own (vip_factors.io.mcap_frames, mcap_camera).
"""

import dataclasses
import re
from collections.abc import Callable, Mapping
from math import prod
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.timestamp_pb2 import Timestamp

from vip_factors.body.anthropometry import LengthPrior
from vip_factors.body.joint_priors import HingeEstimate
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.estimate import BodyEstimate, DetectorEstimate, SensorPlaceEstimate, StartChoice
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.schemas import body_pose_pb2, estimate_info_pb2, subject_pb2
from vip_factors.io.schemas.calibration_estimate_pb2 import CalibrationEstimate
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz, Vector3
from vip_factors.io.schemas.sensor_placement_pb2 import SensorPlacement
from vip_factors.sensors.calibration import Calibration, Placement, SensorCalibration, SensorSite
from vip_factors.sensors.recording import Subject
from vip_factors.solve.levenberg_marquardt import Iteration, SolveReport

if TYPE_CHECKING:
    from google.protobuf.message import Message

NS_PER_S = 1_000_000_000
LATEST_NS = 2**63  # 2262: the largest signed number of 64 bits
UNIT = re.compile("_(m2?|rad2?|s|hz)$")  # at the end of a field's name
Convert = Callable[[Any], Any]
M = TypeVar("M", bound="Message")
T = TypeVar("T")


def vector_message(v: Array) -> Vector3:
    """A message of three numbers."""
    x, y, z = (float(value) for value in v)
    return Vector3(x=x, y=y, z=z)


def vector(message: Vector3) -> Array:
    """The three numbers ``(3,)`` of a message."""
    return np.array([message.x, message.y, message.z])


def _rotation_message(R: Array) -> QuaternionWxyz:
    w, x, y, z = quaternion_from_matrix(R, Order.WXYZ).tolist()
    return QuaternionWxyz(w=w, x=x, y=y, z=z)


def _rotation(message: QuaternionWxyz) -> Array:
    return matrix_from_quaternion([message.w, message.x, message.y, message.z], Order.WXYZ)


def set_timestamp(message: Timestamp, time_ns: int) -> None:
    """Write an absolute time into a message in place; one that no clock shows is refused (InputError)."""
    if not abs(time_ns) < LATEST_NS:
        raise InputError(f"a time of {time_ns / NS_PER_S:.4g} s since 1970: expected one before 2262")
    message.seconds, message.nanos = divmod(time_ns, NS_PER_S)


def time_ns_of(message: Timestamp) -> int:
    """The absolute time of a message in nanoseconds."""
    return message.seconds * NS_PER_S + message.nanos


def _timestamp(time_ns: int) -> Timestamp:
    message = Timestamp()
    set_timestamp(message, time_ns)
    return message


class Codec(Generic[M, T]):
    """Conversion between objects of one class and messages of one type.

    Attributes that the class does not have (fields of a message that only other programs read, or that belong to
    other objects) are arguments of :meth:`encode` or results of ``encode_hook``; they are not read back.

    Args:
        message: class of the messages.
        kind: class of the objects, a dataclass; for another class, ``decode_hook`` makes the arguments.
        names: attribute by field, where their names differ.
        encode_hook: makes further attributes from an object.
        shapes: of repeated numbers, an axis as long as each of these fields; one axis by default.
        decode_hook: makes the attributes from a message and the values that were read from it.
    """

    of_message: ClassVar[dict[str, "Codec[Any, Any]"]] = {}  # by full name; the codecs of nested messages

    def __init__(
        self,
        message: type[M],
        kind: type[T],
        names: Mapping[str, str] | None = None,
        *,
        encode_hook: Callable[[Any], dict[str, Any]] | None = None,
        shapes: Mapping[str, tuple[str, ...]] | None = None,
        decode_hook: Callable[[M, dict[str, Any]], dict[str, Any]] | None = None,
    ) -> None:
        self.message, self.kind, self._shapes = message, kind, shapes or {}
        self._encode_hook, self._decode_hook = encode_hook, decode_hook
        unknown = ({*(names or {})} | {*self._shapes}) - {field.name for field in message.DESCRIPTOR.fields}
        if unknown:
            raise TypeError(f"{message.DESCRIPTOR.name} has no {', '.join(sorted(unknown))}")
        declared = dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ()
        defaults = {attribute.name: attribute.default for attribute in declared if attribute.init}
        self._writers: list[tuple[str, str, Convert]] = []
        self._readers: list[tuple[str, str, Convert, bool]] = []  # and whether an absent field is None
        for field in message.DESCRIPTOR.fields:
            bare_name, nested = UNIT.sub("", field.name), field.message_type
            usual = bare_name if bare_name in defaults or hasattr(kind, bare_name) else field.name
            attribute = (names or {}).get(field.name, field.name if field.name in defaults else usual)
            write, read = _conversions(field)
            self._writers.append((field.name, attribute, write))
            if attribute in defaults and read is not None:
                is_optional = field.has_presence and (nested is None or defaults[attribute] is None)
                self._readers.append((field.name, attribute, read, is_optional))
        self.of_message.setdefault(message.DESCRIPTOR.full_name, self)

    def encode(self, value: Any, **attributes: Any) -> M:
        """The message of an object with such attributes; ``attributes`` complete or replace its own."""
        if self._encode_hook is not None:
            attributes = self._encode_hook(value) | attributes
        content = {}
        for name, attribute, write in self._writers:
            attribute_value = attributes[attribute] if attribute in attributes else getattr(value, attribute, None)
            if attribute_value is not None:
                content[name] = write(attribute_value)
        return self.message(**content)

    def values(self, message: M) -> dict[str, Any]:
        """The attributes of a message's object.

        Raises:
            FileFormatError: for another number of numbers than expected.
            InputError: for a rotation that is none.
        """
        values = dict[str, Any]()
        for name, attribute, read, is_optional in self._readers:
            is_absent = is_optional and not message.HasField(name)
            values[attribute] = None if is_absent else read(getattr(message, name))
            if name in self._shapes:
                values[attribute] = self._shaped(message, name, values[attribute])
        return values if self._decode_hook is None else self._decode_hook(message, values)

    def decode(self, message: M) -> T:
        """The object of a message; raises as :meth:`values` and the object's class."""
        return self.kind(**self.values(message))

    def _shaped(self, message: M, name: str, values: Array) -> Array:
        shape = tuple(len(getattr(message, axis)) for axis in self._shapes[name])
        if len(values) != prod(shape):
            raise FileFormatError(
                f"{self.message.DESCRIPTOR.name} has {len(values)} numbers of {name}: expected {prod(shape)}"
            )
        return values.reshape(shape)


_CONVERTERS: dict[str, tuple[Convert, Convert]] = {
    Vector3.DESCRIPTOR.full_name: (vector_message, vector),
    QuaternionWxyz.DESCRIPTOR.full_name: (_rotation_message, _rotation),
    Timestamp.DESCRIPTOR.full_name: (_timestamp, time_ns_of),
}
_INTEGERS = (
    FieldDescriptor.CPPTYPE_INT32,
    FieldDescriptor.CPPTYPE_INT64,
    FieldDescriptor.CPPTYPE_UINT32,
    FieldDescriptor.CPPTYPE_UINT64,
)


def _is_repeated(field: FieldDescriptor) -> bool:
    if hasattr(field, "is_repeated"):
        return bool(field.is_repeated)
    return bool(field.label == FieldDescriptor.LABEL_REPEATED)  # of Protobuf before 6.31


def _conversions(field: FieldDescriptor) -> tuple[Convert, Convert | None]:
    """From an attribute to an argument of the message's constructor, and from the field back (None: not read)."""
    is_repeated, nested = _is_repeated(field), field.message_type
    if nested is not None and nested.GetOptions().map_entry:
        return dict, dict
    if nested is not None:
        write, read = _CONVERTERS.get(nested.full_name) or _nested_conversions(nested.full_name)
        if not is_repeated:
            return write, read
        return lambda values: list(map(write, values)), read and (lambda messages: tuple(map(read, messages)))
    if is_repeated and field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
        return list, tuple
    if is_repeated:
        dtype = int if field.cpp_type in _INTEGERS else float
        return lambda values: np.asarray(values).ravel().tolist(), lambda values: np.array(values, dtype=dtype)
    kinds: dict[int, Convert] = {
        FieldDescriptor.CPPTYPE_DOUBLE: float,
        FieldDescriptor.CPPTYPE_FLOAT: float,
        FieldDescriptor.CPPTYPE_BOOL: bool,
    } | dict.fromkeys(_INTEGERS, int)
    return kinds.get(field.cpp_type, _unchanged), _unchanged


def _nested_conversions(name: str) -> tuple[Convert, Convert | None]:
    """Conversions by the codec of a nested message; a codec that is declared later is only written."""
    codec = Codec.of_message.get(name)
    return (
        lambda value: value if hasattr(value, "DESCRIPTOR") else Codec.of_message[name].encode(value),
        None if codec is None else codec.decode,
    )


def _unchanged(value: Any) -> Any:
    return value


def _joints_and_landmarks(skeleton: Skeleton) -> dict[str, Any]:
    joints = zip(JOINT_NAMES, PARENTS, map(vector_message, skeleton.p_parent_joint), strict=True)
    return {
        "joints": [
            subject_pb2.Skeleton.Joint(name=name, parent=JOINT_NAMES[parent] if parent >= 0 else "", p_parent_joint=p)
            for name, parent, p in joints
        ],
        "landmarks": [
            subject_pb2.Skeleton.Landmark(
                name=name, bone=JOINT_NAMES[landmark.bone], p_bone_point=vector_message(landmark.p_bone_point)
            )
            for name, landmark in skeleton.landmarks.items()
        ],
    }


def _skeleton(message: subject_pb2.Skeleton, read: dict[str, Any]) -> dict[str, Any]:
    offsets = {joint.name: vector(joint.p_parent_joint) for joint in message.joints}
    missing = [name for name in JOINT_NAMES if name not in offsets]
    if missing:
        raise FileFormatError(f"the skeleton lacks {', '.join(missing)}: expected all of {', '.join(JOINT_NAMES)}")
    landmarks = {
        landmark.name: Landmark(joint_index(landmark.bone), vector(landmark.p_bone_point))
        for landmark in message.landmarks
    }
    return read | {"p_parent_joint": np.array([offsets[name] for name in JOINT_NAMES]), "landmarks": landmarks}


def _subject(message: subject_pb2.Subject, read: dict[str, Any]) -> dict[str, Any]:
    skeleton = SKELETON.decode(message.skeleton) if message.skeleton_given else None
    return read | {"stature_m": message.stature_m or None, "skeleton": skeleton}  # absent is zero


SKELETON = Codec(subject_pb2.Skeleton, Skeleton, encode_hook=_joints_and_landmarks, decode_hook=_skeleton)
Codec(subject_pb2.LengthPrior, LengthPrior, {"lengths": "names"}, shapes={"covariance_m2": ("lengths", "lengths")})
Codec(
    subject_pb2.Hinge,
    HingeEstimate,
    {"tilt_sigma_rad": "sigma"},
    shapes={"covariance_rad2": ("variables_rad", "variables_rad")},
)
SUBJECT = Codec(
    subject_pb2.Subject,
    Subject,
    {"skeleton": "given_or_likely"},
    encode_hook=lambda subject: {"given_or_likely": subject.body(), "skeleton_given": subject.skeleton is not None},
    decode_hook=_subject,
)
Codec(SensorPlacement.Site, SensorSite, {"mounting_wxyz": "R_bone_sensor"})
PLACEMENT = Codec(SensorPlacement, Placement, {"preset": "name"})
Codec(
    estimate_info_pb2.BodyEstimate,
    BodyEstimate,
    {"lengths": "names", "found_m": "posterior"},
    shapes={
        "prior_m": ("lengths",),
        "found_m": ("lengths",),
        "prior_covariance_m2": ("lengths", "lengths"),
        "covariance_m2": ("lengths", "lengths"),
    },
)
_SENSOR = Codec(CalibrationEstimate.Sensor, SensorCalibration, {"mounting_wxyz": "R_bone_sensor"})
CALIBRATION = Codec[CalibrationEstimate, Calibration](
    CalibrationEstimate,
    dict,
    encode_hook=lambda sensors: {"sensors": [_SENSOR.encode(sensor, sensor=name) for name, sensor in sensors.items()]},
    decode_hook=lambda message, read: {sensor.sensor: _SENSOR.decode(sensor) for sensor in message.sensors},
)
"""Headings and mountings of all sensors."""
Codec(estimate_info_pb2.SolveReport.Iteration, Iteration)
Codec(estimate_info_pb2.SensorPlaceEstimate, SensorPlaceEstimate, {"found_m": "posterior"})
Codec(estimate_info_pb2.StartChoice, StartChoice)
MOTION = Codec(body_pose_pb2.MotionInfo, Motion, encode_hook=lambda motion: {"frames": len(motion)})
REPORT = Codec(estimate_info_pb2.SolveReport, SolveReport)

_PLACE = {"prior_m": "prior", "found_m": "posterior", "prior_sigma_m": "prior_sigma", "sigma_m": "sigma"}


def _keypoint_messages(detector: DetectorEstimate) -> dict[str, Any]:
    rows = []
    for row, name in enumerate(detector.keypoints):
        vectors = {field: vector_message(getattr(detector, attribute)[row]) for field, attribute in _PLACE.items()}
        rows.append(estimate_info_pb2.DetectorEstimate.Keypoint(keypoint=name, **vectors))
    return {"keypoints": rows}


def _keypoints(message: estimate_info_pb2.DetectorEstimate, read: dict[str, Any]) -> dict[str, Any]:
    rows = message.keypoints
    columns = {
        attribute: np.array([vector(getattr(row, field)) for row in rows]).reshape(-1, 3)
        for field, attribute in _PLACE.items()
    }
    return {"keypoints": tuple(row.keypoint for row in rows), **columns}


Codec(estimate_info_pb2.DetectorEstimate, DetectorEstimate, encode_hook=_keypoint_messages, decode_hook=_keypoints)
