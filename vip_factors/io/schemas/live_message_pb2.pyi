from google.protobuf import timestamp_pb2 as _timestamp_pb2
from vip_factors.io.schemas import camera_estimate_pb2 as _camera_estimate_pb2
from vip_factors.io.schemas import camera_info_pb2 as _camera_info_pb2
from vip_factors.io.schemas import detections_2d_pb2 as _detections_2d_pb2
from vip_factors.io.schemas import imu_sample_pb2 as _imu_sample_pb2
from vip_factors.io.schemas import sensor_placement_pb2 as _sensor_placement_pb2
from vip_factors.io.schemas import subject_pb2 as _subject_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class LiveMessage(_message.Message):
    __slots__ = ("carrier", "header", "imu", "detections")
    CARRIER_FIELD_NUMBER: _ClassVar[int]
    HEADER_FIELD_NUMBER: _ClassVar[int]
    IMU_FIELD_NUMBER: _ClassVar[int]
    DETECTIONS_FIELD_NUMBER: _ClassVar[int]
    carrier: str
    header: LiveHeader
    imu: _imu_sample_pb2.ImuSample
    detections: _detections_2d_pb2.Detections2D
    def __init__(self, carrier: _Optional[str] = ..., header: _Optional[_Union[LiveHeader, _Mapping]] = ..., imu: _Optional[_Union[_imu_sample_pb2.ImuSample, _Mapping]] = ..., detections: _Optional[_Union[_detections_2d_pb2.Detections2D, _Mapping]] = ...) -> None: ...

class LiveHeader(_message.Message):
    __slots__ = ("name", "start", "wearers", "cameras")
    NAME_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    WEARERS_FIELD_NUMBER: _ClassVar[int]
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    name: str
    start: _timestamp_pb2.Timestamp
    wearers: _containers.RepeatedCompositeFieldContainer[LiveWearer]
    cameras: _containers.RepeatedCompositeFieldContainer[LiveCamera]
    def __init__(self, name: _Optional[str] = ..., start: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., wearers: _Optional[_Iterable[_Union[LiveWearer, _Mapping]]] = ..., cameras: _Optional[_Iterable[_Union[LiveCamera, _Mapping]]] = ...) -> None: ...

class LiveWearer(_message.Message):
    __slots__ = ("subject", "placement", "initial_pose")
    SUBJECT_FIELD_NUMBER: _ClassVar[int]
    PLACEMENT_FIELD_NUMBER: _ClassVar[int]
    INITIAL_POSE_FIELD_NUMBER: _ClassVar[int]
    subject: _subject_pb2.Subject
    placement: _sensor_placement_pb2.SensorPlacement
    initial_pose: str
    def __init__(self, subject: _Optional[_Union[_subject_pb2.Subject, _Mapping]] = ..., placement: _Optional[_Union[_sensor_placement_pb2.SensorPlacement, _Mapping]] = ..., initial_pose: _Optional[str] = ...) -> None: ...

class LiveCamera(_message.Message):
    __slots__ = ("info", "calibration", "known_poses")
    INFO_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    KNOWN_POSES_FIELD_NUMBER: _ClassVar[int]
    info: _camera_info_pb2.CameraInfo
    calibration: bytes
    known_poses: _containers.RepeatedCompositeFieldContainer[_camera_estimate_pb2.CameraPose]
    def __init__(self, info: _Optional[_Union[_camera_info_pb2.CameraInfo, _Mapping]] = ..., calibration: _Optional[bytes] = ..., known_poses: _Optional[_Iterable[_Union[_camera_estimate_pb2.CameraPose, _Mapping]]] = ...) -> None: ...
