from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

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
