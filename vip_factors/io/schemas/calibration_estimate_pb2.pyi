from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class CalibrationEstimate(_message.Message):
    __slots__ = ("sensors",)
    class Sensor(_message.Message):
        __slots__ = ("sensor", "heading_rad", "mounting_wxyz", "heading_sigma_rad", "mounting_sigma_rad", "heading_time_s", "heading_path_rad", "bone")
        SENSOR_FIELD_NUMBER: _ClassVar[int]
        HEADING_RAD_FIELD_NUMBER: _ClassVar[int]
        MOUNTING_WXYZ_FIELD_NUMBER: _ClassVar[int]
        HEADING_SIGMA_RAD_FIELD_NUMBER: _ClassVar[int]
        MOUNTING_SIGMA_RAD_FIELD_NUMBER: _ClassVar[int]
        HEADING_TIME_S_FIELD_NUMBER: _ClassVar[int]
        HEADING_PATH_RAD_FIELD_NUMBER: _ClassVar[int]
        BONE_FIELD_NUMBER: _ClassVar[int]
        sensor: str
        heading_rad: float
        mounting_wxyz: _geometry_pb2.QuaternionWxyz
        heading_sigma_rad: float
        mounting_sigma_rad: _geometry_pb2.Vector3
        heading_time_s: _containers.RepeatedScalarFieldContainer[float]
        heading_path_rad: _containers.RepeatedScalarFieldContainer[float]
        bone: str
        def __init__(self, sensor: _Optional[str] = ..., heading_rad: _Optional[float] = ..., mounting_wxyz: _Optional[_Union[_geometry_pb2.QuaternionWxyz, _Mapping]] = ..., heading_sigma_rad: _Optional[float] = ..., mounting_sigma_rad: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., heading_time_s: _Optional[_Iterable[float]] = ..., heading_path_rad: _Optional[_Iterable[float]] = ..., bone: _Optional[str] = ...) -> None: ...
    SENSORS_FIELD_NUMBER: _ClassVar[int]
    sensors: _containers.RepeatedCompositeFieldContainer[CalibrationEstimate.Sensor]
    def __init__(self, sensors: _Optional[_Iterable[_Union[CalibrationEstimate.Sensor, _Mapping]]] = ...) -> None: ...
