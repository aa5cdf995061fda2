"""Jacobians of every registered term against central differences through GTSAM's own retract; near identity too."""

from dataclasses import fields, replace
from functools import cache
from typing import Any

import gtsam
import numpy as np
import pytest
from small_problems import S, drifting_scene, small_scene

from vip_factors.assembly.objective import SceneObjective
from vip_factors.factor_graph.graph import FactorGraph, factor_graph_of
from vip_factors.factor_graph.term_factors import TermFactor
from vip_factors.factor_graph.variables import variable_of
from vip_factors.factor_settings import SQUARE, RobustLoss
from vip_factors.geometry.rotations import exp
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.terms.registry import CAMERA_TERMS, VIEW_TERMS, WEARER_TERMS

KINDS = [term.kind for term in (*WEARER_TERMS, *VIEW_TERMS, *CAMERA_TERMS)]
SPREADS = [0.0, 1e-3, 0.5]


def everything(spread: float) -> tuple[SceneProblem, SceneState]:
    """A scene in which every kind of factor acts, under square losses, at rotations within ``spread`` of identity."""
    problem, state = drifting_scene("moving")
    silent, _ = small_scene("moving", silent=(0,))
    random = np.random.default_rng(3)
    wearers = tuple(
        replace(
            one,
            frames=other.frames,
            settings=all_used(with_square_losses(one.settings)),
            prior_R_bone_sensor=exp(0.5 * random.standard_normal((S, 3))),
        )
        for one, other in zip(problem.wearers, silent.wearers, strict=True)
    )
    cameras = tuple(replace(camera, settings=with_square_losses(camera.settings)) for camera in problem.cameras)
    problem = replace(problem, wearers=wearers, cameras=cameras)
    states = tuple(
        replace(
            wearer,
            R_parent_child=exp(spread * random.standard_normal(wearer.R_parent_child.shape[:3])),
            headings=spread * random.standard_normal(S),
            R_bone_sensor=exp(spread * random.standard_normal((S, 3))),
        )
        for wearer in state.wearers
    )
    return problem, replace(state, wearers=states)


def with_square_losses(settings: Any) -> Any:
    """The same settings of factors, each loss of which is the square."""
    changes = {}
    for field in fields(settings):
        value = getattr(settings, field.name)
        if isinstance(value, RobustLoss):
            changes[field.name] = SQUARE
        elif hasattr(value, "__dataclass_fields__"):
            changes[field.name] = with_square_losses(value)
    return replace(settings, **changes)


def all_used(settings: Any) -> Any:
    """The same, with all that is off by default in use."""
    return replace(settings, agreeing_headings=replace(settings.agreeing_headings, sigma_deg=15.0))


@cache
def graph(spread: float) -> FactorGraph:
    return factor_graph_of(*everything(spread))


def examples(spread: float, kind: str, count: int = 3) -> list[TermFactor]:
    found = [factor for factor in graph(spread).factors if factor.kind == kind]
    return (
        [found[int(index)] for index in np.unique(np.linspace(0, len(found) - 1, count).astype(int))] if found else []
    )


@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize("kind", KINDS)
def test_jacobians_match_central_differences(kind: str, spread: float) -> None:
    chosen = examples(spread, kind)
    assert chosen, f"no factor of kind '{kind}' in the scene of this test: give it one"
    for one in chosen:
        linear = one.factor.linearize(graph(spread).values)
        A, _ = linear.jacobian()
        keys, column = [int(key) for key in list(linear.keys())], 0
        widths = {variable.key: variable.width for variable in one.variables}
        for key in keys:
            expected = numerical_jacobian(one.factor, graph(spread).values, key, widths[key])
            scale = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(A[:, column : column + widths[key]], expected, atol=2e-5 * scale)
            column += widths[key]


def numerical_jacobian(factor: gtsam.NoiseModelFactor, values: gtsam.Values, key: int, columns: int) -> np.ndarray:
    own = gtsam.Values()
    for one in list(factor.keys()):
        own.insert(int(one), _value(values, int(one)))
    step, jacobian = 1e-5, []
    for axis in np.eye(columns):
        sides = []
        for sign in (1.0, -1.0):
            delta = own.zeroVectors()
            single = gtsam.VectorValues()
            single.insert(key, sign * step * axis)
            delta.update(single)
            sides.append(np.array(factor.whitenedError(own.retract(delta))))
        jacobian.append((sides[0] - sides[1]) / (2 * step))
    return np.stack(jacobian, axis=1)


def _value(values: gtsam.Values, key: int) -> Any:
    one = variable_of(key)
    assert one is not None
    reader = {"rotation": "atRot3", "point": "atPoint3", "pose": "atPose3", "vector": "atDouble"}[one.manifold]
    return getattr(values, "atVector" if one.is_one_vector else reader)(key)


def test_every_term_is_in_the_cost_the_equations_and_the_graph() -> None:
    problem, state = everything(0.5)
    kinds = {factor.kind for factor in graph(0.5).factors}
    assert kinds == set(KINDS) == set(SceneObjective(problem).cost(state))
    assert len(set(KINDS)) == len(KINDS)
