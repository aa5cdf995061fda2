from google.protobuf import timestamp_pb2 as _timestamp_pb2
from vip_factors.io.schemas import body_pose_pb2 as _body_pose_pb2
from vip_factors.io.schemas import geometry_pb2 as _geometry_pb2
from vip_factors.io.schemas import subject_pb2 as _subject_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class EstimateInfo(_message.Message):
    __slots__ = ("name", "method", "settings", "start", "clock_s", "findings", "finding_kinds", "sensors", "residual_kinds", "start_choice", "motion", "body", "sensor_positions", "wearer_topics", "wearer_of_detection", "association", "detector")
    class SettingsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    CLOCK_S_FIELD_NUMBER: _ClassVar[int]
    FINDINGS_FIELD_NUMBER: _ClassVar[int]
    FINDING_KINDS_FIELD_NUMBER: _ClassVar[int]
    SENSORS_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_KINDS_FIELD_NUMBER: _ClassVar[int]
    START_CHOICE_FIELD_NUMBER: _ClassVar[int]
    MOTION_FIELD_NUMBER: _ClassVar[int]
    BODY_FIELD_NUMBER: _ClassVar[int]
    SENSOR_POSITIONS_FIELD_NUMBER: _ClassVar[int]
    WEARER_TOPICS_FIELD_NUMBER: _ClassVar[int]
    WEARER_OF_DETECTION_FIELD_NUMBER: _ClassVar[int]
    ASSOCIATION_FIELD_NUMBER: _ClassVar[int]
    DETECTOR_FIELD_NUMBER: _ClassVar[int]
    name: str
    method: str
    settings: _containers.ScalarMap[str, str]
    start: _timestamp_pb2.Timestamp
    clock_s: float
    findings: _containers.RepeatedScalarFieldContainer[str]
    finding_kinds: _containers.RepeatedScalarFieldContainer[str]
    sensors: _containers.RepeatedScalarFieldContainer[str]
    residual_kinds: _containers.RepeatedScalarFieldContainer[str]
    start_choice: StartChoice
    motion: _body_pose_pb2.MotionInfo
    body: BodyEstimate
    sensor_positions: _containers.RepeatedCompositeFieldContainer[SensorPlaceEstimate]
    wearer_topics: _containers.RepeatedScalarFieldContainer[str]
    wearer_of_detection: _containers.RepeatedScalarFieldContainer[int]
    association: _containers.RepeatedScalarFieldContainer[str]
    detector: DetectorEstimate
    def __init__(self, name: _Optional[str] = ..., method: _Optional[str] = ..., settings: _Optional[_Mapping[str, str]] = ..., start: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., clock_s: _Optional[float] = ..., findings: _Optional[_Iterable[str]] = ..., finding_kinds: _Optional[_Iterable[str]] = ..., sensors: _Optional[_Iterable[str]] = ..., residual_kinds: _Optional[_Iterable[str]] = ..., start_choice: _Optional[_Union[StartChoice, _Mapping]] = ..., motion: _Optional[_Union[_body_pose_pb2.MotionInfo, _Mapping]] = ..., body: _Optional[_Union[BodyEstimate, _Mapping]] = ..., sensor_positions: _Optional[_Iterable[_Union[SensorPlaceEstimate, _Mapping]]] = ..., wearer_topics: _Optional[_Iterable[str]] = ..., wearer_of_detection: _Optional[_Iterable[int]] = ..., association: _Optional[_Iterable[str]] = ..., detector: _Optional[_Union[DetectorEstimate, _Mapping]] = ...) -> None: ...

class StartChoice(_message.Message):
    __slots__ = ("hypothesis", "rival", "margin", "doubtful")
    HYPOTHESIS_FIELD_NUMBER: _ClassVar[int]
    RIVAL_FIELD_NUMBER: _ClassVar[int]
    MARGIN_FIELD_NUMBER: _ClassVar[int]
    DOUBTFUL_FIELD_NUMBER: _ClassVar[int]
    hypothesis: str
    rival: str
    margin: float
    doubtful: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, hypothesis: _Optional[str] = ..., rival: _Optional[str] = ..., margin: _Optional[float] = ..., doubtful: _Optional[_Iterable[str]] = ...) -> None: ...

class BodyEstimate(_message.Message):
    __slots__ = ("lengths", "prior_m", "found_m", "prior_covariance_m2", "covariance_m2", "hinges", "prior_hinges")
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
    hinges: _containers.RepeatedCompositeFieldContainer[_subject_pb2.Hinge]
    prior_hinges: _containers.RepeatedCompositeFieldContainer[_subject_pb2.Hinge]
    def __init__(self, lengths: _Optional[_Iterable[str]] = ..., prior_m: _Optional[_Iterable[float]] = ..., found_m: _Optional[_Iterable[float]] = ..., prior_covariance_m2: _Optional[_Iterable[float]] = ..., covariance_m2: _Optional[_Iterable[float]] = ..., hinges: _Optional[_Iterable[_Union[_subject_pb2.Hinge, _Mapping]]] = ..., prior_hinges: _Optional[_Iterable[_Union[_subject_pb2.Hinge, _Mapping]]] = ...) -> None: ...

class SensorPlaceEstimate(_message.Message):
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

class SolveReport(_message.Message):
    __slots__ = ("stage", "iterations", "initial_cost", "final_cost", "converged", "seconds")
    class Iteration(_message.Message):
        __slots__ = ("cost", "damping", "accepted", "seconds")
        class SecondsEntry(_message.Message):
            __slots__ = ("key", "value")
            KEY_FIELD_NUMBER: _ClassVar[int]
            VALUE_FIELD_NUMBER: _ClassVar[int]
            key: str
            value: float
            def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
        COST_FIELD_NUMBER: _ClassVar[int]
        DAMPING_FIELD_NUMBER: _ClassVar[int]
        ACCEPTED_FIELD_NUMBER: _ClassVar[int]
        SECONDS_FIELD_NUMBER: _ClassVar[int]
        cost: float
        damping: float
        accepted: bool
        seconds: _containers.ScalarMap[str, float]
        def __init__(self, cost: _Optional[float] = ..., damping: _Optional[float] = ..., accepted: bool = ..., seconds: _Optional[_Mapping[str, float]] = ...) -> None: ...
    class InitialCostEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    class FinalCostEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    STAGE_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    INITIAL_COST_FIELD_NUMBER: _ClassVar[int]
    FINAL_COST_FIELD_NUMBER: _ClassVar[int]
    CONVERGED_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    stage: str
    iterations: _containers.RepeatedCompositeFieldContainer[SolveReport.Iteration]
    initial_cost: _containers.ScalarMap[str, float]
    final_cost: _containers.ScalarMap[str, float]
    converged: bool
    seconds: float
    def __init__(self, stage: _Optional[str] = ..., iterations: _Optional[_Iterable[_Union[SolveReport.Iteration, _Mapping]]] = ..., initial_cost: _Optional[_Mapping[str, float]] = ..., final_cost: _Optional[_Mapping[str, float]] = ..., converged: bool = ..., seconds: _Optional[float] = ...) -> None: ...

class Residuals(_message.Message):
    __slots__ = ("timestamp", "frame", "kinds")
    class Kind(_message.Message):
        __slots__ = ("name", "values")
        NAME_FIELD_NUMBER: _ClassVar[int]
        VALUES_FIELD_NUMBER: _ClassVar[int]
        name: str
        values: _containers.RepeatedScalarFieldContainer[float]
        def __init__(self, name: _Optional[str] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    KINDS_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame: int
    kinds: _containers.RepeatedCompositeFieldContainer[Residuals.Kind]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., frame: _Optional[int] = ..., kinds: _Optional[_Iterable[_Union[Residuals.Kind, _Mapping]]] = ...) -> None: ...
