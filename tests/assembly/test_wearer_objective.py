"""The summed objective of one wearer and the graph of its GTSAM factors are the same problem."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from linear import assert_same, dense_of_graph
from small_problems import SILENCES, S, T, WearerObjective, small_model

from vip_factors.factor_graph.graph import FactorGraph, factor_graph_of
from vip_factors.geometry.rotations import rotation_z
from vip_factors.problem.state import SceneState, WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import in_stretches
from vip_factors.solve.slices import REACH
from vip_factors.terms.registry import unfilmed_problem


def graph_of(problem: WearerProblem, state: WearerState) -> FactorGraph:
    return factor_graph_of(unfilmed_problem([problem]), SceneState.unfilmed([state]))


def with_limits(problem: WearerProblem, per_axis: bool) -> WearerProblem:
    limit = replace(problem.settings.joint_limit, per_axis=per_axis)
    return replace(problem, settings=replace(problem.settings, joint_limit=limit))


@pytest.mark.parametrize("per_axis", [False, True])
@pytest.mark.parametrize("free", [False, True])
def test_cost_and_equations_are_those_of_the_graph(per_axis: bool, free: bool) -> None:
    problem, state = small_model(free)
    assert_the_graph(with_limits(problem, per_axis), state)


@pytest.mark.parametrize("silent", SILENCES)
def test_where_nothing_was_measured_too(silent: Sequence[int]) -> None:
    problem, state = small_model(silent=silent)
    kinds = WearerObjective(problem).cost(state)
    assert kinds["root coasting"] > 0
    assert kinds["pelvis turn"] > 0
    assert_the_graph(problem, state)


def assert_the_graph(problem: WearerProblem, state: WearerState) -> None:
    whole, objective = graph_of(problem, state), WearerObjective(problem)
    assert sum(objective.cost(state).values()) == pytest.approx(whole.graph.error(whole.values), rel=1e-9)
    assert_same(objective.dense(state), dense_of_graph(whole))


@pytest.mark.parametrize("silent", SILENCES)
def test_frames_in_which_nothing_was_measured_are_determined(silent: Sequence[int]) -> None:
    problem, state = small_model(free=False, silent=silent)
    held = np.arange(T)[:, None] == 0  # at the start alone: nothing else says how fast the wearer moves
    settings = replace(problem.settings, correlation_s=problem.frames.step)  # each contact is one
    problem = replace(problem, contact_confidence=held.astype(float), settings=settings)
    (covariance,) = WearerObjective(problem).linearise(state).marginals().chains
    sigmas = np.sqrt([np.diag(block) for block in covariance])
    assert sigmas[:, :3].max() < 1.0  # rad
    assert sigmas[:, 72:].max() < 5.0  # m: a contact off by so much says little of the velocity


def test_stretches_with_time_between_them_are_one_problem() -> None:
    """What ties frames does not reach over the leap, and each stretch has a place of its own."""
    problem, state = small_model()
    frames = problem.frames
    two = in_stretches([frames.window(slice(0, 3)), replace(frames.window(slice(3, T)), time=frames.time[3:] + 7.0)])
    starts = np.array([[0.0, 0.0, 1.0], [3.0, 0.0, 1.0]])
    problem = replace(problem, frames=two, p_world_start=starts)
    assert_the_graph(problem, state)
    objective = WearerObjective(problem)
    shift = np.where(np.arange(T)[:, None] < 3, 0.0, np.array([0.3, -0.2, 0.0]))
    before, after = (
        objective.cost(one) for one in (state, replace(state, p_world_pelvis=state.p_world_pelvis + shift))
    )
    gauge = {"gauge prior"}
    assert {kind: after[kind] for kind in after.keys() - gauge} == pytest.approx(
        {kind: before[kind] for kind in before.keys() - gauge}
    )
    assert after["gauge prior"] != pytest.approx(before["gauge prior"])
    H, _ = objective.dense(state)
    following = H[: 75 * T, : 75 * T].reshape(T, 75, T, 75).swapaxes(1, 2)
    assert following[0, 1].any()
    assert not following[:3, 3:].any()


def test_coasting_costs_nothing_where_something_was_measured() -> None:
    problem, state = small_model()
    assert not {"root coasting", "pelvis turn"} & set(WearerObjective(problem).cost(state))


def test_fixed_calibration_leaves_its_columns_out() -> None:
    problem, state = small_model(free=False)
    H, _ = WearerObjective(problem).dense(state)
    assert H.shape == (75 * T, 75 * T)


def test_turning_the_world_leaves_the_cost_alone() -> None:
    problem, state = small_model(free=False)
    turn = rotation_z(1.1)
    R = state.R_parent_child.copy()
    R[:, 0] = turn @ R[:, 0]
    problem = replace(problem, p_world_start=np.zeros(3))
    turned = WearerState(R, state.p_world_pelvis @ turn.T, state.headings + 1.1, state.R_bone_sensor, state.pose_mean)
    costs, turned_costs = WearerObjective(problem).cost(state), WearerObjective(problem).cost(turned)
    assert turned_costs == pytest.approx(costs, rel=1e-9)


def test_marginals_of_all_frames() -> None:
    """Against the inverse of the whole information matrix."""
    problem, state = small_model()
    objective = WearerObjective(problem)
    H, _ = objective.dense(state)
    covariance = np.linalg.inv(H)
    (marginals,) = objective.linearise(state).marginals().chains
    for t in range(T):
        block = covariance[75 * t : 75 * t + 75, 75 * t : 75 * t + 75]
        np.testing.assert_allclose(marginals[t], block, atol=1e-6 * np.abs(block).max())


@pytest.mark.parametrize("silent", [(), *SILENCES])
def test_it_does_not_matter_how_many_frames_are_evaluated_together(silent: Sequence[int]) -> None:
    problem, state = small_model(silent=silent)
    whole = WearerObjective(problem).dense(state)
    for chunk in (1, REACH, REACH + 1):  # factors see the frames behind their stretch; the last frame is once alone
        assert_same(WearerObjective(problem, chunk=chunk).dense(state), whole)


def test_sensors_are_those_of_the_frames() -> None:
    problem, _ = small_model()
    assert len(problem.sensor_points.bones) == S
