"""A video's clock that drifts is told where it matters and is sure."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.keypoints import keypoint_set
from vip_factors.estimate import CameraEstimate
from vip_factors.findings import sentences
from vip_factors.sensors.camera import CameraModel, CameraPath, VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Camera
from vip_factors.stages.drift import clock_findings, middle_time

LENS = CameraModel(640, 480, (500.0, 500.0), (320.0, 240.0))


def camera(seconds: float) -> Camera:
    K = len(keypoint_set("coco17"))
    nobody = np.zeros(0, int), np.zeros((0, K, 2)), np.zeros((0, K))
    detections = Detections(keypoint_set("coco17"), np.array([0.0, seconds]), *nobody)
    return Camera("camera", LENS, detections, clock=VideoClock(0.0, 1e-4))


def found(drift: float, sigma: float) -> CameraEstimate:
    still = CameraPath(np.zeros(1), np.eye(3)[None], np.zeros((1, 3)))
    middle = 150.0  # of the longer videos, where the offset is the scene's
    offset = (1e-4 - drift) * middle
    return CameraEstimate("camera", LENS, still, clock=VideoClock(offset, drift), clock_sigma=(0.001, sigma))


def test_a_drift_beyond_what_the_scene_said_is_told() -> None:
    (told,) = sentences(clock_findings(camera(300.0), found(3e-4, 1e-5)))
    assert "by +60 ms from its start to its end (+200 ± 10 ppm)" in told


@pytest.mark.parametrize(
    ("seconds", "drift", "sigma"), [(300.0, 1.2e-4, 1e-6), (300.0, 3e-4, 1e-4), (20.0, 3e-4, 1e-6)]
)
def test_little_or_unsure_drifts_are_not(seconds: float, drift: float, sigma: float) -> None:
    assert list(clock_findings(camera(seconds), found(drift, sigma))) == []


def test_nothing_is_said_of_a_clock_that_was_kept() -> None:
    kept = replace(found(3e-4, 1e-6), clock_sigma=None)
    assert list(clock_findings(camera(300.0), kept)) == []


def test_an_offset_of_some_video_frames_is_told() -> None:
    off = replace(found(1e-4, 1e-5), clock=VideoClock(0.08, 1e-4))
    (told,) = sentences(clock_findings(camera(300.0), off))
    assert "+80 ± 1 ms off the clock given in the scene" in told


def test_the_middle_is_on_the_sensors_clock() -> None:
    assert middle_time(replace(camera(300.0), clock=VideoClock(2.0))) == pytest.approx(152.0)
