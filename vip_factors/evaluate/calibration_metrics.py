"""Headings and mountings in the table: all sensors, and those of feet and hands apart from the rest.

Few keypoint sets have a point beyond ankle and wrist, so the camera says little about the headings of those sensors.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vip_factors.evaluate import consistency
from vip_factors.evaluate.calibration import CalibrationError, mean_and_95th
from vip_factors.evaluate.table import Metric
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.sensors.calibration import Calibration, Placement

ENDS = frozenset(f"{side}_{bone}" for side in ("left", "right") for bone in ("ankle", "foot", "wrist", "hand"))


def calibration_metrics(
    error: CalibrationError, estimate: Calibration, placement: Placement | None = None, mean_gauge: bool = False
) -> dict[str, Metric]:
    """Mean and 95th percentile of heading and mounting errors, and whether their sigmas are honest.

    Args:
        error: of the sensors that are compared.
        estimate: with the sigmas.
        placement: to tell the sensors of feet and hands from the rest.
        mean_gauge: whether the mean of the heading errors was removed. The sigmas are meant otherwise: one heading
            defines the world's, and those of the others are against it.
    """
    table = error_metrics([error])
    if placement is not None:
        ends = {site.sensor for site in placement.sites if site.bone in ENDS}
        rest = {site.sensor for site in placement.sites} - ends
        table |= error_metrics([error.of(ends)], "_feet_hands") | error_metrics([error.of(rest)], "_rest")
    table["yaw_gauge"] = Metric(float(np.rad2deg(error.gauge)), "deg")
    against = _against_the_surest(error, estimate) if mean_gauge else error
    if against.heading:
        table |= consistency_metrics("heading", consistency.heading_nees(against, estimate), 1)
    return table | consistency_metrics("mounting", consistency.mounting_nees(error, estimate), 3)


def _against_the_surest(error: CalibrationError, estimate: Calibration) -> CalibrationError:
    """Heading errors against that of the sensor that is surest of its own, which defines the world's; without it."""
    sigmas = {name: estimate[name].heading_sigma for name in error.heading}
    known = {name: sigma for name, sigma in sigmas.items() if np.isfinite(sigma)}
    if not known:
        return error
    surest = min(known, key=lambda name: known[name])
    heading = {name: float(wrap_angle(value - error.heading[surest])) for name, value in error.heading.items()}
    return replace(error, heading=heading).of([name for name in heading if name != surest])


def error_metrics(errors: list[CalibrationError], which: str = "") -> dict[str, Metric]:
    """Headings and mountings of all sensors in several calibrations together; empty if there is none."""
    errors = [error for error in errors if error.heading]
    if not errors:
        return {}
    table: dict[str, Metric] = {}
    for name, values in (
        ("heading_error", np.concatenate([error.heading_magnitude for error in errors])),
        ("mounting_error", np.concatenate([error.mounting_magnitude for error in errors])),
    ):
        mean, high = mean_and_95th(values)
        table |= {f"{name}{which}": Metric(mean, "deg"), f"{name}{which}_95th": Metric(high, "deg")}
    return table


def sensor_table(error: CalibrationError) -> dict[str, Mapping[str, float]]:
    """Per sensor: the signed heading error and the mounting error, in degrees."""
    return {
        name: {
            "heading_deg": float(np.rad2deg(error.heading[name])),
            "mounting_deg": float(np.rad2deg(np.linalg.norm(error.mounting[name]))),
        }
        for name in error.heading
    }


def consistency_metrics(what: str, values: Array, dimension: int) -> dict[str, Metric]:
    """NEES and coverage of values that are already over their dimension; empty if none is defined."""
    if not np.any(np.isfinite(values)):
        return {}
    result = consistency.summarise(values, dimension)
    return {f"nees_{what}": Metric(result.nees, ""), f"coverage_95_{what}": Metric(result.coverage_95, "")}
