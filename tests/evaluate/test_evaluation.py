"""The table of all metrics, and the frames it compares."""

import json
from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.errors import InputError, RecordingError
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.evaluate.comparison import doubts
from vip_factors.evaluate.evaluation import EvaluationWarning, evaluate, evaluate_motion
from vip_factors.evaluate.metrics import common_frames, resample
from vip_factors.geometry.rotations import exp, rotation_z
from vip_factors.sensors.calibration import SensorCalibration, preset
from vip_factors.sensors.recording import Recording, Truth
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording


@pytest.fixture(scope="module")
def truth() -> Motion:
    return gestures(4.0, rate=60.0)


def shaken(motion: Motion, sigma: float) -> Motion:
    turns = sigma * np.random.default_rng(0).standard_normal((len(motion), 24, 3))
    return replace(motion, R_parent_child=motion.R_parent_child @ exp(turns))


def test_common_frames_are_the_estimates_within_the_truth(truth: Motion) -> None:
    estimate = replace(truth, start=2.5, rate=100.0)
    part, reference, chosen = common_frames(estimate, truth)
    assert part.time[0] == pytest.approx(2.5)
    assert part.time[-1] <= truth.time[-1] + 1e-6
    assert part.time == pytest.approx(reference.time)
    assert len(part) == chosen.stop - chosen.start == 151


def test_motions_apart_in_time_are_refused(truth: Motion) -> None:
    with pytest.raises(InputError, match="share no frame"):
        common_frames(replace(truth, start=100.0), truth)
    with pytest.raises(InputError, match="cannot give"):
        resample(truth, 3.0, 60.0, 1000)


def test_the_truth_is_perfect(truth: Motion) -> None:
    result = evaluate_motion(truth, truth)
    of_both = ("jitter", "foot_sliding")
    for name, metric in result.metrics.items():
        if not name.startswith(of_both):
            assert metric.value == pytest.approx(0.0, abs=1e-5), name
    assert result["jitter"] == pytest.approx(result["jitter_truth"])
    assert all(row["position_mm"] < 1e-6 for row in result.joints.values())


def test_an_estimate_with_everything(truth: Motion) -> None:
    sigma = np.deg2rad(3.0)
    motion = shaken(truth, sigma)
    covariance = PoseCovariance(
        np.broadcast_to(sigma**2 * np.eye(3), (len(truth), 24, 3, 3)), np.broadcast_to(np.eye(3), (len(truth), 3, 3))
    )
    true = {name: SensorCalibration(0.3, np.eye(3)) for name in ("head", "pelvis")}
    found = {"head": SensorCalibration(0.5, np.eye(3), 0.2), "pelvis": SensorCalibration(0.3, exp([0.1, 0, 0]), 1e-3)}
    # Starting later than the truth: covariances must follow their frames.
    late = slice(60, None)
    covariance = PoseCovariance(covariance.joints[late], covariance.root[late])
    result = evaluate(WearerEstimate("walk", "IT", motion.frames(late), found, covariance), Truth(truth, true))
    assert result.frames == len(truth) - 60
    assert result["nees_joints"] == pytest.approx(1.0, abs=0.05)
    assert result["mpjae_local"] == pytest.approx(3.0 * np.sqrt(8 / np.pi), rel=0.05)  # mean of a Maxwell distribution
    assert result["heading_error"] == pytest.approx(np.rad2deg(0.1))
    assert result["nees_heading"] == pytest.approx(1.0)  # of the head, against the pelvis's, which is the world's
    assert result.sensors["pelvis"]["mounting_deg"] == pytest.approx(np.rad2deg(0.1))
    assert "nees_mounting" not in result.metrics  # no sigma was reported


def test_table_and_json_hold_every_number(truth: Motion) -> None:
    still = truth.frames(slice(0, 3))
    result = evaluate_motion(still, still)
    table, parsed = result.to_table(), json.loads(result.to_json())
    assert parsed["metrics"]["mpjpe"]["unit"] == "mm"
    assert parsed["metrics"]["jitter"]["value"] is None  # three frames have no third difference
    for name in result.metrics:
        assert f"| {name} |" in table
    assert "| jitter | n/a |" in table
    assert all(line.count("|") == 4 for line in table.splitlines()[:10])


UPPER = frozenset(name for name in JOINT_NAMES if not any(leg in name for leg in ("hip", "knee", "ankle", "foot")))
LEGS = frozenset({"pelvis", *(name for name in JOINT_NAMES if name not in UPPER)})


@pytest.fixture(scope="module")
def walk() -> Motion:
    return gestures(2.0)


def bent(motion: Motion, joint: str, degrees: float) -> Motion:
    R = motion.R_parent_child.copy()
    R[:, joint_index(joint)] = R[:, joint_index(joint)] @ rotation_z(np.deg2rad(degrees))
    return replace(motion, R_parent_child=R)


def of(motion: Motion) -> WearerEstimate:
    return WearerEstimate("walk", "motion", motion, {})


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
    assert "| knee |" not in str(told)
    assert "| elbow |" in str(told)
    legs = evaluate(of(walk), Truth(walk, known_bones=LEGS))
    assert {"trunk", "forearm", "shoulder width"}.isdisjoint(legs.lengths)
    assert legs["knee_flexion_rmse"] == pytest.approx(0.0, abs=1e-6)


def test_a_truth_of_too_little_is_refused(walk: Motion) -> None:
    with pytest.raises(InputError, match="at least 3"):
        evaluate(of(walk), Truth(walk, known_bones=frozenset({"left_ankle"})))
    with pytest.raises(RecordingError, match="tail"):
        Truth(walk, known_bones=frozenset({"tail"}))


@pytest.fixture(scope="module")
def recording() -> Recording:
    motion = gestures(2.0)
    return simulate_recording(motion, preset("sip6", motion.skeleton), name="walk")


def estimate_of(recording: Recording) -> Estimate:
    assert recording.truth is not None
    assert recording.truth.calibration is not None
    one = WearerEstimate(
        recording.name, "SIP", recording.truth.motion, recording.truth.calibration, sensors=tuple(recording.imus)
    )
    return Estimate(recording.name, "SIP", (one,))


def test_nothing_is_said_of_the_same_recording(recording: Recording) -> None:
    assert doubts(estimate_of(recording), Scene("walk", (recording,))) == ""


def test_names_times_and_sensors_tell(recording: Recording) -> None:
    estimate = estimate_of(recording)
    named = doubts(estimate, Scene("run", (replace(recording, name="run"),)))
    assert "'walk'" in named
    assert "'run'" in named
    later = Scene("walk", (replace(recording, start_ns=10**18),))
    assert "100 s apart" in doubts(estimate, later, 10**18 - 100 * 10**9)
    other = replace(estimate, wearers=(replace(estimate.wearers[0], sensors=("00B40B91",)),))
    assert "00B40B91" in doubts(other, Scene("walk", (recording,)))
    assert recording.truth is not None
    short = replace(recording, truth=replace(recording.truth, motion=recording.truth.motion.frames(slice(0, 40))))
    assert "the truth covers" in doubts(estimate, Scene("walk", (short,)))


def test_calibrations_without_a_common_sensor_are_left_out_with_a_note(recording: Recording) -> None:
    estimate = estimate_of(recording).wearers[0]
    numbered = {f"00B4{number}": one for number, one in enumerate(estimate.calibration.values())}
    assert recording.truth is not None
    with pytest.warns(EvaluationWarning, match="00B40, 00B41"):
        evaluation = evaluate(replace(estimate, calibration=numbered), recording.truth)
    assert "heading_error" not in evaluation.metrics
    assert evaluation["mpjpe"] == pytest.approx(0.0, abs=1e-6)
