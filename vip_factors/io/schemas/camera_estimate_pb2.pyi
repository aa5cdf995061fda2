from google.protobuf import timestamp_pb2 as _timestamp_pb2
from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class CameraEstimateInfo(_message.Message):
    __slots__ = ("name", "time_offset_s", "poses", "has_residuals", "wearers", "residual_frames", "time_drift", "clock_sigma", "focal_sigma", "wearer_of_detection")
    NAME_FIELD_NUMBER: _ClassVar[int]
    TIME_OFFSET_S_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    HAS_RESIDUALS_FIELD_NUMBER: _ClassVar[int]
    WEARERS_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_FRAMES_FIELD_NUMBER: _ClassVar[int]
    TIME_DRIFT_FIELD_NUMBER: _ClassVar[int]
    CLOCK_SIGMA_FIELD_NUMBER: _ClassVar[int]
    FOCAL_SIGMA_FIELD_NUMBER: _ClassVar[int]
    WEARER_OF_DETECTION_FIELD_NUMBER: _ClassVar[int]
    name: str
    time_offset_s: float
    poses: int
    has_residuals: bool
    wearers: int
    residual_frames: int
    time_drift: float
    clock_sigma: _containers.RepeatedScalarFieldContainer[float]
    focal_sigma: float
    wearer_of_detection: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, name: _Optional[str] = ..., time_offset_s: _Optional[float] = ..., poses: _Optional[int] = ..., has_residuals: bool = ..., wearers: _Optional[int] = ..., residual_frames: _Optional[int] = ..., time_drift: _Optional[float] = ..., clock_sigma: _Optional[_Iterable[float]] = ..., focal_sigma: _Optional[float] = ..., wearer_of_detection: _Optional[_Iterable[int]] = ...) -> None: ...

class CameraPose(_message.Message):
    __slots__ = ("timestamp", "seconds", "frame", "rotation_wxyz", "p_world_camera", "covariance")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    ROTATION_WXYZ_FIELD_NUMBER: _ClassVar[int]
    P_WORLD_CAMERA_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    seconds: float
    frame: int
    rotation_wxyz: _geometry_pb2.QuaternionWxyz
    p_world_camera: _geometry_pb2.Vector3
    covariance: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., seconds: _Optional[float] = ..., frame: _Optional[int] = ..., rotation_wxyz: _Optional[_Union[_geometry_pb2.QuaternionWxyz, _Mapping]] = ..., p_world_camera: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., covariance: _Optional[_Iterable[float]] = ...) -> None: ...
