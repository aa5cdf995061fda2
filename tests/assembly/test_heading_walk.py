"""Headings that walk: objective and GTSAM graph stay the same problem, in whatever stretches it is eliminated."""

from dataclasses import replace

import numpy as np
import pytest
from linear import assert_same, dense, dense_of_graph
from small_problems import KNOTS, WearerObjective, small_model, walking_model, walking_scene

from vip_factors.assembly.objective import SceneObjective
from vip_factors.factor_graph.graph import FactorGraph, factor_graph_of
from vip_factors.problem.state import SceneState
from vip_factors.problem.wearer import knot_weights
from vip_factors.solve import chain_system
from vip_factors.solve.chain_elimination import ChainElimination, last_marginals
from vip_factors.solve.chain_system import frame_keys, knot_key
from vip_factors.solve.elimination import eliminate
from vip_factors.solve.levenberg_marquardt import SolveSettings, levenberg_marquardt
from vip_factors.terms.registry import unfilmed_problem


def in_order_of_elimination(whole: FactorGraph) -> list[int]:
    """Frames, later knots, and then what frames share."""
    ranks = [(not (one.is_of_a_frame or one.is_of_the_camera_path), one.knot == 0) for one in whole.variables]
    if not whole.problem.camera.moving:
        shared = [one.is_of_the_camera_path for one in whole.variables]
        ranks = [(True, True) if camera else rank for rank, camera in zip(ranks, shared, strict=True)]
    order = sorted(range(len(ranks)), key=lambda index: (ranks[index][0], ranks[index][0] and ranks[index][1]))
    return [whole.variables[index].key for index in order]


@pytest.mark.parametrize("knots", KNOTS)
def test_cost_and_equations_are_those_of_the_graph(knots: str) -> None:
    problem, state = walking_model(knots)
    whole = factor_graph_of(unfilmed_problem([problem]), SceneState.unfilmed([state]))
    costs = WearerObjective(problem).cost(state)
    assert sum(costs.values()) == pytest.approx(whole.graph.error(whole.values), rel=1e-9)
    assert costs["heading walk"] > 0
    theirs = dense_of_graph(whole, in_order_of_elimination(whole))
    assert_same(dense(WearerObjective(problem).linearise(state)), theirs)


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_cost_and_equations_of_a_scene_are_those_of_its_graph(kind: str) -> None:
    problem, state = walking_scene(kind)
    whole, objective = factor_graph_of(problem, state), SceneObjective(problem)
    assert sum(objective.cost(state).values()) == pytest.approx(whole.graph.error(whole.values), rel=1e-9)
    theirs = dense_of_graph(whole, in_order_of_elimination(whole))
    assert_same(dense(objective.linearise(state)), theirs)


@pytest.mark.parametrize("kind", ["moving", "standing"])
@pytest.mark.parametrize("stretch", [1, 2, 3])
def test_knots_that_are_passed_are_eliminated_early_and_nothing_changes(
    kind: str, stretch: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, state = walking_scene(kind)
    objective = SceneObjective(problem)
    equations = objective.linearise(state)
    whole = eliminate(equations.stretches(0.1)).optimize()
    shared = last_marginals(equations, objective.static_keys)
    monkeypatch.setattr(chain_system, "STRETCH", stretch)
    parts = [ordering for _, ordering in equations.stretches(0.1)]
    early = {part.at(index) for part in parts[:-1] for index in range(part.size())}
    assert knot_key(0, 1) in early
    piecewise = eliminate(equations.stretches(0.1)).optimize()
    later = [knot_key(1, knot) for knot in range(1, len(problem.wearers[1].heading_knots))]
    by_frame = ChainElimination(equations, 0.1).step()
    for key in [*frame_keys(0, problem.frames), *later, *objective.static_keys]:
        np.testing.assert_allclose(by_frame.at(key), whole.at(key), atol=1e-7 * np.abs(whole.at(key)).max())
        np.testing.assert_allclose(piecewise.at(key), whole.at(key), atol=1e-7 * np.abs(whole.at(key)).max())
    for key, block in last_marginals(equations, objective.static_keys).items():
        np.testing.assert_allclose(block, shared[key], atol=1e-6 * np.abs(block).max())


def test_turning_the_world_leaves_the_cost_alone() -> None:
    model, state = walking_model("between frames")
    model = replace(model, use_acceleration=True, is_gauge=False)
    turned = replace(model, prior_headings=model.prior_headings + 1.1)
    costs = WearerObjective(turned).cost(state.turned(1.1))
    assert costs == pytest.approx(WearerObjective(model).cost(state), rel=1e-9)


def test_equal_knots_cost_as_a_constant_heading_does() -> None:
    """All but the prior, which is looser on the start of a walk than on a heading that stays."""
    model, state = small_model()
    walking = replace(model, heading_knots=model.frames.time[0] + np.array([0, 0.07, 0.2]))
    costs = WearerObjective(walking).cost(state.with_knots(3))
    constant = WearerObjective(model).cost(state)
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
