"""Smoothness: Gaussian prior on the angular velocity of joints, which bounds joints without a sensor.

The residual is ``time · L Log(R(t)ᵀ R(t+1)) / step``, with the pose prior's ``Σ⁻¹ = Lᵀ L``: joints that deviate
together turn together. The difference is taken on the group, since rotation vectors jump at half a turn.
"""

from collections.abc import Iterator

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.terms.equations import JointEquations, Term
from vip_factors.terms.evaluation import WearerEvaluation


def turn_jacobians(turn: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., 3, 3)`` of ``Log(R(t)ᵀ R(t+1))`` ``(..., 3)`` by the two rotations."""
    right = inverse_right_jacobian(turn)
    return -transpose(right), right  # the left Jacobian is the transpose


def equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[JointEquations]:
    """One factor for each frame and the next."""
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


SMOOTHNESS = Term("smoothness", 1, equations)
