"""Noisy little problems at random states, in which every kind of factor acts."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from linear import dense

from vip_factors.assembly.objective import SceneObjective
from vip_factors.assembly.system import SceneSystem, Steps
from vip_factors.body.anthropometry import likely_body
from vip_factors.body.joint_priors import HINGE_VARIABLES, load_joint_limits, load_pose_prior
from vip_factors.body.keypoints import OFFSET_KEYPOINTS, keypoint_set
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.skeleton import held_pose, joint_index
from vip_factors.factor_settings import CameraFactorSettings, FactorSettings
from vip_factors.geometry.rotations import exp
from vip_factors.problem.scene import CameraProblem, Foot, GroundView, KeypointView, SceneProblem
from vip_factors.problem.state import CameraPoses, CameraState, DetectorState, SceneState, WearerState
from vip_factors.problem.wearer import BodyPoint, InitialPose, WearerProblem
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.camera import CameraModel, Odometry
from vip_factors.sensors.frames import ImuFrames, resample
from vip_factors.sensors.recording import Recording
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.terms.ground_contact import pixel_rays
from vip_factors.terms.registry import unfilmed_problem

T, S = 5, 6


SILENCES = [(2,), (0,), (3, 4)]  # frames in which no sensor measured anything: within, at the start, at the end


class WearerObjective:
    """One wearer whom no camera sees, as an objective of their state."""

    def __init__(self, problem: WearerProblem, chunk: int = 32) -> None:
        self.problem, self.scene = problem, SceneObjective(unfilmed_problem([problem]), chunk=chunk)

    def cost(self, state: WearerState) -> Mapping[str, float]:
        return self.scene.cost(SceneState.unfilmed([state]))

    def linearise(self, state: WearerState) -> SceneSystem:
        return self.scene.linearise(SceneState.unfilmed([state]))

    def dense(self, state: WearerState) -> tuple[np.ndarray, np.ndarray]:
        return dense(self.scene, SceneState.unfilmed([state]))

    def retract(self, state: WearerState, steps: Steps) -> WearerState:
        return self.scene.retract(SceneState.unfilmed([state]), steps).wearers[0]


@cache
def gestured() -> Recording:
    motion = gestures(seconds=0.5)
    settings = SimulateSettings(gap_s=0.0, packet_loss=0.0)
    return simulate_recording(motion, preset("sip6", motion.skeleton), settings, seed=3)


def small_model(free: bool = True, silent: Sequence[int] = ()) -> tuple[WearerProblem, WearerState]:
    """A noisy little problem in which every kind of factor acts, at a random state; some frames may be silent."""
    motion = gestures(seconds=0.5)
    placement = gestured().placement
    frames = resample(gestured(), 20.0).window(slice(0, T))
    random = np.random.default_rng(1)
    valid = frames.orientation_valid.copy()
    valid[2, 1] = False
    valid[list(silent)] = False
    whole = frames.acceleration_valid.copy()
    for t in silent:
        whole[max(t - 1, 0) : t + 2] = False
    frames = replace(frames, orientation_valid=valid, acceleration_valid=whole)
    sites = [placement.site(name) for name in frames.sensors]
    ankle = joint_index("left_ankle")
    model = WearerProblem(
        motion.skeleton, load_pose_prior(), load_joint_limits(), frames,
        tuple(BodyPoint(site.bone_index, site.p_bone_sensor) for site in sites),
        np.zeros(S), np.full(S, 0.3), np.stack([site.R_bone_sensor for site in sites]), np.full(S, 0.5),
        FactorSettings(),
        initial_pose=InitialPose(held_pose("n-pose"), 2),
        contacts=(BodyPoint(ankle, np.array([0, -0.05, 0.1])),),
        contact_confidence=random.uniform(0, 1, (T, 1)),
        free_headings=free, free_mountings=free, free_pose_mean=free,
        variation=likely_body(1.75).variation, free_body=free, free_hinges=free, free_places=free,
        free_sole=free,
    )  # fmt: skip
    state = WearerState(
        exp(0.7 * random.standard_normal((T, 24, 3))),
        0.1 * random.standard_normal((T, 3)),
        random.standard_normal(S),
        model.prior_R_bone_sensor @ exp(0.2 * random.standard_normal((S, 3))),
        0.1 * random.standard_normal(69),
        sensor_positions=0.02 * np.random.default_rng(6).standard_normal((S, 3)) * free,
        sole=0.4 * free,
        hinges=(0.1 * np.random.default_rng(5).standard_normal(HINGE_VARIABLES)) * free,
        body=0.02 * np.random.default_rng(4).standard_normal(len(LENGTHS)) if free else np.zeros(len(LENGTHS)),
    )
    return model, state


R_WORLD_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks along the world's y, four metres away
KINDS = ["moving", "standing", "known path", "no IMU", "further cameras", "two carried"]


def small_scene(kind: str, silent: Sequence[int] = ()) -> tuple[SceneProblem, SceneState]:
    """Two wearers, a camera or several, and detections with noise, at a random state."""
    random = np.random.default_rng(7)
    first, state = small_model(silent=silent)
    second = replace(first, is_gauge=False)
    other = replace(state, p_world_pelvis=state.p_world_pelvis + np.array([0.8, 0.3, 0.0]))
    lens = CameraModel(1920, 1080, (1400.0, 1390.0), (950.0, 550.0), (-0.1, 0.02, 0.001, -0.002))
    count = 1 if kind == "standing" else T
    poses = CameraPoses(
        R_WORLD_CAMERA @ exp(0.05 * random.standard_normal((count, 3))),
        np.array([0.0, -4.0, 0.3]) + 0.05 * random.standard_normal((count, 3)),
    )
    measured = random.standard_normal((T, 1, 3))
    valid = np.ones((T, 1), bool)
    valid[3] = False
    imu = ImuFrames(("camera",), first.frames.time, exp(measured), valid, 5 * measured, valid)
    camera = CameraProblem(
        lens, kind != "standing", kind != "known path", None if kind == "no IMU" else imu,
        np.array([0.02, 0.03, -0.01]), 0.3, exp([0.1, 0.2, -0.1]), free_clock=True,
        clock_middle=0.05, focal_sigma=0.25, settings=CameraFactorSettings(),
        odometry=None if kind == "standing" else small_odometry(),
    )  # fmt: skip
    views = []
    for number, wearer in enumerate((state, other)):
        points = tuple(
            BodyPoint(place.bone, place.p_bone_point)
            for place in keypoint_set("coco17").on_body(first.skeleton)
            if place is not None
        )
        body = forward_kinematics(first.skeleton, wearer.R_parent_child, wearer.p_world_pelvis)
        p = np.stack([point.of(body) for point in points], axis=1)
        R, centre = poses.R_world_camera, poses.p_world_camera
        pixels = lens.project((p - centre[:, None]) @ R) + 10 * random.standard_normal((T, len(points), 2))
        seen = random.uniform(size=pixels.shape[:2]) < 0.8
        if number:
            seen[1] = False
        rate = 100 * random.standard_normal(pixels.shape)
        ground = standing_feet(lens, points, pixels, seen, random)
        sigma = random.uniform(3, 10, seen.shape)
        names = keypoint_set("coco17").keypoints
        views.append(
            KeypointView(
                points, pixels, sigma, 0.5 * sigma, seen, rate, ground=ground, names=names, clock=(0.004, -0.01)
            )
        )
    own = CameraState(poses, 0.4, exp([0.2, 0.1, 0.0]), 0.01, 0.02, 0.1, -0.2)
    cameras = [(camera, own, tuple(views))]
    if kind == "further cameras":
        cameras += [further_camera(camera, views, random, free_pose=free) for free in (False, True)]
    if kind == "two carried":
        cameras.append(
            (replace(camera, imu=None), replace(own, poses=poses.shifted(np.array([0.3, 0, 0]))), tuple(views))
        )
    problems, states, of_cameras = zip(*cameras, strict=True)
    model = SceneProblem((first, second), problems, of_cameras, free_keypoints=True)
    detector = DetectorState(0.02 * np.random.default_rng(8).standard_normal((len(OFFSET_KEYPOINTS), 3)))
    return model, SceneState((state, other), states, detector)


def small_odometry() -> Odometry:
    """A path of unknown scale, of which one step is missing."""
    random = np.random.default_rng(9)
    turns, shifts = 0.05 * random.standard_normal((T, 3)), 0.05 * random.standard_normal((T, 3))
    return Odometry(exp(turns), shifts, np.arange(T) != 1, is_scale_free=True)


def standing_feet(
    lens: CameraModel, points: tuple[BodyPoint, ...], pixels: np.ndarray, seen: np.ndarray, random: np.random.Generator
) -> GroundView:
    """Both feet, on the ground in some of the frames."""
    ankles = [joint_index("left_ankle"), joint_index("right_ankle")]
    columns = [next(k for k, point in enumerate(points) if point.bone == ankle) for ankle in ankles]
    sole = np.array([[0.0, -0.08, -0.05], [0.0, -0.07, 0.13]])
    feet = tuple(Foot(ankle, np.zeros(3), sole) for ankle in ankles)
    whitening = 2 * np.eye(3) + random.standard_normal((T, 2, 3, 3))
    return GroundView(feet, pixel_rays(lens, pixels[:, columns]), whitening, seen[:, columns])


def further_camera(
    camera: CameraProblem, views: list[KeypointView], random: np.random.Generator, free_pose: bool
) -> tuple[CameraProblem, CameraState, tuple[KeypointView, ...]]:
    """One that stands still beside the first one, with what was seen there moved a little."""
    position = np.array([[0.0, -4.0, 0.3]]) + 0.1 * random.standard_normal((1, 3))
    moved = tuple(
        replace(view, pixels=view.pixels + 5, seen=random.uniform(size=view.seen.shape) < 0.7) for view in views
    )
    problem = replace(camera, moving=False, free_pose=free_pose, imu=None)
    return problem, CameraState(CameraPoses(R_WORLD_CAMERA[None], position), zoom=-0.05, clock=0.02), moved


# Of the five frames, around which headings are the same.
DRIFTS = {"each frame": [0, 1, 2, 3, 4], "two frames": [0.5, 2.5, 4], "of other lengths": [1, 3.6]}


def drifting_model(times: str) -> tuple[WearerProblem, WearerState]:
    model, state = small_model()
    at = model.frames.time[0] + np.array(DRIFTS[times]) * model.frames.step
    settings = replace(model.settings, heading_walk=replace(model.settings.heading_walk, unknown_drift_deg=200.0))
    later = state.headings + 0.3 * np.random.default_rng(8).standard_normal((len(at) - 1, S))
    return replace(model, heading_times=at, settings=settings), replace(state, later_headings=later)


def drifting_scene(kind: str) -> tuple[SceneProblem, SceneState]:
    model, state = small_scene(kind)
    (first, own), (second, other) = drifting_model("two frames"), drifting_model("of other lengths")
    wearers = first, replace(model.wearers[1], heading_times=second.heading_times, settings=first.settings)
    model = replace(model, wearers=wearers)
    later = own.later_headings, other.later_headings
    states = tuple(replace(one, later_headings=two) for one, two in zip(state.wearers, later, strict=True))
    return model, replace(state, wearers=states)
