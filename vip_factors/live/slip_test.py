"""Whether a sensor has slipped, by what the last seconds say of its heading and mounting against what was known before.

The innovation test of Kalman filters, on what all frames share: from an earlier estimate ``x₀`` with covariance ``P₀``
to the newest one ``x`` with ``P`` a sensor's calibration moves by chance with covariance ``P₀ − P``, and the data since
then alone would have moved it by ``P₀ (P₀ − P)⁻¹ (x − x₀)``. Residuals do not show a slip: bones follow their sensors.
Willsky, Jones: A generalized likelihood ratio approach to the detection of jumps in linear systems, 1976.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.ranges import NotNegative, Share


@dataclass(frozen=True)
class SlipSettings:
    """When the last seconds contradict what was known of a sensor."""

    # of data that the calibration was found from, before anything is judged by it, or it is called unsettled: that of
    # five seconds is 40° off at times.
    learnt_s: float = 9.0
    windows_s: tuple[float, ...] = (1.0, 2.0, 4.0)  # a gesture shows a slip within one; a slow one takes longer
    # Directions in which the last seconds say less than this share of what is known by now are not judged.
    share: Share = 0.2
    # Squared standard deviations: four are expected of independent errors; those of limbs and cameras last for seconds.
    # Without a slip up to 36 were seen of turns as large; after one of 40°, 43 where little was known, else 400.
    evidence: float = 40.0
    angle_deg: float = 20.0  # of the mounting or heading, by the last seconds alone
    # A sensor that was knocked is estimated anew at once, and has moved if it is elsewhere by then.
    confirmed_s: NotNegative = 1.0
    confirming: float = 16.0  # squared standard deviations: it was suspected already; steps of feet reach 4
    rest_s: NotNegative = 1.0  # after which a sensor that is estimated anew can be judged again


class _Estimate(NamedTuple):
    number: int
    value: Array  # (n, k)
    covariance: Array  # (n, k, k)


class SlipTest:
    """Watches all sensors of a stream, estimate by estimate.

    Args:
        columns: of each sensor in the vector that all frames share, heading first, then its mounting: ``(n, 4)``.
        wander: ``(4,)`` how far each of them may wander, per √second.
        settings: of the test.
        rate: frames per second.
        begin: number of the first frame whose estimates can be trusted.
    """

    def __init__(self, columns: np.ndarray, wander: Array, settings: SlipSettings, rate: float, begin: int) -> None:
        self._columns, self._wander, self._settings, self._rate = columns, np.diag(wander**2), settings, rate
        self._past: deque[_Estimate] = deque()
        self._suspects: dict[int, tuple[int, _Estimate]] = {}  # by sensor: since which frame; what was known by then
        self._since = np.full(len(columns), begin)

    def forget(self, sensors: Sequence[int], number: int) -> None:
        """These sensors' calibrations are estimated anew from a frame on, or depend on one that is."""
        self._since[list(sensors)] = number + round(self._settings.rest_s * self._rate)

    def suspect(self, sensor: int, number: int) -> None:
        """A sensor may have moved in a frame, and is estimated anew: see where it goes."""
        if self._past and sensor not in self._suspects:
            self._suspects[sensor] = number, self._past[-1]

    def confirmed(self, number: int, shared: Array, covariance: Array) -> list[int]:
        """Suspects that have moved; those whose time is over are not suspected any more.

        Args:
            number: of the newest frame.
            shared: ``(s,)`` what all frames share, as estimated now.
            covariance: ``(s, s)`` of it.
        """
        found, now = list[int](), self._estimate(number, shared, covariance)
        for sensor, (since, before) in list(self._suspects.items()):
            if number < since + self._settings.confirmed_s * self._rate:
                continue
            del self._suspects[sensor]
            turn, both = now.value[sensor] - before.value[sensor], now.covariance[sensor] + before.covariance[sensor]
            angle = max(abs(turn[0]), float(np.linalg.norm(turn[1:])))
            evidence = turn @ np.linalg.solve(both, turn)
            if angle > np.deg2rad(self._settings.angle_deg) and evidence > self._settings.confirming:
                found.append(sensor)
        return found

    def slipped(self, number: int, shared: Array, covariance: Array) -> int | None:
        """The sensor that has slipped, if there is one: the surest of them. Arguments as above."""
        newest = self._estimate(number, shared, covariance)
        evidence = np.zeros(len(self._columns))
        for seconds in self._settings.windows_s:
            begin = number - round(seconds * self._rate)
            past = next((one for one in reversed(self._past) if one.number <= begin), None)
            if past is not None:
                judged = self._since <= past.number
                evidence = np.maximum(evidence, np.where(judged, self._evidence(past, newest), 0.0))
        self._past.append(newest)
        while self._past[0].number < number - (max(self._settings.windows_s) + 1.0) * self._rate:
            self._past.popleft()
        surest = int(np.argmax(evidence))
        return surest if evidence[surest] > self._settings.evidence else None

    def _estimate(self, number: int, shared: Array, covariance: Array) -> _Estimate:
        blocks = covariance[self._columns[:, :, None], self._columns[:, None, :]]
        return _Estimate(number, shared[self._columns], blocks)

    def _evidence(self, past: _Estimate, newest: _Estimate) -> Array:
        """Squared standard deviations ``(n,)`` between two estimates; 0 of turns too small to be a slip's."""
        before = past.covariance + self._wander * (newest.number - past.number) / self._rate
        root = np.linalg.cholesky(before)
        step = np.linalg.solve(root, (newest.value - past.value)[..., None])[..., 0]
        left = np.linalg.solve(root, np.linalg.solve(root, newest.covariance).swapaxes(1, 2))
        learnt, axes = np.linalg.eigh(np.eye(root.shape[1]) - (left + left.swapaxes(1, 2)) / 2)
        told = np.where(learnt > self._settings.share, np.einsum("nij,ni->nj", axes, step), 0.0)
        share = np.maximum(learnt, self._settings.share)
        turn = np.einsum("nij,njk,nk->ni", root, axes, told / share)
        angle = np.maximum(np.abs(turn[:, 0]), np.linalg.norm(turn[:, 1:], axis=1))
        return np.where(angle > np.deg2rad(self._settings.angle_deg), np.sum(told**2 / share, axis=1), 0.0)
