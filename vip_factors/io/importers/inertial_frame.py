"""Which way is up in a sensor's inertial frame: gravity in its own samples tells."""

import numpy as np

from vip_factors.geometry.rotations import Array

GRAVITY = 9.80665  # m/s², standard; what vendors subtract
UP = np.array([0.0, 0.0, 1.0])
# Averaged over a file, specific force points up to within a few degrees in every recording looked at.
TILT_LIMIT_DEG = 30.0
# Half a turn about x: the fixed rotation that puts a z-down frame upright.
R_UP_DOWN = np.diag([1.0, -1.0, -1.0])


def mean_force_inertial(R_inertial_sensor: Array, specific_force: Array) -> Array:
    """Average specific force ``(3,)`` m/s² in the inertial frame over the samples that are finite."""
    force = np.einsum("nij,nj->ni", R_inertial_sensor, specific_force)
    force = force[np.all(np.isfinite(force), axis=1)]
    return force.mean(axis=0) if len(force) else np.full(3, np.nan)


def tilt_of_up(R_inertial_sensor: Array, specific_force: Array) -> float:
    """Angle in degrees between the inertial frame's z axis and the average specific force; NaN if unknown."""
    force = mean_force_inertial(R_inertial_sensor, specific_force)
    length = np.linalg.norm(force)
    return float(np.rad2deg(np.arccos(np.clip(force[2] / length, -1, 1)))) if length > 0 else float("nan")


def z_up(name: str, R_inertial_sensor: Array, specific_force: Array) -> tuple[Array, list[str]]:
    """The orientations in a frame whose z is up, turned over if specific force says that z was down; and notes."""
    tilt = tilt_of_up(R_inertial_sensor, specific_force)
    if tilt > 180 - TILT_LIMIT_DEG:
        return R_UP_DOWN @ R_inertial_sensor, [f"{name}: its inertial frame had z down; turned by 180° about x"]
    if tilt > TILT_LIMIT_DEG:
        return R_inertial_sensor, [
            f"{name}: averaged specific force stands {tilt:.0f}° off the z axis of the orientation's frame: expected "
            "gravity along z; check that acceleration and orientation belong to the same sensor axes"
        ]
    return R_inertial_sensor, []
