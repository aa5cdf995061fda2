"""Headings that drift: objective and GTSAM graph stay the same problem."""

from dataclasses import replace

import numpy as np
import pytest
from linear import assert_same, dense, dense_of_graph
from small_problems import DRIFTS, WearerObjective, drifting_model, drifting_scene, small_model

from vip_factors.assembly.objective import SceneObjective
from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.problem.state import SceneState
from vip_factors.settings import SolveSettings
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt
from vip_factors.terms.registry import unfilmed_problem


@pytest.mark.parametrize("times", DRIFTS)
def test_cost_and_equations_are_those_of_the_graph(times: str) -> None:
    problem, state = drifting_model(times)
    whole = factor_graph_of(unfilmed_problem([problem]), SceneState.unfilmed([state]))
    costs = WearerObjective(problem).cost(state)
    assert sum(costs.values()) == pytest.approx(whole.graph.error(whole.values), rel=1e-9)
    assert costs["heading walk"] > 0
    assert_same(WearerObjective(problem).dense(state), dense_of_graph(whole))


@pytest.mark.parametrize("kind", ["moving", "standing"])
def test_cost_and_equations_of_a_scene_are_those_of_its_graph(kind: str) -> None:
    problem, state = drifting_scene(kind)
    whole, objective = factor_graph_of(problem, state), SceneObjective(problem)
    assert sum(objective.cost(state).values()) == pytest.approx(whole.graph.error(whole.values), rel=1e-9)
    assert_same(dense(objective, state), dense_of_graph(whole))


def test_turning_the_world_leaves_the_cost_alone() -> None:
    model, state = drifting_model("two frames")
    model = replace(model, use_acceleration=True, is_gauge=False)
    turned = replace(model, prior_headings=model.prior_headings + 1.1)
    costs = WearerObjective(turned).cost(state.turned(1.1))
    assert costs == pytest.approx(WearerObjective(model).cost(state), rel=1e-9)


def test_equal_headings_cost_as_a_constant_one_does() -> None:
    """All but the prior, which is looser on the start of a drift than on a heading that stays."""
    model, state = small_model()
    drifting = replace(model, heading_times=model.frames.time[0] + np.array([0, 0.07, 0.2]))
    costs = WearerObjective(drifting).cost(state.with_headings(3))
    constant = WearerObjective(model).cost(state)
    assert costs.pop("heading walk") == 0
    assert costs.pop("heading prior") < constant["heading prior"]
    assert costs == pytest.approx({kind: constant[kind] for kind in costs}, rel=1e-12)


def test_a_step_lowers_the_cost_and_moves_later_headings() -> None:
    model, state = drifting_scene("standing")
    solved, report = levenberg_marquardt(SceneObjective(model), state, SolveSettings(max_iterations=5))
    assert sum(report.final_cost.values()) < 0.8 * sum(report.initial_cost.values())
    assert np.all(solved.wearers[1].later_headings != state.wearers[1].later_headings)
