"""Sensors knocked round their bone, or with a heading set anew: they turn as no limb can."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.ranges import NotNegative

IMPACT = 3  # sensors knocked together: a landing


@dataclass(frozen=True)
class WatchSettings:
    """When a sensor is believed to have moved, and how much is forgotten of it then."""

    # °/s², of one sensor from frame to frame: 11° within a sixtieth of a second. A kick reaches 20 000; tissue that
    # rings after a step 160 000, so a knock alone says nothing yet.
    knock_deg_s2: float = 40_000.0
    knock_deg: float = 30.0  # by which a knocked sensor is still turned when it is quiet, if it has moved
    impact_s: float = 0.2  # within which three sensors or more are knocked by a landing: straps slip one by one
    quiet_s: NotNegative = 0.07  # without a knock: tissue rings at 8 Hz and more
    ringing_s: NotNegative = 0.5  # and no longer than that
    steady_s: NotNegative = 0.05  # over which a limb's turning is averaged: what it would have gone on with
    rest_s: NotNegative = 3.0  # after which the same sensor may be judged again: that long re-estimating takes
    settle_s: NotNegative = 2.0  # after a start nothing is judged: mountings are still being found
    heading_sigma_deg: float = 40.0  # how far a sensor set anew may point elsewhere
    mounting_sigma_deg: float = 30.0  # how far a strap slips


class Knocks(NamedTuple):
    """Sensors, by number: those not to be listened to in the newest frame, and those that have moved."""

    ringing: np.ndarray
    moved: np.ndarray


class SensorWatch:
    """Watches one wearer's sensors.

    Args:
        sensors: how many.
        settings: of the watch.
        rate: frames per second.
        begin: number of the frame that tracking began with.
    """

    def __init__(self, sensors: int, settings: WatchSettings, rate: float, begin: int) -> None:
        self._settings, self._rate, S = settings, rate, sensors
        self._since = np.full(S, begin + round(settings.settle_s * rate))
        self._last_turn, self._moving = np.zeros((S, 3)), np.zeros(S, bool)  # from frame to frame; whether it is known
        # Turning before a knock and in quiet frames after it, and in all frames since; frames since, −1: no knock.
        self._before, self._after, self._net = np.zeros((S, 3)), np.zeros((S, 3)), np.zeros((S, 3))
        self._frames, self._quiet = np.full(S, -1), np.zeros(S, int)
        self._knock = np.full(S, -(10**9))  # number of the last frame in which each was knocked

    def knocked(self, number: int, R_before: Array, R_now: Array, both: np.ndarray) -> Knocks:
        """Sensors that turn as no limb can, from the last frame to the newest one or a moment ago.

        Tissue rings after a step: what turns there and back has not moved. So a knocked sensor is not listened to until
        it is quiet, and has moved if it is still turned by then, against how its limb went on.

        Args:
            number: of the newest frame.
            R_before, R_now: ``(S, 3, 3)`` orientations in the sensors' inertial frames.
            both: ``(S,)`` whether both were measured.
        """
        settings = self._settings
        ringing = self._follow(number, log(R_now @ transpose(R_before)), both)
        ended = self._quiet >= settings.quiet_s * self._rate
        over = ringing & (ended | (self._frames > settings.ringing_s * self._rate))
        lately = number - self._frames - settings.impact_s * self._rate
        alone = np.sum(self._knock[:, None] >= lately, axis=0) < IMPACT
        far = np.linalg.norm(self._excess(), axis=1) > np.deg2rad(settings.knock_deg)
        moved = np.flatnonzero(over & far & alone & (number >= self._since))
        self._frames[over] = -1
        self._since[moved] = number + round(settings.rest_s * self._rate)
        return Knocks(np.flatnonzero(ringing & ~over), moved)

    def _follow(self, number: int, turn: Array, both: np.ndarray) -> np.ndarray:
        """Sum up turns from frame to frame ``(S, 3)``, radians; which sensors ``(S,)`` ring from a knock."""
        limit = np.deg2rad(self._settings.knock_deg_s2) / self._rate**2
        knocked = both & self._moving & (np.linalg.norm(turn - self._last_turn, axis=1) > limit)
        begins = knocked & (self._frames < 0)
        self._net[begins], self._frames[begins] = 0.0, 0
        self._quiet[knocked], self._after[knocked], self._knock[knocked] = 0, 0.0, number
        ringing = both & (self._frames >= 0)
        self._net[ringing] += turn[ringing]
        self._frames[ringing] += 1
        quiet, steady = ringing & ~knocked, both & ~ringing
        self._quiet[quiet] += 1
        self._after[quiet] += turn[quiet]
        share = 1 - np.exp(-1 / (self._settings.steady_s * self._rate))
        # One frame late: the one before a knock may belong to it.
        self._before[steady] += share * (self._last_turn[steady] - self._before[steady])
        self._last_turn[both], self._moving = turn[both], both
        return ringing

    def _excess(self) -> Array:
        """How far each has turned since its knock beyond what its limb did, whose turning went over evenly."""
        after = self._after / np.maximum(self._quiet, 1)[:, None]
        return self._net - self._frames[:, None] * (self._before + after) / 2
