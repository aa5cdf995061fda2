from google.protobuf import timestamp_pb2 as _timestamp_pb2
from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ImuSample(_message.Message):
    __slots__ = ("timestamp", "seconds", "sensor", "specific_force", "orientation_wxyz", "angular_rate")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    SENSOR_FIELD_NUMBER: _ClassVar[int]
    SPECIFIC_FORCE_FIELD_NUMBER: _ClassVar[int]
    ORIENTATION_WXYZ_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_RATE_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    seconds: float
    sensor: str
    specific_force: _geometry_pb2.Vector3
    orientation_wxyz: _geometry_pb2.QuaternionWxyz
    angular_rate: _geometry_pb2.Vector3
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., seconds: _Optional[float] = ..., sensor: _Optional[str] = ..., specific_force: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., orientation_wxyz: _Optional[_Union[_geometry_pb2.QuaternionWxyz, _Mapping]] = ..., angular_rate: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ...) -> None: ...
