"""The fixed-lag tracker on short streams: every frame is answered, near the truth and near the batch, always alike."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from filmed_gestures import filmed_gestures
from tracked import (
    LAG,
    QUICK,
    RATE,
    filmed,
    placed_camera,
    poses,
    track,
    tracked,
    tracked_by_placed_camera,
    unfilmed,
)

from vip_factors.evaluate.metrics import mpjpe
from vip_factors.geometry.poses import align_yaw
from vip_factors.geometry.rotations import rotation_z
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame, live_samples, stream_head
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.simulate.staging import placed

FRAMES = round(4.0 * RATE) - 1  # the first is where video and the last of the sensors have begun


def test_every_frame_is_answered_once_and_in_order() -> None:
    answers = tracked().answers
    assert [one.frame for one in answers] == list(range(FRAMES))
    time = np.array([one.time for one in answers])
    np.testing.assert_allclose(np.diff(time), 1 / RATE, atol=1e-9)
    assert all(one.wearers[0].newest.time == one.time for one in answers)


def test_smoothed_poses_come_one_lag_later_each_once() -> None:
    answers = tracked().answers
    late = [one.time - one.wearers[0].smoothed.time for one in answers if one.wearers[0].smoothed is not None]
    np.testing.assert_allclose(late, LAG / RATE, atol=1e-9)
    assert [one.wearers[0].smoothed is None for one in answers] == [True] * LAG + [False] * (len(answers) - LAG)


def test_answers_are_near_the_truth() -> None:
    assert tracked().error_mm("smoothed") < 40
    assert tracked().error_mm("newest") < 45


def test_the_wearer_is_seen_by_the_camera() -> None:
    one, truth = tracked(), filmed().camera.truth
    assert truth is not None
    seen = [answer.wearers[0].detection for answer in one.answers if answer.time > 1.5]
    assert np.mean([person is not None for person in seen]) > 0.9
    assert one.answers[-1].cameras[0].smoothed is not None


def test_toes_are_just_above_the_floor_before_a_camera_of_unknown_pose() -> None:
    toes = tracked().motion("smoothed").state.p_world_joint[:, [10, 11], 2].min(axis=1)
    assert 0.0 < np.median(toes) < 0.08


def test_smoothed_poses_are_near_the_batch() -> None:
    batch = smooth(filmed(), Settings(frame_rate=RATE, covariance=False)).wearers[0].motion
    ours = tracked().motion("smoothed")
    first = round((ours.start - batch.start) * RATE)
    late = round(2.0 * RATE)
    count = len(ours) - late
    theirs = batch.frames(slice(first + late, first + late + count))
    assert mpjpe(ours.frames(slice(late, late + count)), theirs) < 25


def test_covariances_are_positive_and_calibrations_get_surer() -> None:
    answers = tracked().answers
    for one in (answers[0], answers[len(answers) // 2], answers[-1]):
        pose = one.wearers[0].newest
        assert pose.joint_covariance is not None
        assert pose.root_covariance is not None
        assert np.linalg.eigvalsh(pose.joint_covariance).min() > 0
        assert np.linalg.eigvalsh(pose.root_covariance).min() > 0
    begin, end = (one.wearers[0].calibration for one in (answers[round(1.2 * RATE)], answers[-1]))
    for name, sensor in end.items():
        assert 0 < sensor.heading_sigma < 0.2
        assert np.all(sensor.mounting_sigma > 0)
        assert np.linalg.norm(sensor.mounting_sigma) < 0.9 * np.linalg.norm(begin[name].mounting_sigma)


def test_smoothed_poses_are_surer_than_the_newest() -> None:
    last = tracked().answers[-1].wearers[0]
    assert last.smoothed is not None
    sizes = [
        np.trace(np.asarray(one.joint_covariance), axis1=1, axis2=2).mean() for one in (last.smoothed, last.newest)
    ]
    assert sizes[0] < sizes[1]


def test_the_order_of_samples_within_an_instant_is_nothing() -> None:
    samples = sorted(
        enumerate(live_samples(filmed())), key=lambda one: (one[1].time, isinstance(one[1], VideoFrame), -one[0])
    )
    again = track(filmed(), [sample for _, sample in samples])
    assert len(again.answers) == len(tracked().answers)
    for one, other in zip(again.answers, tracked().answers, strict=True):
        np.testing.assert_array_equal(one.wearers[0].newest.R_parent_child, other.wearers[0].newest.R_parent_child)
        np.testing.assert_array_equal(one.wearers[0].newest.p_world_pelvis, other.wearers[0].newest.p_world_pelvis)


def test_finish_answers_the_rest() -> None:
    scene = unfilmed(filmed())
    tracker = FixedLagTracker(stream_head(scene), QUICK)
    answered = [one for sample in live_samples(scene) if sample.time < 2.0 for one in tracker.push(sample)]
    rest = tracker.finish()
    assert [one.frame for one in (*answered, *rest)] == list(range(len(answered) + len(rest)))
    assert answered[-1].time < 1.99 < (answered + rest)[-1].time + 1 / RATE
    assert tracker.finish() == []


def test_imus_alone_are_tracked() -> None:
    alone = track(unfilmed(filmed()), settings=QUICK)
    assert [one.frame for one in alone.answers] == list(range(FRAMES + 1))
    assert alone.error_mm("smoothed") < 60
    assert all(not one.cameras and one.wearers[0].detection is None for one in alone.answers)


def test_two_wearers_are_told_apart() -> None:
    both = track(filmed_gestures("fixed", 3.0, ("anna", "ben")), settings=QUICK)
    truth = both.scene.camera.truth
    assert truth is not None
    assert [one.name for one in both.answers[-1].wearers] == ["anna", "ben"]
    for wearer in (0, 1):
        assert both.error_mm("smoothed", wearer=wearer) < 50
    assert both.scene.camera is not None
    detections = both.scene.camera.detections
    right, taken = 0, 0
    for answer in both.answers[round(1.5 * RATE) :]:
        frame = int(np.flatnonzero(detections.time <= answer.time + 1e-6)[-1])
        known = truth.wearer[detections.of_frame(frame)]
        for number, one in enumerate(answer.wearers):
            if one.detection is not None and one.detection < len(known):
                taken, right = taken + 1, right + (known[one.detection] == number)
    assert taken > 0.7 * 2 * 1.5 * RATE
    assert right > 0.9 * taken  # of some answers the newest video frame is not in yet


def test_a_wearer_whom_the_camera_sees_late_is_found() -> None:
    def empty(sample: LiveSample) -> LiveSample:
        if isinstance(sample, VideoFrame) and sample.time < 2.0:
            return replace(sample, pixels=sample.pixels[:0], confidence=sample.confidence[:0])
        return sample

    late = track(filmed(), map(empty, live_samples(filmed())), QUICK)
    assert [one.frame for one in late.answers] == list(range(FRAMES))
    assert "found in the video" in late.findings
    assert not late.answers[round(1.5 * RATE)].cameras
    assert late.answers[-1].cameras
    assert late.answers[-1].wearers[0].detection is not None
    assert late.error_mm("smoothed", after=3.2) < 50


def test_a_sensor_that_comes_late_is_used() -> None:
    name = "left_forearm"
    some = (
        sample
        for sample in live_samples(filmed())
        if not (isinstance(sample, ImuSample) and sample.sensor == name and sample.time < 1.5)
    )
    late = track(filmed(), some, QUICK)
    assert f"sensor '{name}' of 'anna' has sent nothing yet" in late.findings
    assert "another sensor is used" in late.findings
    assert name not in late.answers[round(1.4 * RATE)].wearers[0].calibration
    assert name in late.answers[-1].wearers[0].calibration
    assert [one.frame for one in late.answers] == list(range(FRAMES))
    assert late.error_mm("smoothed", after=3.2) < 60


def test_garbage_is_left_out_and_told() -> None:
    samples: list[LiveSample] = []
    for number, sample in enumerate(live_samples(filmed())):
        samples.append(sample)
        if number % 50 == 25:
            bad = np.full((3, 3), np.nan)
            samples += [
                ImuSample("anna", "third_arm", sample.time, np.eye(3), np.zeros(3)),
                ImuSample("nobody", "pelvis", sample.time, np.eye(3), np.zeros(3)),
                ImuSample("anna", "pelvis", sample.time, bad, np.zeros(3)),
                ImuSample("anna", "pelvis", float("nan"), np.eye(3), np.zeros(3)),
                ImuSample("anna", "sternum", sample.time + 1e9, np.eye(3), np.zeros(3)),
                VideoFrame("no camera", sample.time, np.zeros((1, 18, 2)), np.ones((1, 18))),
                VideoFrame("camera", sample.time, np.zeros((1, 5, 2)), np.ones((1, 5))),
            ]
    through = track(filmed(), samples)
    for part in ("'third_arm'", "'nobody'", "'no camera'", "skipped", "jumped from"):
        assert part in through.findings, part
    assert [one.frame for one in through.answers] == list(range(FRAMES))
    assert through.error_mm("smoothed") < tracked().error_mm("smoothed") + 1


def test_the_world_may_be_turned() -> None:
    """Nothing knows where north is: turned inertial frames and a turned camera give turned answers."""
    angle = 2.0
    R = rotation_z(angle)
    scene = placed_camera()
    assert scene.camera is not None
    assert scene.camera.known_path is not None
    path = scene.camera.known_path
    turned_path = CameraPath(path.time, R @ path.R_world_camera, path.p_world_camera @ R.T)
    turned = replace(scene, cameras=(replace(scene.camera, known_path=turned_path),))

    def turn(sample: LiveSample) -> LiveSample:
        if isinstance(sample, VideoFrame) or sample.R_inertial_sensor is None:
            return sample
        return replace(sample, R_inertial_sensor=R @ sample.R_inertial_sensor)

    one, other = tracked_by_placed_camera(), track(turned, map(turn, live_samples(scene)))
    assert one.error_mm("smoothed") < 40
    for kind in ("newest", "smoothed"):
        for ours, theirs in zip(poses(one.answers, kind), poses(other.answers, kind), strict=True):
            np.testing.assert_allclose(R @ ours.R_parent_child[0], theirs.R_parent_child[0], atol=2e-3)
            np.testing.assert_allclose(ours.R_parent_child[1:], theirs.R_parent_child[1:], atol=2e-3)
            np.testing.assert_allclose(R @ ours.p_world_pelvis, theirs.p_world_pelvis, atol=2e-3)


def test_a_known_camera_holds_the_wearer_in_place() -> None:
    one = tracked_by_placed_camera()
    motion, truth = one.motion("smoothed"), filmed().wearers[0].truth
    assert truth is not None
    late = motion.frames(slice(round(2.0 * RATE), None))
    true = np.stack([np.interp(late.time, truth.motion.time, truth.motion.p_world_pelvis[:, k]) for k in range(3)], 1)
    assert np.linalg.norm(late.p_world_pelvis - true, axis=1).mean() < 0.15
    assert align_yaw(late.p_world_pelvis, true) is not None


@pytest.mark.slow
def test_two_carried_cameras_are_tracked_in_one_world() -> None:
    motion = placed(gestures(4.0), 0.3, (0.4, -0.2))
    settings = SceneSettings(camera="hand-held", cameras=2, carried=1, azimuth_deg=20.0)
    scene = simulate_scene([Performer("anna", motion, preset("tnt10", motion.skeleton))], settings, seed=1)
    second = replace(scene, cameras=scene.cameras[1:])
    assert all(camera.moving and camera.known_path is None for camera in scene.cameras)
    both = track(scene)
    assert both.error_mm("smoothed") < 0.8 * track(second).error_mm("smoothed")
    camera = both.answers[-1].cameras[0].smoothed
    true_path = scene.cameras[0].truth.path
    assert camera.covariance.shape == (6, 6)
    assert abs(camera.p_world_camera[2] - true_path.at(np.array([camera.time])).p_world_camera[0, 2]) < 0.3


def test_memory_does_not_grow() -> None:
    scene = unfilmed(filmed_gestures("fixed", 3.0))
    tracker = FixedLagTracker(stream_head(scene), QUICK)
    traced = []
    marks = [1.7, 2.3, 2.9]
    tracemalloc.start(1)
    try:
        for sample in live_samples(scene):
            tracker.push(sample)
            if marks and sample.time >= marks[0]:
                traced.append(tracemalloc.get_traced_memory()[0])
                marks.pop(0)
    finally:
        tracemalloc.stop()
    assert max(traced[1:]) - traced[0] < 300_000


@pytest.mark.parametrize("seconds", [0.0, 0.3, 0.8])
def test_a_stream_that_ends_before_it_begins(seconds: float) -> None:
    scene = unfilmed(filmed())
    tracker = FixedLagTracker(stream_head(scene), QUICK)
    for sample in live_samples(scene):
        if sample.time < seconds:
            assert tracker.push(sample) == []
    answers = tracker.finish()
    assert [one.frame for one in answers] == list(range(len(answers)))
