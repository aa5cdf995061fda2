from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.estimate import Estimate
from vip_factors.geometry.rotations import angle_between, rotation_z
from vip_factors.sensors.scene import Scene
from vip_factors.viz.compare import (
    SIDE_BY_SIDE_M,
    Compare,
    at_times,
    common_frames,
    floor_height,
    known_bones,
    onto_truth,
    position_error_mm,
)
from vip_factors.viz.scene_world import drawn_scene


def turned(motion, angle: float, shift):
    R = motion.R_parent_child.copy()
    R[:, 0] = rotation_z(angle) @ R[:, 0]
    return replace(motion, R_parent_child=R, p_world_pelvis=motion.p_world_pelvis @ rotation_z(angle).T + shift)


@given(angle=st.floats(-3.1, 3.1), x=st.floats(-5, 5))
def test_the_gauge_is_found_whatever_the_turn_and_shift(scene, angle: float, x: float) -> None:
    moved = turned(scene.truth, angle, np.array([x, -x, 0.5]))
    for compare in (Compare.ROOT, Compare.WORLD):
        back = onto_truth(moved, scene.truth, compare)
        np.testing.assert_allclose(back.state.p_world_joint, scene.truth.state.p_world_joint, atol=1e-9)
    assert position_error_mm(moved, scene.truth).max() < 1e-6


def test_side_by_side_differs_by_one_horizontal_step(scene) -> None:
    aside = onto_truth(scene.truth, scene.truth, Compare.SIDE)
    step = aside.p_world_pelvis - scene.truth.p_world_pelvis
    np.testing.assert_allclose(np.linalg.norm(step, axis=1), SIDE_BY_SIDE_M)
    np.testing.assert_allclose(step[:, 2], 0)


def test_common_frames_cut_to_the_truth(scene) -> None:
    truth = scene.truth.frames(slice(30, 60))
    estimated, true = common_frames(scene.truth, truth)
    assert len(estimated) == len(true) == 30
    np.testing.assert_allclose(estimated.time, truth.time)


def test_interpolation_keeps_a_smooth_motion(scene) -> None:
    coarse = scene.truth.frames(slice(None, None, 2))
    time = scene.truth.time[:-1]
    fine = at_times(coarse, time, scene.truth.rate)
    assert np.rad2deg(angle_between(fine.R_parent_child, scene.truth.R_parent_child[:-1])).max() < 0.5
    np.testing.assert_allclose(fine.time, time)


def test_floor_is_under_the_feet(scene) -> None:
    lowest = scene.truth.state.p_world_joint[..., 2].min()
    assert floor_height(scene.truth) == pytest.approx(lowest, abs=0.08)


def test_what_the_truth_does_not_know_is_no_error(scene) -> None:
    knees = [JOINT_NAMES.index(f"{side}_knee") for side in ("left", "right")]
    R = scene.truth.R_parent_child.copy()
    R[:, knees] = R[:, knees] @ rotation_z(1.0)
    wrong = replace(scene.truth, R_parent_child=R)
    upper = frozenset(name for name in JOINT_NAMES if "knee" not in name and "ankle" not in name)
    assert position_error_mm(wrong, scene.truth).mean() > 10
    assert position_error_mm(wrong, scene.truth, upper).max() < 1e-6
    assert np.isnan(position_error_mm(wrong, scene.truth, frozenset(("left_hand",)))).all()


def test_bones_are_known_of_the_recordings_own_truth(scene) -> None:
    assert scene.recording.truth is not None
    partial = replace(scene.recording, truth=replace(scene.recording.truth, known_bones=frozenset(("pelvis",))))
    assert known_bones(partial, partial.truth.motion) == {"pelvis"}
    assert known_bones(partial, turned(scene.truth, 0.0, np.zeros(3))) is None
    drawn = drawn_scene(Scene("a", (partial,)), Estimate("a", "SIP", (scene.estimate,)))
    whole = drawn_scene(Scene("a", (scene.recording,)), Estimate("a", "SIP", (scene.estimate,)))
    assert not np.allclose(drawn.wearers[0].error_mm, whole.wearers[0].error_mm)
