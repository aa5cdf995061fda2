"""Dataclasses to Protobuf messages and back, declared instead of written out field by field.

A :class:`DataclassCodec` says which message stands for which class, and which attribute each field holds where the
names differ. How a value is written follows from the type of its field (data_schemas):

=====================  ==========================================================
field                  attribute
=====================  ==========================================================
``Vector3``            ``(3,)`` array
``QuaternionWxyz``     ``(3, 3)`` rotation matrix
``Timestamp``          absolute time in nanoseconds
other message          object of the class of that message's codec; None if absent
                       and None is what the attribute usually is
repeated message       tuple of such objects
repeated text          tuple
repeated number        array, flattened row by row
map                    dictionary
optional number, text  None if absent
=====================  ==========================================================

What comes with every sample or frame is written by loops of its own (vip_factors.io.mcap_samples, mcap_frames).
"""

import dataclasses
from collections.abc import Callable, Mapping
from math import prod
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.timestamp_pb2 import Timestamp

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz, Vector3

if TYPE_CHECKING:
    from google.protobuf.message import Message

NS_PER_S = 1_000_000_000
LATEST_NS = 2**63  # 2262: what a signed number of 64 bits holds
M = TypeVar("M", bound="Message")
T = TypeVar("T")


def vector_message(v: Array) -> Vector3:
    """A message of three numbers."""
    x, y, z = (float(value) for value in v)
    return Vector3(x=x, y=y, z=z)


def vector(message: Vector3) -> Array:
    """The three numbers ``(3,)`` of a message."""
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


def set_timestamp(message: Timestamp, time_ns: int) -> None:
    """Write an absolute time into a message in place.

    Raises:
        InputError: for a time that no clock shows.
    """
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
    """Objects as messages of one type and back, by two functions."""

    def __init__(self, message: type[M], encode: Callable[[T], M], decode: Callable[[M], T]) -> None:
        self.message, self._encode, self._decode = message, encode, decode

    def encode(self, value: T) -> M:
        """The message of an object."""
        return self._encode(value)

    def decode(self, message: M) -> T:
        """The object of a message.

        Raises:
            FileFormatError, InputError: for what no such object can be.
        """
        return self._decode(message)


class DataclassCodec(Codec[M, T]):
    """How objects of one class are written as messages of one type, and read back.

    Attributes that the class has not got (fields of a message that only other programs read, or that belong to
    something else) are given to :meth:`encode`, or made by ``more``; they are not read back.

    Args:
        message: class of the messages.
        kind: class of the objects, a dataclass.
        names: attribute by field, where it is not of the field's name.
        more: further attributes of an object, where they are no attributes of it or differ from what is written.
        shapes: of repeated numbers, an axis as long as each of these fields; without it one axis.
        mend: what was read, and its message, to the attributes; where it is not as it was written.
    """

    of_message: "dict[str, DataclassCodec[Any, Any]]" = {}  # noqa: RUF012 — by full name; the codecs of nested messages

    def __init__(
        self,
        message: type[M],
        kind: type[T],
        names: Mapping[str, str] | None = None,
        *,
        more: Callable[[Any], dict[str, Any]] | None = None,
        shapes: Mapping[str, tuple[str, ...]] | None = None,
        mend: Callable[[M, dict[str, Any]], dict[str, Any]] | None = None,
    ) -> None:
        self.message, self.kind, self._more, self._mend, self._shapes = message, kind, more, mend, shapes or {}
        unknown = ({*(names or {})} | {*self._shapes}) - {field.name for field in message.DESCRIPTOR.fields}
        if unknown:
            raise TypeError(f"{message.DESCRIPTOR.name} has no {', '.join(sorted(unknown))}")
        readable = {one.name: one.default for one in dataclasses.fields(kind) if one.init}  # type: ignore[arg-type]
        self._fields: list[tuple[str, str, Callable[[Any], Any]]] = []
        self._read: list[tuple[str, str, Callable[[M, str], Any]]] = []
        for field in message.DESCRIPTOR.fields:
            attribute = (names or {}).get(field.name, field.name)
            self._fields.append((field.name, attribute, _writer(field)))
            read = self._reader(field, readable[attribute] is None) if attribute in readable else None
            if read is not None:
                self._read.append((field.name, attribute, read))
        self.of_message.setdefault(message.DESCRIPTOR.full_name, self)

    def encode(self, value: Any, **given: Any) -> M:
        """The message of an object.

        Args:
            value: the object, or any other that has the attributes.
            given: attributes that it has not got, or which are to be written instead of its own.
        """
        if self._more is not None:
            given = self._more(value) | given
        content = {}
        for name, attribute, write in self._fields:
            one = given[attribute] if attribute in given else getattr(value, attribute, None)
            if one is not None:
                content[name] = write(one)
        return self.message(**content)

    def values(self, message: M) -> dict[str, Any]:
        """What a message says of an object, by attribute.

        Raises:
            FileFormatError: for another number of numbers than expected.
            InputError: for a rotation that is none.
        """
        read = {attribute: value(message, name) for name, attribute, value in self._read}
        return read if self._mend is None else self._mend(message, read)

    def decode(self, message: M) -> T:
        """The object of a message; raises as :meth:`values`, and for what no such object can be."""
        return self.kind(**self.values(message))

    def _reader(self, field: FieldDescriptor, may_be_absent: bool) -> Callable[[M, str], Any] | None:
        """From a message and the name of the field to the attribute; None if its message has no codec."""
        shape = self._shapes.get(field.name)
        if shape is not None:
            return lambda message, name: self._array(message, name, shape)
        many, nested = _repeated(field), field.message_type
        if nested is not None and nested.GetOptions().map_entry:
            return lambda message, name: dict(getattr(message, name))
        if nested is not None:
            known = _CONVERTERS.get(nested.full_name)
            if known is not None and not many:
                return lambda message, name: known[1](getattr(message, name))
            if nested.full_name not in self.of_message:
                return None
            one = self.of_message[nested.full_name].decode
            if many:
                return lambda message, name: tuple(one(each) for each in getattr(message, name))
            if may_be_absent:
                return lambda message, name: one(getattr(message, name)) if message.HasField(name) else None
            return lambda message, name: one(getattr(message, name))
        if many and field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
            return lambda message, name: tuple(getattr(message, name))
        if many:
            dtype = int if field.cpp_type in _INTEGERS else float
            return lambda message, name: np.array(getattr(message, name), dtype=dtype)
        if field.has_presence:
            return lambda message, name: getattr(message, name) if message.HasField(name) else None
        return getattr

    def _array(self, message: M, name: str, axes: tuple[str, ...]) -> Array:
        shape = tuple(len(getattr(message, axis)) for axis in axes)
        values = getattr(message, name)
        if len(values) != prod(shape):
            raise FileFormatError(
                f"{self.message.DESCRIPTOR.name} has {len(values)} numbers of {name}: expected {prod(shape)}"
            )
        return np.array(values, float).reshape(shape)


_CONVERTERS: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    Vector3.DESCRIPTOR.full_name: (vector_message, vector),
    QuaternionWxyz.DESCRIPTOR.full_name: (rotation_message, rotation),
    Timestamp.DESCRIPTOR.full_name: (_timestamp, time_ns_of),
}
_INTEGERS = (
    FieldDescriptor.CPPTYPE_INT32,
    FieldDescriptor.CPPTYPE_INT64,
    FieldDescriptor.CPPTYPE_UINT32,
    FieldDescriptor.CPPTYPE_UINT64,
)


def _repeated(field: FieldDescriptor) -> bool:
    if hasattr(field, "is_repeated"):
        return bool(field.is_repeated)
    return bool(field.label == FieldDescriptor.LABEL_REPEATED)  # of Protobuf before 6.31


def _writer(field: FieldDescriptor) -> Callable[[Any], Any]:
    """From an attribute's value to what the constructor of the message takes."""
    many, nested = _repeated(field), field.message_type
    if nested is not None and nested.GetOptions().map_entry:
        return dict
    if nested is not None:
        known = _CONVERTERS.get(nested.full_name)
        if known is not None:
            return known[0]
        codecs, name = DataclassCodec.of_message, nested.full_name

        def one(value: Any) -> Any:
            return value if hasattr(value, "DESCRIPTOR") else codecs[name].encode(value)

        return (lambda values: [one(each) for each in values]) if many else one
    if many and field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
        return list
    if many:
        return lambda values: np.asarray(values).ravel().tolist()
    if field.cpp_type in (FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_FLOAT):
        return float
    if field.cpp_type == FieldDescriptor.CPPTYPE_BOOL:
        return bool
    return int if field.cpp_type in _INTEGERS else lambda value: value
