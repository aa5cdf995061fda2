from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class EstimateInfo(_message.Message):
    __slots__ = ("name", "method", "sensors", "settings", "start", "residual_kinds", "findings", "start_choice", "finding_kinds")
    class SettingsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    SENSORS_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_KINDS_FIELD_NUMBER: _ClassVar[int]
    FINDINGS_FIELD_NUMBER: _ClassVar[int]
    START_CHOICE_FIELD_NUMBER: _ClassVar[int]
    FINDING_KINDS_FIELD_NUMBER: _ClassVar[int]
    name: str
    method: str
    sensors: _containers.RepeatedScalarFieldContainer[str]
    settings: _containers.ScalarMap[str, str]
    start: _timestamp_pb2.Timestamp
    residual_kinds: _containers.RepeatedScalarFieldContainer[str]
    findings: _containers.RepeatedScalarFieldContainer[str]
    start_choice: StartChoice
    finding_kinds: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, name: _Optional[str] = ..., method: _Optional[str] = ..., sensors: _Optional[_Iterable[str]] = ..., settings: _Optional[_Mapping[str, str]] = ..., start: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., residual_kinds: _Optional[_Iterable[str]] = ..., findings: _Optional[_Iterable[str]] = ..., start_choice: _Optional[_Union[StartChoice, _Mapping]] = ..., finding_kinds: _Optional[_Iterable[str]] = ...) -> None: ...

class StartChoice(_message.Message):
    __slots__ = ("supposition", "rival", "margin", "doubtful")
    SUPPOSITION_FIELD_NUMBER: _ClassVar[int]
    RIVAL_FIELD_NUMBER: _ClassVar[int]
    MARGIN_FIELD_NUMBER: _ClassVar[int]
    DOUBTFUL_FIELD_NUMBER: _ClassVar[int]
    supposition: str
    rival: str
    margin: float
    doubtful: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, supposition: _Optional[str] = ..., rival: _Optional[str] = ..., margin: _Optional[float] = ..., doubtful: _Optional[_Iterable[str]] = ...) -> None: ...
