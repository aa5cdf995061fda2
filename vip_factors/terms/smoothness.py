"""Smoothness: joints that no sensor sees turn no faster than people turn them.

Six sensors leave thighs, upper arms and the trunk free between two poses that fit. Acceleration ties them together
over time, but its noise, summed twice, lets them wander; a Gaussian over their speed holds them:
``time · L Log(R(t)ᵀ R(t+1)) / step``, whitened. It is the pose prior's, ``Σ⁻¹ = Lᵀ L``, of rotation over a time instead
of from the mean: joints that deviate together turn together. The difference is taken on the group, for rotation vectors
jump at half a turn.
"""

from collections.abc import Iterator

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.terms.equations import JointEquations, Term
from vip_factors.terms.evaluation import WearerEvaluation


def turn_jacobians(turn: Array) -> tuple[Array, Array]:
    """Derivatives of ``Log(R(t)ᵀ R(t+1))`` ``(..., 3)`` by the rotation now and the one after, ``(..., 3, 3)``."""
    right = inverse_right_jacobian(turn)
    return -transpose(right), right  # the left one is the transpose


def equations(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor for each frame and its next."""
    problem, prior = at.problem, at.problem.prior
    settings = problem.settings.smoothness
    if not (problem.use_acceleration and settings.use):
        return
    R = at.state.R_parent_child[first.start : first.stop + 1, 1:]
    follows, scale = problem.frames.follows[first, None, None], settings.time / problem.frames.step
    turn = follows * log(transpose(R[:-1]) @ R[1:])
    residual = scale * turn.reshape(len(turn), -1) @ prior.whitening.T
    yield JointEquations(
        first.start, residual[:, None], 1.0, SQUARE, at.owner,
        lambda: tuple(follows[..., None] * J for J in turn_jacobians(turn)),
        scale * prior.whitening,
    )  # fmt: skip


SMOOTHNESS = Term("smoothness", 1, equations)
