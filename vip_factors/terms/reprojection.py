"""Reprojection: where a point of the body appears in the image, against where the detector saw it.

With ``q = Rᵀ (p − c)`` in the camera's frame and ``J = ∂π/∂q`` of the lens: ``∂r/∂p = J Rᵀ``; a step ``(ω, v)`` of the
camera takes ``q`` to ``Exp(−ω) (q − v)``, so ``∂r/∂(ω, v) = J (hat(q), −1)``. The clock adds how fast the detection
moves.
"""

from dataclasses import dataclass, field

import numpy as np

from vip_factors.geometry.rotations import Array, hat, transpose
from vip_factors.ranges import NotNegative, Share
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.terms.adaptive_biweight import AdaptiveBiweightSettings
from vip_factors.terms.camera_pose import CameraPoses
from vip_factors.terms.robust import Loss, RobustLoss


@dataclass(frozen=True)
class ReprojectionSettings:
    """How exactly a detector sees."""

    # Standard deviation of a fully confident keypoint before anything is known of the detector, in OKS sigmas of that
    # keypoint times the square root of the person's area: OpenPose's scatter is 0.5.
    spread: float = 0.5
    # The part of a detector's errors that lasts for longer than a correlation time is so many times what changes.
    persistence: NotNegative = 2.0
    adaptive: bool = True  # after a first fit the spread is that of the residuals: detectors differ
    least_px: NotNegative = 1.0  # detectors answer on a grid of a few pixels
    # m: joint centres, clothes and a detector's habits are no better known, however sharply it sees; without it perfect
    # keypoints bend the body.
    point_sigma: NotNegative = 0.015
    least_confidence: Share = 0.1  # below it detectors guess
    # px, standard deviation of every fully confident keypoint alike; none: by its OKS sigma and the person's size.
    fixed_px: float | None = None
    biweight: AdaptiveBiweightSettings = field(default_factory=AdaptiveBiweightSettings)
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # left and right swap, limbs hide


def reprojection_residual(
    p_world_point: Array, camera: CameraPoses, model: CameraModel, pixels: Array
) -> tuple[Array, Array]:
    """Projected less detected pixels (thesis eqs. 4.6, 4.30).

    Args:
        p_world_point: ``(T, K, 3)`` metres.
        camera: at the ``T`` frames.
        model: its intrinsics.
        pixels: ``(T, K, 2)`` as detected, in the distorted image.

    Returns:
        Residuals ``(T, K, 2)`` in pixels, and the points ``(T, K, 3)`` in the camera's frame.
    """
    p_camera = (p_world_point - camera.p_world_camera[:, None]) @ camera.R_world_camera  # rows times R are Rᵀ p
    return model.project(p_camera) - pixels, p_camera


def reprojection_jacobians(p_camera: Array, camera: CameraPoses, model: CameraModel) -> tuple[Array, Array]:
    """Derivatives of :func:`reprojection_residual`.

    Returns:
        By the point's world position ``(T, K, 2, 3)`` and by the camera's tangent ``(T, K, 2, 6)``.
    """
    _, J = model.project_with_jacobian(p_camera)
    by_point = J @ transpose(camera.R_world_camera)[:, None]
    return by_point, np.concatenate([J @ hat(p_camera), -J], axis=3)
