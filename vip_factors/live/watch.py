"""Sensors that are no longer where they were: re-attached, knocked round their bone, or with a heading set anew."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.assembly.evaluation import WearerEvaluation
from vip_factors.assembly.wearer_terms import orientation
from vip_factors.body.kinematics import BodyState
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem


@dataclass(frozen=True)
class WatchSettings:
    """When a sensor is believed to have moved, and how much is forgotten of it then."""

    # °/s², of one sensor from frame to frame: 11° within a sixtieth of a second. A kick reaches 20 000.
    knock_deg_s2: float = 40_000.0
    angle_deg: float = 15.0  # of a sensor against its bone: four times what tissue and filters do
    memory_s: float = 0.4  # over which that is averaged: a knock passes, a strap that has turned stays
    rest_s: float = 3.0  # after which the same sensor may be judged again: that long re-estimating takes
    settle_s: float = 2.0  # after a start nothing is judged: mountings are still being found
    heading_sigma_deg: float = 40.0  # how far a sensor set anew may point elsewhere
    mounting_sigma_deg: float = 30.0  # how far a strap slips


class SensorWatch:
    """Watches one wearer's sensors.

    Args:
        model: the wearer's problem.
        settings: of the watch.
        rate: frames per second.
        every: how many frames lie between those that are judged.
        begin: number of the frame that tracking began with.
    """

    def __init__(self, model: WearerProblem, settings: WatchSettings, rate: float, every: int, begin: int) -> None:
        self._settings, self._rate, self._every = settings, rate, every
        self._mean = np.zeros((len(model.sensors), 3))
        self._since = np.full(len(model.sensors), begin + round(settings.settle_s * rate))
        self._turn = np.zeros((len(model.sensors), 3))  # from frame to frame, of late
        self._moving = np.zeros(len(model.sensors), bool)  # whether that is known
        self._sigma = model.settings.orientation.sigma

    def moved(self, number: int, model: WearerProblem, state: WearerState, body: BodyState) -> Sequence[int]:
        """Sensors that have moved, judged at a frame: ``model``, ``state`` and ``body`` hold it alone."""
        at = WearerEvaluation(0, model, state, body)
        residual = next(orientation(at, slice(0, 1))).residual[0] * self._sigma
        share = 1 - np.exp(-self._every / (self._settings.memory_s * self._rate))
        valid = model.frames.orientation_valid[0]
        self._mean[valid] += share * (residual[valid] - self._mean[valid])
        angle = np.linalg.norm(self._mean, axis=1)
        found = np.flatnonzero((angle > np.deg2rad(self._settings.angle_deg)) & (number >= self._since))
        self._since[found] = number + round(self._settings.rest_s * self._rate)
        self._mean[found] = 0.0
        return [int(sensor) for sensor in found]

    def jumped(self, number: int, R_before: Array, R_now: Array, both: np.ndarray) -> list[int]:
        """Sensors that turned as no limb can from the last frame to the newest one.

        Args:
            number: of the newest frame.
            R_before, R_now: ``(S, 3, 3)`` orientations in the sensors' inertial frames.
            both: ``(S,)`` whether both were measured.
        """
        turn = log(R_now @ transpose(R_before))
        limit = np.deg2rad(self._settings.knock_deg_s2) / self._rate**2
        knocked = both & (np.linalg.norm(turn - self._turn, axis=1) > limit)
        steady = both & ~knocked
        self._turn[steady] = turn[steady]  # the second half of a knock is not compared with its first
        found = np.flatnonzero(knocked & self._moving)
        self._moving = both
        self._since[found] = number + round(self._settings.rest_s * self._rate)
        self._mean[found] = 0.0
        return [int(sensor) for sensor in found]
