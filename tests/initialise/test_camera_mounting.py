"""The mounting and heading of a camera's IMU come back from rough rotations of the camera."""

import numpy as np
import pytest

from vip_factors.geometry.rotations import angle_between, exp, rotation_z, transpose, wrap_angle
from vip_factors.initialise.camera_mounting import camera_mounting


@pytest.mark.parametrize("heading", [0.4, -2.9])
def test_mounting_and_heading_come_back(heading: float) -> None:
    random, n = np.random.default_rng(3), 400
    mounting = exp(np.array([2.0, -0.8, 1.1]))
    sway = np.cumsum(0.02 * random.standard_normal((n, 3)), axis=0)  # a hand's, some 20 degrees
    camera = exp(np.array([-1.5, 0.0, 0.0])) @ exp(sway)
    imu = rotation_z(-heading) @ camera @ mounting
    rough = camera @ exp(0.1 * random.standard_normal((n, 3)))
    rough[:60] = exp(random.uniform(-2, 2, (60, 3)))  # the wrong person, or seen from behind
    found, angle = camera_mounting(rough, imu)
    assert np.rad2deg(angle_between(found, mounting)) < 4.0
    assert abs(np.rad2deg(wrap_angle(angle - heading))) < 4.0


def test_a_camera_that_stands_still_gets_a_pair_that_fits() -> None:
    camera, imu = exp(np.array([[-1.5, 0.2, 0.1]])), exp(np.array([[0.3, 1.0, -0.4]]))
    mounting, heading = camera_mounting(camera, imu)
    np.testing.assert_allclose(camera @ mounting @ transpose(imu), rotation_z(heading)[None], atol=0.01)
