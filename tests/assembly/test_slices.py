"""The slices of a scene add up to the scene, and each holds the factors whose first frame is its own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from linear import dense
from small_problems import KINDS, SILENCES, T, small_scene

from vip_factors.assembly.charts import Charts
from vip_factors.assembly.objective import SceneObjective, joined_slices
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import scene_layout
from vip_factors.solve.slices import Slices


def slices_of(model: SceneProblem, state: SceneState, charts: Charts | None = None) -> Slices:
    layout = scene_layout(model)
    empty = Slices(layout.frame_width, layout.static_width, model.frames)
    return joined_slices([layout], model, state, [empty], charts)[0]


def batched(model: SceneProblem, state: SceneState) -> tuple[np.ndarray, np.ndarray]:
    return dense(SceneObjective(model), state)


def summed(slices: Slices, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of all slices together, for coordinates ``value`` of frames and of what they share."""
    w, s, n = slices.frame, slices.static, len(value)
    H, g = np.zeros((n, n)), np.zeros(n)
    for t in range(T):
        columns = np.concatenate([np.arange(w * t, w * min(t + 3, T)), np.arange(n - s, n)])
        information, vector = slices.in_coordinates(t, value[: n - s].reshape(T, w)[t : t + 3], value[n - s :])
        H[np.ix_(columns, columns)] += np.triu(information) + np.triu(information, 1).T
        g[columns] += vector
    return H, g


def hessian_of_slices(model: SceneProblem, state: SceneState, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return summed(slices_of(model, state), value)


@pytest.mark.parametrize("kind", KINDS)
def test_slices_add_up_to_the_batch(kind: str) -> None:
    assert_slices_add_up(*small_scene(kind))


def test_what_is_made_of_a_slice_stays_with_the_next_ones() -> None:
    model, state = small_scene(KINDS[0])
    made = slices_of(model, state)
    information, vector = made.in_coordinates(0, np.zeros((3, made.frame)), np.zeros(made.static))
    before = np.triu(information)
    made.emptied(T)
    np.testing.assert_array_equal(np.triu(information), before)
    assert np.any(before)
    assert np.any(vector)


@pytest.mark.parametrize("kind", KINDS)
def test_slices_of_each_wearer_and_of_what_films_them_add_up_too(kind: str) -> None:
    model, state = small_scene(kind)
    layout = scene_layout(model)
    charts = Charts.at(layout, np.zeros((T, layout.frame_width)), np.zeros(layout.static_width))
    whole = slices_of(model, state, charts)
    owners = [owner for owner, _ in layout.blocks]
    parts = [{owner, *owners[len(model.wearers) :]} for owner in owners[: len(model.wearers)]]
    parts.append(set(owners[len(model.wearers) :]))
    layouts = [layout.of_owners(part) for part in parts]
    empty = [Slices(layout.frame_width, layout.static_width, T) for layout in layouts]
    hessian, gradient = np.zeros_like(whole.hessian), np.zeros_like(whole.gradient)
    for part, one in zip(parts, joined_slices(layouts, model, state, empty, charts), strict=True):
        frame, static = layout.frame_columns(part), layout.static_columns(part)
        own = np.concatenate([*(ahead * whole.frame + frame for ahead in range(3)), 3 * whole.frame + static])
        hessian[np.ix_(np.arange(T), own, own)] += one.hessian
        gradient[:, own] += one.gradient
    np.testing.assert_allclose(np.triu(hessian), np.triu(whole.hessian), atol=1e-9 * np.abs(whole.hessian).max())
    np.testing.assert_allclose(gradient, whole.gradient, atol=1e-9 * np.abs(whole.gradient).max())


@pytest.mark.parametrize("silent", SILENCES)
def test_slices_add_up_where_nothing_was_measured(silent: Sequence[int]) -> None:
    assert_slices_add_up(*small_scene("moving", silent))


def assert_slices_add_up(model: SceneProblem, state: SceneState) -> None:
    expected_H, expected_g = batched(model, state)
    H, g = hessian_of_slices(model, state, np.zeros(len(expected_g)))
    np.testing.assert_allclose(H, expected_H, atol=1e-9 * np.abs(expected_H).max())
    np.testing.assert_allclose(g, expected_g, atol=1e-9 * np.abs(expected_g).max())


def test_slices_are_in_coordinates_not_in_steps() -> None:
    model, state = small_scene("moving")
    H, g = hessian_of_slices(model, state, np.zeros(len(batched(model, state)[1])))
    value = 0.1 * np.random.default_rng(0).standard_normal(len(g))
    same, moved = hessian_of_slices(model, state, value)
    np.testing.assert_allclose(same, H)
    np.testing.assert_allclose(moved, g + H @ value, atol=1e-9 * np.abs(g).max() + 1e-12 * np.abs(H).max())


@pytest.mark.parametrize("silent", [(), *SILENCES])
def test_a_slice_does_not_depend_on_what_came_before(silent: Sequence[int]) -> None:
    model, state = small_scene("moving", silent)
    rest = slice(1, T)
    whole, part = slices_of(_inner(model), state), slices_of(_inner(model).window(rest), state.window(rest))
    np.testing.assert_allclose(part.hessian, whole.hessian[1:], atol=1e-9 * np.abs(whole.hessian).max())
    np.testing.assert_allclose(part.gradient, whole.gradient[1:], atol=1e-9 * np.abs(whole.gradient).max())


def _inner(model: SceneProblem) -> SceneProblem:
    wearers = tuple(replace(wearer, is_beginning=False, initial_pose=None) for wearer in model.wearers)
    return replace(
        model, wearers=wearers, cameras=tuple(replace(camera, is_beginning=False) for camera in model.cameras)
    )


@pytest.mark.parametrize("kind", ["moving", "standing"])
@pytest.mark.parametrize("far", [0.01, 0.4])  # rad and m of one sigma, from where coordinates are zero
def test_the_gradient_by_coordinates_is_that_of_the_cost_near_and_far(kind: str, far: float) -> None:
    model, origin = small_scene(kind)
    layout, random = scene_layout(model), np.random.default_rng(0)
    value = far * random.standard_normal(layout.frame_width * T + layout.static_width)
    objective = SceneObjective(model)

    def state_at(value: np.ndarray) -> SceneState:
        frames, static = np.split(value, [layout.frame_width * T])
        return origin.retract_frames(layout, frames.reshape(T, -1)).retract_static(layout, static)

    frames, static = np.split(value, [layout.frame_width * T])
    charts = Charts.at(layout, frames.reshape(T, -1), static)
    _, gradient = summed(slices_of(model, state_at(value), charts), np.zeros_like(value))
    chosen = [*random.choice(len(value), 30, replace=False), *range(len(value) - 20, len(value))]
    for column in chosen:
        step = 1e-6 * (np.arange(len(value)) == column)
        sides = [sum(objective.cost(state_at(value + sign * step)).values()) for sign in (1, -1)]
        assert (sides[0] - sides[1]) / 2e-6 == pytest.approx(-gradient[column], abs=1e-6 * np.abs(gradient).max())
