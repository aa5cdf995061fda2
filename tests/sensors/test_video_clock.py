"""Between the video's clock and the sensors'."""

import numpy as np
import pytest

from vip_factors.sensors.video_clock import VideoClock


def test_corrections_of_clocks_add_up() -> None:
    video = np.array([0.0, 60.0, 300.0])
    clock = VideoClock(2.0, 1e-3)
    sensors = clock.at(video)
    np.testing.assert_allclose(sensors, [2.0, 62.06, 302.3])
    better = clock.corrected(0.02, -2e-4, middle=150.0)
    np.testing.assert_allclose(better.at(video), sensors + 0.02 - 2e-4 * (sensors - 150.0), atol=1e-12)
    assert VideoClock().late(5.0) == pytest.approx(0.0)
