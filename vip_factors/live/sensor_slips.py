"""Detection of sensors that move on their bone: by turns that no limb makes, or by a calibration that has changed.

The latter is the innovation test of Kalman filters, on the shared variables. From an earlier estimate ``x₀`` with
covariance ``P₀`` to the newest one ``x`` with ``P``, a calibration moves by chance with covariance ``P₀ − P``; the data
since then alone would have moved it by ``P₀ (P₀ − P)⁻¹ (x − x₀)``. Residuals do not show a slip, because bones follow
their sensors.

Willsky, Jones: A generalized likelihood ratio approach to the detection of jumps in linear systems, 1976.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vip_factors.geometry.rotations import Array, log, transpose

NONE = np.zeros(0, int)


class Knocks(NamedTuple):
    """Numbers of sensors to ignore in the newest frame (``ringing``) and of sensors that have moved."""

    ringing: np.ndarray
    moved: np.ndarray


class KnockDetector:
    """Detects knocks of one wearer's sensors.

    Args:
        sensors: their number.
        rate: frames per second.
        begin: number of the first frame that is tested.
    """

    KNOCK_DEG_S2 = 40_000.0  # of one sensor from frame to frame; a kick reaches 20 000, ringing tissue 160 000
    MOVED_DEG = 30.0  # remaining turn from which a knocked sensor counts as moved
    IMPACT, IMPACT_S = 3, 0.2  # sensors knocked together within this time: a landing, as straps slip one at a time
    QUIET_S = 0.07  # without a knock: tissue rings at 8 Hz and more
    RINGING_S = 0.5  # longest ringing
    STEADY_S = 0.05  # time constant of a limb's mean turn
    REST_S = 3.0  # until the same sensor is tested again: its calibration is estimated meanwhile

    def __init__(self, sensors: int, rate: float, begin: int) -> None:
        self._rate, S = rate, sensors
        self._since = np.full(S, begin)
        self._last_turn, self._moving = np.zeros((S, 3)), np.zeros(S, bool)  # turn between frames; whether measured
        # Turn before a knock, in quiet frames after it, and in all frames since; number of these, −1 without a knock
        self._before, self._after, self._net = np.zeros((S, 3)), np.zeros((S, 3)), np.zeros((S, 3))
        self._frames, self._quiet = np.full(S, -1), np.zeros(S, int)
        self._knock = np.full(S, -(10**9))  # number of the last frame in which each was knocked

    def knocked(self, number: int, R_before: Array, R_now: Array, measured: np.ndarray) -> Knocks:
        """Detect sensors that turn faster than a limb can.

        Tissue rings after a step: a turn there and back is no slip. A knocked sensor is ignored until it is quiet, and
        has moved if it is still turned then, compared with the steady turn of its limb.

        Args:
            number: number of the newest frame.
            R_before, R_now: ``(S, 3, 3)`` orientations in the sensors' inertial frames.
            measured: ``(S,)`` whether both were measured.
        """
        ringing = self._follow(number, log(R_now @ transpose(R_before)), measured)
        if not ringing.any():
            return Knocks(NONE, NONE)
        ended = self._quiet >= self.QUIET_S * self._rate
        over = ringing & (ended | (self._frames > self.RINGING_S * self._rate))
        lately = number - self._frames - self.IMPACT_S * self._rate
        is_single = np.sum(self._knock[:, None] >= lately, axis=0) < self.IMPACT
        # Turn of each sensor since its knock beyond that of its limb, whose rate changes evenly.
        turn_after = self._after / np.maximum(self._quiet, 1)[:, None]
        excess = self._net - self._frames[:, None] * (self._before + turn_after) / 2
        far = np.linalg.norm(excess, axis=1) > np.deg2rad(self.MOVED_DEG)
        moved = np.flatnonzero(over & far & is_single & (number >= self._since))
        self._frames[over] = -1
        self._since[moved] = number + round(self.REST_S * self._rate)
        return Knocks(np.flatnonzero(ringing & ~over), moved)

    def _follow(self, number: int, turn: Array, measured: np.ndarray) -> np.ndarray:
        """Sum up turns between frames ``(S, 3)``, radians; returns which sensors ring from a knock ``(S,)``."""
        limit = np.deg2rad(self.KNOCK_DEG_S2) / self._rate**2
        knocked = measured & self._moving & (np.linalg.norm(turn - self._last_turn, axis=1) > limit)
        ringing = measured & (knocked | (self._frames >= 0))
        if ringing.any():
            begins = knocked & (self._frames < 0)
            self._net[begins], self._frames[begins] = 0.0, 0
            self._quiet[knocked], self._after[knocked], self._knock[knocked] = 0, 0.0, number
            self._net[ringing] += turn[ringing]
            self._frames[ringing] += 1
            quiet = ringing & ~knocked
            self._quiet[quiet] += 1
            self._after[quiet] += turn[quiet]
        steady = measured & ~ringing
        share = 1 - np.exp(-1 / (self.STEADY_S * self._rate))
        # One frame late, because the frame before a knock may belong to it.
        self._before[steady] += share * (self._last_turn[steady] - self._before[steady])
        self._last_turn[measured], self._moving = turn[measured], measured
        return ringing


class _Estimate(NamedTuple):
    number: int
    value: Array  # (n, k)
    covariance: Array  # (n, k, k)


class SlipTest:
    """Tests the calibration of all sensors of a stream for changes.

    Args:
        columns: ``(n, 4)`` columns of each sensor among the shared variables: heading, then mounting.
        process_noise: ``(4,)`` their random walk, per √second.
        rate: frames per second.
        begin: number of the first frame whose estimates can be trusted.
    """

    # Least data of a calibration before sensors are tested: one from five seconds is 40° off at times.
    LEARNT_S = 9.0
    WINDOWS_S = (1.0, 2.0, 4.0)  # a gesture shows a slip within a second; a slow motion takes longer
    LEAST_SHARE = 0.2  # directions in which a window adds a smaller share of the information are not tested
    MODEL_DEG = 7.0  # model error during one kind of motion: soft tissue turns sensors by 4 to 7°
    EVIDENCE = 20.0  # squared standard deviations including that error: a turn of at least 31°
    ANGLE_DEG = 20.0  # of the mounting or heading, by the window alone
    CONFIRMED_S = 1.0  # a suspect's calibration is freed at once; it has moved if the estimate differs after this time
    CONFIRMING = 16.0  # squared standard deviations of a suspect; steps of feet reach 4
    REST_S = 1.0  # until a sensor whose calibration was freed is tested again

    def __init__(self, columns: np.ndarray, process_noise: Array, rate: float, begin: int) -> None:
        self._columns, self._wander, self._rate = columns, np.diag(process_noise**2), rate
        self._model = np.deg2rad(self.MODEL_DEG) ** 2 * np.eye(4)
        self._past: deque[_Estimate] = deque()
        self._suspects: dict[int, tuple[int, _Estimate]] = {}  # by sensor: first frame, and the estimate before it
        self._since = np.full(len(columns), begin)

    def restart(self, sensors: Sequence[int], number: int) -> None:
        """Pause the test of sensors whose calibration is freed at a frame, or depends on one that is."""
        self._since[list(sensors)] = number + round(self.REST_S * self._rate)

    def suspect(self, sensor: int, number: int) -> None:
        """Note that a sensor may have moved in a frame; its calibration is freed."""
        if self._past and sensor not in self._suspects:
            self._suspects[sensor] = number, self._past[-1]

    def confirmed(self, number: int, shared: Array, covariance: Array) -> list[int]:
        """Suspects that have moved; suspects are dropped after the test.

        Args:
            number: number of the newest frame.
            shared: ``(s,)`` estimate of the shared variables.
            covariance: ``(s, s)`` its covariance.
        """
        moved, newest = list[int](), self._estimate(number, shared, covariance)
        for sensor, (suspected_from, past) in list(self._suspects.items()):
            if number < suspected_from + self.CONFIRMED_S * self._rate:
                continue
            del self._suspects[sensor]
            turn = newest.value[sensor] - past.value[sensor]
            noise = newest.covariance[sensor] + past.covariance[sensor] + self._model
            angle = max(abs(turn[0]), float(np.linalg.norm(turn[1:])))
            evidence = turn @ np.linalg.solve(noise, turn)
            if angle > np.deg2rad(self.ANGLE_DEG) and evidence > self.CONFIRMING:
                moved.append(sensor)
        return moved

    def slipped(self, number: int, shared: Array, covariance: Array) -> int | None:
        """The sensor with the most evidence of a slip, a suspect from now on; None without one. Arguments as above."""
        newest = self._estimate(number, shared, covariance)
        evidence, trusted = np.zeros(len(self._columns)), [newest] * len(self._columns)
        for seconds in self.WINDOWS_S:
            begin = number - round(seconds * self._rate)
            past = next((estimate for estimate in reversed(self._past) if estimate.number <= begin), None)
            if past is not None:
                of_window = np.where(self._since <= past.number, self._evidence(past, newest), 0.0)
                for sensor in np.flatnonzero(of_window > evidence):
                    trusted[sensor] = past
                evidence = np.maximum(evidence, of_window)
        self._past.append(newest)
        while self._past[0].number < number - (max(self.WINDOWS_S) + 1.0) * self._rate:
            self._past.popleft()
        surest = int(np.argmax(evidence))
        if evidence[surest] <= self.EVIDENCE:
            return None
        self._suspects.setdefault(surest, (number, trusted[surest]))
        return surest

    def _estimate(self, number: int, shared: Array, covariance: Array) -> _Estimate:
        blocks = covariance[self._columns[:, :, None], self._columns[:, None, :]]
        return _Estimate(number, shared[self._columns], blocks)

    def _evidence(self, past: _Estimate, newest: _Estimate) -> Array:
        """Squared standard deviations ``(n,)`` between two estimates; 0 for turns too small for a slip."""
        prior = past.covariance + self._wander * (newest.number - past.number) / self._rate
        root = np.linalg.cholesky(prior)
        step = np.linalg.solve(root, (newest.value - past.value)[..., None])[..., 0]
        posterior = np.linalg.solve(root, np.linalg.solve(root, newest.covariance).swapaxes(1, 2))
        learnt, axes = np.linalg.eigh(np.eye(root.shape[1]) - (posterior + posterior.swapaxes(1, 2)) / 2)
        share = np.maximum(learnt, self.LEAST_SHARE)
        innovation = np.where(learnt > self.LEAST_SHARE, np.einsum("nij,ni->nj", axes, step) / share, 0.0)
        axes = root @ axes
        turn = np.einsum("nij,nj->ni", axes, innovation)
        noise = (axes / share[:, None, :]) @ axes.swapaxes(1, 2)
        angle = np.maximum(np.abs(turn[:, 0]), np.linalg.norm(turn[:, 1:], axis=1))
        sure = np.einsum("ni,ni->n", turn, np.linalg.solve(noise + self._model, turn[..., None])[..., 0])
        return np.where(angle > np.deg2rad(self.ANGLE_DEG), sure, 0.0)
