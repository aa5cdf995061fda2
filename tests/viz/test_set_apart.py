"""Wearers without a camera are drawn apart from each other; with one they stay where they are."""

from dataclasses import replace

import numpy as np
import pytest
from scene_sample import estimate_of, scene_sample

from vip_factors.simulate.gestures import gestures
from vip_factors.viz.compare import floor_height
from vip_factors.viz.scene_summary import scene_summary
from vip_factors.viz.scene_world import drawn_scene
from vip_factors.viz.set_apart import APART, APART_M, moved, set_apart


def test_paths_that_cross_never_come_near() -> None:
    still = gestures(1.0)
    there = np.linspace(0, 1, len(still))[:, None] * [0.0, 3.0, 0.0]
    walker = replace(still, p_world_pelvis=still.p_world_pelvis + there)
    high = replace(still, p_world_pelvis=still.p_world_pelvis + np.array([7.0, -4.0, 0.5]))
    bodies = [walker, still, high]
    drawn = [moved(one, shift) for one, shift in zip(bodies, set_apart(bodies), strict=True)]
    for index, one in enumerate(drawn):
        assert floor_height(one) == pytest.approx(floor_height(walker), abs=1e-9)
        for other in drawn[:index]:
            off = np.hypot(*(one.p_world_pelvis - other.p_world_pelvis)[:, :2].T)
            assert off.min() >= APART_M - 1e-6
    np.testing.assert_array_equal(drawn[0].p_world_pelvis, walker.p_world_pelvis)


def test_only_wearers_whose_places_are_unknown_are_moved() -> None:
    scene = scene_sample(0.3)
    found = estimate_of(scene)
    blind = replace(found, camera=None, wearer_of_detection=np.zeros(0, int))
    apart, tied = drawn_scene(None, blind), drawn_scene(None, found)
    assert (apart.apart, tied.apart, drawn_scene(scene, blind).apart) == (True, False, False)
    assert APART in scene_summary(apart)
    assert APART not in scene_summary(tied)
    one, other = (wearer.motion.p_world_pelvis[:, :2] for wearer in apart.wearers)
    assert np.linalg.norm(one - other, axis=1).min() >= APART_M - 1e-6
    for wearer, estimate in zip(tied.wearers, found.wearers, strict=True):
        np.testing.assert_array_equal(wearer.motion.p_world_pelvis, estimate.motion.p_world_pelvis)
