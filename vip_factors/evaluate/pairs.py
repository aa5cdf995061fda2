"""Where two wearers are, relative to each other."""

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.evaluate.metrics import MM
from vip_factors.geometry.poses import Alignment
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_path import MotionPair


def relative_position_error(one: MotionPair, other: MotionPair, gauge: Alignment) -> dict[str, float]:
    """Errors of the vector from one wearer's pelvis to the other's, in mm, over the time that both share.

    Of the gauge only the yaw is applied (a shift moves both). ``distance`` compares lengths alone, which no
    alignment touches. NaN if the two share no time.
    """
    time = _shared_time(one, other)
    estimated, true = (_path(second, time) - _path(first, time) for first, second in zip(one, other, strict=True))
    if not len(time):
        return dict.fromkeys(("relative_mm", "relative_95th_mm", "distance_mm", "distance_95th_mm"), float("nan"))
    vector = MM * np.linalg.norm(estimated @ gauge.R_target_source.T - true, axis=1)
    distance = MM * np.abs(np.linalg.norm(estimated, axis=1) - np.linalg.norm(true, axis=1))
    return {
        "relative_mm": float(vector.mean()),
        "relative_95th_mm": float(np.quantile(vector, 0.95)),
        "distance_mm": float(distance.mean()),
        "distance_95th_mm": float(np.quantile(distance, 0.95)),
    }


def _shared_time(one: MotionPair, other: MotionPair) -> Array:
    time = one[0].time
    return time[(time >= other[0].time[0] - 1e-6) & (time <= other[0].time[-1] + 1e-6)]


def _path(motion: Motion, time: Array) -> Array:
    return np.stack([np.interp(time, motion.time, axis) for axis in motion.p_world_pelvis.T], axis=1)
