"""Shoes: what touches the ground is under the sole, the skeleton and its keypoints are barefoot above it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from small_problems import WearerObjective, small_model

from vip_factors.assembly.objective import SceneObjective
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import contact_points
from vip_factors.factor_settings import SoleSettings
from vip_factors.geometry.rotations import exp
from vip_factors.problem.state import SceneState, WearerState
from vip_factors.problem.wearer import BodyPoint, WearerProblem, sole_shift
from vip_factors.stages.inertial_model import place_on_floor

UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # the body's y axis is the world's z
SHOE = 0.032  # m


def standing(shoe: float, spread: float = 0.6) -> tuple[WearerProblem, WearerState]:
    """A wearer whose body is known, standing on soles of some thickness on feet that slope a little."""
    model, state = small_model()
    R = np.tile(np.eye(3), (state.frames, 24, 1, 1))
    R[:, 0] = UPRIGHT
    R[1:3, 7] = exp([0.05, 0.0, 0.0])  # the left ankle
    points = contact_points(model.skeleton)
    settings = replace(model.settings, sole=SoleSettings(spread=spread))
    contacts = tuple(BodyPoint(bone, p) for bone, p in points)
    model = replace(
        model, contacts=contacts, contact_confidence=np.ones((state.frames, len(points))), settings=settings
    )
    body = forward_kinematics(model.skeleton, R, np.zeros((state.frames, 3)))
    heel, p = points[2]
    root = np.zeros((state.frames, 3))
    root[:, 2] = -body.point(heel, p + sole_shift(shoe))[:, 2]
    return model, replace(state, R_parent_child=R, p_world_pelvis=root, body=np.zeros_like(state.body))


def found(model: WearerProblem, state: WearerState) -> float:
    """The thickness with the least cost of contacts, the rest kept as it is."""
    objective = WearerObjective(model).scene

    def cost(sole: float) -> float:
        costs = objective.cost(SceneState.unfilmed([replace(state, sole=sole)]))
        return costs["floor contact"] + costs["foot contact"] + costs["sole prior"]

    return model.settings.sole.of(minimize_scalar(cost, bounds=(-3, 3), method="bounded").x)


def only_heels(model: WearerProblem) -> WearerProblem:
    """Balls lie higher than heels at rest, which is no shoe's doing."""
    confidence = np.zeros_like(model.contact_confidence)
    confidence[:, 2] = 1e6
    return replace(model, contact_confidence=confidence)


@pytest.mark.parametrize("shoe", [0.003, SHOE])
def test_a_sole_is_found_where_the_body_is_held(shoe: float) -> None:
    model, state = standing(shoe)
    assert found(only_heels(model), state) == pytest.approx(shoe, abs=1e-3)


def test_a_few_frames_leave_it_to_the_prior() -> None:
    model, state = standing(SHOE)
    assert found(model, state) == pytest.approx(SoleSettings().thickness, abs=0.003)


def test_a_sole_is_never_negative() -> None:
    assert 0 < SoleSettings().of(-30.0) < SoleSettings().of(0.0) == SoleSettings().thickness
    np.testing.assert_array_equal(sole_shift(SHOE), [0.0, -SHOE, 0.0])


def test_a_wearer_is_placed_on_soles() -> None:
    model, state = standing(SHOE)
    shod = place_on_floor(model, replace(state, sole=np.log(SHOE / model.settings.sole.thickness)))
    barefoot = place_on_floor(replace(model, settings=replace(model.settings, sole=SoleSettings(0.0))), state)
    raised = (shod.p_world_pelvis - barefoot.p_world_pelvis)[:, 2]
    np.testing.assert_allclose(raised[[0, 3, 4]], SHOE)
    assert np.all((raised > 0.9 * SHOE) & (raised < 1.1 * SHOE))


def test_a_sole_that_is_kept_has_no_column() -> None:
    model, state = standing(SHOE)
    kept = WearerObjective(replace(model, free_sole=False)).scene
    assert "sole prior" not in kept.cost(SceneState.unfilmed([state]))
    free: SceneObjective = WearerObjective(model).scene
    assert kept.layout.static_width == free.layout.static_width - 1
