from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SensorPlacement(_message.Message):
    __slots__ = ("preset", "sites")
    class Site(_message.Message):
        __slots__ = ("sensor", "bone", "p_bone_sensor", "mounting_wxyz", "mounting_sigma_rad")
        SENSOR_FIELD_NUMBER: _ClassVar[int]
        BONE_FIELD_NUMBER: _ClassVar[int]
        P_BONE_SENSOR_FIELD_NUMBER: _ClassVar[int]
        MOUNTING_WXYZ_FIELD_NUMBER: _ClassVar[int]
        MOUNTING_SIGMA_RAD_FIELD_NUMBER: _ClassVar[int]
        sensor: str
        bone: str
        p_bone_sensor: _geometry_pb2.Vector3
        mounting_wxyz: _geometry_pb2.QuaternionWxyz
        mounting_sigma_rad: float
        def __init__(self, sensor: _Optional[str] = ..., bone: _Optional[str] = ..., p_bone_sensor: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., mounting_wxyz: _Optional[_Union[_geometry_pb2.QuaternionWxyz, _Mapping]] = ..., mounting_sigma_rad: _Optional[float] = ...) -> None: ...
    PRESET_FIELD_NUMBER: _ClassVar[int]
    SITES_FIELD_NUMBER: _ClassVar[int]
    preset: str
    sites: _containers.RepeatedCompositeFieldContainer[SensorPlacement.Site]
    def __init__(self, preset: _Optional[str] = ..., sites: _Optional[_Iterable[_Union[SensorPlacement.Site, _Mapping]]] = ...) -> None: ...
