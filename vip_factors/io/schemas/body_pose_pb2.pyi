from google.protobuf import timestamp_pb2 as _timestamp_pb2
from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from vip_factors.io.schemas import subject_pb2 as _subject_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class MotionInfo(_message.Message):
    __slots__ = ("name", "rate_hz", "start_s", "frames", "skeleton", "known_bones")
    NAME_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    START_S_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    SKELETON_FIELD_NUMBER: _ClassVar[int]
    KNOWN_BONES_FIELD_NUMBER: _ClassVar[int]
    name: str
    rate_hz: float
    start_s: float
    frames: int
    skeleton: _subject_pb2.Skeleton
    known_bones: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, name: _Optional[str] = ..., rate_hz: _Optional[float] = ..., start_s: _Optional[float] = ..., frames: _Optional[int] = ..., skeleton: _Optional[_Union[_subject_pb2.Skeleton, _Mapping]] = ..., known_bones: _Optional[_Iterable[str]] = ...) -> None: ...

class BodyPose(_message.Message):
    __slots__ = ("timestamp", "frame", "joint_rotations_wxyz", "p_world_pelvis", "joint_covariance", "root_covariance")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    JOINT_ROTATIONS_WXYZ_FIELD_NUMBER: _ClassVar[int]
    P_WORLD_PELVIS_FIELD_NUMBER: _ClassVar[int]
    JOINT_COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    ROOT_COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame: int
    joint_rotations_wxyz: _containers.RepeatedScalarFieldContainer[float]
    p_world_pelvis: _geometry_pb2.Vector3
    joint_covariance: _containers.RepeatedScalarFieldContainer[float]
    root_covariance: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., frame: _Optional[int] = ..., joint_rotations_wxyz: _Optional[_Iterable[float]] = ..., p_world_pelvis: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., joint_covariance: _Optional[_Iterable[float]] = ..., root_covariance: _Optional[_Iterable[float]] = ...) -> None: ...
