"""What a camera of known pose tells a stream: feet on the floor, keypoints as expected, and a second camera."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tracked import QUICK, RATE, Tracked, filmed, placed_camera, track, tracked_by_placed_camera

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.cli.options import read_settings
from vip_factors.evaluate.metrics import common_frames
from vip_factors.factor_settings import AdaptiveBiweightSettings, ContactFrom
from vip_factors.live.association import Belief
from vip_factors.live.camera_observer import CameraObserver
from vip_factors.live.smoother import LagSmoother
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.problem.scene import SceneProblem
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.live import LiveSample, VideoFrame, live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.simulate.staging import placed

KAICHI = Path(__file__).parents[2] / "docs" / "kaichi.toml"


def with_ground(settings: LiveSettings, **changes: Any) -> LiveSettings:
    ground = replace(settings.camera.ground_contact, **changes)
    return replace(settings, camera=replace(settings.camera, ground_contact=ground))


def with_biweight(settings: LiveSettings) -> LiveSettings:
    reprojection = replace(settings.camera.reprojection, biweight=AdaptiveBiweightSettings(use=True))
    return replace(settings, camera=replace(settings.camera, reprojection=reprojection))


def placed_cm(one: Tracked, kind: str = "smoothed", after: float = 1.5) -> float:
    """Mean joint error with nothing aligned, from a time on."""
    motion, truth = one.motion(kind), one.scene.wearers[0].truth
    assert truth is not None
    ours, true, _ = common_frames(motion.frames(slice(round((after - motion.start) * RATE), None)), truth.motion)
    off = ours.state.p_world_joint - true.state.p_world_joint
    return float(100 * np.linalg.norm(off, axis=2).mean())


@cache
def begun(settings: LiveSettings) -> FixedLagTracker:
    """A tracker two seconds into the scene with the known camera."""
    tracker = FixedLagTracker(stream_head(placed_camera()), settings)
    for sample in live_samples(placed_camera()):
        if sample.time < 2.0:
            tracker.push(sample)
    return tracker


def stretch(settings: LiveSettings) -> tuple[LagSmoother, SceneProblem]:
    """The problem of the frames that the tracker keeps, and where it stands."""
    tracking = begun(settings)._tracking
    assert tracking is not None
    smoother = tracking.smoother
    frames = [smoother.frame(number) for number in smoother.numbers]
    return smoother, smoother.problem.model(frames, beginning=False)


def test_feet_that_stand_are_held_where_their_pixels_meet_the_floor() -> None:
    smoother, model = stretch(QUICK)
    ground, view = model.views[0][0].ground, model.views[0][0]
    assert ground is not None
    assert ground.stands.any()
    assert not ground.stands[~view.seen.any(axis=1)].any()
    truth = filmed().wearers[0].truth
    assert truth is not None
    time = [smoother.frame(number).time for number in smoother.numbers]
    nearest = np.rint((np.array(time) - truth.motion.start) * truth.motion.rate).astype(int)
    true = truth.motion.frames(slice(0, None)).state.p_world_joint[nearest]
    heights = np.stack([true[:, foot.bone, 2] for foot in ground.feet], axis=1)
    assert np.median(heights[ground.stands]) < np.median(heights[~ground.stands]) - 0.01  # swinging feet are higher
    camera = smoother.shared.cameras[0].poses
    for g, foot in enumerate(ground.feet):
        rows = np.flatnonzero(ground.stands[:, g])
        d = ground.rays[rows, g] @ camera.R_world_camera[0].T
        ends = (
            camera.p_world_camera[0] + d * ((true[rows, foot.bone, 2] - camera.p_world_camera[0, 2]) / d[:, 2])[:, None]
        )
        assert np.median(np.linalg.norm(ends - true[rows, foot.bone], axis=1)) < 0.2


def test_feet_may_be_told_by_their_sensors() -> None:
    _, model = stretch(with_ground(QUICK, contact_from=ContactFrom.ACCELERATION))
    assert model.views[0][0].ground is not None
    # One of both feet always stands, by their word.
    seen = model.views[0][0].seen.all(axis=1)
    assert model.views[0][0].ground.stands[seen].any(axis=1).all()


def test_where_it_is_not_wanted_or_the_pose_unknown_there_is_none() -> None:
    _, model = stretch(with_ground(QUICK, use=False))
    assert model.views[0][0].ground is None
    tracker = FixedLagTracker(stream_head(filmed()), QUICK)
    for sample in live_samples(filmed()):
        if sample.time < 1.5:
            tracker.push(sample)
    assert tracker._tracking is not None
    assert tracker._tracking.smoother.problem.feet == [[None]]


def test_a_wearer_before_a_known_camera_is_where_they_are() -> None:
    one = tracked_by_placed_camera()
    assert placed_cm(one) < 8
    assert placed_cm(one, "newest") < 10


@pytest.mark.parametrize("far_px", [15.0, 400.0])
def test_keypoints_far_from_where_they_are_expected_count_less(far_px: float) -> None:
    scene, truth = placed_camera(), filmed().wearers[0].truth
    setup, settings = stream_head(scene), with_biweight(QUICK)
    assert truth is not None
    assert scene.camera is not None
    assert scene.camera.known_path is not None
    assert setup.camera is not None
    motion, path = truth.motion.frames(slice(0, 1)), scene.camera.known_path
    skeleton = setup.wearers[0].subject.body()
    body = forward_kinematics(skeleton, motion.R_parent_child, motion.p_world_pelvis)
    R, p = path.R_world_camera[0], path.p_world_camera[0]
    places = setup.camera.keypoints.on_body(skeleton)
    points = [np.zeros(3) if place is None else body.point(place.bone, place.p_bone_point)[0] for place in places]
    pixels = scene.camera.model.project((np.stack(points) - p) @ R)
    pixels[places.index(next(place for place in places if place is not None))] += far_px
    video = VideoFrame("camera", 0.0, pixels[None], np.full((1, len(pixels)), 0.9))
    views = []
    for one in (QUICK, settings):
        observer = CameraObserver(setup.camera, [skeleton], [0.0], [1.0], one.camera)
        belief = Belief(0, [body], np.eye(3)[None, None], R[None], p[None])
        views.append(observer._view(video, 0, 0, belief, None))
    plain, careful = views
    assert careful.seen[0, 0] == (far_px < 100)
    assert careful.confidence[0, 0] < plain.confidence[0, 0]
    np.testing.assert_allclose(careful.sigma[0, 1:], plain.sigma[0, 1:], rtol=1e-6)
    np.testing.assert_allclose(careful.confidence[0, 1:], 0.9, rtol=1e-6)
    assert careful.ground is None


@cache
def two_cameras() -> Scene:
    """Both of known pose, facing each other."""
    motion = placed(gestures(3.0), 0.3, (0.4, -0.2))
    settings = SceneSettings(camera="fixed", cameras=2, azimuth_deg=270.0)
    return simulate_scene([Performer("anna", motion, preset("tnt10", motion.skeleton))], settings, seed=5)


@pytest.mark.slow
def test_two_cameras_tell_more_than_one() -> None:
    two = track(two_cameras())
    one = track(replace(two_cameras(), cameras=two_cameras().cameras[:1]))
    assert placed_cm(two) < 0.9 * placed_cm(one)
    assert placed_cm(two) < 5


def test_kaichis_estimator_on_a_stream() -> None:
    """Frames each by itself, nothing that all share, their weights."""
    settings = read_settings(KAICHI, QUICK)
    assert settings.lag_s == QUICK.lag_s
    one = track(placed_camera(), settings=settings)
    assert all("does not determine how right_forearm" in sentence for sentence in one.findings.splitlines())
    assert one.error_mm("newest") < 60
    assert placed_cm(one, "newest") < 20
    tracking = begun(settings)._tracking
    assert tracking is not None
    assert tracking.smoother.problem.layout.static_width == 0
    assert np.isnan(one.answers[-1].wearers[0].calibration["pelvis"].heading_sigma)


def test_their_imus_alone_walk_on_standing_feet() -> None:
    """Where the camera is not used the root follows the feet, and goes neither up nor down."""
    settings = read_settings(KAICHI, QUICK)
    settings = replace(settings, fusion=replace(settings.fusion, use_camera=False))
    one = track(placed_camera(), settings=settings)
    assert not any(answer.cameras for answer in one.answers)
    assert one.error_mm("newest") < 60
    motion, truth = one.motion("newest"), filmed().wearers[0].truth
    assert truth is not None
    ours, true, _ = common_frames(motion, truth.motion)
    assert np.abs(ours.p_world_pelvis[:, 2] - true.p_world_pelvis[:, 2]).max() < 0.1
    gone, truly = (np.linalg.norm(np.diff(m.p_world_pelvis[::15, :2], axis=0), axis=1).sum() for m in (ours, true))
    assert 0.7 < gone / truly < 1.4


def test_a_stretch_without_the_wearer_does_not_lose_their_estimator() -> None:
    def blind(sample: LiveSample) -> LiveSample:
        if isinstance(sample, VideoFrame) and 2.0 < sample.time < 2.6:
            return replace(sample, pixels=sample.pixels[:0], confidence=sample.confidence[:0])
        return sample

    settings = read_settings(KAICHI, QUICK)
    one = track(placed_camera(), map(blind, live_samples(placed_camera())), settings)
    assert "lost" not in one.findings
    assert placed_cm(one, "newest") < 25


def test_two_cameras_of_unknown_pose_are_followed() -> None:
    """One is carried, the other stands. Answers have the pose of the first one."""
    scene = two_cameras()
    first, second = (replace(camera, known_path=None, moving=False) for camera in scene.cameras)
    tracked = track(replace(scene, cameras=(second, replace(first, moving=True))), settings=QUICK)
    answer = tracked.answers[-1]
    np.testing.assert_array_equal(answer.cameras[0].newest.p_world_camera, answer.cameras[0].smoothed.p_world_camera)
    alone = track(replace(scene, cameras=(replace(first, moving=True),)), settings=QUICK)
    assert tracked.error_mm("smoothed") < 1.1 * alone.error_mm("smoothed")
