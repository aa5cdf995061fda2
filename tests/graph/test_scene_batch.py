"""The batched scene and its GTSAM graph are the same problem: moving, standing, known and further cameras."""

from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from test_batch import small_model

from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.factors.ground_contact import Foot, pixel_rays
from vip_factors.geometry.rotations import exp, rotation_z
from vip_factors.graph.keys import (
    camera_heading_key,
    camera_key,
    camera_mounting_key,
    clock_key,
    heading_key,
    joint_key,
    mounting_key,
    pose_mean_key,
    root_key,
)
from vip_factors.graph.model import BodyPoint
from vip_factors.graph.scene_batch import SceneObjective
from vip_factors.graph.scene_frame import scene_graph
from vip_factors.graph.scene_model import CameraProblem, GroundView, KeypointView, SceneModel, Viewpoint
from vip_factors.graph.scene_state import CameraState, SceneState
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.frames import ImuFrames
from vip_factors.solve.levenberg_marquardt import SolveSettings, levenberg_marquardt
from vip_factors.solve.marginals import chain_marginals, last_marginals

T, S = 5, 6
R_WORLD_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks along the world's y, four metres away
KINDS = ["moving", "standing", "known path", "no IMU", "further cameras"]


def small_scene(kind: str, silent: Sequence[int] = ()) -> tuple[SceneModel, SceneState]:
    """Two wearers, a camera, and detections with noise, at a random state."""
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
        views.append(KeypointView(points, pixels, sigma, seen, rate, ground=ground))
    further = tuple(known_camera(lens, views, random) for _ in range(2 if kind == "further cameras" else 0))
    model = SceneModel((first, second), camera, tuple(views), further)
    return model, SceneState((state, other), CameraState(poses, 0.4, exp([0.2, 0.1, 0.0]), 0.01))


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


def known_camera(lens: CameraModel, views: list[KeypointView], random: np.random.Generator) -> Viewpoint:
    """Beside the first one, with what was seen there moved a little."""
    position = np.array([[0.0, -4.0, 0.3]]) + 0.1 * random.standard_normal((1, 3))
    moved = tuple(
        replace(view, pixels=view.pixels + 5, seen=random.uniform(size=view.seen.shape) < 0.7) for view in views
    )
    problem = CameraProblem(lens, moving=False, free_pose=False)
    return Viewpoint(problem, CameraState(CameraPoses(R_WORLD_CAMERA[None], position)), moved)


def ordering_of(model: SceneModel) -> gtsam.Ordering:
    """GTSAM's keys in the order of the batched tangents: frame by frame, then what frames share."""
    keys, camera = [], model.camera
    for t in range(T):
        for wearer in range(2):
            keys += [*[joint_key(t, j, wearer) for j in range(24)], root_key(t, wearer)]
        if camera.moving and camera.free_pose:
            keys.append(camera_key(t))
    for wearer in range(2):
        keys += [heading_key(s, wearer) for s in range(S)]
        keys += [*[mounting_key(s, wearer) for s in range(S)], pose_mean_key(wearer)]
    if not camera.moving and camera.free_pose:
        keys.append(camera_key(0))
    if camera.imu is not None:
        keys += [camera_heading_key(), camera_mounting_key()]
    keys.append(clock_key())
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    return ordering


def batched_hessian(model: SceneModel, state: SceneState) -> tuple[np.ndarray, np.ndarray]:
    whole, order = gtsam.GaussianFactorGraph(), gtsam.Ordering()
    for graph, ordering in SceneObjective(model).linearise(state).stretches(0.0):
        whole.push_back(graph)
        for index in range(ordering.size()):
            order.push_back(ordering.at(index))
    return whole.hessian(order)


@pytest.mark.parametrize("kind", KINDS)
def test_the_cost_is_the_error_of_the_graph(kind: str) -> None:
    model, state = small_scene(kind)
    expected = scene_graph(model).error(state.to_values())
    assert sum(SceneObjective(model).cost(state).values()) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_the_normal_equations_are_those_of_the_graph(kind: str) -> None:
    model, state = small_scene(kind)
    linear = scene_graph(model).linearize(state.to_values())
    ordering = ordering_of(model)
    inside = {ordering.at(index) for index in range(ordering.size())}
    everything, fixed = gtsam.Ordering(ordering), sorted(set(linear.keyVector()) - inside)
    for key in fixed:
        everything.push_back(key)
    H, g = linear.hessian(everything)
    ours, our_g = batched_hessian(model, state)
    n = len(ours)
    assert len(H) - n == 6 * len(fixed)  # only poses of a known camera may be left out
    H, g = H[:n, :n], g[:n]
    scale = np.sqrt(np.outer(np.diag(H), np.diag(H)))
    np.testing.assert_allclose(ours / scale, H / scale, atol=1e-9)
    np.testing.assert_allclose(our_g, g, atol=1e-9 * np.abs(g).max())


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_turning_the_world_leaves_the_cost_alone(kind: str) -> None:
    model, state = small_scene(kind)
    wearers = tuple(replace(one, free_headings=False, p_world_start=np.zeros(3)) for one in model.wearers)
    model = replace(model, wearers=wearers)
    turn, poses = rotation_z(1.1), state.camera.poses
    moved = CameraPoses(turn @ poses.R_world_camera, poses.p_world_camera @ turn.T)
    camera = replace(state.camera, poses=moved, heading=state.camera.heading + 1.1)
    turned_state = SceneState(tuple(wearer.turned(1.1) for wearer in state.wearers), camera)
    costs = dict(SceneObjective(model).cost(state))
    turned = replace(
        model,
        camera=replace(model.camera, prior_heading=model.camera.prior_heading + 1.1),
        views=tuple(with_turned_ground(view, turn) for view in model.views),
    )
    assert dict(SceneObjective(turned).cost(turned_state)) == pytest.approx(costs, rel=1e-9)


def with_turned_ground(view: KeypointView, turn: np.ndarray) -> KeypointView:
    assert view.ground is not None
    return replace(view, ground=replace(view.ground, whitening=view.ground.whitening @ turn.T))


@pytest.mark.parametrize("kind", KINDS)
def test_a_step_lowers_the_cost_and_moves_what_is_free(kind: str) -> None:
    model, state = small_scene(kind)
    solved, report = levenberg_marquardt(SceneObjective(model), state, SolveSettings(max_iterations=5))
    assert sum(report.final_cost.values()) < 0.8 * sum(report.initial_cost.values())
    moved = np.abs(solved.camera.poses.p_world_camera - state.camera.poses.p_world_camera).max()
    assert (moved > 1e-6) == (kind != "known path")
    assert solved.camera.clock != state.camera.clock


def test_marginals_are_those_of_the_whole_problem() -> None:
    model, state = small_scene("moving")
    objective = SceneObjective(model)
    system = objective.linearise(state)
    H, _ = batched_hessian(model, state)
    covariance, marginals = np.linalg.inv(H), chain_marginals(system)
    start = 75 * 2  # the first frame of both wearers stands before the first pose of the camera
    block = covariance[start : start + 6, start : start + 6]
    np.testing.assert_allclose(marginals[objective.camera.frame_keys[0]], block, atol=1e-6 * np.abs(block).max())


@pytest.mark.parametrize("kind", KINDS)
def test_what_frames_share_has_its_covariance_from_the_last_elimination(kind: str) -> None:
    model, state = small_scene(kind)
    objective = SceneObjective(model)
    H, _ = batched_hessian(model, state)
    covariance = np.linalg.inv(H)
    marginals = last_marginals(objective.linearise(state), objective.static_keys)
    start = 2 * 75 * T + objective.camera.frame_width * T
    for key in objective.static_keys:
        stop = start + len(marginals[key])
        block = covariance[start:stop, start:stop]
        np.testing.assert_allclose(marginals[key], block, atol=1e-6 * np.abs(block).max())
        start = stop
    assert start == len(H)
