"""The summed objective of a scene and its GTSAM graph are the same problem, whatever the camera does."""

from dataclasses import replace

import numpy as np
import pytest
from linear import assert_same, dense, dense_of_graph, shared_names
from small_problems import KINDS, T, drifting_scene, small_scene

from vip_factors.assembly.objective import SceneObjective
from vip_factors.compiled import kernels
from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.geometry.rotations import rotation_z
from vip_factors.problem.scene import KeypointView
from vip_factors.problem.state import CameraPoses
from vip_factors.problem.variables import scene_layout
from vip_factors.settings import SolveSettings
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt
from vip_factors.solve.nested_dissection import NestedElimination


@pytest.mark.parametrize("kind", KINDS)
def test_cost_and_equations_are_those_of_the_graph(kind: str) -> None:
    problem, state = small_scene(kind)
    whole = factor_graph_of(problem, state)
    expected = dense_of_graph(whole)
    for objective in (SceneObjective(problem), SceneObjective(problem, chunk=2)):  # frames that are evaluated together
        assert sum(objective.cost(state).values()) == pytest.approx(whole.graph.error(whole.values), rel=1e-9)
        assert_same(dense(objective, state), expected)


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_the_camera_alone_follows_kept_wearers(kind: str) -> None:
    problem, state = small_scene(kind)
    objective = SceneObjective(problem, wearers_move=False)
    whole = factor_graph_of(problem, state, scene_layout(problem, wearers_move=False))
    assert_same(dense(objective, state), dense_of_graph(whole))
    solved, _ = levenberg_marquardt(objective, state, SolveSettings(max_iterations=3))
    assert solved.wearers == state.wearers
    assert np.abs(solved.cameras[0].poses.p_world_camera - state.cameras[0].poses.p_world_camera).max() > 1e-6


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_turning_the_world_leaves_the_cost_alone(kind: str) -> None:
    model, state = small_scene(kind)
    wearers = tuple(replace(wearer, free_headings=False, p_world_start=np.zeros(3)) for wearer in model.wearers)
    model = replace(model, wearers=wearers)
    turn, poses = rotation_z(1.1), state.cameras[0].poses
    moved = CameraPoses(turn @ poses.R_world_camera, poses.p_world_camera @ turn.T)
    camera = replace(state.cameras[0], poses=moved, heading=state.cameras[0].heading + 1.1)
    turned_state = replace(state, wearers=tuple(wearer.turned(1.1) for wearer in state.wearers), cameras=(camera,))
    costs = dict(SceneObjective(model).cost(state))
    turned = replace(
        model,
        cameras=(replace(model.cameras[0], prior_heading=model.cameras[0].prior_heading + 1.1),),
        views=(tuple(with_turned_ground(view, turn) for view in model.views[0]),),
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
    moved = np.abs(solved.cameras[0].poses.p_world_camera - state.cameras[0].poses.p_world_camera).max()
    assert (moved > 1e-6) == (kind != "known path")
    assert solved.cameras[0].clock != state.cameras[0].clock
    assert solved.cameras[0].clock_drift != state.cameras[0].clock_drift


@pytest.mark.parametrize("pure", [False, True])
@pytest.mark.parametrize("drifting", [False, True])
def test_steps_and_covariances_of_several_wearers_before_a_moving_camera_are_those_of_dense_algebra(
    drifting: bool, pure: bool
) -> None:
    model, state = small_scene("moving")
    several, states = (*model.wearers, model.wearers[1]), (*state.wearers, state.wearers[1])
    if drifting:  # between its frames: those before and behind are eliminated in stretches of their own
        times = model.wearers[0].frames.time[[0, -1]]
        several = (replace(several[0], heading_times=times), *several[1:])
        states = (states[0].with_headings(2), *states[1:])
    views = tuple((*of_camera, of_camera[1]) for of_camera in model.views)
    model = replace(model, wearers=several, views=views)
    state = replace(state, wearers=states)
    objective = SceneObjective(model, kernels=None if pure else kernels)
    damping = 0.1
    steps = objective.linearise(state).step(damping)
    H, g = dense(objective, state)
    names, layout = shared_names(objective), objective.layout
    unit = np.tile(np.concatenate([chain.step for chain in layout.chains]), T) ** -2.0
    scale, known = layout.per_column("step"), set(names)
    damped = [scale[column] ** -2.0 * ((column, step + 1) not in known) for column, step in names]
    x = np.linalg.solve(H + damping * np.diag(np.concatenate([unit, damped])), g)
    end, first = layout.frame_width * T, [index for index, (_, step) in enumerate(names) if step == 0]
    np.testing.assert_allclose(steps.frames.ravel(), x[:end], atol=1e-8 * np.abs(x).max())
    np.testing.assert_allclose(steps.static, x[end:][first], atol=1e-8 * np.abs(x).max())
    (group,) = objective.groups
    assert isinstance(group.memory, NestedElimination)
    for stretch in group.memory._stretches.values():  # reused memory may hold anything
        for elimination in stretch.chains:
            for rows, _ in elimination._conditionals:
                rows.fill(np.nan)
    covariance, marginals = np.linalg.inv(H), objective.linearise(state).marginals()
    for blocks, columns in zip(marginals.chains, layout.chain_columns, strict=True):
        for t, block in enumerate(blocks):
            rows = slice(layout.frame_width * t + columns.start, layout.frame_width * t + columns.stop)
            expected = covariance[rows, rows]
            np.testing.assert_allclose(block, expected, atol=1e-6 * np.abs(expected).max())
    static = end + np.array(first)
    for *_, columns in layout.placed:
        expected = covariance[np.ix_(static[columns], static[columns])]
        np.testing.assert_allclose(
            marginals.static[columns, columns], expected, atol=1e-6 * np.abs(expected).max(initial=1e-9)
        )


# Elimination sees the shapes of a problem: a camera's columns in every frame, or among those that frames share.
@pytest.mark.parametrize(
    ("kind", "drifting", "chunk", "pure"),
    [
        *((kind, True, 32, False) for kind in KINDS),
        *((kind, False, 1, False) for kind in ("moving", "further cameras")),
        *((kind, True, 2, True) for kind in ("standing", "two carried")),
    ],
)
def test_steps_and_covariances_are_those_of_dense_algebra(kind: str, drifting: bool, chunk: int, pure: bool) -> None:
    model, state = drifting_scene(kind) if drifting else small_scene(kind)
    objective, damping = SceneObjective(model, kernels=None if pure else kernels, chunk=chunk), 0.1
    H, g = dense(objective, state)
    layout, names = objective.layout, shared_names(objective)
    W, end = layout.frame_width, layout.frame_width * T
    of_frame = np.concatenate([chain.step for chain in layout.chains])
    unit = np.tile(of_frame, T) ** -2.0
    static = [index for index, (_, step) in enumerate(names) if step == 0]
    last, scale = dict(names), layout.per_column("step")  # a step of headings is held by its process noise
    of_static = np.array([scale[column] ** -2.0 * (step == last[column]) for column, step in names])
    x = np.linalg.solve(H + damping * np.diag(np.concatenate([unit, of_static])), g)
    steps = objective.linearise(state).step(damping)
    near = {"rtol": 1e-8, "atol": 1e-8 * np.abs(x).max()}
    np.testing.assert_allclose(steps.frames, x[:end].reshape(T, W), **near)
    np.testing.assert_allclose(steps.static, x[end:][static], **near)
    later = np.concatenate([np.zeros(0), *(heading.ravel() for heading in steps.later_headings.values())])
    np.testing.assert_allclose(later, np.delete(x[end:], static), **near)
    covariance, told = np.linalg.inv(H), list[float]()
    marginals = objective.linearise(state).marginals(told.append)
    for chain, columns in zip(marginals.chains, layout.chain_columns, strict=True):
        for t, block in enumerate(chain):
            own = slice(W * t + columns.start, W * t + columns.stop)
            expected = covariance[own, own]
            np.testing.assert_allclose(block, expected, atol=1e-6 * np.abs(expected).max())
    shared = objective.linearise(state).static_covariance()
    at = end + np.array(static)
    for *_, columns in layout.placed:
        expected = covariance[np.ix_(at[columns], at[columns])]
        for found in (shared, marginals.static):
            np.testing.assert_allclose(
                found[columns, columns], expected, atol=1e-6 * np.abs(expected).max(initial=1e-9)
            )
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0.0, 1.0)
