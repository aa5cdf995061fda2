"""Errors of headings and mountings. Nobody publishes these; the definitions are ours."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, log, transpose, wrap_angle
from vip_factors.sensors.calibration import Calibration


@dataclass(frozen=True)
class CalibrationError:
    """Per sensor, estimate minus truth.

    Attributes:
        heading: radians, wrapped, the common yaw of all sensors removed.
        mounting: ``(3,)`` rad by sensor: ``R_true = R_estimated Exp(error)``, so about the sensor's axes.
        gauge: the yaw that was removed, radians: the whole estimate may stand turned about the vertical.
    """

    heading: Mapping[str, float]
    mounting: Mapping[str, Array]
    gauge: float

    @property
    def heading_magnitude(self) -> Array:
        """Absolute heading errors, radians."""
        return np.abs(np.array(list(self.heading.values())))

    @property
    def mounting_magnitude(self) -> Array:
        """Geodesic mounting errors, radians."""
        return np.linalg.norm(np.array(list(self.mounting.values())), axis=-1)

    def of(self, sensors: Collection[str]) -> "CalibrationError":
        """The errors of some sensors."""
        heading = {name: value for name, value in self.heading.items() if name in sensors}
        return CalibrationError(heading, {name: self.mounting[name] for name in heading}, self.gauge)


def share_sensors(estimate: Calibration, truth: Calibration) -> bool:
    """Whether there is a sensor that both know; a converted log calls by number what a simulation calls by site."""
    return any(name in truth for name in estimate)


def calibration_error(estimate: Calibration, truth: Calibration, gauge: float | None = None) -> CalibrationError:
    """Errors of the sensors that both know.

    Where the estimate's world is turned by a yaw g against the true one, every heading is g larger and no
    measurement can tell; g is ``gauge`` if given (that of a whole scene), else the circular mean of the differences.

    Raises:
        InputError: if they share no sensor.
    """
    sensors = [name for name in estimate if name in truth]
    if not sensors:
        raise InputError(f"calibrations share no sensor: estimated {sorted(estimate)}, true {sorted(truth)}")
    difference = np.array([estimate[name].heading - truth[name].heading for name in sensors])
    gauge = float(np.angle(np.exp(1j * difference).sum())) if gauge is None else gauge
    heading = wrap_angle(difference - gauge)
    R_estimated, R_true = (np.stack([side[name].R_bone_sensor for name in sensors]) for side in (estimate, truth))
    mounting = log(transpose(R_estimated) @ R_true)
    return CalibrationError(
        dict(zip(sensors, heading.tolist(), strict=True)), dict(zip(sensors, mounting, strict=True)), gauge
    )


def heading_error_over_time(
    estimate: Calibration, truth: Calibration, time: Array, gauge: float | None = None
) -> dict[str, Array]:
    """Heading errors ``(T,)`` in radians, wrapped, of the sensors that both know, at instants in seconds.

    The gauge is as in :func:`calibration_error`, one for all times.
    """
    difference = {n: estimate[n].heading_at(time) - truth[n].heading_at(time) for n in estimate if n in truth}
    if gauge is None:
        gauge = float(np.angle(sum(np.exp(1j * one).sum() for one in difference.values())))
    return {name: wrap_angle(one - gauge) for name, one in difference.items()}


def mean_and_95th(errors_rad: Array) -> tuple[float, float]:
    """Mean and 95th percentile in degrees of errors in radians."""
    degrees = np.rad2deg(errors_rad)
    return float(degrees.mean()), float(np.quantile(degrees, 0.95))
