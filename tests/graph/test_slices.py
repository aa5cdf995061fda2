"""The slices of a scene add up to the scene, and each holds the factors whose first frame is its own."""

from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from test_batch import SILENCES
from test_scene_batch import KINDS, T, batched_hessian, small_scene

from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import SceneState
from vip_factors.graph.slice_factors import scene_slices
from vip_factors.graph.slices import SliceColumns, Slices, shared_key, slice_key


def hessian_of_slices(model: SceneModel, state: SceneState, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of all slices' factors together, for coordinates ``value`` of frames and of what they share."""
    columns = SliceColumns.of(model)
    slices, w, s = scene_slices(model, state, Slices(columns, T)), columns.frame, columns.static
    graph, order = gtsam.GaussianFactorGraph(), gtsam.Ordering()
    for t in range(T):
        own = np.zeros(columns.width)
        reach = value[w * t : w * min(t + 3, T)]
        own[: len(reach)] = reach
        own[3 * w :] = value[w * T : w * T + s]
        keys = [slice_key(t + ahead) for ahead in range(3)]
        graph.push_back(slices.factors(t, keys, shared_key(0), own))
        order.push_back(keys[0])
    order.push_back(shared_key(0))
    return graph.hessian(order)


@pytest.mark.parametrize("kind", KINDS)
def test_slices_add_up_to_the_batch(kind: str) -> None:
    assert_slices_add_up(*small_scene(kind))


@pytest.mark.parametrize("silent", SILENCES)
def test_slices_add_up_where_nothing_was_measured(silent: Sequence[int]) -> None:
    assert_slices_add_up(*small_scene("moving", silent))


def assert_slices_add_up(model: SceneModel, state: SceneState) -> None:
    expected_H, expected_g = batched_hessian(model, state)
    H, g = hessian_of_slices(model, state, np.zeros(len(expected_g)))
    np.testing.assert_allclose(H, expected_H, atol=1e-9 * np.abs(expected_H).max())
    np.testing.assert_allclose(g, expected_g, atol=1e-9 * np.abs(expected_g).max())


def test_factors_are_in_coordinates_not_in_steps() -> None:
    model, state = small_scene("moving")
    H, g = hessian_of_slices(model, state, np.zeros(len(batched_hessian(model, state)[1])))
    value = 0.1 * np.random.default_rng(0).standard_normal(len(g))
    same, moved = hessian_of_slices(model, state, value)
    np.testing.assert_allclose(same, H)
    np.testing.assert_allclose(moved, g + H @ value, atol=1e-9 * np.abs(g).max() + 1e-12 * np.abs(H).max())


@pytest.mark.parametrize("silent", [(), *SILENCES])
def test_a_slice_does_not_depend_on_what_came_before(silent: Sequence[int]) -> None:
    model, state = small_scene("moving", silent)
    columns = SliceColumns.of(model)
    later = _without_first(model), _state_without_first(state)
    whole, part = scene_slices(_inner(model), state, Slices(columns, T)), scene_slices(*later, Slices(columns, T - 1))
    np.testing.assert_allclose(part.hessian, whole.hessian[1:], atol=1e-9 * np.abs(whole.hessian).max())
    np.testing.assert_allclose(part.gradient, whole.gradient[1:], atol=1e-9 * np.abs(whole.gradient).max())


def _inner(model: SceneModel) -> SceneModel:
    wearers = tuple(replace(one, is_beginning=False, initial_pose=None) for one in model.wearers)
    return replace(model, wearers=wearers, camera=replace(model.camera, is_beginning=False))


def _without_first(model: SceneModel) -> SceneModel:
    model, rest = _inner(model), slice(1, None)
    wearers = tuple(
        replace(one, frames=one.frames.window(rest), contact_confidence=one.contact_confidence[rest])
        for one in model.wearers
    )
    views = tuple(
        replace(
            view, pixels=view.pixels[rest], sigma=view.sigma[rest], seen=view.seen[rest],
            pixels_per_second=view.pixels_per_second[rest],
            ground=None if view.ground is None else view.ground.at_frames(rest),
        )
        for view in model.views
    )  # fmt: skip
    assert model.camera.imu is not None
    return SceneModel(wearers, replace(model.camera, imu=model.camera.imu.window(rest)), views)


def _state_without_first(state: SceneState) -> SceneState:
    wearers = tuple(
        replace(one, R_parent_child=one.R_parent_child[1:], p_world_pelvis=one.p_world_pelvis[1:])
        for one in state.wearers
    )
    return SceneState(wearers, replace(state.camera, poses=state.camera.at_frames(slice(1, T))))
