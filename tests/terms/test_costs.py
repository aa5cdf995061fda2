"""What one standard deviation costs: half a nat, of each term that a default weighs."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from small_problems import S, T, WearerObjective, small_model

from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import exp
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem

STILL = np.broadcast_to([0.0, 0.0, 9.81], (T, S, 3))
KNEE = joint_index("left_knee")
Moved = tuple[WearerProblem, WearerState]


def at_rest() -> Moved:
    """A wearer upright and still, whose sensors measure just that."""
    problem, state = small_model(free=False)
    frames = replace(problem.frames, specific_force_inertial=STILL.copy(), acceleration_valid=np.ones((T, S), bool))
    still = np.broadcast_to(np.eye(3), (T, 24, 3, 3)).copy(), np.zeros((T, 3)), np.zeros(S)
    settings = replace(problem.settings, correlation_s=frames.step)  # each frame counts as one
    return replace(problem, frames=frames, settings=settings), replace(
        state, R_parent_child=still[0], p_world_pelvis=still[1], headings=still[2]
    )


def a_push(problem: WearerProblem, state: WearerState) -> Moved:
    force = STILL.copy()
    force[2, 1, 0] = 1.5  # m/s²
    return replace(problem, frames=replace(problem.frames, specific_force_inertial=force)), state


def with_knee(state: WearerState, degrees: float, from_frame: int) -> WearerState:
    R = state.R_parent_child.copy()
    R[from_frame:, KNEE] = exp([np.deg2rad(degrees), 0.0, 0.0])
    return replace(state, R_parent_child=R)


def a_quick_knee(problem: WearerProblem, state: WearerState) -> Moved:
    """By one standard deviation of the pose prior in 0.07 s, as far as this knee alone is concerned."""
    axis = 3 * (KNEE - 1)
    turn = problem.frames.step / 0.07 / np.sqrt(problem.prior.information[axis, axis])
    return problem, with_knee(state, np.rad2deg(turn), from_frame=2)


def a_knee_bent_too_far(problem: WearerProblem, state: WearerState) -> Moved:
    limit = problem.limits.upper[3 * (KNEE - 1)]
    return problem, with_knee(state, np.rad2deg(limit) + 3.0, from_frame=T - 1)


@pytest.mark.parametrize(
    ("term", "move", "cost"),
    [
        ("acceleration", a_push, 0.5),
        ("smoothness", a_quick_knee, 0.5),
        ("joint limit", a_knee_bent_too_far, 4.5 * np.log(1 + 1 / 9)),  # Cauchy's of width 3
    ],
)
def test_one_standard_deviation_costs(term: str, move: Callable[..., Moved], cost: float) -> None:
    before, after = (WearerObjective(problem).cost(state) for problem, state in (at_rest(), move(*at_rest())))
    assert before[term] == pytest.approx(0.0, abs=1e-9)
    assert after[term] == pytest.approx(cost, rel=1e-6)
