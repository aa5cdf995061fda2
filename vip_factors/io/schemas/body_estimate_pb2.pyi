from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class BodyEstimate(_message.Message):
    __slots__ = ("lengths", "prior_m", "found_m", "prior_covariance_m2", "covariance_m2", "hinges", "prior_hinges")
    class Hinge(_message.Message):
        __slots__ = ("joint", "axis", "tilt_sigma_rad", "carrying_angle_rad", "carrying_sigma_rad", "variables_rad", "covariance_rad2")
        JOINT_FIELD_NUMBER: _ClassVar[int]
        AXIS_FIELD_NUMBER: _ClassVar[int]
        TILT_SIGMA_RAD_FIELD_NUMBER: _ClassVar[int]
        CARRYING_ANGLE_RAD_FIELD_NUMBER: _ClassVar[int]
        CARRYING_SIGMA_RAD_FIELD_NUMBER: _ClassVar[int]
        VARIABLES_RAD_FIELD_NUMBER: _ClassVar[int]
        COVARIANCE_RAD2_FIELD_NUMBER: _ClassVar[int]
        joint: str
        axis: _geometry_pb2.Vector3
        tilt_sigma_rad: _containers.RepeatedScalarFieldContainer[float]
        carrying_angle_rad: float
        carrying_sigma_rad: float
        variables_rad: _containers.RepeatedScalarFieldContainer[float]
        covariance_rad2: _containers.RepeatedScalarFieldContainer[float]
        def __init__(self, joint: _Optional[str] = ..., axis: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., tilt_sigma_rad: _Optional[_Iterable[float]] = ..., carrying_angle_rad: _Optional[float] = ..., carrying_sigma_rad: _Optional[float] = ..., variables_rad: _Optional[_Iterable[float]] = ..., covariance_rad2: _Optional[_Iterable[float]] = ...) -> None: ...
    LENGTHS_FIELD_NUMBER: _ClassVar[int]
    PRIOR_M_FIELD_NUMBER: _ClassVar[int]
    FOUND_M_FIELD_NUMBER: _ClassVar[int]
    PRIOR_COVARIANCE_M2_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_M2_FIELD_NUMBER: _ClassVar[int]
    HINGES_FIELD_NUMBER: _ClassVar[int]
    PRIOR_HINGES_FIELD_NUMBER: _ClassVar[int]
    lengths: _containers.RepeatedScalarFieldContainer[str]
    prior_m: _containers.RepeatedScalarFieldContainer[float]
    found_m: _containers.RepeatedScalarFieldContainer[float]
    prior_covariance_m2: _containers.RepeatedScalarFieldContainer[float]
    covariance_m2: _containers.RepeatedScalarFieldContainer[float]
    hinges: _containers.RepeatedCompositeFieldContainer[BodyEstimate.Hinge]
    prior_hinges: _containers.RepeatedCompositeFieldContainer[BodyEstimate.Hinge]
    def __init__(self, lengths: _Optional[_Iterable[str]] = ..., prior_m: _Optional[_Iterable[float]] = ..., found_m: _Optional[_Iterable[float]] = ..., prior_covariance_m2: _Optional[_Iterable[float]] = ..., covariance_m2: _Optional[_Iterable[float]] = ..., hinges: _Optional[_Iterable[_Union[BodyEstimate.Hinge, _Mapping]]] = ..., prior_hinges: _Optional[_Iterable[_Union[BodyEstimate.Hinge, _Mapping]]] = ...) -> None: ...
