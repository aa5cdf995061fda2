"""A carried camera's path from visual odometry: its place in the world, axes, scale, gaps and resets."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from filmed_gestures import FROM_STRAPS, camera_of, filmed_gestures
from hypothesis import given, settings
from hypothesis import strategies as st

from vip_factors.geometry.rotations import Array, angle_between, exp, transpose
from vip_factors.initialise.camera import along_odometry, in_camera_axes
from vip_factors.pipeline import smooth
from vip_factors.sensors.camera import CameraPath, Odometry
from vip_factors.sensors.scene import Scene

OPENGL = np.diag([1.0, -1.0, -1.0])


def path(frames: int = 60, seed: int = 0, rate: float = 30.0) -> CameraPath:
    """A smooth path with turns and shifts in all directions."""
    random, time = np.random.default_rng(seed), np.arange(frames) / rate
    waves = np.sin(time[:, None] * random.uniform(1, 4, 6) + random.uniform(0, 6, 6))
    return CameraPath(time, exp(0.4 * waves[:, :3]), 0.5 * waves[:, 3:])


def moved(source: CameraPath, R: Array, p: Array, scale: float = 1.0) -> CameraPath:
    """The path in another world."""
    return CameraPath(source.time, R @ source.R_world_camera, scale * source.p_world_camera @ R.T + p)


def drifting(source: CameraPath, seed: int) -> CameraPath:
    """The path as odometry measures it: errors of 0.1° and 1 cm after a second add up."""
    random, step = np.random.default_rng(seed), np.sqrt(np.diff(source.time))[:, None]
    R, p = [np.eye(3)], [np.zeros(3)]
    for n, (turn, shift) in enumerate(step[:, None] * np.deg2rad(0.1) * random.standard_normal((len(step), 2, 3))):
        R_next = transpose(source.R_world_camera[n]) @ source.R_world_camera[n + 1]
        p_next = (source.p_world_camera[n + 1] - source.p_world_camera[n]) @ source.R_world_camera[n]
        p.append(p[-1] + R[-1] @ (p_next + 0.01 / np.deg2rad(0.1) * shift))
        R.append(R[-1] @ R_next @ exp(turn))
    return CameraPath(source.time, np.array(R), np.array(p))


@given(turn=st.tuples(*[st.floats(-1.8, 1.8)] * 3), scale=st.floats(0.1, 1.2))
@settings(max_examples=20)
def test_a_path_in_any_world_is_laid_over_rough_poses(turn: tuple[float, float, float], scale: float) -> None:
    true = path()
    measured = moved(true, exp(np.array(turn)), np.array([3.0, -1, 2]), scale)
    odometry = Odometry.between(measured, true.time, is_scale_free=True)
    found, found_scale = along_odometry(measured, odometry, true)
    assert found_scale == pytest.approx(1 / scale, rel=1e-6)
    np.testing.assert_allclose(found.p_world_camera, true.p_world_camera, atol=1e-6)
    assert angle_between(found.R_world_camera, true.R_world_camera).max() < 1e-6


def test_a_reset_and_a_gap_part_the_path() -> None:
    true = path(frames=90)
    p, R = true.p_world_camera.copy(), true.R_world_camera.copy()
    turn = exp(np.array([0, 0, 1.0]))
    p[30:], R[30:] = p[30:] @ turn.T + [2.0, 0, 1], turn @ R[30:]
    present = np.r_[0:50, 65:90]
    measured = CameraPath(true.time[present], R[present], p[present])
    odometry = Odometry.between(measured, true.time)
    np.testing.assert_array_equal(np.flatnonzero(~odometry.valid), [29, *range(49, 65), 89])
    found, _ = along_odometry(measured, odometry, true)
    np.testing.assert_allclose(found.p_world_camera[present], true.p_world_camera[present], atol=1e-6)


@pytest.mark.parametrize("axes", [np.eye(3), OPENGL])
def test_the_axes_of_the_camera_are_recognised_from_rough_poses(axes: Array) -> None:
    true, random = path(frames=120), np.random.default_rng(1)
    noise = exp(0.05 * random.standard_normal((120, 3))), 0.1 * random.standard_normal((120, 3))
    rough = CameraPath(true.time, true.R_world_camera @ noise[0], true.p_world_camera + noise[1])
    camera = replace(camera_of(scene()), odometry=replace(true, R_world_camera=true.R_world_camera @ axes))
    found = in_camera_axes(camera, rough).odometry
    assert found is not None
    np.testing.assert_allclose(found.R_world_camera, true.R_world_camera, atol=1e-12)


@cache
def scene() -> Scene:
    return filmed_gestures("hand-held", 6.0)


def camera_error(with_odometry: Scene) -> float:
    """Median error in metres of the motion of the camera between frames half a second apart."""
    found, truth = smooth(with_odometry, FROM_STRAPS).cameras[0].path, scene().camera.truth
    assert truth is not None
    true = truth.path.at(found.time)
    span = int(np.searchsorted(found.time, found.time[0] + 0.5))
    shifts = [
        np.einsum("tji,tj->ti", one.R_world_camera[:-span], one.p_world_camera[span:] - one.p_world_camera[:-span])
        for one in (found, true)
    ]
    return float(np.median(np.linalg.norm(shifts[0] - shifts[1], axis=1)))


def test_odometry_holds_the_path_of_a_carried_camera() -> None:
    camera, truth = camera_of(scene()), scene().camera.truth
    assert truth is not None
    measured = moved(drifting(truth.path, seed=3), exp(np.array([0.3, -0.8, 2.0])), np.array([5.0, 0, 1]))
    late = replace(measured, time=measured.time - camera.clock.offset)
    plain = camera_error(scene())
    metric = camera_error(replace(scene(), cameras=(replace(camera, odometry=late),)))
    assert metric < 0.3 * plain
    opengl, small = late.R_world_camera @ OPENGL, 0.2 * late.p_world_camera
    monocular = replace(camera, odometry=replace(late, R_world_camera=opengl, p_world_camera=small))
    monocular = replace(monocular, scale_free_odometry=True)
    assert camera_error(replace(scene(), cameras=(monocular,))) < 0.5 * plain


def test_a_reset_parts_the_path_at_any_rate_of_frames() -> None:
    true = path(frames=120, rate=60.0)
    p = true.p_world_camera.copy()
    p[60:] += [0.4, 0.1, -0.2]  # 6 m/s from frame to frame at 15 Hz: as fast as people swing a camera
    odometry = Odometry.between(replace(true, p_world_camera=p), true.time[::4] + 0.003)
    np.testing.assert_array_equal(np.flatnonzero(~odometry.valid), [14, 29])
