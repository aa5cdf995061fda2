"""The terms on what a wearer's frames share, and the gauge: they count once, at the beginning."""

from collections.abc import Iterator

import numpy as np

from vip_factors.assembly.equations import AT_THE_FIRST_KNOT, DenseEquations, KnotEquations, Part
from vip_factors.assembly.evaluation import WearerEvaluation
from vip_factors.assembly.registry import Term
from vip_factors.geometry.rotations import inverse_right_jacobian
from vip_factors.terms.agreeing_headings import agreeing_headings_jacobian, agreeing_headings_residual
from vip_factors.terms.gauge_prior import gauge_prior_residual
from vip_factors.terms.heading_prior import heading_prior_residual
from vip_factors.terms.heading_walk import heading_walk_residual
from vip_factors.terms.pose_prior import pose_mean_residual
from vip_factors.terms.robust import SQUARE
from vip_factors.terms.rotation_prior import rotation_prior_residual


def _begins(at: WearerEvaluation, first: slice) -> bool:
    """Whether a stretch holds the very first frame, with which these terms come."""
    return at.problem.is_beginning and first.start == 0


def heading_prior(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor for each sensor: on its heading at the first knot, where it walks."""
    problem, sigmas = at.problem, at.problem.heading_sigmas
    if not (problem.free_headings and _begins(at, first)):
        return
    residual = heading_prior_residual(at.state.headings, problem.prior_headings) / sigmas
    part = Part(at.owner, "headings", (1 / sigmas)[None, :, None, None], each=True, ahead=AT_THE_FIRST_KNOT)
    yield DenseEquations("heading prior", 0, residual[None, :, None], 1.0, SQUARE, lambda: (part,))


def agreeing_headings(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor for each sensor, on the headings of all."""
    problem, settings, headings = at.problem, at.problem.settings.agreeing_headings, at.state.headings
    if settings.sigma is None or not (problem.free_headings and _begins(at, first)):
        return
    residual = agreeing_headings_residual(headings) / settings.sigma
    by_all = (agreeing_headings_jacobian(headings) / settings.sigma)[None, :, None]
    part = Part(at.owner, "headings", by_all, ahead=AT_THE_FIRST_KNOT)
    yield DenseEquations("agreeing headings", 0, residual[None, :, None], 1.0, settings.loss, lambda: (part,))


def heading_walk(at: WearerEvaluation, first: slice) -> Iterator[KnotEquations]:
    """One factor for each sensor, from each knot to the next."""
    problem, knots = at.problem, at.state.heading_knots
    if not (problem.free_headings and problem.headings_walk and _begins(at, first)):
        return
    root = 1 / problem.walk_sigmas
    residual = root * heading_walk_residual(knots[:-1], knots[1:])
    yield KnotEquations("heading walk", 0, residual[..., None], 1.0, SQUARE, at.owner, "headings", root)


def mounting_prior(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor for each sensor."""
    problem, sigma = at.problem, at.problem.mounting_sigma[:, None]
    if not (problem.free_mountings and _begins(at, first)):
        return
    error = rotation_prior_residual(at.state.R_bone_sensor, problem.prior_R_bone_sensor)
    yield DenseEquations(
        "mounting prior", 0, (error / sigma)[None], 1.0, SQUARE,
        lambda: (Part(at.owner, "R_bone_sensor", (inverse_right_jacobian(error) / sigma[..., None])[None], each=True),),
    )  # fmt: skip


def pose_mean(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the recording's mean pose."""
    problem, settings = at.problem, at.problem.settings.pose_prior
    if not (problem.free_pose_mean and _begins(at, first)):
        return
    residual = pose_mean_residual(at.state.pose_mean, problem.prior, settings)
    by_mean = (settings.mean_scale * problem.prior.whitening)[None, None]
    part = Part(at.owner, "pose_mean", by_mean)
    yield DenseEquations("pose mean", 0, residual[None, None], 1.0, SQUARE, lambda: (part,))


def body_prior(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the body's lengths: whitened changes under a Gaussian; linear."""
    variation = at.problem.variation
    if variation is None or not (at.problem.body_moves and _begins(at, first)):
        return
    residual = variation.whitening @ (at.state.body - variation.mean)
    part = Part(at.owner, "body", variation.whitening[None, None])
    yield DenseEquations("body prior", 0, residual[None, None], 1.0, SQUARE, lambda: (part,))


def hinge_prior(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the axes of elbows and knees: usual ones are the likeliest, or those found before; linear."""
    if not (at.problem.free_hinges and _begins(at, first)):
        return
    prior = at.problem.hinge_prior
    residual = prior.whitening @ (at.state.hinges - prior.mean)
    part = Part(at.owner, "hinges", prior.whitening[None, None])
    yield DenseEquations("hinge prior", 0, residual[None, None], 1.0, SQUARE, lambda: (part,))


def sensor_place_prior(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor for each sensor, in bone axes; linear."""
    if not (at.problem.free_places and _begins(at, first)):
        return
    whitening = at.problem.place_whitening
    residual = (whitening @ at.state.sensor_places[..., None])[None, ..., 0]
    part = Part(at.owner, "sensor_places", whitening[None], each=True)
    yield DenseEquations("sensor place prior", 0, residual, 1.0, SQUARE, lambda: (part,))


def sole_prior(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the logarithm of the sole's thickness; linear."""
    spread = at.problem.settings.sole.spread
    if not (at.problem.free_sole and _begins(at, first)):
        return
    part = Part(at.owner, "sole", np.ones((1, 1, 1, 1)) / spread)
    yield DenseEquations("sole prior", 0, np.full((1, 1, 1), at.state.sole / spread), 1.0, SQUARE, lambda: (part,))


def gauge_prior(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the root of the first frame, of each stretch if there are several."""
    problem, sigma = at.problem, at.problem.settings.gauge_prior.position_sigma
    if not (problem.use_acceleration and problem.is_gauge):
        return
    part = Part(at.owner, "root", np.eye(3)[None, None] / sigma)
    for frame, p_world in problem.placed_starts:
        if first.start <= frame < first.stop:
            residual = gauge_prior_residual(at.state.p_world_pelvis[frame], p_world) / sigma
            yield DenseEquations("gauge prior", frame, residual[None, None], 1.0, SQUARE, lambda: (part,))


PRIORS: tuple[Term[WearerEvaluation], ...] = (
    Term("heading prior", 0, heading_prior, every_frame=False),
    Term("agreeing headings", 0, agreeing_headings, every_frame=False),
    Term("heading walk", 0, heading_walk, every_frame=False),
    Term("mounting prior", 0, mounting_prior, every_frame=False),
    Term("pose mean", 0, pose_mean, every_frame=False),
    Term("body prior", 0, body_prior, every_frame=False),
    Term("hinge prior", 0, hinge_prior, every_frame=False),
    Term("sensor place prior", 0, sensor_place_prior, every_frame=False),
    Term("sole prior", 0, sole_prior, every_frame=False),
    Term("gauge prior", 0, gauge_prior, every_frame=False),
)
