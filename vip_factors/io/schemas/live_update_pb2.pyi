from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class LiveUpdate(_message.Message):
    __slots__ = ("timestamp", "frame", "update_s", "detection_of_wearer", "findings", "preliminary")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    UPDATE_S_FIELD_NUMBER: _ClassVar[int]
    DETECTION_OF_WEARER_FIELD_NUMBER: _ClassVar[int]
    FINDINGS_FIELD_NUMBER: _ClassVar[int]
    PRELIMINARY_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame: int
    update_s: float
    detection_of_wearer: _containers.RepeatedScalarFieldContainer[int]
    findings: _containers.RepeatedScalarFieldContainer[str]
    preliminary: bool
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., frame: _Optional[int] = ..., update_s: _Optional[float] = ..., detection_of_wearer: _Optional[_Iterable[int]] = ..., findings: _Optional[_Iterable[str]] = ..., preliminary: bool = ...) -> None: ...
