"""Detections put onto the estimate's frames: each video frame speaks once, and gaps stay gaps."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.lengths import stature_of
from vip_factors.factor_settings import ReprojectionSettings
from vip_factors.geometry.rotations import Array
from vip_factors.problem.scene import KeypointView
from vip_factors.sensors.detections import Detections
from vip_factors.stages.views import AREA_OF_HEIGHT, keypoint_view, scatter

COCO = keypoint_set("coco17")
SETTINGS, SKELETON = ReprojectionSettings(), skeleton_from_stature(1.75)
METRE = 200 / (AREA_OF_HEIGHT * stature_of(SKELETON))  # in pixels


def moving(video: Array, missing: tuple[int, ...] = ()) -> Detections:
    """All keypoints move at 100 pixels a second in x."""
    frames = np.array([f for f in range(len(video)) if f not in missing])
    pixels = np.zeros((len(frames), 17, 2))
    pixels[..., 0] = 500 + 100 * video[frames, None]
    return Detections(COCO, video, frames, pixels, np.full((len(frames), 17), 0.64))


def view(detections: Detections, time: Array, settings: ReprojectionSettings = SETTINGS) -> KeypointView:
    chosen = np.ones(len(detections), bool)
    return keypoint_view(detections, chosen, SKELETON, time, np.full(len(time), 200.0), 0.5, settings)


def test_frames_on_the_video_are_taken_as_they_are() -> None:
    time = np.arange(10) / 30
    seen = view(moving(time), time)
    assert seen.seen.all()
    np.testing.assert_allclose(seen.pixels[:, 3, 0], 500 + 100 * time)
    np.testing.assert_allclose(seen.pixels_per_second[1:-1, :, 0], 100)
    expected = SETTINGS.persistence * 0.5 * COCO.sigmas * 200 / 0.8
    np.testing.assert_allclose(
        seen.sigma[0], np.hypot(np.maximum(expected, SETTINGS.least_px), SETTINGS.point_sigma * METRE)
    )


def test_finer_frames_do_not_hear_one_video_frame_twice() -> None:
    video = np.arange(10) / 30
    time = np.arange(20) / 60
    np.testing.assert_array_equal(view(moving(video), time).seen[:, 0], np.arange(20) % 2 == 0)


def test_between_video_frames_the_track_is_interpolated() -> None:
    video = np.arange(11) / 30
    time = video[:-1] + 0.4 / 30
    seen = view(moving(video), time)
    assert seen.seen.all()
    np.testing.assert_allclose(seen.pixels[:, 0, 0], 500 + 100 * time)


def test_gaps_are_not_bridged() -> None:
    video = np.arange(10) / 30
    time = video + 0.4 / 30
    seen = view(moving(video, missing=(4, 5)), time).seen[:, 0]
    np.testing.assert_array_equal(np.flatnonzero(~seen), [3, 4, 5, 9])


@pytest.mark.parametrize("spread", [0.2, 0.5])
def test_the_scatter_is_measured_whatever_was_assumed(spread: float) -> None:
    time = np.arange(200) / 30
    seen = view(moving(time), time)
    random = np.random.default_rng(0)
    scattered = spread * seen.oks_px[..., None] * random.standard_normal((200, 17, 2))
    assert scatter(scattered / seen.sigma[..., None], seen, 0.5) == pytest.approx(spread, rel=0.05)


def test_speeds_are_known_however_the_detector_trembles() -> None:
    random, time = np.random.default_rng(0), np.arange(60) / 30
    found = moving(time, missing=(20,))
    trembling = replace(found, pixels=found.pixels + 5 * random.standard_normal(found.pixels.shape))
    seen = view(trembling, time)
    error = seen.pixels_per_second[seen.seen] - [100, 0]
    assert np.sqrt(np.mean(error**2)) < 30  # px/s; the differences of neighbours would be off by 106
    np.testing.assert_allclose(view(found, time).pixels_per_second[seen.seen], [[100, 0]] * seen.seen.sum(), atol=1e-6)


def test_no_keypoint_is_nearer_its_point_than_bodies_are_known() -> None:
    time = np.arange(30) / 30
    sharp = replace(SETTINGS, persistence=0.0, least_px=0.0, point_sigma=0.02)
    seen = view(moving(time), time, sharp)
    np.testing.assert_allclose(seen.sigma[seen.seen], 0.02 * METRE)
