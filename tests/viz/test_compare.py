from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scene_sample import estimate_of, scene_sample

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.evaluate.comparison import compare_motion
from vip_factors.evaluate.evaluation import evaluate
from vip_factors.geometry.rotations import rotation_z
from vip_factors.sensors.recording import Truth
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.viz.drawn_scene import (
    APART,
    APART_M,
    drawn_scene,
    floor_height,
    onto_truth,
    set_apart,
)
from vip_factors.viz.rerun_layout import scene_summary


def turned(motion, angle: float, shift):
    R = motion.R_parent_child.copy()
    R[:, 0] = rotation_z(angle) @ R[:, 0]
    return replace(motion, R_parent_child=R, p_world_pelvis=motion.p_world_pelvis @ rotation_z(angle).T + shift)


@given(angle=st.floats(-3.1, 3.1), x=st.floats(-5, 5))
def test_the_gauge_is_found_whatever_the_turn_and_shift(scene, angle: float, x: float) -> None:
    moved = turned(scene.truth, angle, np.array([x, -x, 0.5]))
    back = onto_truth(moved, scene.truth)
    np.testing.assert_allclose(back.state.p_world_joint, scene.truth.state.p_world_joint, atol=1e-9)
    assert compare_motion(moved, Truth(scene.truth)).error_mm.max() < 1e-6


def test_what_the_truth_does_not_know_is_no_error(scene) -> None:
    knees = [JOINT_NAMES.index(f"{side}_knee") for side in ("left", "right")]
    R = scene.truth.R_parent_child.copy()
    R[:, knees] = R[:, knees] @ rotation_z(1.0)
    wrong = WearerEstimate("a", "SIP", replace(scene.truth, R_parent_child=R), {})
    upper = frozenset(name for name in JOINT_NAMES if "knee" not in name and "ankle" not in name)
    for known, most, least in ((None, np.inf, 10), (upper, 1e-6, 0)):
        recording = replace(scene.recording, truth=Truth(scene.truth, known_bones=known))
        drawn = drawn_scene(Scene("a", (recording,)), Estimate("a", "SIP", (wrong,)))
        assert least <= drawn.wearers[0].error_mm.mean() <= most
        assert drawn.wearers[0].error_mm.mean() == pytest.approx(evaluate(wrong, recording.truth)["mpjpe"])
    little = Truth(scene.truth, known_bones=frozenset(("left_hand",)))
    assert np.isnan(compare_motion(wrong.motion, little).error_mm).all()


def test_paths_that_cross_never_come_near() -> None:
    still = gestures(1.0)
    there = np.linspace(0, 1, len(still))[:, None] * [0.0, 3.0, 0.0]
    walker = replace(still, p_world_pelvis=still.p_world_pelvis + there)
    high = replace(still, p_world_pelvis=still.p_world_pelvis + np.array([7.0, -4.0, 0.5]))
    bodies = [walker, still, high]
    drawn = [
        replace(one, p_world_pelvis=one.p_world_pelvis + shift)
        for one, shift in zip(bodies, set_apart(bodies), strict=True)
    ]
    for index, one in enumerate(drawn):
        assert floor_height(one) == pytest.approx(floor_height(walker), abs=1e-9)
        for other in drawn[:index]:
            off = np.hypot(*(one.p_world_pelvis - other.p_world_pelvis)[:, :2].T)
            assert off.min() >= APART_M - 1e-6
    np.testing.assert_array_equal(drawn[0].p_world_pelvis, walker.p_world_pelvis)


def test_only_wearers_whose_places_are_unknown_are_moved() -> None:
    scene = scene_sample(0.3)
    found = estimate_of(scene)
    blind = replace(found, cameras=())
    apart, tied = drawn_scene(None, blind), drawn_scene(None, found)
    assert (apart.apart, tied.apart, drawn_scene(scene, blind).apart) == (True, False, False)
    assert APART in scene_summary(apart)
    assert APART not in scene_summary(tied)
    one, other = (wearer.motion.p_world_pelvis[:, :2] for wearer in apart.wearers)
    assert np.linalg.norm(one - other, axis=1).min() >= APART_M - 1e-6
    for wearer, estimate in zip(tied.wearers, found.wearers, strict=True):
        np.testing.assert_array_equal(wearer.motion.p_world_pelvis, estimate.motion.p_world_pelvis)
