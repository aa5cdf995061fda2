"""Repetitions of motions whose figures are known; none in walks, gestures and standing."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from exercises import BEGIN, CURL_DEG, CYCLE, JUMP_M, KINDS, KNEE_DEG, exercises

import vip_factors as vip
from vip_factors.body.kinematics import Motion
from vip_factors.body.model_errors import shape_factor
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError
from vip_factors.estimate import PoseCovariance, WearerEstimate
from vip_factors.geometry.rotations import exp, log
from vip_factors.repetitions.repetition import Repetition
from vip_factors.simulate.gestures import gestures


def found_in(motion: Motion, sigma: float | None = None) -> Sequence[Repetition]:
    covariance = None
    if sigma is not None:
        joints, root = (np.broadcast_to(sigma**2 * np.eye(3), (len(motion), *shape, 3, 3)) for shape in ((24,), ()))
        covariance = PoseCovariance(joints, root)
    (one,) = vip.repetitions(WearerEstimate("a", "SIP", motion, {}, covariance))
    return one.repetitions


@pytest.fixture(scope="module")
def motion() -> Motion:
    return exercises()


@pytest.fixture(scope="module")
def found(motion: Motion) -> Sequence[Repetition]:
    return found_in(motion, np.deg2rad(3.0))


def test_each_is_found_once(found: Sequence[Repetition]) -> None:
    assert [one.kind for one in found] == list(KINDS)
    for number, one in enumerate(found):
        assert one.start == pytest.approx(BEGIN + number * CYCLE, abs=0.3)
        assert one.start < one.turn < one.end < one.start + CYCLE
    assert {one.side for one in found if one.kind == "lunge"} == {"left"}


def test_figures_of_squats_and_curls(found: Sequence[Repetition], motion: Motion) -> None:
    reach = motion.state.p_world_joint[:, 0, 2] - motion.state.p_world_joint[:, joint_index("left_foot"), 2]
    squat, curl = found[0], found[-1]
    during = slice(round(BEGIN * motion.rate), round((BEGIN + CYCLE) * motion.rate))
    assert squat.depth_m.value == pytest.approx(np.ptp(reach[during]), abs=0.005)
    assert 0.005 < squat.depth_m.sigma < 0.05
    assert squat.depth_deg.value == pytest.approx(KNEE_DEG, abs=1)
    assert squat.ranges_deg["left_knee_flexion"].value == pytest.approx(KNEE_DEG, abs=5)
    assert squat.left_less_right_deg.value == pytest.approx(0, abs=1)
    assert squat.left_less_right_deg.sigma > 1
    assert squat.down_s == pytest.approx(squat.up_s, abs=0.05)
    assert curl.ranges_deg["right_elbow_flexion"].value == pytest.approx(CURL_DEG, abs=5)
    assert np.isnan(curl.depth_m.value)


def test_height_of_jumps(found: Sequence[Repetition]) -> None:
    for one in (one for one in found if one.kind == "jump"):
        assert one.flight_height_m.value == pytest.approx(JUMP_M, abs=0.035)  # soles that leave flat leave late
        assert one.flight_height_m.sigma < 0.03
        assert one.rise_m.value == pytest.approx(JUMP_M, abs=0.03)
        assert one.rise_m.sigma > 0


def test_one_bow_is_no_exercise() -> None:
    assert not found_in(exercises(("squat",)))
    assert not found_in(exercises(("curl",)))


def test_none_in_walks_and_standing(motion: Motion) -> None:
    assert not found_in(gestures(20.0, 60.0))
    assert not found_in(motion.frames(slice(0, 50)))
    for few in (1, 2, 3):
        assert not found_in(motion.frames(slice(0, few)))
    with pytest.raises(InputError, match="no frames"):
        found_in(motion.frames(slice(0, 0)))


def test_a_height_that_drifts_does_not_count(motion: Motion) -> None:
    drift = np.zeros((len(motion), 3))
    drift[:, 2] = 0.02 * motion.time
    drifting = replace(motion, p_world_pelvis=motion.p_world_pelvis + drift)
    assert [one.kind for one in found_in(drifting)] == list(KINDS)


def test_sigmas_of_depths_and_jumps(found: Sequence[Repetition], motion: Motion) -> None:
    """Of knees 3° off each by itself; of soles 1.5 cm off when they leave the floor and when they land."""
    thigh, shank = (motion.skeleton.bone_length(f"left_{joint}") for joint in ("knee", "ankle"))
    bends = np.deg2rad(found[0].depth_deg.value + np.array([-0.5, 0.5]))
    per_degree = abs(np.diff(np.sqrt(thigh**2 + shank**2 + 2 * thigh * shank * np.cos(bends)))[0])
    assert found[0].depth_m.sigma == pytest.approx(shape_factor("knee") * 3 * per_degree / np.sqrt(2), rel=0.02)
    for one in (one for one in found if one.kind == "jump"):
        assert 0.015 / np.sqrt(2) < one.flight_height_m.sigma < 0.02  # the slower they leave, the less sure


def test_the_leg_that_bends_more_is_named_by_the_sign(motion: Motion) -> None:
    R, knee = motion.R_parent_child.copy(), joint_index("left_knee")
    R[:, knee] = exp(1.1 * log(R[:, knee]))
    squat = found_in(replace(motion, R_parent_child=R))[0]
    assert squat.left_less_right_deg.value == pytest.approx(0.1 * KNEE_DEG, abs=1)
