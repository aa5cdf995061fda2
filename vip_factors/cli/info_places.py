"""What ``vip-factors info`` says of where sensors, and a detector's keypoints, were found on the bones."""

from collections.abc import Sequence

import numpy as np

from vip_factors.cli.text_table import aligned, with_sigma
from vip_factors.estimate import DetectorEstimate, SensorPlaceEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import SITES, site_axes

MM = 1e3
FORWARD, UP, LEFT = 2, 1, 0  # bone axes


def sensor_place_lines(places: Sequence[SensorPlaceEstimate]) -> list[str]:
    """A table: where each sensor was found, and where it was supposed; in bone axes, in millimetres."""
    rows: list[tuple[str, ...]] = [("sensor's place (mm; supposed)", "bone", "left", "up", "forward")]
    for one in places:
        cells = _cells((one.found, one.sigma), (one.prior, one.prior_sigma), (LEFT, UP, FORWARD))
        rows.append((one.sensor, one.bone, *cells))
    return aligned(rows, left=2) if places else []


def sites_text() -> str:
    """A table: every site by name, where it is, and the axes of a sensor there."""
    rows: list[tuple[str, ...]] = [("site", "where (from one joint to the next)", "x", "y", "z, out of the skin")]
    for name in SITES:
        where, axes = site_axes(name).split("; ")
        rows.append((name, where, *(one.partition(" ")[2] for one in axes.split(", "))))
    said = "left, right, up, down, front and back are the wearer's own, in a T-pose with the palms down"
    return "\n".join([*aligned(rows, left=5), said])


def detector_lines(detector: DetectorEstimate) -> list[str]:
    """A table: how far from where its table has it a detector puts each keypoint, of the left side, in millimetres."""
    rows: list[tuple[str, ...]] = [("keypoint's offset (mm; supposed)", "forward", "up", "outward")]
    for number, name in enumerate(detector.keypoints):
        found, prior = detector.found[number], detector.prior[number]
        sigma, prior_sigma = detector.sigma[number], detector.prior_sigma[number]
        rows.append((name, *_cells((found, sigma), (prior, prior_sigma), (FORWARD, UP, LEFT))))
    return aligned(rows, left=1)


def _cells(found: tuple[Array, Array], prior: tuple[Array, Array], axes: tuple[int, ...]) -> list[str]:
    """Text for each axis of values and standard deviations, both ``(3,)`` metres."""
    values, before = (MM * np.array(one) for one in (found, prior))
    return [
        f"{with_sigma(*values[:, axis])} ({with_sigma(before[0, axis], before[1, axis], sigma_decimals=0)})"
        for axis in axes
    ]
