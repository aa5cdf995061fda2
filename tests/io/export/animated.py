"""Estimates that the tests of exports write, and where the joints of a file lie in the estimate's world."""

from functools import cache

import numpy as np
from scene_sample import estimate_of, scene_sample
from scipy.spatial.transform import Rotation

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.geometry.rotations import Array, exp
from vip_factors.sensors.scene import Scene

TENTH_MM = 1e-4
SMPL_PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)


@cache
def filmed() -> tuple[Scene, Estimate]:
    """Two people who walk past a camera that moves, and what is known of them: the truth."""
    scene = scene_sample(0.5)
    return scene, estimate_of(scene)


def any_pose(seed: int = 3, frames: int = 6) -> Estimate:
    """One person in poses that no body takes."""
    rng = np.random.default_rng(seed)
    R = exp(rng.normal(0, 1.5, (frames, 24, 3)))
    motion = Motion(skeleton_from_stature(1.62), R, rng.normal(0, 2, (frames, 3)), 29.97)
    return Estimate("poses", "VIP", (WearerEstimate("Ada", "VIP", motion, {}),))


def zup(p_yup: Array) -> Array:
    """Points ``(..., 3)`` of a world with Y up where the estimate has them."""
    x, y, z = np.moveaxis(np.asarray(p_yup, float), -1, 0)
    return np.stack([x, -z, y], axis=-1)


def smpl_joints(poses: Array, p_pelvis: Array, offsets: Array) -> Array:
    """Positions ``(T, 24, 3)`` of SMPL's joints by its pose vectors ``(T, 72)``, forward kinematics of our own."""
    R = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(-1, 24, 3, 3)
    p = np.repeat(p_pelvis[:, None], 24, axis=1)
    for joint, parent in enumerate(SMPL_PARENTS):
        if parent >= 0:
            p[:, joint] = p[:, parent] + R[:, parent] @ offsets[joint]
            R[:, joint] = R[:, parent] @ R[:, joint]
    return p
