"""The benchmark of the fixed-lag tracker against batch: its measures, and a tiny run all the way through."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies import scenes, stream_accuracy
from tests.studies.live_run import filled_motion, pose_errors, since_start
from tests.studies.scenes import true_motion
from tests.studies.stream_accuracy import StreamAccuracy
from tests.studies.study import markdown, run
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError, RecordingError
from vip_factors.geometry.rotations import exp, rotation_z
from vip_factors.live.settings import LiveSettings
from vip_factors.live_estimate import LivePose
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.solve.levenberg_marquardt import SolveSettings

SETTINGS = LiveSettings(frame_rate=30.0, calibration_rate=10.0, solve=SolveSettings(max_iterations=2))

# A recording of a moment.
QUICK = StreamAccuracy(
    motions=Path(), clips=("07_01",), seconds=1.8, lags=(0.25,), cameras=("fixed", "none"), begins=("t-pose",),
    settings=SETTINGS,
)  # fmt: skip


@pytest.fixture(scope="module")
def truth() -> Motion:
    return gestures(4.0, rate=30.0)


def _poses(motion: Motion, error_deg: float = 0.0, sigma_deg: float = 1.0, seed: int = 0) -> list[LivePose]:
    noise = np.deg2rad(error_deg) * np.random.default_rng(seed).standard_normal((len(motion), 24, 3))
    covariance = np.deg2rad(sigma_deg) ** 2 * np.tile(np.eye(3), (24, 1, 1))
    R = motion.R_parent_child @ exp(noise)
    return [
        LivePose(float(time), R[n], motion.p_world_pelvis[n], covariance, np.eye(3))
        for n, time in enumerate(motion.time)
    ]


def test_root_errors_are_free_of_the_gauge_and_counted_from_a_moment_on(truth: Motion) -> None:
    R = rotation_z(0.7)
    turned = truth.R_parent_child.copy()
    turned[:, 0] = R @ turned[:, 0]
    moved = replace(truth, R_parent_child=turned, p_world_pelvis=truth.p_world_pelvis @ R.T + [1.0, 2.0, 3.0])
    errors = pose_errors(moved, truth, 1.0)
    assert errors.frames == len(truth) - 30
    assert max(errors.mpjpe_mm, errors.mpjae_deg, errors.root_cm) < 1e-4
    with pytest.raises(InputError, match=r"ends at 4\.00 s: expected more than 5 s"):
        pose_errors(moved, truth, 5.0)


def test_honest_covariances_expect_the_error_that_there_is(truth: Motion) -> None:
    spans = since_start(_poses(truth, 3.0, 3.0), 1.0, truth)
    assert [(one.since_s, one.until_s) for one in spans] == [(0.0, 1.0), (1.0, 3.0), (3.0, 6.0)]
    assert [one.frames for one in spans] == [30, 60, 1]  # what came before the first answer in time is not judged
    for one in spans[:2]:
        assert one.sigma_deg == pytest.approx(3.0 * np.sqrt(3))
        assert one.error_deg == pytest.approx(one.sigma_deg, rel=0.1)


def test_where_tracking_was_lost_the_pose_before_is_kept(truth: Motion) -> None:
    poses = _poses(truth)
    motion = filled_motion([*poses[:10], *poses[15:]], truth.skeleton, 30.0, "gestures")
    assert len(motion) == len(truth)
    np.testing.assert_array_equal(motion.p_world_pelvis[14], truth.p_world_pelvis[9])
    np.testing.assert_array_equal(motion.p_world_pelvis[15], truth.p_world_pelvis[15])


def test_both_beginnings_have_the_same_sensors_and_as_much_to_compare() -> None:
    posed, moving = (QUICK.scene(gestures(2.5), "walk", "fixed", begin, 0) for begin in ("t-pose", "in-motion"))
    assert [scene.wearers[0].initial_pose for scene in (posed, moving)] == ["t-pose", "none"]
    lengths = [true_motion(scene.wearers[0]).time[-1] for scene in (posed, moving)]
    assert lengths[0] == pytest.approx(lengths[1], abs=0.1)
    assert QUICK.scene(gestures(2.5), "walk", "none", "t-pose", 0).camera is None


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StreamAccuracy:
    (tmp_path / "07_01.bvh").touch()
    monkeypatch.setattr(scenes, "read_motion", lambda path: gestures(2.5))
    return replace(QUICK, motions=tmp_path)


@pytest.mark.slow
def test_a_run_from_clips_to_tables(study: StreamAccuracy) -> None:
    rows = run(study)
    assert [(one.camera, one.estimator) for one in rows] == [
        ("fixed", "batch"), ("fixed", "lag 0.25 s"), ("none", "batch"), ("none", "lag 0.25 s"),
    ]  # fmt: skip
    assert not any(one.failure for one in rows)
    assert rows[1].newest.mpjpe_mm < 100
    assert len(rows[1].sensors) == 13
    assert rows[1].over_time[0].sigma_deg > 0
    tables = markdown(study, rows)
    assert "| fixed | t-pose | lag 0.25 s |" in tables
    assert "0 to 1 s: mm" in tables


def test_what_cannot_be_tracked_is_told_and_left_out(study: StreamAccuracy, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(scene: Scene, settings: LiveSettings) -> None:
        raise RecordingError("the tracker gave no answer")

    for name in ("run_live", "smooth"):
        monkeypatch.setattr(stream_accuracy, name, fail)
    rows = run(replace(study, cameras=("none",)))
    assert all(one.failure == "RecordingError: the tracker gave no answer" for one in rows)
    assert "- 07_01, none, t-pose, batch: RecordingError" in markdown(study, rows)
