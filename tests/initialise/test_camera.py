"""The camera's start from hypothesis cameras: standing, moving and carried; outliers, turned worlds and leaps."""

import numpy as np
import pytest

from vip_factors.geometry.rotations import Array, angle_between, exp, rotation_z, transpose, wrap_angle
from vip_factors.initialise.camera import (
    Sightings,
    camera_mounting,
    carried_camera,
    filmed_path,
    leaps,
    moving_camera,
    robust_mean_angle,
    standing_camera,
    together,
    world_turn,
)
from vip_factors.sensors.camera import CameraPath

LOOKING_ALONG_Y = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # R_world_camera
TIME = np.arange(90) / 30


def walked() -> Array:
    return np.stack([0.8 * TIME - 1.2, 4.0 + 0.2 * TIME, np.full(len(TIME), 0.95)], axis=1)


def sighted(camera: CameraPath, turn: float = 0.0, wrong: int = 0, noise: float = 0.0) -> Sightings:
    """What hypothesis cameras say of a wearer on :func:`walked`, whose own world is turned back by ``turn``."""
    random, there = np.random.default_rng(3), camera.at(TIME)
    R = there.R_world_camera @ exp(noise * random.standard_normal((len(TIME), 3)))
    p = np.einsum("tji,tj->ti", there.R_world_camera, walked() - there.p_world_camera)
    R_camera_world = transpose(R) @ rotation_z(turn)
    for k in random.choice(len(TIME), wrong, replace=False):
        R_camera_world[k] = R_camera_world[k] @ rotation_z(np.pi)
    return Sightings(TIME, R_camera_world, p)


@pytest.fixture
def standing() -> CameraPath:
    return CameraPath(TIME[:1], (LOOKING_ALONG_Y @ exp([0.1, 0.2, 0.0]))[None], np.array([[0.1, -0.5, 1.4]]))


@pytest.fixture
def moving() -> CameraPath:
    R = LOOKING_ALONG_Y @ exp(np.stack([0.05 * np.sin(TIME), 0.2 * TIME / 3, 0 * TIME], axis=1))
    return CameraPath(TIME, R, np.stack([0.3 * TIME, 0.1 * np.sin(TIME), np.full(len(TIME), 1.5)], axis=1))


def test_a_standing_camera_is_found_among_wrong_hypotheses(standing: CameraPath) -> None:
    found = standing_camera(sighted(standing, wrong=20, noise=0.02), walked())
    assert np.rad2deg(angle_between(found.R_world_camera[0], standing.R_world_camera[0])) < 1.0
    np.testing.assert_allclose(found.p_world_camera[0], standing.p_world_camera[0], atol=0.1)


def test_a_moving_camera_is_followed(moving: CameraPath) -> None:
    found = moving_camera(sighted(moving), walked(), TIME)
    assert np.rad2deg(angle_between(found.R_world_camera, moving.R_world_camera)).max() < 1.0
    np.testing.assert_allclose(found.p_world_camera, moving.p_world_camera, atol=0.05)  # a median at the ends


def test_a_carried_camera_has_its_rotations_of_its_sensor(moving: CameraPath) -> None:
    R_inertial_camera = rotation_z(-0.7) @ moving.R_world_camera
    found, heading = carried_camera(sighted(moving, noise=0.05, wrong=10), walked(), TIME, R_inertial_camera)
    assert heading == pytest.approx(0.7, abs=0.03)
    assert np.rad2deg(angle_between(found.R_world_camera, moving.R_world_camera)).max() < 2.0


def test_a_turned_world_is_turned_back_and_its_wearer_placed(standing: CameraPath) -> None:
    seen = sighted(standing, turn=1.1)
    assert world_turn(standing, seen) == pytest.approx(1.1, abs=1e-6)
    own = walked() @ rotation_z(-1.1).T + np.array([5.0, 2.0, 0.0])
    np.testing.assert_allclose(filmed_path(standing, seen, own @ rotation_z(1.1).T, TIME), walked(), atol=1e-9)


def test_several_cameras_see_as_one(standing: CameraPath) -> None:
    shifted = CameraPath(np.zeros(1), rotation_z(0.7) @ standing.R_world_camera[:1], np.array([[3.0, 1.0, 1.2]]))
    one, other = sighted(standing, turn=1.1), sighted(shifted, turn=1.1)
    path, seen = together([(standing, one), (shifted, other)])
    assert len(seen) == len(one) + len(other)
    assert world_turn(path, seen) == pytest.approx(1.1, abs=1e-6)
    own = walked() @ rotation_z(-1.1).T + np.array([5.0, 2.0, 0.0])
    np.testing.assert_allclose(filmed_path(path, seen, own @ rotation_z(1.1).T, TIME), walked(), atol=0.02)
    assert world_turn(standing, one.turned(1.1)) == pytest.approx(0.0, abs=1e-6)


def test_the_mean_angle_is_of_the_fullest_direction() -> None:
    angles = np.concatenate([np.full(10, 3.1), np.full(6, 0.5), [-3.1, -3.1]])
    assert robust_mean_angle(angles) == pytest.approx(3.1, abs=0.1)


def test_cuts_and_zooms_leap_and_steady_cameras_do_not(standing: CameraPath, moving: CameraPath) -> None:
    assert len(leaps(sighted(moving))) == 0
    seen = sighted(standing)
    zoomed = seen.p_camera_pelvis.copy()
    zoomed[45:, 2] /= 1.6
    np.testing.assert_allclose(leaps(Sightings(TIME, seen.R_camera_world, zoomed)), [1.5], atol=0.1)
    flipping = seen.R_camera_world.copy()
    flipping[40:50:2] = flipping[40:50:2] @ rotation_z(1.0)
    assert len(leaps(Sightings(TIME, flipping, seen.p_camera_pelvis))) == 0
    cut = seen.R_camera_world.copy()
    cut[45:] = cut[45:] @ rotation_z(0.6)
    np.testing.assert_allclose(leaps(Sightings(TIME, cut, seen.p_camera_pelvis)), [1.5], atol=0.1)


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


@pytest.mark.parametrize("frames", [8, 60])
def test_only_what_lasts_is_a_leap(frames: int) -> None:
    """A detector that takes left for right turns the camera for a quarter of a second; a cut turns it for good."""
    time = np.arange(120) / 30
    turned = (time >= 2) & (np.arange(120) < 60 + frames)
    found = leaps(Sightings(time, rotation_z(np.where(turned, 1.0, 0.0)), np.tile([0.0, 0.0, 4.0], (120, 1))))
    assert len(found) == (1 if frames == 60 else 0)
