"""The camera model against OpenCV, its derivative against differences, and its inverse."""

import cv2
import numpy as np
import pytest

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraModel, VideoClock

DISTORTIONS = [
    (),
    (-0.2, 0.05, 0.001, -0.002),
    (-0.2, 0.05, 0.001, -0.002, 0.01),
    (0.1, 0.02, 0.001, 0.0, 0.0, 0.05, 0.01, 0.0),
]


@pytest.fixture
def points() -> Array:
    random = np.random.default_rng(1)
    return random.uniform([-1, -1, 2], [1, 1, 6], (50, 3))


def model(distortion: tuple[float, ...]) -> CameraModel:
    return CameraModel(1920, 1080, (1400.0, 1390.0), (955.0, 548.0), distortion)


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_projects_as_opencv_does(points: Array, distortion: tuple[float, ...]) -> None:
    camera = model(distortion)
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.K, np.array(distortion) if distortion else None
    )
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_jacobian_is_the_difference_quotient(points: Array, distortion: tuple[float, ...]) -> None:
    camera = model(distortion)
    _, J = camera.project_with_jacobian(points)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        numeric = (camera.project(points + step) - camera.project(points - step)) / 2e-6
        np.testing.assert_allclose(J[..., axis], numeric, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_normalise_undoes_project(points: Array, distortion: tuple[float, ...]) -> None:
    camera = model(distortion)
    np.testing.assert_allclose(camera.normalise(camera.project(points)), points[:, :2] / points[:, 2:], atol=1e-6)


def test_points_behind_the_camera_stay_finite() -> None:
    pixels, J = model(()).project_with_jacobian(np.array([[0.1, 0.2, -1.0], [0.0, 0.0, 0.0]]))
    assert np.all(np.isfinite(pixels))
    assert np.all(np.isfinite(J))


@pytest.mark.parametrize(
    "wrong", [{"width": 0}, {"focal": (-1.0, 1.0)}, {"centre": (np.nan, 0.0)}, {"distortion": (1.0,)}]
)
def test_implausible_intrinsics_are_refused(wrong: dict) -> None:
    given = {"width": 640, "height": 480, "focal": (500.0, 500.0), "centre": (320.0, 240.0), "distortion": ()} | wrong
    with pytest.raises(InputError, match="camera"):
        CameraModel(**given)


def test_keypoints_not_found_stay_not_found() -> None:
    assert np.all(np.isnan(model(DISTORTIONS[1]).normalise(np.full((2, 2), np.nan))))


def test_corrections_of_clocks_add_up() -> None:
    video = np.array([0.0, 60.0, 300.0])
    clock = VideoClock(2.0, 1e-3)
    sensors = clock.at(video)
    np.testing.assert_allclose(sensors, [2.0, 62.06, 302.3])
    better = clock.corrected(0.02, -2e-4, middle=150.0)
    np.testing.assert_allclose(better.at(video), sensors + 0.02 - 2e-4 * (sensors - 150.0), atol=1e-12)
    assert VideoClock().late(5.0) == pytest.approx(0.0)
