"""The summed objective of a scene and its GTSAM graph are the same problem, whatever the camera does."""

from dataclasses import replace

import numpy as np
import pytest
from linear import assert_same, dense, dense_of_graph
from small_problems import KINDS, T, small_scene, walking_scene

from vip_factors.assembly.objective import SceneObjective
from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.geometry.rotations import rotation_z
from vip_factors.problem.scene import KeypointView
from vip_factors.problem.state import CameraPoses
from vip_factors.problem.variables import scene_layout
from vip_factors.solve.chain_elimination import chain_marginals, last_marginals, tree_marginals
from vip_factors.solve.levenberg_marquardt import SolveSettings, levenberg_marquardt


@pytest.mark.parametrize("kind", KINDS)
def test_cost_and_equations_are_those_of_the_graph(kind: str) -> None:
    problem, state = small_scene(kind)
    whole, objective = factor_graph_of(problem, state), SceneObjective(problem)
    assert sum(objective.cost(state).values()) == pytest.approx(whole.graph.error(whole.values), rel=1e-9)
    assert_same(dense(objective.linearise(state)), dense_of_graph(whole))


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_the_camera_alone_follows_kept_wearers(kind: str) -> None:
    problem, state = small_scene(kind)
    objective = SceneObjective(problem, wearers_move=False)
    whole = factor_graph_of(problem, state, scene_layout(problem, wearers_move=False))
    assert_same(dense(objective.linearise(state)), dense_of_graph(whole))
    solved, _ = levenberg_marquardt(objective, state, SolveSettings(max_iterations=3))
    assert solved.wearers == state.wearers
    assert np.abs(solved.camera.poses.p_world_camera - state.camera.poses.p_world_camera).max() > 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_it_does_not_matter_how_many_frames_are_evaluated_together(kind: str) -> None:
    problem, state = small_scene(kind)
    whole = dense(SceneObjective(problem).linearise(state))
    assert_same(dense(SceneObjective(problem, chunk=2).linearise(state)), whole)


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_turning_the_world_leaves_the_cost_alone(kind: str) -> None:
    model, state = small_scene(kind)
    wearers = tuple(replace(one, free_headings=False, p_world_start=np.zeros(3)) for one in model.wearers)
    model = replace(model, wearers=wearers)
    turn, poses = rotation_z(1.1), state.camera.poses
    moved = CameraPoses(turn @ poses.R_world_camera, poses.p_world_camera @ turn.T)
    camera = replace(state.camera, poses=moved, heading=state.camera.heading + 1.1)
    turned_state = replace(state, wearers=tuple(wearer.turned(1.1) for wearer in state.wearers), camera=camera)
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
    assert solved.camera.clock_drift != state.camera.clock_drift


@pytest.mark.parametrize("walking", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_marginals_are_those_of_gtsams_tree(kind: str, walking: bool) -> None:
    model, state = walking_scene(kind) if walking else small_scene(kind)
    system = SceneObjective(model).linearise(state)
    found, expected = chain_marginals(system), tree_marginals(system)
    assert found.keys() == expected.keys()
    for key, block in expected.items():
        np.testing.assert_allclose(found[key], block, rtol=0.0, atol=1e-8 * np.abs(block).max())


@pytest.mark.parametrize("kind", KINDS)
def test_what_frames_share_has_its_covariance_from_the_last_elimination(kind: str) -> None:
    model, state = small_scene(kind)
    objective = SceneObjective(model)
    H, _ = dense(SceneObjective(model).linearise(state))
    covariance = np.linalg.inv(H)
    marginals = last_marginals(objective.linearise(state), objective.static_keys)
    start = objective.layout.frame_width * T
    for key in objective.static_keys:
        stop = start + len(marginals[key])
        block = covariance[start:stop, start:stop]
        np.testing.assert_allclose(marginals[key], block, atol=1e-6 * np.abs(block).max())
        start = stop
    assert start == len(H)
