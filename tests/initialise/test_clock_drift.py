"""Clocks that drift apart are told from clocks that do not."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.initialise.clock import ClockOffset, ClockSettings, find_clock_offset
from vip_factors.initialise.clock_drift import DriftSettings
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings

SHORT = DriftSettings(stretch=4.0, most=8e-3)  # half a minute is enough where clocks are that bad


@pytest.fixture(scope="module")
def filmed() -> Scene:
    motion = gestures(28.0)
    settings = SceneSettings.noise_free(camera="fixed")
    return simulate_scene([Performer("a", motion, preset("sip6", motion.skeleton))], settings)


def found(scene: Scene, drift: float) -> ClockOffset:
    assert scene.camera is not None
    seen = scene.camera.detections
    drifted = replace(seen, time=(seen.time - 0.5) / (1 + drift))
    settings = ClockSettings(method="motion", max_offset=1.5, drift=SHORT)
    return find_clock_offset(replace(scene, camera=replace(scene.camera, detections=drifted), truth=None), settings)


def test_a_drift_is_found_and_told(filmed: Scene) -> None:
    told = found(filmed, 4e-3)
    assert told.determined
    assert told.drift is not None
    assert told.drift.per_second == pytest.approx(4e-3, abs=5e-4)
    assert "drifts by +1" in told.sentence  # a hundred and twelve milliseconds
    video = np.array([0.0, 14.0, 28.0])
    np.testing.assert_allclose(told.clock.at(video), 0.5 + 1.004 * video, atol=0.01)


def test_clocks_that_run_alike_are_left_alone(filmed: Scene) -> None:
    told = found(filmed, 0.0)
    assert told.clock.drift == 0.0
    assert "drift" not in told.sentence
