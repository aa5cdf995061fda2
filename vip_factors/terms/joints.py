"""Joint rotations: their prior from motion capture, their speed and their limits.

All factors are on ``x = Log(R)`` of joints, with ``∂x/∂δ = J_r⁻¹(x)``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.terms.equations import DenseEquations, JacobianBlock, JointEquations, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def pose_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[JointEquations]:
    """Pose prior: one factor in each frame, ``scale · L (x − m)`` (thesis eqs. 3.14, 3.28–3.29).

    Joint rotations follow a Gaussian learned from motion capture, in a hierarchical model: the recording's mean pose
    ``m`` is a variable with one prior about the learned mean ``μ``, since ``μ`` in every frame would bend the knees of
    a person who stands. If the mean is not free it is ``μ``.
    """
    settings = wearer.problem.settings.pose_prior
    prior, x = wearer.problem.prior, wearer.joint_vectors(stretch)
    residual = settings.scale * (x.reshape(len(x), -1) - wearer.state.pose_mean) @ prior.whitening.T

    def by_joints() -> tuple[Array, ...]:
        return (wearer.joint_jacobians(stretch),)

    whitening = settings.scale * prior.whitening
    yield JointEquations(
        stretch.start, residual[:, None], 1.0, SQUARE, wearer.owner, by_joints, whitening, mean="pose_mean"
    )


def mean_equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """Pose mean: one factor on the recording's mean pose, ``mean_scale · L (m − μ)``."""
    if wearer.problem.free_pose_mean:
        prior, settings = wearer.problem.prior, wearer.problem.settings.pose_prior
        by_mean = settings.mean_scale * prior.whitening
        block = JacobianBlock(wearer.owner, "pose_mean", by_mean[None, None])
        yield from prior_equations(block, (by_mean @ (wearer.state.pose_mean - prior.mean))[None])


def turn_jacobians(turn: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., 3, 3)`` of ``Log(R(t)ᵀ R(t+1))`` ``(..., 3)`` by the two rotations."""
    right = inverse_right_jacobian(turn)
    return -transpose(right), right  # the left Jacobian is the transpose


def smoothness_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[JointEquations]:
    """Smoothness: one factor for each frame and the next, which bounds joints without a sensor.

    The residual is ``time · L Log(R(t)ᵀ R(t+1)) / step``, with the pose prior's ``Σ⁻¹ = Lᵀ L``: joints that deviate
    together turn together. The difference is taken on the group, since rotation vectors jump at half a turn.
    """
    problem, prior = wearer.problem, wearer.problem.prior
    settings = problem.settings.smoothness
    if not (problem.use_acceleration and settings.use):
        return
    R = wearer.state.R_parent_child[stretch.start : stretch.stop + 1, 1:]
    follows, scale = problem.frames.follows[stretch, None, None], settings.time / problem.frames.step
    turn = follows * log(transpose(R[:-1]) @ R[1:])
    residual = scale * turn.reshape(len(turn), -1) @ prior.whitening.T

    def by_joints() -> tuple[Array, ...]:
        return tuple(follows[..., None] * J for J in turn_jacobians(turn))

    whitening = scale * prior.whitening
    yield JointEquations(stretch.start, residual[:, None], 1.0, SQUARE, wearer.owner, by_joints, whitening)


def limit_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[JointEquations]:
    """Joint limit: one factor for each joint but the root, or for each of its axes.

    The residual is the distance of each coordinate of ``x`` from its range, radians (thesis eq. 3.15). Outside the
    range its derivative is the coordinate's row of ``J_r⁻¹(x)``.
    """
    settings = wearer.problem.settings.joint_limit
    x, sigma = wearer.joint_vectors(stretch), np.deg2rad(settings.sigma_deg)
    outside = wearer.problem.limits.violation(x.reshape(len(x), -1))
    residual = outside.reshape(len(x), -1, 1 if settings.per_axis else 3) / sigma
    outside_range = (outside != 0).reshape(*x.shape, 1)

    def by_joints() -> tuple[Array, ...]:
        return (outside_range * wearer.joint_jacobians(stretch) / sigma,)

    acts = bool(outside_range.any())
    yield JointEquations(stretch.start, residual, 1.0, settings.loss, wearer.owner, by_joints, acts=acts)


POSE_PRIOR = Term("pose prior", 0, pose_equations)
POSE_MEAN = Term.prior("pose mean", mean_equations)
SMOOTHNESS = Term("smoothness", 1, smoothness_equations)
JOINT_LIMIT = Term("joint limit", 0, limit_equations)
