"""A motion in which every joint turns, and its estimate, for the formats of biomechanics."""

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, calibration_pose
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.geometry.rotations import exp, rotation_z

FRAMES, RATE = 40, 50.0


def sample_scene(covariance: bool = False) -> Estimate:
    """One wearer, from the third second on, all of whose joints turn by up to 25° while the body turns round."""
    rng = np.random.default_rng(11)
    phase, swing = rng.uniform(0, 6, (JOINT_COUNT, 3)), rng.uniform(-0.25, 0.25, (JOINT_COUNT, 3))
    time = np.arange(FRAMES) / RATE
    R = calibration_pose("n-pose") @ exp(swing * np.sin(4 * time[:, None, None] + phase))
    R[:, 0] = rotation_z(3 * time) @ R[:, 0]
    p = np.column_stack([np.sin(time), 0.5 + time, 0.95 + 0.02 * np.cos(time)])
    motion = Motion(skeleton_from_stature(1.8), R, p, RATE, start=3.0)
    spread = np.broadcast_to(0.0004 * np.eye(3), (FRAMES, JOINT_COUNT, 3, 3))
    known = PoseCovariance(spread, np.broadcast_to(0.0001 * np.eye(3), (FRAMES, 3, 3))) if covariance else None
    return Estimate("walk", "SIP", (WearerEstimate("Ada", "SIP", motion, {}, known),))
