"""Pose prior: joint rotations under a Gaussian learnt from motion capture, about the mean of this very recording.

The learnt Gaussian says how people differ *and* how they move. Its mean, believed in every frame anew, would bend the
knees of somebody who only stands. So the mean of a recording is a variable, and only that variable is held, once, to
the learnt mean: a hierarchical model. Where the mean is not free it stays the learnt one (thesis eq. 3.14).
"""

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

    scale: float = 0.15  # of the whitened residual: a pose lasts some 40 frames at 60 Hz, which are not 40 new poses
    mean_scale: float = 0.3  # of the recording's mean: a recording of one activity is off by more than one pose is


def joint_vector_jacobian(x: Array) -> Array:
    """Derivative of each joint's rotation vector by its own right perturbation, ``(T, 23, 3, 3)``."""
    return inverse_right_jacobian(x.reshape(len(x), -1, 3))


def pose_prior_residual(x: Array, mean: Array, prior: PosePrior, settings: PosePriorSettings) -> Array:
    """``scale · L (x − m)``, ``(T, 69)``, of unit variance where the Gaussian holds (thesis eqs. 3.14, 3.28–3.29).

    ``m`` ``(69,)`` is the mean of the recording; the derivative by it is ``−scale · L``.
    """
    return settings.scale * (x - mean) @ prior.whitening.T


def pose_mean_residual(mean: Array, prior: PosePrior, settings: PosePriorSettings) -> Array:
    """``mean_scale · L (m − μ)``, ``(69,)``: the recording's mean against the learnt one."""
    return settings.mean_scale * prior.whitening @ (mean - prior.mean)


def pose_mean_factor(mean_key: int, prior: PosePrior, settings: PosePriorSettings) -> gtsam.CustomFactor:
    """The GTSAM factor on the recording's mean."""
    L = settings.mean_scale * prior.whitening

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        return pose_mean_residual(values.atVector(mean_key), prior, settings), [L]

    return custom_factor("pose mean", gtsam.noiseModel.Unit.Create(69), [mean_key], [69], evaluate)


def pose_prior_factor(
    keys: FrameKeys, mean_key: int, prior: PosePrior, settings: PosePriorSettings
) -> gtsam.CustomFactor:
    """The GTSAM factor on joints 1 … 23 of one frame, and on the recording's mean."""
    joint_keys = [keys.joints[joint] for joint in range(1, 24)]
    L = settings.scale * prior.whitening

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        residual, blocks = _of_joints(values, joint_keys, values.atVector(mean_key), prior, settings)
        return residual, [*blocks, -L]

    return custom_factor(
        "pose prior", gtsam.noiseModel.Unit.Create(69), [*joint_keys, mean_key], [*[3] * 23, 69], evaluate
    )


def held_pose_prior_factor(
    keys: FrameKeys, mean: Array, prior: PosePrior, settings: PosePriorSettings
) -> gtsam.CustomFactor:
    """The same where the mean ``(69,)`` is no variable."""
    joint_keys = [keys.joints[joint] for joint in range(1, 24)]

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        return _of_joints(values, joint_keys, mean, prior, settings)

    return custom_factor("pose prior", gtsam.noiseModel.Unit.Create(69), joint_keys, [3] * 23, evaluate)


def _of_joints(
    values: gtsam.Values, joint_keys: list[int], mean: Array, prior: PosePrior, settings: PosePriorSettings
) -> tuple[Array, list[Array]]:
    """Residual ``(69,)``, and its derivatives ``(69, 3)`` by each joint."""
    R = np.stack([values.atRot3(key).matrix() for key in joint_keys])
    x, L = log(R).reshape(1, -1), settings.scale * prior.whitening
    blocks = L.reshape(69, 23, 3).swapaxes(0, 1) @ joint_vector_jacobian(x)[0]
    return pose_prior_residual(x, mean, prior, settings)[0], list(blocks)
