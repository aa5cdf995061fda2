"""Gaussian priors on variables that all frames share, and on the position at which a scene starts."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.problem.variables import DETECTOR
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations, scalar_prior
from vip_factors.terms.evaluation import CameraEvaluation, WearerEvaluation


def body_equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """Body prior: one factor on the body's lengths, given the subject's stature, sex, mass and measured lengths.

    ``r = L_b (s − s₀)``, whitened changes of lengths under the subject's Gaussian over bodies
    (:class:`~vip_factors.body.lengths.BodyVariation`), ``factors.length_scale`` times as wide as its table's; linear.
    """
    variation = wearer.problem.variation
    if variation is not None and wearer.problem.body_moves:
        residual = variation.whitening @ (wearer.state.body - variation.mean)
        yield from prior_equations(JacobianBlock(wearer.owner, "body", variation.whitening[None, None]), residual[None])


def sole_equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """Sole prior: one factor on the thickness ``h`` of the shoes' soles.

    Contact points are points of the skeleton's barefoot foot, shifted by ``h`` down the foot's axis; keypoints are not
    shifted. The variable is ``x = ln(h / h₀)``, common to both feet, and ``r = x``.
    """
    if wearer.problem.free_sole:
        yield from scalar_prior(wearer.owner, "sole", wearer.state.sole, wearer.problem.settings.sole.spread)


def sensor_position_whitening(problem: WearerProblem) -> Array:
    """Whitening ``(S, 3, 3)`` per metre, with different standard deviations along and across limbs."""
    settings = problem.settings.sensor_place
    whitenings = []
    for bone in problem.sensor_points.bones:
        limb = problem.skeleton.limb(bone)
        if limb is None:
            whitenings.append(np.eye(3) / settings.elsewhere)
            continue
        length = float(np.linalg.norm(limb))
        along = np.outer(limb, limb) / length**2
        whitenings.append(along / (settings.along * length) + (np.eye(3) - along) / settings.across)
    return np.array(whitenings).reshape(-1, 3, 3)


def sensor_position_equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """Sensor position: one factor for each sensor on its position on the bone minus the declared one.

    ``r = s − s₀`` in bone axes, metres; linear. A wrong lever arm would bias the mounting: both have the same effect on
    the accelerations of a swinging limb.
    """
    if wearer.problem.free_places:
        whitening = sensor_position_whitening(wearer.problem)
        residual = (whitening @ wearer.state.sensor_positions[..., None])[..., 0]
        block = JacobianBlock(wearer.owner, "sensor_positions", whitening[None], is_per_factor=True)
        yield from prior_equations(block, residual)


def gauge_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """Gauge prior: one factor on the root in the first frame of each uninterrupted part of the recording.

    IMUs do not determine the position of the scene; the start is fixed by convention. The residual is the root's
    position minus the chosen one, metres; its derivative is the identity.
    """
    problem = wearer.problem
    if not (problem.use_acceleration and problem.is_gauge):
        return
    settings = problem.settings.gauge_prior
    block = JacobianBlock(wearer.owner, "root", np.eye(3)[None, None] / settings.position_sigma)
    for frame, p_world in problem.placed_starts:
        if stretch.start <= frame < stretch.stop:
            residual = (wearer.state.p_world_pelvis[frame] - p_world) / settings.position_sigma
            yield from prior_equations(block, residual[None], first_frame=frame)


def keypoint_offset_equations(camera: CameraEvaluation) -> Iterator[DenseEquations]:
    """Keypoint offset prior: one factor on a detector's "hip", "shoulder", "knee" … relative to the skeleton's.

    ``r = k − k₀`` in bone axes, metres, mirrored on the right side; linear; ``k₀`` is zero unless it was learned.
    Without these variables the constant bias of a detector would distort the body, the mountings and the camera. All
    cameras share the detector, so the factor counts with the first camera.
    """
    if camera.free_offsets and camera.offsets is not None and camera.number == 0:
        prior = camera.problem.prior_offsets
        sigmas = prior.sigma.ravel()
        block = JacobianBlock(DETECTOR, "keypoint_offsets", np.diag(1 / sigmas)[None, None])
        yield from prior_equations(block, ((camera.offsets - prior.mean).ravel() / sigmas)[None])


def clock_equations(camera: CameraEvaluation, block: str, sigma: str) -> Iterator[DenseEquations]:
    """Video clock: one factor on the clock's offset, or on its drift; ``sigma`` is the name of its setting.

    The image at the sensors' time ``t`` was taken ``Δ(t) = o + d (t − m)`` seconds later, with the offset ``o`` at the
    recording's middle ``m`` and the drift ``d``. A keypoint with velocity ``v`` px/s appears at ``z − v Δ(t)``, so a
    reprojection's residual has the derivatives ``v`` and ``v (t − m)``. The priors' residuals are ``o``, s, and ``d``,
    s/s.
    """
    if camera.problem.free_clock:
        settings = camera.problem.settings.clock
        yield from scalar_prior(camera.owner, block, getattr(camera.state, block), getattr(settings, sigma))


def lens_equations(camera: CameraEvaluation) -> Iterator[DenseEquations]:
    """Lens prior: one factor on the logarithm ``z`` of the focal length over its nominal value, if it is a variable.

    The residual is ``z / σ``. Both focal lengths are ``exp(z)`` times the nominal ones; principal point and distortion
    are constant.
    """
    if camera.problem.focal_sigma:
        yield from scalar_prior(camera.owner, "zoom", camera.state.zoom, camera.problem.focal_sigma)


BODY_PRIOR = Term.prior("body prior", body_equations)
SOLE_PRIOR = Term.prior("sole prior", sole_equations)
SENSOR_POSITION_PRIOR = Term.prior("sensor place prior", sensor_position_equations)
GAUGE_PRIOR = Term("gauge prior", 0, gauge_equations, every_frame=False)
KEYPOINT_OFFSET_PRIOR = Term.prior("keypoint offset prior", keypoint_offset_equations)
CLOCK_PRIOR = Term.prior("clock prior", partial(clock_equations, block="clock", sigma="offset_sigma"))
CLOCK_DRIFT_PRIOR = Term.prior("clock drift prior", partial(clock_equations, block="clock_drift", sigma="drift_sigma"))
LENS_PRIOR = Term.prior("lens prior", lens_equations)
