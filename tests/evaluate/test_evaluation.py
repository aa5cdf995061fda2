"""The table of all metrics, and the frames it compares."""

import json
from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import Skeleton
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, PoseCovariance
from vip_factors.evaluate.evaluation import evaluate, evaluate_motion
from vip_factors.evaluate.frames import common_frames, resample
from vip_factors.geometry.rotations import angle_between, exp
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.recording import Truth
from vip_factors.simulate.gestures import gestures


@pytest.fixture(scope="module")
def truth() -> Motion:
    return gestures(4.0, rate=60.0)


def shaken(motion: Motion, sigma: float) -> Motion:
    turns = sigma * np.random.default_rng(0).standard_normal((len(motion), 24, 3))
    return replace(motion, R_parent_child=motion.R_parent_child @ exp(turns))


def test_resampling_at_the_same_frames_changes_nothing(truth: Motion) -> None:
    again = resample(truth, truth.start, truth.rate, len(truth))
    assert again.R_parent_child == pytest.approx(truth.R_parent_child, abs=1e-9)
    assert again.p_world_pelvis == pytest.approx(truth.p_world_pelvis, abs=1e-12)


def test_other_rates_agree_between_frames(truth: Motion) -> None:
    fine = gestures(4.0, rate=240.0)
    again = resample(truth, 0.0, 240.0, len(fine))
    assert angle_between(again.R_parent_child, fine.R_parent_child).max() < np.deg2rad(0.2)
    assert again.p_world_pelvis == pytest.approx(fine.p_world_pelvis, abs=0.002)


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
    shaking = {"jitter", "jitter_truth", "foot_sliding", "foot_sliding_truth"}
    for name, metric in result.metrics.items():
        if name not in shaking:
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
    result = evaluate(Estimate("walk", "IT", motion.frames(late), found, covariance), Truth(truth, true))
    assert result.frames == len(truth) - 60
    assert result["nees_joints"] == pytest.approx(1.0, abs=0.05)
    assert result["mpjae_local"] == pytest.approx(3.0 * np.sqrt(8 / np.pi), rel=0.05)  # mean of a Maxwell distribution
    assert result["heading_error"] == pytest.approx(np.rad2deg(0.1))
    assert result["yaw_gauge"] == pytest.approx(np.rad2deg(0.1))
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


def test_skeletons_may_differ(truth: Motion) -> None:
    longer = Skeleton(1.06 * truth.skeleton.p_parent_joint, truth.skeleton.landmarks)
    taller = replace(truth, skeleton=longer)
    result = evaluate_motion(taller, truth)
    assert result["mpjpe"] > 10
    assert result["pa_mpjpe"] < 1.0
    assert result["mpjae_local"] == pytest.approx(0.0, abs=1e-5)
