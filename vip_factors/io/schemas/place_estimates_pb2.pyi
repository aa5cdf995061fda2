from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SensorPlaceEstimates(_message.Message):
    __slots__ = ("sensors",)
    class Sensor(_message.Message):
        __slots__ = ("sensor", "bone", "prior_m", "found_m", "prior_sigma_m", "sigma_m")
        SENSOR_FIELD_NUMBER: _ClassVar[int]
        BONE_FIELD_NUMBER: _ClassVar[int]
        PRIOR_M_FIELD_NUMBER: _ClassVar[int]
        FOUND_M_FIELD_NUMBER: _ClassVar[int]
        PRIOR_SIGMA_M_FIELD_NUMBER: _ClassVar[int]
        SIGMA_M_FIELD_NUMBER: _ClassVar[int]
        sensor: str
        bone: str
        prior_m: _geometry_pb2.Vector3
        found_m: _geometry_pb2.Vector3
        prior_sigma_m: _geometry_pb2.Vector3
        sigma_m: _geometry_pb2.Vector3
        def __init__(self, sensor: _Optional[str] = ..., bone: _Optional[str] = ..., prior_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., found_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., prior_sigma_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., sigma_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ...) -> None: ...
    SENSORS_FIELD_NUMBER: _ClassVar[int]
    sensors: _containers.RepeatedCompositeFieldContainer[SensorPlaceEstimates.Sensor]
    def __init__(self, sensors: _Optional[_Iterable[_Union[SensorPlaceEstimates.Sensor, _Mapping]]] = ...) -> None: ...

class DetectorEstimate(_message.Message):
    __slots__ = ("keypoints",)
    class Keypoint(_message.Message):
        __slots__ = ("keypoint", "prior_m", "found_m", "prior_sigma_m", "sigma_m")
        KEYPOINT_FIELD_NUMBER: _ClassVar[int]
        PRIOR_M_FIELD_NUMBER: _ClassVar[int]
        FOUND_M_FIELD_NUMBER: _ClassVar[int]
        PRIOR_SIGMA_M_FIELD_NUMBER: _ClassVar[int]
        SIGMA_M_FIELD_NUMBER: _ClassVar[int]
        keypoint: str
        prior_m: _geometry_pb2.Vector3
        found_m: _geometry_pb2.Vector3
        prior_sigma_m: _geometry_pb2.Vector3
        sigma_m: _geometry_pb2.Vector3
        def __init__(self, keypoint: _Optional[str] = ..., prior_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., found_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., prior_sigma_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., sigma_m: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ...) -> None: ...
    KEYPOINTS_FIELD_NUMBER: _ClassVar[int]
    keypoints: _containers.RepeatedCompositeFieldContainer[DetectorEstimate.Keypoint]
    def __init__(self, keypoints: _Optional[_Iterable[_Union[DetectorEstimate.Keypoint, _Mapping]]] = ...) -> None: ...
