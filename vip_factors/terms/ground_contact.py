"""Ground contact: the ankle minus the point where the ray of its pixel meets the floor (Kaichi et al. 2020, eq. 9).

The ray ends on the horizontal plane through the ankle of a foot whose sole stands on the floor at z = 0. In the paper
the plane passes through the solved ankle; with the height of the pose being solved, depth would be unobservable.
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
    """Rays ``(..., 3)`` of pixels ``(..., 2)``, in the camera's frame, with depth one."""
    flat = model.normalise(pixels)
    return np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)


def ground_contact_residual(p_world_ankle: Array, height: Array, camera: CameraPoses, ray: Array) -> Array:
    """Ankle minus the end of its ray, ``(T, 3)`` m, world axes; the last row is the height of the sole.

    ``height`` ``(T,)`` m is the ankle's height when the foot stands; ``ray`` ``(T, 3)`` is in the camera's frame.
    """
    d = np.einsum("tij,tj->ti", camera.R_world_camera, ray)
    length = (height - camera.p_world_camera[:, 2]) / d[:, 2]
    return p_world_ankle - camera.p_world_camera - length[:, None] * d


def ground_contact_jacobians(height: Array, camera: CameraPoses, ray: Array) -> tuple[Array, Array]:
    """Derivatives of :func:`ground_contact_residual`; that by the ankle is the identity.

    Returns:
        Derivatives by the height ``(T, 3)`` and by the camera's tangent ``(T, 3, 6)``.
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
    """Test which rays ``(T,)`` meet their planes in front of the camera, near enough and not too flat."""
    least_grazing_deg = 3.0  # on flatter rays a pixel is metres of floor
    farthest = 20.0  # m along the ray
    d = np.einsum("tij,tj->ti", camera.R_world_camera, ray)
    norm = np.linalg.norm(d, axis=1)
    steep = np.abs(d[:, 2]) >= norm * np.sin(np.deg2rad(least_grazing_deg))
    length = (height - camera.p_world_camera[:, 2]) / np.where(steep, d[:, 2], 1.0)
    return steep & (length > 0) & (length * norm <= farthest)


def ground_contact_whitening(
    height: Array,
    camera: CameraPoses,
    ray: Array,
    sigma_px: Array,
    model: CameraModel,
    confidence: Array,
    settings: GroundContactSettings,
) -> Array:
    """Whitening of the residual, ``(T, 3, 3)`` per metre: square root of the inverse covariance, world axes.

    With weighing by pixels, the covariance is that of the ray's end under noise of the pixel (``sigma_px`` ``(T,)``)
    and of the floor's height. Rays must meet the floor; ``confidence`` ``(T,)``, positive, divides the variance.
    """
    root = np.sqrt(confidence)[:, None, None]
    if settings.weighing is Weighing.DISTANCE:
        return root * np.eye(3) / settings.sigma
    slope, by_camera = ground_contact_jacobians(height, camera, ray)
    length = (height - camera.p_world_camera[:, 2]) / np.einsum("ti,ti->t", camera.R_world_camera[:, 2], ray)
    across = by_camera[:, :, 3:5] * (sigma_px * length)[:, None, None] / np.array(model.focal)
    # half @ half.T is the covariance
    half = np.concatenate([across, settings.floor_sigma * slope[:, :, None]], axis=2)
    return root * np.linalg.inv(half)


def acceleration_confidence(acceleration: Array, lowest: Array, settings: GroundContactSettings) -> Array:
    """Confidence that feet stand, ``(T, G)`` from 0 to 2: ``δ + min(1, β_G / (|a| + ε))`` (Kaichi et al. 2020, eq. 9).

    Args:
        acceleration: ``(T, G)`` m/s², norm of each foot's acceleration without gravity; NaN if it was not measured.
        lowest: ``(T, G)`` m, height of the lowest point of each foot; ``δ`` is one for the lowest foot.
        settings: of the factor.
    """
    still = np.minimum(1.0, settings.acceleration_scale / (acceleration + 1e-6))
    return (lowest == lowest.min(axis=1, keepdims=True)) + np.nan_to_num(still)


def equations(evaluation: ViewEvaluation, stretch: slice) -> Iterator[BoneEquations]:
    """One factor for each detected foot that stands."""
    ground = evaluation.view.ground
    if ground is None or not ground.stands[stretch].any():
        return
    settings = evaluation.camera.settings.ground_contact
    stands, bones = ground.stands[stretch], tuple(foot.bone for foot in ground.feet)
    residual, by_foot = np.zeros((*stands.shape, 3)), []
    for g in range(len(bones)):
        frames = np.flatnonzero(stands[:, g])
        residual[frames, g], derive = _foot_equations(evaluation, ground, g, stretch.start + frames)
        by_foot.append((frames, g, derive))

    def derivatives() -> tuple[Array, tuple[JacobianBlock, ...]]:
        by_twist, by_camera = np.zeros((2, *stands.shape, 3, 6))
        by_sole = np.zeros((*stands.shape, 3, 1))
        for frames, g, derive in by_foot:
            by_twist[frames, g], by_camera[frames, g], by_sole[frames, g] = derive()
        ankles = BodyPoints(bones, np.stack([foot.p_bone_ankle for foot in ground.feet]))
        # the height of a standing ankle does not depend on the body's lengths
        whitening = np.where(ground.stands[stretch, :, None, None], ground.whitening[stretch], 0.0)
        of_body = evaluation.wearer.body_blocks(evaluation.wearer.body.at(stretch), ankles, whitening)
        of_sole = (
            (JacobianBlock(evaluation.wearer.owner, "sole", by_sole),) if evaluation.wearer.problem.free_sole else ()
        )
        return by_twist, (JacobianBlock(evaluation.owner, "poses", by_camera), *of_body, *of_sole)

    yield BoneEquations(stretch.start, residual, stands, settings.loss, evaluation.wearer.owner, bones, derivatives)


def _foot_equations(
    evaluation: ViewEvaluation, ground: GroundView, number: int, frames: np.ndarray
) -> tuple[Array, Callable[[], tuple[Array, Array, Array]]]:
    """Whitened residuals ``(n, 3)`` of one foot in the frames in which it stands, and a function for derivatives.

    These are by the foot's twist, the camera's pose, both ``(n, 3, 6)``, and the sole ``(n, 3, 1)``.
    """
    foot, sole = ground.feet[number], evaluation.wearer.sole
    body = BodyState(evaluation.wearer.body.R_world_bone[frames], evaluation.wearer.body.p_world_joint[frames])
    poses, ray = evaluation.state.at_frames(slice(0, evaluation.frames)), ground.rays[frames, number]
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
