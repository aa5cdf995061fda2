"""GTSAM's own smoothers, fed frame by frame: what the fixed-lag chain is held against.

They know nothing of bodies: factors, values, and the number of each variable's frame. Each is used as it is fastest.
"""

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array

BEFORE = 2  # frames that a clique may hold before the first one that moved: factors reach that far
MOVED = 0.0087  # rad or m, half a degree: from which on a variable is linearised anew


class LagOfGtsam:
    """``BatchFixedLagSmoother`` or ``IncrementalFixedLagSmoother``; time is counted in frames."""

    def __init__(self, smoother: gtsam.FixedLagSmoother) -> None:
        self._smoother = smoother

    @classmethod
    def batch(cls, lag: int, iterations: int | None = None) -> "LagOfGtsam":
        """All frames of the lag at once, by at most so many iterations; None: to convergence."""
        settings = gtsam.LevenbergMarquardtParams()
        if iterations is not None:
            settings.setMaxIterations(iterations)
        return cls(gtsam.BatchFixedLagSmoother(float(lag), settings))

    @classmethod
    def incremental(cls, lag: int) -> "LagOfGtsam":
        """By ISAM2."""
        return cls(gtsam.IncrementalFixedLagSmoother(float(lag), _isam2_settings()))

    def update(
        self,
        newest: int,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        frames: Mapping[int, int],
        shared: Sequence[int],
    ) -> gtsam.Values:
        """Put in what is new; all variables of the lag then."""
        times = {key: float(frame) for key, frame in frames.items()}
        times.update(dict.fromkeys(shared, float(newest)))
        self._smoother.update(factors, values, times)  # type: ignore[arg-type]  # its Mapping is invariant in its keys
        return self._smoother.calculateEstimate()


class TimeOrderedIsam2:
    """Plain ISAM2 with its variables kept in the order of time, what is shared last, and the oldest marginalised."""

    def __init__(self, lag: int) -> None:
        self._lag = lag
        self._isam = gtsam.ISAM2(_isam2_settings())
        self._frames: dict[int, list[int]] = {}

    def update(
        self,
        newest: int,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        frames: Mapping[int, int],
        shared: Sequence[int],
    ) -> gtsam.Values:
        """As :meth:`LagOfGtsam.update`."""
        old = [number for number in self._frames]
        for key, frame in frames.items():
            self._frames.setdefault(frame, []).append(key)
        start = min([newest, *frames.values()])
        if old:
            start = max(min(old), min(start - BEFORE, self._first_moved(shared) - BEFORE) - 1)
        self._isam.update(factors, values, self._ordered(start, old, shared))
        found = self._isam.calculateEstimate()
        gone = [number for number in self._frames if number < newest - self._lag]
        if gone:
            self._isam.marginalizeLeaves(_key_list([key for number in gone for key in self._frames.pop(number)]))
        return found

    def _ordered(self, start: int, old: Sequence[int], shared: Sequence[int]) -> gtsam.ISAM2UpdateParams:
        """The order of what is eliminated again. Groups without a variable end the process: all are made to be."""
        groups, again = gtsam.KeyGroupMap(), []
        for number in (one for one in sorted(self._frames) if one >= start):
            for key in self._frames[number]:
                groups.insert2(key, number - start)
            again += self._frames[number] if number in old else []
        for key in shared:
            groups.insert2(key, max(self._frames) - start + 1)
        settings = gtsam.ISAM2UpdateParams()
        settings.constrainedKeys = groups
        if again:
            settings.extraReelimKeys = _key_list(again)
        return settings

    def _first_moved(self, shared: Sequence[int]) -> int:
        """The earliest frame that this update will linearise anew; what marginals hold never is."""
        delta, fixed = self._isam.getDelta(), {int(key) for key in self._isam.getFixedVariables()}
        if any(key not in fixed and np.abs(delta.at(key)).max() >= MOVED for key in shared):
            return min(self._frames)
        for number in sorted(self._frames):
            keys = [key for key in self._frames[number] if key not in fixed and delta.exists(key)]
            if any(np.abs(delta.at(key)).max() >= MOVED for key in keys):
                return number
        return max(self._frames)


class Isam2Chain:
    """ISAM2 in the place of :class:`~vip_factors.solve.fixed_lag.FixedLagChain`, fed with the same linear factors.

    What all frames share must not wander: each frame eliminates its own key alone.

    Args:
        width: of a frame's variable.
        shared_width: of what all frames share.
    """

    def __init__(self, width: int, shared_width: int) -> None:
        self._width, self._shared_width = width, shared_width
        settings = _isam2_settings()
        settings.enableRelinearization = False
        self._isam = gtsam.ISAM2(settings)
        self._frames: dict[int, int] = {}  # key by number
        self._places: dict[int, list[int]] = {}  # of each frame's factors
        self._new: dict[int, gtsam.GaussianFactorGraph] = {}

    def eliminate(self, number: int, keys: Sequence[int], factors: gtsam.GaussianFactorGraph) -> None:
        """Put in a frame, or replace it; it counts from the next solution on."""
        (self._frames[number],) = keys
        self._new[number] = factors

    def marginalise_before(self, before: int) -> None:
        """Marginalise frames with a smaller number."""
        gone = [number for number in self._frames if number < before]
        if gone:
            self._isam.marginalizeLeaves(_key_list([self._frames.pop(number) for number in gone]))
        for number in gone:
            self._places.pop(number)

    def solution(self, shared: int) -> "Isam2Chain":
        """All variables of the lag."""
        graph, owners = gtsam.NonlinearFactorGraph(), []
        for number, factors in self._new.items():
            for index in range(factors.size()):
                graph.push_back(gtsam.LinearContainerFactor(factors.at(index), gtsam.Values()))
                owners.append(number)
        fresh = [key for key in [*self._frames.values(), shared] if not self._isam.valueExists(key)]
        values = gtsam.Values()
        for key in fresh:
            values.insert(key, np.zeros(self._shared_width if key == shared else self._width))
        result = self._isam.update(graph, values, self._ordered(shared, fresh))
        for number in self._new:
            self._places[number] = []
        for number, place in zip(owners, list(result.getNewFactorsIndices()), strict=True):
            self._places[number].append(int(place))
        self._new = {}
        self._delta = self._isam.getDelta()
        return self

    def at(self, key: int) -> Array:
        """A variable."""
        return np.array(self._delta.at(key))  # a copy: the next update changes it

    def covariance(self, key: int) -> Array:
        """Marginal covariance of a variable."""
        return np.asarray(self._isam.marginalCovariance(key))

    def _ordered(self, shared: int, fresh: Sequence[int]) -> gtsam.ISAM2UpdateParams:
        groups, settings = gtsam.KeyGroupMap(), gtsam.ISAM2UpdateParams()
        start = max(min(self._new) - 1, min(self._frames))
        again = [self._frames[number] for number in sorted(self._frames) if number >= start]
        for group, key in enumerate([*again, shared]):
            groups.insert2(key, group)
        settings.constrainedKeys = groups
        settings.removeFactorIndices = [place for number in self._new for place in self._places.get(number, [])]
        old = [key for key in again if key not in fresh]
        if old:
            settings.extraReelimKeys = _key_list(old)
        return settings


def _key_list(keys: Sequence[int]) -> gtsam.KeyList:
    found = gtsam.KeyList()
    for key in keys:
        found.push_back(key)
    return found


def _isam2_settings() -> gtsam.ISAM2Params:
    settings = gtsam.ISAM2Params()
    settings.setOptimizationParams(gtsam.ISAM2GaussNewtonParams(0.0))
    settings.setRelinearizeThreshold(MOVED)
    settings.relinearizeSkip = 1  # the default looks only every tenth time
    settings.findUnusedFactorSlots = True  # else their number grows without end
    return settings
