"""Ground contact: the ankle against the point where the ray of its pixel meets the floor (Kaichi et al. 2020, eq. 9).

The ray ends on the plane on which an ankle lies whose sole stands on the floor at z = 0. The paper lets that plane
pass through "each ankle of the solved model": one that took its height from the pose being solved would cut every ray
at the ankle's own height and say nothing of depth, so it must be that of a foot which stands.
"""

from collections.abc import Callable, Iterator

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.factor_settings import GroundContactSettings, Weighing
from vip_factors.geometry.rotations import Array, hat
from vip_factors.problem.scene import GroundView
from vip_factors.problem.state import CameraPoses
from vip_factors.problem.wearer import BodyPoints
from vip_factors.sensors.camera import CameraModel
from vip_factors.terms.equations import BoneEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import ViewEvaluation


def pixel_rays(model: CameraModel, pixels: Array) -> Array:
    """Directions ``(..., 3)`` in the camera's frame, of depth one, of pixels ``(..., 2)``."""
    flat = model.normalise(pixels)
    return np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)


def ground_contact_residual(p_world_ankle: Array, height: Array, camera: CameraPoses, ray: Array) -> Array:
    """The ankle less the end of its ray, ``(T, 3)`` metres; the last row is how far the sole is off where it stands.

    ``height`` ``(T,)`` is what the ankle has where the foot stands, ``ray`` ``(T, 3)`` that of its pixel, in the
    camera's frame.
    """
    d = np.einsum("tij,tj->ti", camera.R_world_camera, ray)
    length = (height - camera.p_world_camera[:, 2]) / d[:, 2]
    return p_world_ankle - camera.p_world_camera - length[:, None] * d


def ground_contact_jacobians(height: Array, camera: CameraPoses, ray: Array) -> tuple[Array, Array]:
    """Derivatives of :func:`ground_contact_residual`; that by the ankle is the identity.

    Returns:
        By the height ``(T, 3)`` and by the camera's tangent ``(T, 3, 6)``.
    """
    R = camera.R_world_camera
    d = np.einsum("tij,tj->ti", R, ray)
    slope = d / d[:, 2:]
    length = (height - camera.p_world_camera[:, 2]) / d[:, 2]
    along = np.tile(np.eye(3), (len(d), 1, 1))  # projects onto the plane, along the ray
    along[:, :, 2] -= slope
    by_camera = np.concatenate([length[:, None, None] * (along @ R @ hat(ray)), -along @ R], axis=2)
    return -slope, by_camera


def rays_meet_floor(height: Array, camera: CameraPoses, ray: Array) -> np.ndarray:
    """Whether rays ``(T,)`` meet their planes in front of the camera, near enough and not too flat."""
    least_grazing_deg = 3.0  # a flatter ray meets the floor anywhere: a pixel is metres
    farthest = 20.0  # m along the ray
    d = np.einsum("tij,tj->ti", camera.R_world_camera, ray)
    norm = np.linalg.norm(d, axis=1)
    steep = np.abs(d[:, 2]) >= norm * np.sin(np.deg2rad(least_grazing_deg))
    length = (height - camera.p_world_camera[:, 2]) / np.where(steep, d[:, 2], 1.0)
    return steep & (length > 0) & (length * norm <= farthest)


def ground_contact_whitening(
    height: Array, camera: CameraPoses, ray: Array, sigma_px: Array, model: CameraModel, confidence: Array,
    settings: GroundContactSettings,
) -> Array:  # fmt: skip
    """What whitens the residual, ``(T, 3, 3)`` per metre: the square root of its inverse covariance, world axes.

    Weighed by pixels, the end of the ray moves by ``J σ_px`` with the pixel and along the ray with the floor's height:
    a pixel is ``depth / focal`` across the ray, and more along it by one over the sine of the grazing angle. Rays must
    meet the floor; ``sigma_px`` ``(T,)`` is the ankle's keypoint's; confidence ``(T,)``, positive, divides the
    variance.
    """
    root = np.sqrt(confidence)[:, None, None]
    if settings.weighing is Weighing.DISTANCE:
        return root * np.eye(3) / settings.sigma
    slope, by_camera = ground_contact_jacobians(height, camera, ray)
    length = (height - camera.p_world_camera[:, 2]) / np.einsum("ti,ti->t", camera.R_world_camera[:, 2], ray)
    across = by_camera[:, :, 3:5] * (sigma_px * length)[:, None, None] / np.array(model.focal)
    # Times its transpose the covariance, so that its inverse whitens.
    half = np.concatenate([across, settings.floor_sigma * slope[:, :, None]], axis=2)
    return root * np.linalg.inv(half)


def acceleration_confidence(acceleration: Array, lowest: Array, settings: GroundContactSettings) -> Array:
    """How surely feet stand, ``(T, G)`` from 0 to 2: ``δ + min(1, β_G / (|a| + ε))`` (Kaichi et al. 2020, eq. 9).

    Args:
        acceleration: ``(T, G)`` m/s², norms of each foot's acceleration *without gravity*: with it a foot at rest
            would have 9.81, and be believed half. NaN where it was not measured: then ``δ`` alone counts.
        lowest: ``(T, G)`` height of the lowest point of each foot; ``δ`` is one for the lowest foot.
        settings: of the factor.
    """
    still = np.minimum(1.0, settings.acceleration_scale / (acceleration + 1e-6))
    return (lowest == lowest.min(axis=1, keepdims=True)) + np.nan_to_num(still)


def equations(at: ViewEvaluation, first: slice) -> Iterator[BoneEquations]:
    """One factor for each foot that was seen to stand."""
    ground = at.view.ground
    if ground is None or not ground.stands[first].any():
        return
    settings = at.camera.settings.ground_contact
    stands, bones = ground.stands[first], tuple(foot.bone for foot in ground.feet)
    residual, by_foot = np.zeros((*stands.shape, 3)), []
    for g in range(len(bones)):
        frames = np.flatnonzero(stands[:, g])
        residual[frames, g], derive = _of_foot(at, ground, g, first.start + frames)
        by_foot.append((frames, g, derive))

    def derivatives() -> tuple[Array, tuple[JacobianBlock, ...]]:
        by_twist, by_camera = np.zeros((2, *stands.shape, 3, 6))
        by_sole = np.zeros((*stands.shape, 3, 1))
        for frames, g, derive in by_foot:
            by_twist[frames, g], by_camera[frames, g], by_sole[frames, g] = derive()
        ankles = BodyPoints(bones, np.stack([foot.p_bone_ankle for foot in ground.feet]))
        # By the ankles where they stand; the height of a standing one is its foot's alone.
        whitening = np.where(ground.stands[first, :, None, None], ground.whitening[first], 0.0)
        of_body = at.wearer.body_blocks(at.wearer.body.at(first), ankles, whitening)
        of_sole = (JacobianBlock(at.wearer.owner, "sole", by_sole),) if at.wearer.problem.free_sole else ()
        return by_twist, (JacobianBlock(at.owner, "poses", by_camera), *of_body, *of_sole)

    yield BoneEquations(first.start, residual, stands, settings.loss, at.wearer.owner, bones, derivatives)


def _of_foot(
    at: ViewEvaluation, ground: GroundView, number: int, frames: np.ndarray
) -> tuple[Array, Callable[[], tuple[Array, Array, Array]]]:
    """Residuals ``(n, 3)`` of one foot in the frames in which it stands, and what gives their derivatives.

    These are by the twist of the foot, the camera's pose, both ``(n, 3, 6)``, and the sole ``(n, 3, 1)``; all whitened.
    """
    foot, sole = ground.feet[number], at.wearer.sole
    body = BodyState(at.wearer.body.R_world_bone[frames], at.wearer.body.p_world_joint[frames])
    poses, ray = at.state.at_frames(slice(0, at.frames)), ground.rays[frames, number]
    camera = CameraPoses(poses.R_world_camera[frames], poses.p_world_camera[frames])
    whitening = ground.whitening[frames, number]
    p_world_ankle, height = foot.ankle(body, sole)
    residual = ground_contact_residual(p_world_ankle, height, camera, ray)

    def derivatives() -> tuple[Array, Array, Array]:
        by_height, by_camera = ground_contact_jacobians(height, camera, ray)
        by_twist = body.point_twists(p_world_ankle[:, None])[:, 0]
        by_twist[:, :, :3] += by_height[:, :, None] * foot.height_by_turn(body, sole)[:, None]
        by_sole = by_height * (sole * foot.height_by_sole(body))[:, None]
        return whitening @ by_twist, whitening @ by_camera, whitening @ by_sole[..., None]

    return (whitening @ residual[..., None])[..., 0], derivatives


GROUND_CONTACT = Term("ground contact", 0, equations)
