"""Scenes whose errors are exactly what the factors assume: truth drawn from the priors, white noise on the rest.

On these the reported covariance has to be honest; what is left is the curvature of the problem and mistakes in it.
"""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_priors import POSE_SIZE, JointLimits, load_pose_prior
from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton
from vip_factors.factor_settings import CameraFactorSettings, FactorSettings, RobustLoss
from vip_factors.geometry.rotations import Array, exp, rotation_x, rotation_z, transpose
from vip_factors.problem.scene import CameraProblem, KeypointView, SceneProblem
from vip_factors.problem.state import CameraPoses, CameraState, SceneState, WearerState
from vip_factors.problem.wearer import BodyPoint, WearerProblem
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.frames import ImuFrames
from vip_factors.terms.acceleration import GRAVITY
from vip_factors.terms.camera_velocity import camera_velocity_sigmas
from vip_factors.terms.heading_prior import heading_sigmas

SQUARE = RobustLoss()
LENS = CameraModel(1920, 1080, (1660.0, 1660.0), (960.0, 540.0))
R_WORLD_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks along the world's y
P_WORLD_CAMERA = np.array([0.0, -5.0, 1.2])  # metres: a person of 1.8 m fills a third of the picture
P_CAMERA_IMU = np.array([0.03, 0.02, -0.015])


@dataclass(frozen=True)
class GaussianSettings:
    """Size of the problem, and the errors; those not named here are the factors' own."""

    frames: int = 20
    step: float = 0.1  # s
    moving: bool = False
    placement: str = "totalcapture13"
    keypoints: str = "body25"
    pixel_sigma: float = 5.0  # of every keypoint; a wrist's in a picture of this size
    unseen: float = 0.2  # share of keypoints
    heading_sigma_deg: float = 15.0  # of the prior headings, except that which defines the world
    mounting_sigma_deg: float = 8.0  # of the prior mountings
    pose_scale: float = 3.0  # of the whitened pose prior: poses that differ by a third of what people's do
    turn_sigma_deg_s: float = 15.0  # of the moving camera
    speed_sigma: float = 0.3  # m/s
    orientation_sigma_deg: float = 4.0  # of the body's sensors, as the orientation factor's default
    # Of all sigmas above (but the poses' and the camera's ways): a smaller one leaves less to the problem's curvature.
    noise: float = 1.0


@dataclass(frozen=True)
class GaussianScene:
    """A problem and the state that its measurements were made of."""

    model: SceneProblem
    truth: SceneState


def gaussian_scene(settings: GaussianSettings, seed: int) -> GaussianScene:
    """A wearer who takes poses drawn from the prior on a path in front of the camera, measured with white noise."""
    random = np.random.default_rng([seed, 0x6A55])
    skeleton = skeleton_from_stature(1.75)
    wearer = _wearer(settings, skeleton, random)
    body = forward_kinematics(skeleton, wearer[1].R_parent_child, wearer[1].p_world_pelvis)
    model = _measured(wearer[0], wearer[1], body, random)
    camera, state = _camera(settings, random)
    view = _view(settings, model, body, state, random)
    return GaussianScene(SceneProblem((model,), (camera,), ((view,),)), SceneState((wearer[1],), (state,)))


def _factor_settings(settings: GaussianSettings) -> FactorSettings:
    factors = FactorSettings()
    return replace(
        factors,
        correlation_s=settings.step,  # noise that is new in every frame
        orientation=replace(
            factors.orientation, loss=SQUARE, sigma_deg=settings.noise * settings.orientation_sigma_deg
        ),
        acceleration=replace(factors.acceleration, loss=SQUARE, sigma=settings.noise * factors.acceleration.sigma),
        pose_prior=replace(factors.pose_prior, scale=settings.pose_scale),
        smoothness=replace(factors.smoothness, use=False),  # it is no distribution that poses can be drawn from
        heading_prior=replace(factors.heading_prior, least_sigma_deg=settings.noise * settings.heading_sigma_deg),
    )


def _wearer(
    settings: GaussianSettings, skeleton: Skeleton, random: np.random.Generator
) -> tuple[WearerProblem, WearerState]:
    """The problem with priors drawn about the truth, without measurements, and the truth."""
    T, placement = settings.frames, preset(settings.placement, skeleton)
    S, prior = len(placement.sites), load_pose_prior()
    x = prior.mean + random.standard_normal((T, POSE_SIZE)) @ np.linalg.inv(prior.whitening).T / settings.pose_scale
    R = np.empty((T, JOINT_COUNT, 3, 3))
    R[:, 1:] = exp(x.reshape(T, JOINT_COUNT - 1, 3))
    time = settings.step * np.arange(T, dtype=np.float64)
    R[:, 0] = rotation_z(0.8 * time + random.uniform(-np.pi, np.pi)) @ rotation_x(np.full(T, np.pi / 2))
    p = np.stack([0.4 * np.cos(time), 0.4 * np.sin(time), np.full(T, 0.95)], axis=1)
    mountings = np.stack([site.R_bone_sensor for site in placement.sites])
    truth = WearerState(R, p, random.uniform(-np.pi, np.pi, S), mountings, prior.mean)
    sigma = np.deg2rad(settings.noise * settings.mounting_sigma_deg)
    frames = ImuFrames(
        tuple(site.sensor for site in placement.sites), time, np.zeros((T, S, 3, 3)), np.ones((T, S), bool),
        np.zeros((T, S, 3)), np.ones((T, S), bool),
    )  # fmt: skip
    unlimited = np.full(POSE_SIZE, np.inf)
    model = WearerProblem(
        skeleton, prior, JointLimits(-unlimited, unlimited), frames,
        tuple(BodyPoint(site.bone_index, site.p_bone_sensor) for site in placement.sites),
        prior_headings=truth.headings, heading_sigma=np.zeros(S),
        prior_R_bone_sensor=mountings @ exp(-sigma * random.standard_normal((S, 3))),
        mounting_sigma=np.full(S, sigma), settings=_factor_settings(settings),
        contact_confidence=np.zeros((T, 0)), free_headings=True, free_mountings=True,
        gauge_sensor=[site.bone for site in placement.sites].index("pelvis"),
    )  # fmt: skip
    gauge = model.settings.gauge_prior.position_sigma * random.standard_normal(3)
    headings = truth.headings + heading_sigmas(model) * random.standard_normal(S)
    return replace(model, prior_headings=headings, p_world_start=p[0] + gauge), truth


def _measured(model: WearerProblem, truth: WearerState, body: BodyState, random: np.random.Generator) -> WearerProblem:
    """With what the sensors say: residuals of orientation and acceleration are the noise itself."""
    orientations, forces = [], []
    step, settings = model.frames.step, model.settings
    for s, sensor in enumerate(model.sensors):
        R_world_inertial = rotation_z(truth.headings[s])
        noise = settings.orientation.sigma * random.standard_normal((len(model.frames), 3))
        R_world_sensor = exp(-noise) @ body.R_world_bone[:, sensor.bone] @ truth.R_bone_sensor[s]
        orientations.append(R_world_inertial.T @ R_world_sensor)
        forces.append(_force(sensor.of(body), step, settings.acceleration.sigma, random) @ R_world_inertial)
    inside = np.ones((len(model.frames), len(model.sensors)), bool)
    inside[[0, -1]] = False
    frames = replace(
        model.frames, R_inertial_sensor=np.stack(orientations, axis=1),
        specific_force_inertial=np.stack(forces, axis=1), acceleration_valid=inside,
    )  # fmt: skip
    return replace(model, frames=frames)


def _force(p_world: Array, step: float, sigma: float, random: np.random.Generator) -> Array:
    """Specific force ``(T, 3)`` in the world, by second differences of the positions; zero at both ends."""
    force = np.zeros_like(p_world)
    acceleration = (p_world[:-2] - 2 * p_world[1:-1] + p_world[2:]) / step**2
    force[1:-1] = acceleration - GRAVITY - sigma * random.standard_normal(acceleration.shape)
    return force


def _camera(settings: GaussianSettings, random: np.random.Generator) -> tuple[CameraProblem, CameraState]:
    """A standing camera without IMU, or one that wanders as its velocity factor supposes, with one."""
    factors = CameraFactorSettings()
    factors = replace(
        factors,
        correlation_s=settings.step,
        reprojection=replace(factors.reprojection, loss=SQUARE),
        orientation=replace(factors.orientation, loss=SQUARE, sigma_deg=settings.noise * factors.orientation.sigma_deg),
        acceleration=replace(factors.acceleration, loss=SQUARE, sigma=settings.noise * factors.acceleration.sigma),
        heading_sigma_deg=settings.noise * factors.heading_sigma_deg,
        velocity=replace(
            factors.velocity, loss=SQUARE, turn_sigma_deg_s=settings.turn_sigma_deg_s, speed_sigma=settings.speed_sigma
        ),
    )
    if not settings.moving:
        problem = CameraProblem(LENS, moving=False, settings=factors)
        return problem, CameraState(CameraPoses(R_WORLD_CAMERA[None], P_WORLD_CAMERA[None]))
    T, step = settings.frames, settings.step
    R, p = np.empty((T, 3, 3)), np.empty((T, 3))
    R[0], p[0] = R_WORLD_CAMERA, P_WORLD_CAMERA
    steps = step * camera_velocity_sigmas(factors.velocity) * random.standard_normal((T, 6))
    for t in range(1, T):  # a walk on a group: each step in the axes that the one before left
        R[t], p[t] = R[t - 1] @ exp(steps[t, :3]), p[t - 1] + R[t - 1] @ steps[t, 3:]
    poses, heading = CameraPoses(R, p), random.uniform(-np.pi, np.pi)
    sigma = np.deg2rad(settings.noise * settings.mounting_sigma_deg)
    R_camera_imu = np.diag([1.0, -1.0, -1.0])
    noise = np.deg2rad(factors.orientation.sigma_deg) * random.standard_normal((T, 3))
    R_imu = rotation_z(heading).T @ exp(-noise) @ R @ R_camera_imu
    force = _force(poses.point(P_CAMERA_IMU), step, factors.acceleration.sigma, random) @ rotation_z(heading)
    inside = np.ones((T, 1), bool)
    inside[[0, -1]] = False
    imu = ImuFrames(
        ("camera",),
        step * np.arange(T, dtype=np.float64),
        R_imu[:, None],
        np.ones((T, 1), bool),
        force[:, None],
        inside,
    )
    problem = CameraProblem(
        LENS, True, True, imu, P_CAMERA_IMU,
        prior_heading=heading + np.deg2rad(factors.heading_sigma_deg) * random.standard_normal(),
        prior_R_camera_imu=R_camera_imu @ exp(-sigma * random.standard_normal(3)), mounting_sigma=sigma,
        settings=factors,
    )  # fmt: skip
    return problem, CameraState(poses, heading, R_camera_imu)


def _view(
    settings: GaussianSettings, model: WearerProblem, body: BodyState, camera: CameraState, random: np.random.Generator
) -> KeypointView:
    places = keypoint_set(settings.keypoints).on_body(model.skeleton)
    points = tuple(BodyPoint(place.bone, place.p_bone_point) for place in places if place is not None)
    p_world = np.stack([point.of(body) for point in points], axis=1)
    poses = camera.at_frames(slice(0, len(p_world)))
    p_camera = np.einsum("tij,tkj->tki", transpose(poses.R_world_camera), p_world - poses.p_world_camera[:, None])
    pixels = LENS.project(p_camera)
    seen = (random.uniform(size=pixels.shape[:2]) >= settings.unseen) & LENS.inside(pixels)
    sigma = np.full(seen.shape, settings.noise * settings.pixel_sigma)
    pixels = pixels + sigma[..., None] * random.standard_normal(pixels.shape)
    return KeypointView(
        points, np.where(seen[..., None], pixels, 0.0), sigma, np.ones_like(sigma), seen, np.zeros_like(pixels)
    )
