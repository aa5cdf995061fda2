"""The batched objective and the graph of GTSAM factors are the same problem."""

from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np
import pytest

from vip_factors.body.calibration_pose import calibration_pose
from vip_factors.body.joint_limits import load_joint_limits
from vip_factors.body.pose_prior import load_pose_prior
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import exp, rotation_z
from vip_factors.graph import batch
from vip_factors.graph.batch import BatchObjective
from vip_factors.graph.frame import nonlinear_graph
from vip_factors.graph.keys import heading_key, joint_key, mounting_key, pose_mean_key, root_key
from vip_factors.graph.model import BodyPoint, InertialModel, InitialPose
from vip_factors.graph.state import GraphState
from vip_factors.sensors.frames import resample
from vip_factors.sensors.placement import preset
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.solve.marginals import chain_marginals

T, S = 5, 6


SILENCES = [(2,), (0,), (3, 4)]  # frames in which no sensor measured anything: within, at the start, at the end


def small_model(free: bool = True, silent: Sequence[int] = ()) -> tuple[InertialModel, GraphState]:
    """A noisy little problem in which every kind of factor acts, at a random state; some frames may be silent."""
    motion = gestures(seconds=0.5)
    placement = preset("sip6", motion.skeleton)
    recording = simulate_recording(motion, placement, SimulateSettings(gap_s=0.0, packet_loss=0.0), seed=3)
    frames = resample(recording, 20.0).window(slice(0, T))
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
    model = InertialModel(
        motion.skeleton, load_pose_prior(), load_joint_limits(), frames,
        tuple(BodyPoint(site.bone_index, site.p_bone_sensor) for site in sites),
        np.zeros(S), np.full(S, 0.3), np.stack([site.R_bone_sensor for site in sites]), np.full(S, 0.5),
        initial_pose=InitialPose(calibration_pose("n-pose"), 2),
        contacts=(BodyPoint(ankle, np.array([0, -0.05, 0.1])),),
        contact_confidence=random.uniform(0, 1, (T, 1)),
        free_headings=free, free_mountings=free, free_pose_mean=free,
    )  # fmt: skip
    state = GraphState(
        exp(0.7 * random.standard_normal((T, 24, 3))),
        0.1 * random.standard_normal((T, 3)),
        random.standard_normal(S),
        model.prior_R_bone_sensor @ exp(0.2 * random.standard_normal((S, 3))),
        0.1 * random.standard_normal(69),
    )
    return model, state


def batch_columns(model: InertialModel) -> list[tuple[int, int]]:
    """GTSAM key and width of each block of the batched tangent, in order."""
    blocks = []
    for t in range(T):
        blocks += [(joint_key(t, j), 3) for j in range(24)] + [(root_key(t), 3)]
    if model.free_headings:
        blocks += [(heading_key(s), 1) for s in range(S)]
    if model.free_mountings:
        blocks += [(mounting_key(s), 3) for s in range(S)]
    if model.free_pose_mean:
        blocks += [(pose_mean_key(), 69)]
    return blocks


def batched_hessian(model: InertialModel, state: GraphState) -> tuple[np.ndarray, np.ndarray]:
    whole, order = gtsam.GaussianFactorGraph(), gtsam.Ordering()
    for graph, ordering in BatchObjective(model).linearise(state).stretches(0.0):
        whole.push_back(graph)
        for index in range(ordering.size()):
            order.push_back(ordering.at(index))
    return whole.hessian(order)


def with_limits(model: InertialModel, per_axis: bool) -> InertialModel:
    limit = replace(model.settings.joint_limit, per_axis=per_axis)
    return replace(model, settings=replace(model.settings, joint_limit=limit))


@pytest.mark.parametrize("per_axis", [False, True])
def test_the_cost_is_the_error_of_the_graph(per_axis: bool) -> None:
    model, state = small_model()
    assert_cost_of_the_graph(with_limits(model, per_axis), state)


@pytest.mark.parametrize("silent", SILENCES)
def test_where_nothing_was_measured_batch_and_graph_are_the_same_problem(silent: Sequence[int]) -> None:
    model, state = small_model(silent=silent)
    kinds = BatchObjective(model).cost(state)
    assert kinds["root coasting"] > 0
    assert kinds["pelvis turn"] > 0
    assert_cost_of_the_graph(model, state)
    assert_equations_of_the_graph(model, state)


@pytest.mark.parametrize("silent", SILENCES)
def test_frames_in_which_nothing_was_measured_are_determined(silent: Sequence[int]) -> None:
    model, state = small_model(free=False, silent=silent)
    held = np.arange(T)[:, None] == 0  # at the start alone: nothing else says how fast the wearer moves
    model = replace(model, contact_confidence=held.astype(float))
    covariance = chain_marginals(BatchObjective(model).linearise(state))
    sigmas = np.sqrt([np.diag(block) for block in covariance.values()])
    assert sigmas[:, :3].max() < 1.0  # rad
    assert sigmas[:, 72:].max() < 5.0  # m: a contact off by so much says little of the velocity
    coasting = replace(model.settings.coasting, use=False)
    without = replace(model, settings=replace(model.settings, coasting=coasting))
    with pytest.raises(SolveError):
        chain_marginals(BatchObjective(without).linearise(state))


def test_coasting_costs_nothing_where_something_was_measured() -> None:
    model, state = small_model()
    assert not {"root coasting", "pelvis turn"} & set(BatchObjective(model).cost(state))
    assert len(BatchObjective(model).sites.bones) == S + len(model.contacts)


def assert_cost_of_the_graph(model: InertialModel, state: GraphState) -> None:
    graph = nonlinear_graph(model)
    assert sum(BatchObjective(model).cost(state).values()) == pytest.approx(graph.error(state.to_values()), rel=1e-9)


@pytest.mark.parametrize("per_axis", [False, True])
def test_the_normal_equations_are_those_of_the_graph(per_axis: bool) -> None:
    model, state = small_model()
    assert_equations_of_the_graph(with_limits(model, per_axis), state)


def assert_equations_of_the_graph(model: InertialModel, state: GraphState) -> None:
    ordering = gtsam.Ordering()
    for key, _ in batch_columns(model):
        ordering.push_back(key)
    H, g = nonlinear_graph(model).linearize(state.to_values()).hessian(ordering)
    batched_H, batched_g = batched_hessian(model, state)
    scale = np.sqrt(np.outer(np.diag(H), np.diag(H)))
    np.testing.assert_allclose(batched_H / scale, H / scale, atol=1e-9)
    np.testing.assert_allclose(batched_g, g, atol=1e-9 * np.abs(g).max())


def test_fixed_calibration_leaves_its_columns_out() -> None:
    model, state = small_model(free=False)
    H, _ = batched_hessian(model, state)
    assert H.shape == (75 * T, 75 * T)


def test_retract_is_the_graphs_own() -> None:
    model, state = small_model()
    objective, random = BatchObjective(model), np.random.default_rng(5)
    delta = gtsam.VectorValues()
    for key in objective.frame_keys:
        delta.insert(key, 0.1 * random.standard_normal(75))
    delta.insert(objective.static_key, 0.1 * random.standard_normal(4 * S + 69))
    by_key = gtsam.VectorValues()
    for t, key in enumerate(objective.frame_keys):
        for j in range(24):
            by_key.insert(joint_key(t, j), delta.at(key)[3 * j : 3 * j + 3])
        by_key.insert(root_key(t), delta.at(key)[72:])
    static = delta.at(objective.static_key)
    for s in range(S):
        by_key.insert(heading_key(s), static[s : s + 1])
        by_key.insert(mounting_key(s), static[S + 3 * s : S + 3 * s + 3])
    by_key.insert(pose_mean_key(), static[4 * S :])
    moved = GraphState.from_values(state.to_values().retract(by_key), T, S)
    ours = objective.retract(state, delta)
    np.testing.assert_allclose(ours.R_parent_child, moved.R_parent_child, atol=1e-12)
    np.testing.assert_allclose(ours.R_bone_sensor, moved.R_bone_sensor, atol=1e-12)
    np.testing.assert_allclose(ours.pose_mean, moved.pose_mean, atol=1e-12)
    np.testing.assert_allclose(ours.headings, moved.headings, atol=1e-12)
    np.testing.assert_allclose(ours.p_world_pelvis, moved.p_world_pelvis, atol=1e-12)


def test_turning_the_world_leaves_the_cost_alone() -> None:
    model, state = small_model(free=False)
    turn = rotation_z(1.1)
    R = state.R_parent_child.copy()
    R[:, 0] = turn @ R[:, 0]
    model = replace(model, settings=replace(model.settings), p_world_start=np.zeros(3))
    turned = GraphState(R, state.p_world_pelvis @ turn.T, state.headings + 1.1, state.R_bone_sensor, state.pose_mean)
    costs, turned_costs = BatchObjective(model).cost(state), BatchObjective(model).cost(turned)
    assert turned_costs == pytest.approx(costs, rel=1e-9)


def test_marginals_of_all_frames() -> None:
    """Against the inverse of the whole information matrix."""
    model, state = small_model()
    objective = BatchObjective(model)
    H, _ = batched_hessian(model, state)
    covariance = np.linalg.inv(H)
    marginals = chain_marginals(objective.linearise(state))
    for t, key in enumerate(objective.frame_keys):
        block = covariance[75 * t : 75 * t + 75, 75 * t : 75 * t + 75]
        np.testing.assert_allclose(marginals[key], block, atol=1e-6 * np.abs(block).max())


@pytest.mark.parametrize("silent", [(), *SILENCES])
def test_it_does_not_matter_how_many_frames_are_evaluated_together(
    monkeypatch: pytest.MonkeyPatch, silent: Sequence[int]
) -> None:
    model, state = small_model(silent=silent)
    whole = BatchObjective(model).linearise(state)
    monkeypatch.setattr(batch, "CHUNK", 2)  # the last frame is then alone
    parts = BatchObjective(model).linearise(state)
    assert whole.following is not None
    assert parts.following is not None
    scale = np.abs(whole.own).max()
    np.testing.assert_allclose(parts.own, whole.own, atol=1e-12 * scale)
    np.testing.assert_allclose(parts.following, whole.following, atol=1e-12 * scale)
    np.testing.assert_allclose(parts.gradient, whole.gradient, atol=1e-12 * np.abs(whole.gradient).max())
