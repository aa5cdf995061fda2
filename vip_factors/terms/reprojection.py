"""Reprojection: projection of a body point minus its detection in the image.

With ``q = Rᵀ (p − c)`` in the camera's frame and ``J = ∂π/∂q`` of the lens: ``∂r/∂p = J Rᵀ``; a step ``(ω, v)`` of the
camera takes ``q`` to ``Exp(−ω) (q − v)``, so ``∂r/∂(ω, v) = J (hat(q), −1)``. The derivative by the clock is the
detection's velocity, that by the logarithm of the focal length is the pixel's offset from the principal point.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import AdaptiveBiweightSettings
from vip_factors.geometry.rotations import Array, hat, transpose
from vip_factors.problem.state import CameraPoses
from vip_factors.sensors.camera import CameraModel
from vip_factors.terms.equations import BoneEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import ViewEvaluation

FALLOFF_PER_SIGMA = 2.0  # COCO's fall-off constants k are twice its OKS sigmas
PAPERS_WIDTH = 1920.0  # px, image width to which the paper's scale refers


def reprojection_residual(
    p_world_point: Array, camera: CameraPoses, model: CameraModel, pixels: Array
) -> tuple[Array, Array]:
    """Projected minus detected pixels ``(T, K, 2)`` (thesis eqs. 4.6, 4.30).

    Pixels refer to the distorted image. Also returns the points ``(T, K, 3)`` in the camera's frame.
    """
    p_camera = (p_world_point - camera.p_world_camera[:, None]) @ camera.R_world_camera  # rows times R are Rᵀ p
    return model.project(p_camera) - pixels, p_camera


def reprojection_jacobians(p_camera: Array, camera: CameraPoses, model: CameraModel) -> tuple[Array, Array]:
    """Derivatives by the point's world position ``(T, K, 2, 3)`` and by the camera's tangent ``(T, K, 2, 6)``."""
    _, J = model.project_with_jacobian(p_camera)
    by_point = J @ transpose(camera.R_world_camera)[:, None]
    return by_point, np.concatenate([J @ hat(p_camera), -J], axis=3)


def adaptive_biweight(
    pixels: Array, predicted: Array, oks: Array, scale: Array, image_width: float, settings: AdaptiveBiweightSettings
) -> Array:
    """Weights in [0, 1], ``(..., K)``: ``exp(−d² / 2 s² k²)`` within ``β_d s k``, else zero.

    Args:
        pixels: ``(..., K, 2)`` as detected; NaN has no weight.
        predicted: ``(..., K, 2)`` from the previous frame's or solve's body; NaN if unknown, with full weight then.
        oks: ``(K,)`` OKS sigmas.
        scale: ``(...)`` square root of the person's area in pixels.
        image_width: pixels.
        settings: of the weight.
    """
    fixed = settings.scale_px
    s = np.asarray(scale if fixed is None else np.full(np.shape(scale), fixed * image_width / PAPERS_WIDTH))
    away = np.linalg.norm(pixels - predicted, axis=-1) / (s[..., None] * FALLOFF_PER_SIGMA * oks)
    with np.errstate(invalid="ignore"):
        weight = np.where(away <= settings.reach, np.exp(-0.5 * away**2), 0.0)
    return np.where(np.all(np.isfinite(predicted), axis=-1), weight, np.all(np.isfinite(pixels), axis=-1))


def equations(evaluation: ViewEvaluation, stretch: slice) -> Iterator[BoneEquations]:
    """One factor for each detected keypoint."""
    view, lens = evaluation.view, evaluation.lens
    if not view.points:
        return
    settings = evaluation.camera.settings.reprojection
    body, poses, points = evaluation.wearer.body.at(stretch), evaluation.state.at_frames(stretch), view.body_points
    p, sigma = evaluation.points_on(points).on(body), view.sigma[stretch, :, None]
    speed = view.pixels_per_second[stretch]
    residual, p_camera = reprojection_residual(p, poses, lens, view.pixels[stretch])
    is_detected = view.seen[stretch]
    late = evaluation.seconds_late(stretch)[:, None, None]
    whitened = np.where(is_detected[..., None], (residual + late * speed) / sigma, 0.0)

    def derivatives() -> tuple[Array, tuple[JacobianBlock, ...]]:
        by_point, by_camera = reprojection_jacobians(p_camera, poses, lens)
        by_twist = (by_point @ body.point_twists(p)) / sigma[..., None]
        return by_twist, (
            JacobianBlock(evaluation.owner, "poses", by_camera / sigma[..., None]),
            *_clock_blocks(evaluation, stretch, speed / sigma),
            *_zoom_blocks(evaluation, residual + view.pixels[stretch], sigma),
            *evaluation.wearer.body_blocks(body, points, by_point / sigma[..., None]),
            *evaluation.offset_blocks(body, by_point / sigma[..., None]),
        )

    owner = evaluation.wearer.owner
    yield BoneEquations(stretch.start, whitened, is_detected, settings.loss, owner, points.bones, derivatives)


def _clock_blocks(evaluation: ViewEvaluation, stretch: slice, speed: Array) -> tuple[JacobianBlock, ...]:
    """Derivatives by the clock, if it is a variable; ``speed`` ``(t, n, 2)`` is whitened."""
    if not evaluation.camera.free_clock:
        return ()
    by_drift = evaluation.since_middle(stretch)[:, None, None] * speed
    return (
        JacobianBlock(evaluation.owner, "clock", speed[..., None]),
        JacobianBlock(evaluation.owner, "clock_drift", by_drift[..., None]),
    )


def _zoom_blocks(evaluation: ViewEvaluation, projected: Array, sigma: Array) -> tuple[JacobianBlock, ...]:
    """Derivatives of projected pixels ``(t, n, 2)`` by the logarithm of the focal length, if it is a variable."""
    if not evaluation.camera.focal_sigma:
        return ()
    return (JacobianBlock(evaluation.owner, "zoom", ((projected - evaluation.lens.centre) / sigma)[..., None]),)


def whitened_reprojections(evaluation: ViewEvaluation) -> Array:
    """Whitened residuals ``(T, K, 2)`` of all frames, zero without a detection."""
    everything = slice(0, evaluation.frames)
    return next((block.residual for block in equations(evaluation, everything)), np.zeros((evaluation.frames, 0, 2)))


REPROJECTION = Term("reprojection", 0, equations)
