"""Limbs of which the truth knows nothing are not compared, and five lines tell the most important."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.errors import InputError, RecordingError
from vip_factors.estimate import Estimate
from vip_factors.evaluate.evaluation import evaluate
from vip_factors.evaluate.joints import ORIENTATION_JOINTS, POSITION_JOINTS, Compared
from vip_factors.geometry.rotations import rotation_z
from vip_factors.sensors.recording import Truth
from vip_factors.simulate.gestures import gestures

UPPER = frozenset(name for name in JOINT_NAMES if not any(leg in name for leg in ("hip", "knee", "ankle", "foot")))
LEGS = frozenset({"pelvis", *(name for name in JOINT_NAMES if name not in UPPER)})


@pytest.fixture(scope="module")
def walk() -> Motion:
    return gestures(2.0)


def bent(motion: Motion, joint: str, degrees: float) -> Motion:
    R = motion.R_parent_child.copy()
    R[:, joint_index(joint)] = R[:, joint_index(joint)] @ rotation_z(np.deg2rad(degrees))
    return replace(motion, R_parent_child=R)


def of(motion: Motion) -> Estimate:
    return Estimate("walk", "motion", motion, {})


def test_the_bone_above_says_whether_a_place_is_known() -> None:
    legs = Compared.of(LEGS)
    assert [JOINT_NAMES[row] for row in legs.positions(POSITION_JOINTS)] == [
        "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    ]  # fmt: skip
    assert {JOINT_NAMES[row] for row in Compared.of(UPPER).positions(POSITION_JOINTS)} >= {"left_hip", "left_wrist"}
    assert {JOINT_NAMES[row] for row in Compared.of(UPPER).orientations(ORIENTATION_JOINTS)} == {
        "neck", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("known", "elsewhere", "here"), [(UPPER, "left_knee", "left_elbow"), (LEGS, "neck", "left_knee")]
)
def test_limbs_that_are_no_truth_change_nothing(walk: Motion, known: frozenset[str], elsewhere: str, here: str) -> None:
    truth = Truth(walk, known_bones=known)
    wrong_elsewhere = evaluate(of(bent(walk, elsewhere, 40.0)), truth)
    for name in (
        "mpjpe",
        "mpjae",
        "mpjae_local",
        "pa_mpjpe",
        "root_relative_mpjpe",
        "w_mpjpe",
        "global_position_error",
    ):
        assert wrong_elsewhere[name] == pytest.approx(0.0, abs=1e-5), name
        assert evaluate(of(bent(walk, here, 40.0)), truth)[name] > 0.1, name
    assert evaluate(of(bent(walk, elsewhere, 40.0)), Truth(walk))["mpjae"] > 1.0


def test_tables_leave_out_what_is_not_known(walk: Motion) -> None:
    told = evaluate(of(walk), Truth(walk, known_bones=UPPER))
    assert "left_ankle" not in told.joints
    assert np.isnan(told.joints["left_hip"]["local_deg"])  # the hip sits on the pelvis, the thigh is not known
    assert {"thigh", "shank"}.isdisjoint(told.lengths)
    assert np.isnan(told["knee_flexion_rmse"])
    assert "knee" in str(told)
    legs = evaluate(of(walk), Truth(walk, known_bones=LEGS))
    assert {"trunk", "forearm", "shoulder width"}.isdisjoint(legs.lengths)
    assert legs["knee_flexion_rmse"] == pytest.approx(0.0, abs=1e-6)


def test_a_truth_of_too_little_is_refused(walk: Motion) -> None:
    with pytest.raises(InputError, match="at least 3"):
        evaluate(of(walk), Truth(walk, known_bones=frozenset({"left_ankle"})))
    with pytest.raises(RecordingError, match="tail"):
        Truth(walk, known_bones=frozenset({"tail"}))


def test_five_lines_tell_their_gauge(walk: Motion) -> None:
    told = evaluate(of(bent(walk, "left_elbow", 30.0)), Truth(walk))
    lines = told.summary()
    assert [line.split()[0] for line in lines] == ["positions", "orientation", "sensors", "path", "honesty"]
    gauges = ("aligned rigidly", "no alignment", "not compared", "alignment of the path", "not compared")
    for line, gauge in zip(lines, gauges, strict=True):
        assert gauge in line
    assert f"{told['mpjpe']:.2f} mm" in lines[0]
    assert f"{told['mpjae']:.2f}°" in lines[1]
    assert str(told).startswith(lines[0])
