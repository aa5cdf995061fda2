from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SceneEstimateInfo(_message.Message):
    __slots__ = ("name", "method", "wearer_topics", "wearer_of_detection", "findings", "settings", "start", "association", "finding_kinds")
    class SettingsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    WEARER_TOPICS_FIELD_NUMBER: _ClassVar[int]
    WEARER_OF_DETECTION_FIELD_NUMBER: _ClassVar[int]
    FINDINGS_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    ASSOCIATION_FIELD_NUMBER: _ClassVar[int]
    FINDING_KINDS_FIELD_NUMBER: _ClassVar[int]
    name: str
    method: str
    wearer_topics: _containers.RepeatedScalarFieldContainer[str]
    wearer_of_detection: _containers.RepeatedScalarFieldContainer[int]
    findings: _containers.RepeatedScalarFieldContainer[str]
    settings: _containers.ScalarMap[str, str]
    start: _timestamp_pb2.Timestamp
    association: _containers.RepeatedScalarFieldContainer[str]
    finding_kinds: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, name: _Optional[str] = ..., method: _Optional[str] = ..., wearer_topics: _Optional[_Iterable[str]] = ..., wearer_of_detection: _Optional[_Iterable[int]] = ..., findings: _Optional[_Iterable[str]] = ..., settings: _Optional[_Mapping[str, str]] = ..., start: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., association: _Optional[_Iterable[str]] = ..., finding_kinds: _Optional[_Iterable[str]] = ...) -> None: ...
