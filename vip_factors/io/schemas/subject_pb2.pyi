from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Skeleton(_message.Message):
    __slots__ = ("joints", "landmarks", "source")
    class Joint(_message.Message):
        __slots__ = ("name", "parent", "p_parent_joint")
        NAME_FIELD_NUMBER: _ClassVar[int]
        PARENT_FIELD_NUMBER: _ClassVar[int]
        P_PARENT_JOINT_FIELD_NUMBER: _ClassVar[int]
        name: str
        parent: str
        p_parent_joint: _geometry_pb2.Vector3
        def __init__(self, name: _Optional[str] = ..., parent: _Optional[str] = ..., p_parent_joint: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ...) -> None: ...
    class Landmark(_message.Message):
        __slots__ = ("name", "bone", "p_bone_point")
        NAME_FIELD_NUMBER: _ClassVar[int]
        BONE_FIELD_NUMBER: _ClassVar[int]
        P_BONE_POINT_FIELD_NUMBER: _ClassVar[int]
        name: str
        bone: str
        p_bone_point: _geometry_pb2.Vector3
        def __init__(self, name: _Optional[str] = ..., bone: _Optional[str] = ..., p_bone_point: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ...) -> None: ...
    JOINTS_FIELD_NUMBER: _ClassVar[int]
    LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    joints: _containers.RepeatedCompositeFieldContainer[Skeleton.Joint]
    landmarks: _containers.RepeatedCompositeFieldContainer[Skeleton.Landmark]
    source: str
    def __init__(self, joints: _Optional[_Iterable[_Union[Skeleton.Joint, _Mapping]]] = ..., landmarks: _Optional[_Iterable[_Union[Skeleton.Landmark, _Mapping]]] = ..., source: _Optional[str] = ...) -> None: ...

class LengthPrior(_message.Message):
    __slots__ = ("lengths", "covariance_m2")
    LENGTHS_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_M2_FIELD_NUMBER: _ClassVar[int]
    lengths: _containers.RepeatedScalarFieldContainer[str]
    covariance_m2: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, lengths: _Optional[_Iterable[str]] = ..., covariance_m2: _Optional[_Iterable[float]] = ...) -> None: ...

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

class Subject(_message.Message):
    __slots__ = ("name", "stature_m", "mass_kg", "sex", "segment_lengths_m", "skeleton", "skeleton_given", "length_prior", "hinges")
    class SegmentLengthsMEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    STATURE_M_FIELD_NUMBER: _ClassVar[int]
    MASS_KG_FIELD_NUMBER: _ClassVar[int]
    SEX_FIELD_NUMBER: _ClassVar[int]
    SEGMENT_LENGTHS_M_FIELD_NUMBER: _ClassVar[int]
    SKELETON_FIELD_NUMBER: _ClassVar[int]
    SKELETON_GIVEN_FIELD_NUMBER: _ClassVar[int]
    LENGTH_PRIOR_FIELD_NUMBER: _ClassVar[int]
    HINGES_FIELD_NUMBER: _ClassVar[int]
    name: str
    stature_m: float
    mass_kg: float
    sex: str
    segment_lengths_m: _containers.ScalarMap[str, float]
    skeleton: Skeleton
    skeleton_given: bool
    length_prior: LengthPrior
    hinges: _containers.RepeatedCompositeFieldContainer[Hinge]
    def __init__(self, name: _Optional[str] = ..., stature_m: _Optional[float] = ..., mass_kg: _Optional[float] = ..., sex: _Optional[str] = ..., segment_lengths_m: _Optional[_Mapping[str, float]] = ..., skeleton: _Optional[_Union[Skeleton, _Mapping]] = ..., skeleton_given: bool = ..., length_prior: _Optional[_Union[LengthPrior, _Mapping]] = ..., hinges: _Optional[_Iterable[_Union[Hinge, _Mapping]]] = ...) -> None: ...
