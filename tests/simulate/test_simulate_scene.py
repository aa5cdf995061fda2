"""Simulated scenes against projection, physics and their own truth."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between, log, rotation_z, transpose
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.dense import dense_motion
from vip_factors.simulate.detector import LEAST_CONFIDENCE
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import GRAVITY
from vip_factors.simulate.scene import CAMERA_IMU, Performer, simulate_scene
from vip_factors.simulate.settings import CameraKind, SceneSettings, SimulateSettings
from vip_factors.simulate.staging import from_time, staged

CAMERAS: tuple[CameraKind, ...] = ("fixed", "hand-held", "walking")
SECONDS = 2.5


@pytest.fixture(scope="module")
def people() -> tuple[Performer, ...]:
    """Two wearers, and a bystander who goes after two seconds."""
    long = gestures(SECONDS + 2.2)
    ann, bob = staged([long.frames(slice(0, 301)), from_time(long, 2.2).frames(slice(0, 301))], seed=1)
    eve = staged([from_time(long, 1.0).frames(slice(0, 241))], seed=2, neighbours=(ann, bob))[0]
    sensors = preset("sip6", ann.skeleton)
    return Performer("ann", ann, sensors), Performer("bob", bob, sensors), Performer("eve", eve)


def plain(camera: CameraKind = "hand-held", **changes) -> SceneSettings:
    return SceneSettings.noise_free(camera=camera, **changes)


@pytest.fixture(scope="module")
def noise_free(people) -> Callable[[CameraKind], Scene]:
    """Everybody before a perfect detector, by the kind of camera."""
    return cache(lambda camera: simulate_scene(people, plain(camera), seed=3))


def in_image(scene: Scene, motion: Motion) -> np.ndarray:
    """Pixels ``(F, K, 2)`` of a motion's keypoints by its own splines and the true camera."""
    camera, truth = scene.camera, scene.camera.truth
    time = camera.detections.time + truth.clock.offset
    state = dense_motion(motion, SimulateSettings().lowpass_hz).state(time)
    marks = camera.detections.keypoints.on_body(motion.skeleton)
    world = np.stack([state.point(mark.bone, mark.p_bone_point) for mark in marks], axis=1)
    return camera.model.project(truth.path.at(time).to_camera(world))


@pytest.mark.parametrize(("camera", "keypoints"), list(zip(CAMERAS, ("openpose18", "body25", "coco17"), strict=True)))
def test_noise_free_detections_are_the_projection_of_the_truth(people, camera: CameraKind, keypoints: str) -> None:
    scene = simulate_scene(people, plain(camera, keypoints=keypoints, distortion=(-0.1, 0.02, 0.0, 0.0)), seed=3)
    detections, truth = scene.camera.detections, scene.camera.truth
    for number in (0, 1):
        mine = np.flatnonzero(truth.wearer == number)
        assert len(mine) == len(np.unique(detections.frame[mine])) > 0.9 * len(detections.time)
        seen = detections.seen[mine]
        expected = in_image(scene, people[number].motion)[detections.frame[mine]]
        assert detections.pixels[mine][seen] == pytest.approx(expected[seen], abs=1e-6)
        assert truth.pixels[mine][seen] == pytest.approx(expected[seen], abs=1e-6)
        assert np.all(detections.confidence[mine][seen] == 1.0)
        assert np.array_equal(seen, scene.camera.model.inside(expected))


@pytest.mark.parametrize("camera", ["fixed", "walking"])
def test_same_seed_same_scene(people, camera: CameraKind) -> None:
    some = [people[0], people[-1]]
    one, two, other = (simulate_scene(some, SceneSettings(camera=camera), seed=seed) for seed in (4, 4, 5))
    assert np.array_equal(one.camera.detections.pixels, two.camera.detections.pixels, equal_nan=True)
    assert np.array_equal(one.camera.truth.wearer, two.camera.truth.wearer)
    assert np.array_equal(one.camera.truth.path.p_world_camera, two.camera.truth.path.p_world_camera)
    assert not np.array_equal(one.camera.truth.path.p_world_camera, other.camera.truth.path.p_world_camera)
    if one.camera.mount is not None:
        assert np.array_equal(one.camera.mount.imu.specific_force, two.camera.mount.imu.specific_force)


def test_the_videos_clock_is_off_by_what_the_truth_says(people, noise_free) -> None:
    right, late = noise_free("walking"), simulate_scene(people, plain("walking", time_offset_s=0.35), seed=3)
    assert late.camera.detections.time + 0.35 == pytest.approx(right.camera.detections.time)
    assert np.array_equal(right.camera.detections.pixels, late.camera.detections.pixels, equal_nan=True)
    assert (late.camera.clock.offset, late.camera.truth.clock.offset) == (0.0, 0.35)


@pytest.mark.parametrize("camera", ["hand-held", "walking"])
def test_the_cameras_imu_feels_what_the_camera_does(people, camera: CameraKind) -> None:
    settings = plain(camera, video_rate=1000.0, camera_mounting_error_deg=8.0)
    settings = replace(settings, imu=SimulateSettings.noise_free(imu_rate=1000.0, heading_offset_deg=90.0))
    scene = simulate_scene(people[:1], settings, seed=3)
    mount, truth, path = scene.camera.mount, scene.camera.truth, scene.camera.truth.path
    assert mount.imu.name == CAMERA_IMU
    assert mount.imu.time == pytest.approx(path.time, abs=1e-9)
    R_camera_imu, heading = truth.calibration.R_bone_sensor, truth.calibration.heading
    assert 0 < np.rad2deg(angle_between(R_camera_imu, mount.R_camera_imu)) < 40
    R_world_imu = path.R_world_camera @ R_camera_imu
    assert rotation_z(heading) @ mount.imu.R_inertial_sensor == pytest.approx(R_world_imu, abs=1e-9)

    step = 1 / 1000.0
    p = path.p_world_camera + path.R_world_camera @ mount.p_camera_imu
    acceleration = (p[2:] - 2 * p[1:-1] + p[:-2]) / step**2
    force = np.einsum("nij,nj->ni", R_world_imu, mount.imu.specific_force)[1:-1]
    assert np.std(acceleration) > 0.1  # the hand is not a tripod
    assert np.std(force + GRAVITY - acceleration) < 0.05 * np.std(acceleration)
    rate = log(transpose(R_world_imu[:-2]) @ R_world_imu[2:]) / (2 * step)
    assert mount.imu.angular_rate[1:-1] == pytest.approx(rate, abs=0.01)


def test_a_tripod_stands_still_and_has_no_imu_unless_asked_for(people, noise_free) -> None:
    scene = noise_free("fixed")
    assert (len(scene.camera.truth.path), scene.camera.moving, scene.camera.mount) == (1, False, None)
    mount = simulate_scene(people[:1], plain("fixed", camera_imu=True), seed=3).camera.mount
    assert np.linalg.norm(mount.imu.specific_force, axis=1) == pytest.approx(9.81)


@pytest.mark.parametrize("camera", CAMERAS)
def test_people_have_a_plausible_size_and_are_mostly_in_view(noise_free, camera: CameraKind) -> None:
    scene = noise_free(camera)
    mine = scene.camera.truth.wearer >= 0
    pixels = scene.camera.detections.pixels[mine]
    height = np.nanmax(pixels[..., 1], axis=1) - np.nanmin(pixels[..., 1], axis=1)
    assert 200 < np.median(height) < 900
    assert np.mean(scene.camera.detections.seen[mine]) > 0.8
    up = -scene.camera.truth.path.R_world_camera[:, 2, 1]
    assert np.all(up > np.cos(np.deg2rad(30)))  # held upright


def test_realistic_scene_has_the_detectors_troubles(people) -> None:
    scene = simulate_scene(people, SceneSettings(), seed=6)
    detections, truth = scene.camera.detections, scene.camera.truth
    for number in (0, 1):
        frames = detections.frame[truth.wearer == number]
        assert 0.6 * len(detections.time) < len(frames)
    shuffled = [np.any(np.diff(truth.wearer[detections.of_frame(f)]) < 0) for f in range(len(detections.time))]
    assert 0.1 < np.mean(shuffled) < 0.9
    assert np.all(detections.confidence[detections.seen] >= LEAST_CONFIDENCE)


def test_impossible_scenes_say_why(people) -> None:
    with pytest.raises(InputError, match="nobody with sensors"):
        simulate_scene(people[2:])
    with pytest.raises(InputError, match="names repeat"):
        simulate_scene([people[0], replace(people[1], name="ann")])
    late = replace(people[1], motion=replace(people[1].motion, start=100.0))
    with pytest.raises(InputError, match="share"):
        simulate_scene([people[0], late])
    with pytest.raises(InputError, match="fixed, hand-held or walking"):
        SceneSettings(camera="drone")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="unknown keypoint set"):
        SceneSettings(keypoints=keypoint_set("coco17").name + "x")


def test_further_cameras_stand_around_and_see_for_themselves(people) -> None:
    settings = SceneSettings(camera="fixed", azimuth_deg=10.0)
    alone = simulate_scene(people, settings, seed=4)
    scene = simulate_scene(people, replace(settings, cameras=4), seed=4)
    assert [camera.name for camera in scene.cameras] == ["camera", "camera_2", "camera_3", "camera_4"]
    np.testing.assert_array_equal(scene.camera.detections.pixels, alone.camera.detections.pixels)
    assert alone.camera.known_path is None
    middle = np.mean([person.motion.p_world_pelvis.mean(axis=0) for person in people[:2]], axis=0)
    truths = [camera.truth for camera in scene.cameras]
    places = np.array([truth.path.p_world_camera[0] for truth in truths]) - middle
    angles = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    np.testing.assert_allclose(np.diff(angles), np.pi / 2, atol=0.35)
    for camera, truth in zip(scene.cameras, truths, strict=True):
        assert np.linalg.norm(camera.known_path.p_world_camera - truth.path.p_world_camera) < 0.03
        assert {0, 1} <= set(truth.wearer)
    one, other = (camera.detections for camera in scene.cameras[1:3])
    assert one.pixels.shape != other.pixels.shape or not np.array_equal(one.pixels, other.pixels)


def test_further_cameras_are_calibrated_before_a_moving_one(people) -> None:
    scene = simulate_scene(people, plain("hand-held", cameras=2), seed=3)
    assert scene.camera.moving
    assert scene.camera.known_path is None
    second, truth = scene.cameras[1], scene.cameras[1].truth
    assert not second.moving
    assert second.mount is None
    np.testing.assert_allclose(second.known_path.R_world_camera, truth.path.R_world_camera, atol=1e-12)
    with pytest.raises(InputError, match="only that of a fixed one"):
        plain("hand-held", known_camera_pose=True)


def test_cameras_of_any_kind_that_nobody_calibrated(people) -> None:
    settings = SceneSettings(camera="fixed", cameras=3, carried=1, calibrated=False, fov_deg=70.0, azimuth_deg=0.0)
    scene = simulate_scene(people, settings, seed=1)
    assert [camera.moving for camera in scene.cameras] == [False, True, False]
    assert [camera.known_path for camera in scene.cameras] == [None] * 3
    assert [camera.mount for camera in scene.cameras] == [None] * 3
    assert {camera.focal_sigma for camera in scene.cameras} == {0.25}
    assert scene.cameras[0].model.focal[0] > 1.1 * settings.model.focal[0]
    known = simulate_scene(people, SceneSettings(camera="fixed", cameras=3, azimuth_deg=0.0, fov_deg=70.0), seed=1)
    for number in (0, 2):
        np.testing.assert_array_equal(scene.cameras[number].detections.pixels, known.cameras[number].detections.pixels)
    with pytest.raises(InputError, match="2 carried cameras: expected fewer than cameras in all"):
        SceneSettings(cameras=2, carried=2)
