from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor

class SceneInfo(_message.Message):
    __slots__ = ("name", "wearer_topics", "has_camera", "further_camera_topics")
    NAME_FIELD_NUMBER: _ClassVar[int]
    WEARER_TOPICS_FIELD_NUMBER: _ClassVar[int]
    HAS_CAMERA_FIELD_NUMBER: _ClassVar[int]
    FURTHER_CAMERA_TOPICS_FIELD_NUMBER: _ClassVar[int]
    name: str
    wearer_topics: _containers.RepeatedScalarFieldContainer[str]
    has_camera: bool
    further_camera_topics: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, name: _Optional[str] = ..., wearer_topics: _Optional[_Iterable[str]] = ..., has_camera: bool = ..., further_camera_topics: _Optional[_Iterable[str]] = ...) -> None: ...
