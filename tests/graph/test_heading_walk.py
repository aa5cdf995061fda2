"""Headings that walk: batch and GTSAM graph stay the same problem, in whatever stretches it is eliminated."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from test_batch import S, T, batched_hessian, small_model
from test_scene_batch import small_scene

from vip_factors.factors.heading_knots import knot_weights
from vip_factors.graph import scene_system, system
from vip_factors.graph.batch import BatchObjective
from vip_factors.graph.frame import nonlinear_graph
from vip_factors.graph.keys import heading_key, joint_key, mounting_key, pose_mean_key, root_key
from vip_factors.graph.model import InertialModel
from vip_factors.graph.scene_batch import SceneObjective
from vip_factors.graph.scene_frame import scene_graph
from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import SceneState
from vip_factors.graph.state import GraphState
from vip_factors.solve.chain import eliminate
from vip_factors.solve.levenberg_marquardt import SolveSettings, levenberg_marquardt
from vip_factors.solve.marginals import last_marginals

# Of the five frames: knots on frames, between them, one that only a neighbour's interpolation sees, and beyond the end.
KNOTS = {
    "on frames": [0, 2, 4],
    "between frames": [0, 1.3, 2.6, 4],
    "closer than frames": [0, 0.2, 0.5, 0.8, 4],
    "as close as frames": [0, 1, 2, 4],
    "starting before": [-2, 1.5, 6],
}


def walking_model(knots: str) -> tuple[InertialModel, GraphState]:
    model, state = small_model()
    at = model.frames.time[0] + np.array(KNOTS[knots]) * model.frames.step
    settings = replace(model.settings, heading_walk=replace(model.settings.heading_walk, drift_deg=200.0))
    later = state.headings + 0.3 * np.random.default_rng(8).standard_normal((len(at) - 1, S))
    return replace(model, heading_knots=at, settings=settings), replace(state, later_headings=later)


def walking_scene(kind: str) -> tuple[SceneModel, SceneState]:
    model, state = small_scene(kind)
    (first, own), (_, other) = walking_model("as close as frames"), walking_model("between frames")
    wearers = first, replace(model.wearers[1], heading_knots=first.heading_knots, settings=first.settings)
    model = replace(model, wearers=wearers)
    later = own.later_headings, other.later_headings
    states = tuple(replace(one, later_headings=two) for one, two in zip(state.wearers, later, strict=True))
    return model, replace(state, wearers=states)


def ordering_of(knots: int) -> gtsam.Ordering:
    ordering = gtsam.Ordering()
    for t in range(T):
        for key in [*[joint_key(t, j) for j in range(24)], root_key(t)]:
            ordering.push_back(key)
    for k in range(1, knots):
        for s in range(S):
            ordering.push_back(heading_key(s, knot=k))
    for key in [*[heading_key(s) for s in range(S)], *[mounting_key(s) for s in range(S)], pose_mean_key()]:
        ordering.push_back(key)
    return ordering


@pytest.mark.parametrize("knots", KNOTS)
def test_the_cost_is_the_error_of_the_graph(knots: str) -> None:
    model, state = walking_model(knots)
    costs = BatchObjective(model).cost(state)
    assert sum(costs.values()) == pytest.approx(nonlinear_graph(model).error(state.to_values()), rel=1e-9)
    assert costs["heading walk"] > 0


@pytest.mark.parametrize("knots", KNOTS)
def test_the_normal_equations_are_those_of_the_graph(knots: str) -> None:
    model, state = walking_model(knots)
    H, g = nonlinear_graph(model).linearize(state.to_values()).hessian(ordering_of(len(KNOTS[knots])))
    ours, our_g = batched_hessian(model, state)
    scale = np.sqrt(np.outer(np.diag(H), np.diag(H)))
    np.testing.assert_allclose(ours / scale, H / scale, atol=1e-9)
    np.testing.assert_allclose(our_g, g, atol=1e-9 * np.abs(g).max())


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_the_cost_of_a_scene_is_the_error_of_its_graph(kind: str) -> None:
    model, state = walking_scene(kind)
    expected = scene_graph(model).error(state.to_values())
    assert sum(SceneObjective(model).cost(state).values()) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("kind", ["moving", "standing"])
@pytest.mark.parametrize("stretch", [1, 2, 3])
def test_knots_that_are_passed_are_eliminated_early_and_nothing_changes(
    kind: str, stretch: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, state = walking_scene(kind)
    objective = SceneObjective(model)
    equations = objective.linearise(state)
    whole = eliminate(equations.stretches(0.1)).optimize()
    shared = last_marginals(equations, objective.static_keys)
    monkeypatch.setattr(scene_system, "STRETCH", stretch)
    monkeypatch.setattr(system, "STRETCH", stretch)
    parts = [ordering for _, ordering in equations.stretches(0.1)]
    early = {part.at(index) for part in parts[:-1] for index in range(part.size())}
    assert objective.wearers[0].walk_keys[0] in early
    piecewise = eliminate(equations.stretches(0.1)).optimize()
    for key in [*objective.wearers[0].frame_keys, *objective.wearers[1].walk_keys, *objective.static_keys]:
        np.testing.assert_allclose(piecewise.at(key), whole.at(key), atol=1e-7 * np.abs(whole.at(key)).max())
    for key, block in last_marginals(equations, objective.static_keys).items():
        np.testing.assert_allclose(block, shared[key], atol=1e-6 * np.abs(block).max())


def test_retract_is_the_graphs_own() -> None:
    model, state = walking_model("between frames")
    objective, random = BatchObjective(model), np.random.default_rng(5)
    delta, by_key = gtsam.VectorValues(), gtsam.VectorValues()
    for key in objective.frame_keys:
        delta.insert(key, np.zeros(75))
    delta.insert(objective.static_key, np.zeros(4 * S + 69))
    for k, key in enumerate(objective.walk_keys, start=1):
        delta.insert(key, random.standard_normal(S))
        for s in range(S):
            by_key.insert(heading_key(s, knot=k), delta.at(key)[s : s + 1])
    moved = GraphState.from_values(state.to_values().retract(by_key), T, S, len(model.heading_knots))
    ours = objective.retract(state, delta)
    np.testing.assert_allclose(ours.later_headings, moved.later_headings, atol=1e-12)
    np.testing.assert_array_equal(ours.headings, state.headings)


def test_turning_the_world_leaves_the_cost_alone() -> None:
    model, state = walking_model("between frames")
    model = replace(model, use_acceleration=True, is_gauge=False)
    turned = replace(model, prior_headings=model.prior_headings + 1.1)
    costs = BatchObjective(turned).cost(state.turned(1.1))
    assert costs == pytest.approx(BatchObjective(model).cost(state), rel=1e-9)


def test_equal_knots_cost_as_a_constant_heading_does() -> None:
    """All but the prior, which is looser on the start of a walk than on a heading that stays."""
    model, state = small_model()
    walking = replace(model, heading_knots=model.frames.time[0] + np.array([0, 0.07, 0.2]))
    costs = BatchObjective(walking).cost(state.with_knots(3))
    constant = BatchObjective(model).cost(state)
    assert costs.pop("heading walk") == 0
    assert costs.pop("heading prior") < constant["heading prior"]
    assert costs == pytest.approx({kind: constant[kind] for kind in costs}, rel=1e-12)


def test_a_step_lowers_the_cost_and_moves_the_knots() -> None:
    model, state = walking_scene("standing")
    solved, report = levenberg_marquardt(SceneObjective(model), state, SolveSettings(max_iterations=5))
    assert sum(report.final_cost.values()) < 0.8 * sum(report.initial_cost.values())
    assert np.all(solved.wearers[1].later_headings != state.wearers[1].later_headings)


def test_knots_are_joined_by_straight_lines() -> None:
    weights = knot_weights(np.array([0.0, 10.0, 30.0]), np.array([-5.0, 0.0, 2.5, 10.0, 20.0, 40.0]))
    expected = [[1, 0, 0], [1, 0, 0], [0.75, 0.25, 0], [0, 1, 0], [0, 0.5, 0.5], [0, 0, 1]]
    np.testing.assert_allclose(weights, expected, atol=1e-12)
