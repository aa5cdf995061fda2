from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Detections2D(_message.Message):
    __slots__ = ("timestamp", "seconds", "frame", "people")
    class Person(_message.Message):
        __slots__ = ("pixels", "confidence", "truth_wearer", "truth_pixels", "torso_colour")
        PIXELS_FIELD_NUMBER: _ClassVar[int]
        CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
        TRUTH_WEARER_FIELD_NUMBER: _ClassVar[int]
        TRUTH_PIXELS_FIELD_NUMBER: _ClassVar[int]
        TORSO_COLOUR_FIELD_NUMBER: _ClassVar[int]
        pixels: _containers.RepeatedScalarFieldContainer[float]
        confidence: _containers.RepeatedScalarFieldContainer[float]
        truth_wearer: int
        truth_pixels: _containers.RepeatedScalarFieldContainer[float]
        torso_colour: _containers.RepeatedScalarFieldContainer[float]
        def __init__(self, pixels: _Optional[_Iterable[float]] = ..., confidence: _Optional[_Iterable[float]] = ..., truth_wearer: _Optional[int] = ..., truth_pixels: _Optional[_Iterable[float]] = ..., torso_colour: _Optional[_Iterable[float]] = ...) -> None: ...
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    PEOPLE_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    seconds: float
    frame: int
    people: _containers.RepeatedCompositeFieldContainer[Detections2D.Person]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., seconds: _Optional[float] = ..., frame: _Optional[int] = ..., people: _Optional[_Iterable[_Union[Detections2D.Person, _Mapping]]] = ...) -> None: ...
