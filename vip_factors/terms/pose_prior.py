"""Pose prior: joint rotations under a Gaussian learnt from motion capture, about the mean of this very recording.

The learnt Gaussian says how people differ *and* how they move. Its mean, believed in every frame anew, would bend the
knees of somebody who only stands. So the mean of a recording is a variable, and only that variable is held, once, to
the learnt mean: a hierarchical model. Where the mean is not free it stays the learnt one (thesis eq. 3.14).

With ``x = Log(R)`` of each joint: ``scale · L (x − m)``, of unit variance where the Gaussian holds (thesis eqs. 3.14,
3.28–3.29), and ``mean_scale · L (m − μ)``. By the mean the derivative is ``−scale · L``; with ``∂x/∂δ = J_r⁻¹(x)`` that
by the joints is ``scale · L`` times these, block by block.
"""

from collections.abc import Iterator

from vip_factors.factor_settings import SQUARE
from vip_factors.terms.equations import DenseEquations, JacobianBlock, JointEquations, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def pose_equations(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor a frame."""
    settings = at.problem.settings.pose_prior
    prior, x = at.problem.prior, at.joint_vectors(first)
    residual = settings.scale * (x.reshape(len(x), -1) - at.state.pose_mean) @ prior.whitening.T
    yield JointEquations(
        first.start, residual[:, None], 1.0, SQUARE, at.owner, lambda: (at.joint_jacobians(first),),
        settings.scale * prior.whitening, "pose_mean",
    )  # fmt: skip


def mean_equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor on the recording's mean pose."""
    if at.problem.free_pose_mean:
        prior, settings = at.problem.prior, at.problem.settings.pose_prior
        by_mean = settings.mean_scale * prior.whitening
        block = JacobianBlock(at.owner, "pose_mean", by_mean[None, None])
        yield from prior_equations(block, (by_mean @ (at.state.pose_mean - prior.mean))[None])


POSE_PRIOR = Term("pose prior", 0, pose_equations)
POSE_MEAN = Term.prior("pose mean", mean_equations)
