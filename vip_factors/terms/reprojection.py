"""Reprojection: where a point of the body appears in the image, against where the detector saw it.

With ``q = Rᵀ (p − c)`` in the camera's frame and ``J = ∂π/∂q`` of the lens: ``∂r/∂p = J Rᵀ``; a step ``(ω, v)`` of the
camera takes ``q`` to ``Exp(−ω) (q − v)``, so ``∂r/∂(ω, v) = J (hat(q), −1)``. The clock adds how fast the detection
moves. The derivative by the logarithm of the focal length is the pixel's distance from the principal point.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import AdaptiveBiweightSettings
from vip_factors.geometry.rotations import Array, hat, transpose
from vip_factors.problem.state import CameraPoses
from vip_factors.sensors.camera import CameraModel
from vip_factors.terms.equations import BoneEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import ViewEvaluation

K_OF_SIGMA = 2.0  # COCO's fall-off constants k are twice its OKS sigmas
PAPERS_WIDTH = 1920.0  # of the image in which the paper's scale is given


def reprojection_residual(
    p_world_point: Array, camera: CameraPoses, model: CameraModel, pixels: Array
) -> tuple[Array, Array]:
    """Projected less detected pixels ``(T, K, 2)`` (thesis eqs. 4.6, 4.30), and the points ``(T, K, 3)`` in the
    camera's frame.

    Pixels are as detected, in the distorted image; the camera is at the ``T`` frames.
    """
    p_camera = (p_world_point - camera.p_world_camera[:, None]) @ camera.R_world_camera  # rows times R are Rᵀ p
    return model.project(p_camera) - pixels, p_camera


def reprojection_jacobians(p_camera: Array, camera: CameraPoses, model: CameraModel) -> tuple[Array, Array]:
    """By the point's world position ``(T, K, 2, 3)`` and by the camera's tangent ``(T, K, 2, 6)``."""
    _, J = model.project_with_jacobian(p_camera)
    by_point = J @ transpose(camera.R_world_camera)[:, None]
    return by_point, np.concatenate([J @ hat(p_camera), -J], axis=3)


def adaptive_biweight(
    pixels: Array, predicted: Array, oks: Array, scale: Array, image_width: float, settings: AdaptiveBiweightSettings
) -> Array:
    """Weights in [0, 1], ``(..., K)``: ``exp(−d² / 2 s² k²)`` within ``β_d s k``, else zero.

    Args:
        pixels: ``(..., K, 2)`` as detected; NaN has no weight.
        predicted: ``(..., K, 2)`` where the body before (the last frame's, or the last solve's) would be seen; a
            keypoint of which nothing is known is NaN there, and has its full weight.
        oks: ``(K,)`` OKS sigmas.
        scale: ``(...)`` square root of the person's area in pixels.
        image_width: pixels.
        settings: of the weight.
    """
    fixed = settings.scale_px
    s = np.asarray(scale if fixed is None else np.full(np.shape(scale), fixed * image_width / PAPERS_WIDTH))
    away = np.linalg.norm(pixels - predicted, axis=-1) / (s[..., None] * K_OF_SIGMA * oks)
    with np.errstate(invalid="ignore"):
        weight = np.where(away <= settings.reach, np.exp(-0.5 * away**2), 0.0)
    return np.where(np.all(np.isfinite(predicted), axis=-1), weight, np.all(np.isfinite(pixels), axis=-1))


def equations(at: ViewEvaluation, first: slice) -> Iterator[BoneEquations]:
    """One factor for each keypoint that was seen."""
    view, lens = at.view, at.lens
    if not view.points:
        return
    settings = at.camera.settings.reprojection
    body, poses, points = at.wearer.body.at(first), at.state.at_frames(first), view.body_points
    p, sigma, speed = at.points_on(points).on(body), view.sigma[first, :, None], view.pixels_per_second[first]
    residual, p_camera = reprojection_residual(p, poses, lens, view.pixels[first])
    seen = view.seen[first]
    late = at.seconds_late(first)[:, None, None]
    whitened = np.where(seen[..., None], (residual + late * speed) / sigma, 0.0)

    def derivatives() -> tuple[Array, tuple[JacobianBlock, ...]]:
        by_point, by_camera = reprojection_jacobians(p_camera, poses, lens)
        by_twist = (by_point @ body.point_twists(p)) / sigma[..., None]
        return by_twist, (
            JacobianBlock(at.owner, "poses", by_camera / sigma[..., None]),
            *_clock_blocks(at, first, speed / sigma),
            *_zoom_blocks(at, residual + view.pixels[first], sigma),
            *at.wearer.body_blocks(body, points, by_point / sigma[..., None]),
            *at.offset_blocks(body, by_point / sigma[..., None]),
        )

    yield BoneEquations(first.start, whitened, seen, settings.loss, at.wearer.owner, points.bones, derivatives)


def _clock_blocks(at: ViewEvaluation, first: slice, speed: Array) -> tuple[JacobianBlock, ...]:
    """Derivatives of what moves at whitened speeds ``(t, n, 2)``, if the clock is a variable."""
    if not at.camera.free_clock:
        return ()
    by_drift = at.since_middle(first)[:, None, None] * speed
    return (
        JacobianBlock(at.owner, "clock", speed[..., None]),
        JacobianBlock(at.owner, "clock_drift", by_drift[..., None]),
    )


def _zoom_blocks(at: ViewEvaluation, projected: Array, sigma: Array) -> tuple[JacobianBlock, ...]:
    """Derivatives of projected pixels ``(t, n, 2)`` by the logarithm of the focal length, if that is a variable."""
    if not at.camera.focal_sigma:
        return ()
    return (JacobianBlock(at.owner, "zoom", ((projected - at.lens.centre) / sigma)[..., None]),)


def whitened_reprojections(at: ViewEvaluation) -> Array:
    """Whitened residuals ``(T, K, 2)`` in all frames, zero where nothing was seen."""
    everything = slice(0, at.frames)
    return next((one.residual for one in equations(at, everything)), np.zeros((at.frames, 0, 2)))


REPROJECTION = Term("reprojection", 0, equations)
