"""Pose prior: joint rotations under a Gaussian learnt from motion capture, about the mean pose of the recording.

A hierarchical model: the recording's mean pose ``m`` is a variable with one prior about the learnt mean ``μ``, since
``μ`` in every frame would bend the knees of a person who stands. If the mean is not free it is ``μ`` (thesis eq. 3.14).

With ``x = Log(R)`` of each joint, the residuals are ``scale · L (x − m)`` (thesis eqs. 3.14, 3.28–3.29) and
``mean_scale · L (m − μ)``, with ``∂x/∂δ = J_r⁻¹(x)``.
"""

from collections.abc import Iterator

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array
from vip_factors.terms.equations import DenseEquations, JacobianBlock, JointEquations, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def pose_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[JointEquations]:
    """One factor in each frame."""
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
    """One factor on the recording's mean pose."""
    if wearer.problem.free_pose_mean:
        prior, settings = wearer.problem.prior, wearer.problem.settings.pose_prior
        by_mean = settings.mean_scale * prior.whitening
        block = JacobianBlock(wearer.owner, "pose_mean", by_mean[None, None])
        yield from prior_equations(block, (by_mean @ (wearer.state.pose_mean - prior.mean))[None])


POSE_PRIOR = Term("pose prior", 0, pose_equations)
POSE_MEAN = Term.prior("pose mean", mean_equations)
