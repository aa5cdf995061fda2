"""Headings as numbers to draw: estimates and sigmas beside the truth, and what single frames say over time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, transpose, wrap_angle, yaw_of
from vip_factors.viz.drawn_scene import DrawnWearer


@dataclass(frozen=True)
class HeadingRow:
    """One sensor, in degrees: heading in the true world, its sigma (NaN if unknown), and the truth (NaN)."""

    sensor: str
    heading: float
    sigma: float
    truth: float

    @property
    def error(self) -> float:
        """Estimate less truth, wrapped."""
        return float(np.rad2deg(wrap_angle(np.deg2rad(self.heading - self.truth))))


def rows_of(wearer: DrawnWearer) -> Sequence[HeadingRow]:
    """Every sensor's heading, in the true world as far as that is known; empty without an estimate."""
    if wearer.estimate is None:
        return []
    truth = wearer.recording.truth.calibration if wearer.recording is not None and wearer.recording.truth else None
    rows = []
    for sensor, one in wearer.estimate.calibration.items():
        known = (truth or {}).get(sensor)
        true = np.nan if known is None else wrap_angle(known.heading)
        radians = (wrap_angle(one.heading - wearer.gauge_yaw), one.heading_sigma, true)
        rows.append(HeadingRow(sensor, *(float(np.rad2deg(value)) for value in radians)))
    return rows


def implied_headings(wearer: DrawnWearer) -> tuple[Array, dict[str, Array]] | None:
    """What single frames say of each heading, less the estimated one.

    In every frame the heading that would take the sensor's own orientation onto its bone as estimated: drift shows as
    a slope, a strap that slipped as a step. Of a heading that is estimated over time, less what it starts with.

    Returns:
        Times ``(T,)`` and by sensor ``(T,)`` degrees, NaN where the sensor has no samples; None without estimate or
        recording.
    """
    estimate, recording = wearer.estimate, wearer.recording
    if estimate is None or recording is None:
        return None
    motion, found = estimate.motion, {}
    sites = {site.sensor: site for site in recording.placement.sites}
    for sensor, one in estimate.calibration.items():
        imu = recording.imus.get(sensor)
        if imu is None or imu.R_inertial_sensor is None or sensor not in sites:
            continue
        R_world_sensor = motion.state.R_world_bone[:, sites[sensor].bone_index] @ one.R_bone_sensor
        R_inertial_sensor = interpolate_rotations(imu.time, imu.R_inertial_sensor, motion.time)
        implied = yaw_of(R_world_sensor @ transpose(R_inertial_sensor))
        off = np.rad2deg(wrap_angle(implied - one.heading))
        after = np.clip(np.searchsorted(imu.time, motion.time), 0, len(imu.time) - 1)
        before = np.maximum(after - 1, 0)
        lost = np.minimum(np.abs(imu.time[after] - motion.time), np.abs(imu.time[before] - motion.time))
        found[sensor] = np.where(lost > 2 / motion.rate, np.nan, off)
    return motion.time, found


def heading_paths(wearer: DrawnWearer) -> dict[str, tuple[Array, Array]]:
    """Estimated headings that change with time, less what they start with: by sensor times and degrees ``(n,)``."""
    calibration = wearer.estimate.calibration if wearer.estimate is not None else {}
    return {
        sensor: (one.heading_time, np.rad2deg(one.heading_path - one.heading_path[0]))
        for sensor, one in calibration.items()
        if len(one.heading_path)
    }
