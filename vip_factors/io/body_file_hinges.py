"""Elbows and knees in a body file.

::

    [hinges.left_knee] # carrying angle 2.8 ± 1.8°
    axis = [1.0, 0.0, 0.0]              # a unit vector in the bone above
    offset_deg = [2.8, 0.1]             # how far from a right angle to it the limb stays; of a knee also its front
    sigma_deg = [1.5, 3.8, 1.4, 2.2]    # of the axis's tilts towards two directions, then of the offsets
    correlations = [[1.0, …], …]        # of those, row by row
"""

from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.hinges import HINGE_OF, HingeEstimate
from vip_factors.errors import InputError
from vip_factors.io.toml_values import correlation_matrix, known_keys, nearest, numbers_at, table_at, toml_text

LEAST_COSINE = 0.5  # between an axis and the usual one: no joint turns about another, and tilts are small
LONGEST_SIGMA_DEG = 90.0


def hinge_lines(hinge: HingeEstimate) -> list[str]:
    """A table of its own, in degrees to four decimals."""
    sigma = np.sqrt(np.diag(hinge.covariance))
    correlations = np.round(hinge.covariance / np.maximum(np.outer(sigma, sigma), 1e-16), 5)
    angle, angle_sigma = np.rad2deg([hinge.carrying_angle, hinge.carrying_sigma])
    return [
        f"[hinges.{hinge.joint}] # carrying angle {angle:.1f} ± {angle_sigma:.1f}°",
        f"axis = {toml_text(np.round(hinge.axis, 8))}",
        f"offset_deg = {toml_text(np.round(np.rad2deg(hinge.variables[2:]), 4))}",
        f"sigma_deg = {toml_text(np.round(np.rad2deg(sigma), 4))}",
        f"correlations = {toml_text(correlations)}",
    ]


def hinge_at(path: Path, joint: str, value: Any) -> HingeEstimate:
    """The hinge of a table.

    Raises:
        InputError: for an unknown or missing key, or a value of the wrong kind.
    """
    where = f"hinges.{joint}"
    table = table_at(path, where, value)
    known_keys(path, where, table, ("axis", "offset_deg", "sigma_deg", "correlations"))
    if joint not in HINGE_OF:
        raise InputError(f"{path}: {where}: unknown joint '{joint}'{nearest(joint, HINGE_OF)}")
    hinge = HINGE_OF[joint]
    count = len(hinge.columns)
    axis = numbers_at(path, f"{where}.axis", table.get("axis"), 3)
    if not abs(np.linalg.norm(axis) - 1) < 1e-3:
        raise InputError(f"{path}: {where}.axis has length {np.linalg.norm(axis):g}: expected a unit vector")
    if hinge.axis @ axis < LEAST_COSINE:
        raise InputError(f"{path}: {where}.axis is {axis.tolist()}: expected one near {hinge.axis.tolist()}")
    offset = np.deg2rad(numbers_at(path, f"{where}.offset_deg", table.get("offset_deg"), count - 2))
    sigma = numbers_at(path, f"{where}.sigma_deg", table.get("sigma_deg"), count)
    if not np.all((sigma > 0) & (sigma <= LONGEST_SIGMA_DEG)):
        raise InputError(
            f"{path}: {where}.sigma_deg is {sigma.tolist()}: expected degrees, above 0 and at most "
            f"{LONGEST_SIGMA_DEG:g}"
        )
    rows = table.get("correlations")
    if not isinstance(rows, list) or len(rows) != count:
        raise InputError(f"{path}: {where}.correlations is {rows!r}: expected {count} rows of numbers")
    matrix = correlation_matrix(
        path, f"{where}.correlations", [numbers_at(path, f"{where}.correlations", row, count) for row in rows]
    )
    covariance = np.deg2rad(sigma)[:, None] * matrix * np.deg2rad(sigma)
    return HingeEstimate(joint, np.concatenate([hinge.tilt_to(axis), offset]), covariance)
