from google.protobuf import timestamp_pb2 as _timestamp_pb2
from vip_factors.io.schemas import body_pose_pb2 as _body_pose_pb2
from vip_factors.io.schemas import sensor_placement_pb2 as _sensor_placement_pb2
from vip_factors.io.schemas import subject_pb2 as _subject_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class RecordingInfo(_message.Message):
    __slots__ = ("name", "initial_pose", "notes", "start", "clock_s", "sensors", "subject", "placement", "truth")
    NAME_FIELD_NUMBER: _ClassVar[int]
    INITIAL_POSE_FIELD_NUMBER: _ClassVar[int]
    NOTES_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    CLOCK_S_FIELD_NUMBER: _ClassVar[int]
    SENSORS_FIELD_NUMBER: _ClassVar[int]
    SUBJECT_FIELD_NUMBER: _ClassVar[int]
    PLACEMENT_FIELD_NUMBER: _ClassVar[int]
    TRUTH_FIELD_NUMBER: _ClassVar[int]
    name: str
    initial_pose: str
    notes: str
    start: _timestamp_pb2.Timestamp
    clock_s: float
    sensors: _containers.RepeatedScalarFieldContainer[str]
    subject: _subject_pb2.Subject
    placement: _sensor_placement_pb2.SensorPlacement
    truth: _body_pose_pb2.MotionInfo
    def __init__(self, name: _Optional[str] = ..., initial_pose: _Optional[str] = ..., notes: _Optional[str] = ..., start: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., clock_s: _Optional[float] = ..., sensors: _Optional[_Iterable[str]] = ..., subject: _Optional[_Union[_subject_pb2.Subject, _Mapping]] = ..., placement: _Optional[_Union[_sensor_placement_pb2.SensorPlacement, _Mapping]] = ..., truth: _Optional[_Union[_body_pose_pb2.MotionInfo, _Mapping]] = ...) -> None: ...

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
