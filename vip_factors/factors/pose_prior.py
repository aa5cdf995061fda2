"""Pose prior: joint rotations under a Gaussian learnt from motion capture."""

from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.body.pose_prior import PosePrior
from vip_factors.factors.adapter import custom_factor
from vip_factors.factors.chain import FrameKeys
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log


@dataclass(frozen=True)
class PosePriorSettings:
    """How much the learnt Gaussian is believed."""

    scale: float = 1.0  # of the whitened residual: 1 takes the Gaussian at its word, for every frame by itself


def joint_vector(R_parent_child: Array) -> Array:
    """Stacked rotation vectors ``(T, 69)`` in radians of joints 1 … 23, from ``(T, 24, 3, 3)``."""
    return log(R_parent_child[:, 1:]).reshape(len(R_parent_child), -1)


def joint_vector_jacobian(x: Array) -> Array:
    """Derivative of each joint's rotation vector by its own right perturbation, ``(T, 23, 3, 3)``."""
    return inverse_right_jacobian(x.reshape(len(x), -1, 3))


def pose_prior_residual(x: Array, prior: PosePrior, settings: PosePriorSettings) -> Array:
    """``scale · L (x − μ)``, ``(T, 69)``, of unit variance where the Gaussian holds (thesis eqs. 3.14, 3.28–3.29)."""
    return settings.scale * (x - prior.mean) @ prior.whitening.T


def pose_prior_factor(keys: FrameKeys, prior: PosePrior, settings: PosePriorSettings) -> gtsam.CustomFactor:
    """The GTSAM factor on joints 1 … 23 of one frame."""
    joint_keys = [keys.joints[joint] for joint in range(1, 24)]
    L = settings.scale * prior.whitening

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        R = np.stack([values.atRot3(key).matrix() for key in joint_keys])
        x = log(R).reshape(1, -1)
        blocks = L.reshape(69, 23, 3).swapaxes(0, 1) @ joint_vector_jacobian(x)[0]
        return pose_prior_residual(x, prior, settings)[0], list(blocks)

    return custom_factor("pose prior", gtsam.noiseModel.Unit.Create(69), joint_keys, [3] * 23, evaluate)
