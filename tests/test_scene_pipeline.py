"""The pipeline on realistic scenes, with what goes wrong in them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from filmed_gestures import FROM_STRAPS, HASTY, QUICK, camera_of, filmed_gestures, with_detections, without_detections

from vip_factors.estimate import Estimate
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.factor_settings import VideoClockSettings
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import angle_between, exp, rotation_z
from vip_factors.pipeline import smooth
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.scene import UNKNOWN_MOUNTING_SIGMA, CameraMount, Scene
from vip_factors.settings import Settings
from vip_factors.simulate.settings import CameraKind

TRACKER = replace(QUICK, acceleration=False)
WITH_COVARIANCE = replace(QUICK, covariance=True)


@cache
def scene(camera: CameraKind = "fixed", seconds: float = 4.0) -> Scene:
    careless = 12.0 if camera == "fixed" else None
    return filmed_gestures(camera, seconds, mounting_error_deg=careless)


@cache
def solved() -> Estimate:
    return smooth(scene(), WITH_COVARIANCE)


@cache
def pair() -> Scene:
    return filmed_gestures(people=("anna", "bob"), seconds=5.0)


def mpjpe(estimate: Estimate, of: Scene) -> float:
    return evaluate_scene(estimate, of)["mpjpe"]


def with_streams(one: Scene, change: dict[str, ImuStream | None], wearer: int = 0) -> Scene:
    """Some sensors' streams replaced, or left out."""
    recording = one.wearers[wearer]
    streams = {name: change.get(name, stream) for name, stream in recording.imus.items()}
    kept = {name: stream for name, stream in streams.items() if stream is not None}
    wearers = list(one.wearers)
    wearers[wearer] = replace(recording, imus=kept)
    return replace(one, wearers=tuple(wearers))


def turned(stream: ImuStream, angle: float) -> ImuStream:
    """The stream in an inertial frame that lies otherwise about the vertical."""
    assert stream.R_inertial_sensor is not None
    return replace(stream, R_inertial_sensor=rotation_z(angle) @ stream.R_inertial_sensor)


def test_the_camera_makes_up_for_careless_mountings() -> None:
    found = mpjpe(solved(), scene())
    tracked = smooth(scene(), replace(TRACKER, fusion=replace(QUICK.fusion, use_camera=False)))
    assert tracked.method == "IT"
    assert found < 30.0  # mm
    assert found < 0.8 * mpjpe(tracked, scene())


def test_a_gap_in_the_video_is_bridged_by_the_sensors() -> None:
    filmed = without_detections(scene("fixed", 5.0), 1.5, 3.5)
    estimate = smooth(filmed, FROM_STRAPS)
    assert estimate.method == "VIP"
    assert mpjpe(estimate, filmed) < 30.0
    assert estimate.camera is not None
    assert estimate.camera.residual_px is not None
    time, unseen = estimate.wearers[0].motion.time, np.isnan(estimate.camera.residual_px[:, 0])
    assert unseen[(time > 1.6) & (time < 3.4)].all()
    root = estimate.wearers[0].motion.p_world_pelvis
    assert np.linalg.norm(np.diff(root, axis=0), axis=1).max() < 3.0 / 15  # m a frame: nobody leaps


def test_a_wearer_out_of_view_for_a_while() -> None:
    filmed = without_detections(pair(), 1.5, 3.0, wearer=1)
    estimate = smooth(filmed, FROM_STRAPS)
    evaluation = evaluate_scene(estimate, filmed)
    assert max(one["mpjpe"] for one in evaluation.wearers.values()) < 35.0
    assert evaluation["association_precision"] > 95.0
    assert evaluation["scene_position_error"] < 15.0


def test_a_wearer_who_is_never_seen() -> None:
    filmed = without_detections(pair(), -1.0, 9.0, wearer=1)
    estimate = smooth(filmed, FROM_STRAPS)
    assert any("'bob': never seen in the video" in one for one in sentences(estimate.findings))
    assert not any("'anna': never seen in the video" in one for one in sentences(estimate.findings))
    wearers = evaluate_scene(estimate, filmed).wearers
    assert wearers["anna"]["mpjpe"] < 30.0
    assert wearers["bob"]["mpjpe"] < 60.0  # of the IMUs alone


def test_a_sensor_that_drops_out() -> None:
    stream = scene().wearers[0].imus["left_forearm"]
    assert stream.specific_force is not None
    assert stream.R_inertial_sensor is not None
    kept = (stream.time < 1.0) | (stream.time > 3.0)
    halved = ImuStream(stream.name, stream.time[kept], stream.specific_force[kept], stream.R_inertial_sensor[kept])
    filmed = with_streams(scene(), {"left_forearm": halved})
    assert mpjpe(smooth(filmed, QUICK), filmed) < 35.0


def test_bones_without_sensors_are_seen_by_the_camera() -> None:
    bare = with_streams(scene(), dict.fromkeys(("left_forearm", "right_forearm", "left_shank")))
    found, alone = smooth(bare, QUICK), smooth(bare.wearers[0], TRACKER).wearer()
    assert mpjpe(found, bare) < 45.0
    assert mpjpe(found, bare) < 0.8 * mpjpe(Estimate("alone", "IT", (alone,)), bare)


def test_a_hand_held_camera_without_an_imu() -> None:
    filmed = scene("hand-held")
    filmed = replace(filmed, cameras=(replace(camera_of(filmed), mount=None),))
    estimate = smooth(filmed, FROM_STRAPS)
    evaluation = evaluate_scene(estimate, filmed)
    assert estimate.camera is not None
    assert estimate.camera.calibration is None
    assert evaluation["mpjpe"] < 35.0
    assert evaluation["camera_rotation"] < 5.0  # degrees


def test_a_known_camera_is_believed_and_puts_the_wearer_where_they_were() -> None:
    filmed = scene("hand-held")
    assert filmed.camera.truth is not None
    filmed = replace(filmed, cameras=(replace(camera_of(filmed), known_path=filmed.camera.truth.path),))
    estimate = smooth(filmed, FROM_STRAPS)
    assert estimate.camera is not None
    assert filmed.camera.truth is not None
    time = estimate.camera.path.time
    np.testing.assert_allclose(
        estimate.camera.path.p_world_camera, filmed.camera.truth.path.at(time).p_world_camera, atol=1e-6
    )
    assert mpjpe(estimate, filmed) < 30.0
    assert filmed.wearers[0].truth is not None
    motion, true = estimate.wearers[0].motion, filmed.wearers[0].truth.motion
    there = np.stack([np.interp(motion.time, true.time, column) for column in true.p_world_pelvis.T], axis=1)
    assert np.median(np.linalg.norm(motion.p_world_pelvis - there, axis=1)) < 0.15  # m, without any alignment


def test_without_a_camera_nobody_knows_who_stands_where() -> None:
    estimate = smooth(replace(pair(), cameras=()), HASTY)
    assert estimate.method == "SIP"
    assert estimate.camera is None
    assert len(estimate.wearers) == 2
    assert any("the relative positions of the wearers are unknown" in one for one in sentences(estimate.findings))


def test_the_videos_clock_is_found_with_its_drift() -> None:
    clock = VideoClock(0.03, 0.012)  # seconds a second: 36 ms more in the end
    filmed = filmed_gestures(seconds=5.0)
    filmed = with_detections(filmed, lambda seen: replace(seen, time=(seen.time - clock.offset) / (1 + clock.drift)))
    loose = replace(FROM_STRAPS.camera, clock=VideoClockSettings(offset_sigma=0.1, drift_sigma=0.05))
    estimate = smooth(filmed, replace(FROM_STRAPS, camera=loose))
    found = estimate.camera
    assert found is not None
    assert found.clock_sigma is not None
    assert found.clock.late(2.5) == pytest.approx(clock.late(2.5), abs=0.015)
    assert found.clock.drift == pytest.approx(clock.drift, abs=3 * found.clock_sigma[1])


def test_the_focal_length_of_an_uncalibrated_camera_is_estimated() -> None:
    zoom = 0.25
    filmed = filmed_gestures(seconds=8.0)
    true = camera_of(filmed).model.focal[0]
    uncalibrated = replace(camera_of(filmed), model=camera_of(filmed).model.zoomed(zoom), focal_sigma=0.25)
    camera = smooth(replace(filmed, cameras=(uncalibrated,)), FROM_STRAPS).camera
    assert camera is not None
    assert camera.focal_sigma is not None
    assert camera.focal_sigma < 0.15
    error = np.log(camera.model.focal[0] / true)
    assert abs(error) < min(3 * camera.focal_sigma, 0.4 * abs(zoom))


def test_a_calibrated_lens_is_kept() -> None:
    camera = solved().camera
    assert camera is not None
    assert camera.model == camera_of(scene()).model
    assert camera.focal_sigma is None


def test_how_its_sensor_sits_on_the_camera_is_found() -> None:
    filmed = scene("hand-held")
    mount, truth = camera_of(filmed).mount, filmed.camera.truth
    assert mount is not None
    assert mount.imu.R_inertial_sensor is not None
    assert mount.imu.specific_force is not None
    assert truth is not None
    assert truth.calibration is not None
    R = exp(np.array([1.2, -2.0, 0.7]))  # another make's axes
    imu = replace(
        mount.imu, R_inertial_sensor=mount.imu.R_inertial_sensor @ R, specific_force=mount.imu.specific_force @ R
    )
    unknown = CameraMount(imu, mounting_sigma=UNKNOWN_MOUNTING_SIGMA)
    estimate = smooth(replace(filmed, cameras=(replace(camera_of(filmed), mount=unknown),)), FROM_STRAPS)
    assert estimate.camera is not None
    found = estimate.camera.calibration
    assert found is not None
    off = np.rad2deg(angle_between(found.R_bone_sensor, truth.calibration.R_bone_sensor @ R))
    assert off < 25.0  # of 180: in four seconds a hand tilts a camera little
    assert np.all(np.isfinite(found.mounting_sigma))
    assert mpjpe(estimate, filmed) < 35.0


def assert_positive_definite(covariance: np.ndarray) -> None:
    np.testing.assert_allclose(covariance, np.swapaxes(covariance, -1, -2), rtol=1e-6, atol=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("camera", ["fixed", "hand-held"])
def test_covariance_of_poses_and_camera(camera: CameraKind) -> None:
    estimate = solved() if camera == "fixed" else smooth(scene(camera), WITH_COVARIANCE)
    wearer, filmed = estimate.wearers[0], estimate.camera
    assert wearer.covariance is not None
    assert filmed is not None
    assert filmed.covariance is not None
    frames = len(wearer.motion)
    assert wearer.covariance.joints.shape == (frames, 24, 3, 3)
    assert wearer.covariance.root.shape == (frames, 3, 3)
    assert filmed.covariance.shape == (1 if camera == "fixed" else frames, 6, 6)
    for one in (wearer.covariance.joints, wearer.covariance.root, filmed.covariance):
        assert_positive_definite(one)


def test_a_heading_that_nothing_shows_is_less_sure() -> None:
    """Elbows and wrists are hidden: what tells the headings of the arms there is their motion alone."""
    found = camera_of(scene()).detections
    hidden = [index for index, name in enumerate(found.keypoints.keypoints) if "elbow" in name or "wrist" in name]
    confidence = found.confidence.copy()
    confidence[:, hidden] = 0.0
    blind = replace(scene(), cameras=(replace(camera_of(scene()), detections=replace(found, confidence=confidence)),))
    shown, unseen = solved().wearers[0].calibration, smooth(blind, QUICK).wearers[0].calibration
    for name in ("left_forearm", "right_forearm", "left_upper_arm", "right_upper_arm"):
        assert unseen[name].heading_sigma > 1.1 * shown[name].heading_sigma
    for name in ("left_shank", "right_shank"):
        assert unseen[name].heading_sigma == pytest.approx(shown[name].heading_sigma, rel=0.05)


def test_where_the_inertial_frames_point_does_not_matter() -> None:
    """All of them turned about the vertical: another magnetic north, and the same motion."""
    wearer = scene().wearers[0]
    elsewhere = with_streams(scene(), {name: turned(stream, 2.0) for name, stream in wearer.imus.items()})
    estimate = smooth(elsewhere, QUICK)
    assert estimate.wearers[0].covariance is None  # which was not wanted
    assert estimate.camera is not None
    assert estimate.camera.covariance is None
    assert mpjpe(estimate, scene()) == pytest.approx(mpjpe(solved(), scene()), abs=0.1)  # mm


def test_the_frame_rate_is_nobodys_evidence() -> None:
    estimates = [smooth(scene(), Settings(frame_rate=rate, covariance=False)) for rate in (20.0, 60.0)]
    errors = [[evaluate_scene(one, scene())[name] for name in ("mpjpe", "mpjae")] for one in estimates]
    assert np.all(np.ptp(errors, axis=0) < (0.7, 0.4)), errors
