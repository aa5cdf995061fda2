"""Simulated streams against physics and against their own truth."""

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.geometry.rotations import angle_between, exp, log, rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.sensors.calibration import Placement, preset, sensor_site
from vip_factors.sensors.recording import Recording
from vip_factors.simulate.dense import dense_motion
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import GRAVITY, simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose

PLAIN = SimulateSettings.noise_free


@pytest.fixture(scope="module")
def motion() -> Motion:
    return gestures(6.0, rate=120.0)


@pytest.fixture(scope="module")
def placement(motion: Motion) -> Placement:
    return preset("sip6", motion.skeleton)


def world_acceleration(recording: Recording, sensor: str) -> np.ndarray:
    stream, calibration = recording.imus[sensor], recording.truth.calibration[sensor]
    R_world_sensor = rotation_z(calibration.heading) @ stream.R_inertial_sensor
    return np.einsum("nij,nj->ni", R_world_sensor, stream.specific_force) + GRAVITY


def test_truth_explains_the_measured_orientation(motion: Motion, placement: Placement) -> None:
    settings = PLAIN(imu_rate=60.0, heading_offset_deg=180.0, mounting_error_deg=15.0)
    recording = simulate_recording(motion, placement, settings, seed=4)
    truth = recording.truth.motion
    for site in placement.sites:
        stream, calibration = recording.imus[site.sensor], recording.truth.calibration[site.sensor]
        assert stream.time == pytest.approx(truth.time, abs=1e-12)
        body = truth.state.R_world_bone[:, site.bone_index] @ calibration.R_bone_sensor
        sensor = rotation_z(calibration.heading) @ stream.R_inertial_sensor
        assert body == pytest.approx(sensor, abs=1e-9)


def test_specific_force_integrates_twice_to_the_path_of_the_sensor(motion: Motion, placement: Placement) -> None:
    settings = PLAIN(imu_rate=2000.0, heading_offset_deg=45.0)
    site = placement.site("left_forearm")
    recording = simulate_recording(motion, Placement((site,)), settings)
    stream = recording.imus["left_forearm"]
    bone = dense_motion(motion, settings.lowpass_hz).bone(site.bone_index, stream.time)
    position, velocity, _ = bone.point(site.p_bone_sensor)
    acceleration, step = world_acceleration(recording, "left_forearm"), 1 / settings.imu_rate
    v = velocity[0] + np.cumsum((acceleration[1:] + acceleration[:-1]) * step / 2, axis=0)
    p = position[0] + np.cumsum(np.concatenate([velocity[:1], v])[:-1] * step + acceleration[:-1] * step**2 / 2, axis=0)
    assert p == pytest.approx(position[1:], abs=1e-4)


def test_gyroscope_integrates_to_the_orientation(motion: Motion, placement: Placement) -> None:
    shank = Placement((placement.site("right_shank"),))
    recording = simulate_recording(motion, shank, PLAIN(imu_rate=1000.0, wobble=1.0, skin=1.5))
    stream = recording.imus["right_shank"]
    R = stream.R_inertial_sensor[0]
    for turn in exp((stream.angular_rate[:-1] + stream.angular_rate[1:]) / 2000.0):
        R = R @ turn
    assert angle_between(R, stream.R_inertial_sensor[-1]) < 2e-3


def test_at_rest_the_accelerometer_shows_gravity_upwards(motion: Motion, placement: Placement) -> None:
    standing = with_initial_pose(motion, "n-pose", hold_s=3.0)
    recording = simulate_recording(standing, placement, PLAIN(heading_offset_deg=90.0), initial_pose="n-pose")
    for stream in recording.imus.values():
        still = (stream.time > 0.5) & (stream.time < 2.0)
        up = np.einsum("nij,nj->ni", stream.R_inertial_sensor, stream.specific_force)[still]
        assert up == pytest.approx(np.broadcast_to([0, 0, 9.81], up.shape), abs=1e-3)
        assert np.linalg.norm(stream.angular_rate[still], axis=1).max() < 1e-3


def test_headings_turn_about_the_vertical_and_leave_the_rest(motion: Motion, placement: Placement) -> None:
    without = simulate_recording(motion, placement, PLAIN(), seed=1)
    turned = simulate_recording(motion, placement, PLAIN(heading_offset_deg=180.0), seed=1)
    headings = {sensor: calibration.heading for sensor, calibration in turned.truth.calibration.items()}
    assert len(set(headings.values())) == len(headings)
    for sensor, heading in headings.items():
        a, b = without.imus[sensor], turned.imus[sensor]
        assert rotation_z(heading) @ b.R_inertial_sensor == pytest.approx(a.R_inertial_sensor, abs=1e-12)
        assert b.specific_force == pytest.approx(a.specific_force, abs=1e-12)


def test_heading_drift_starts_at_the_true_heading(motion: Motion, placement: Placement) -> None:
    without = simulate_recording(motion, placement, PLAIN(heading_offset_deg=45.0))
    drifting = simulate_recording(motion, placement, PLAIN(heading_offset_deg=45.0, heading_drift_deg=20.0))
    a, b = without.imus["head"].R_inertial_sensor, drifting.imus["head"].R_inertial_sensor
    turn = a @ transpose(b)
    assert turn[0] == pytest.approx(np.eye(3), abs=1e-12)
    assert turn[:, 2, 2] == pytest.approx(np.ones(len(turn)))
    assert np.abs(wrap_angle(yaw_of(turn))).max() > np.deg2rad(1)


def test_mountings_scatter_by_their_sigma(motion: Motion) -> None:
    placement = preset("mvn17", motion.skeleton)
    settings = PLAIN(mounting_error_deg=10.0, imu_rate=10.0, angular_rate=False)
    short = motion.frames(slice(0, 30))
    turns = []
    for seed in range(6):
        calibration = simulate_recording(short, placement, settings, seed).truth.calibration
        turns += [log(site.R_bone_sensor.T @ calibration[site.sensor].R_bone_sensor) for site in placement.sites]
    assert np.rad2deg(np.std(turns, axis=0)) == pytest.approx([10.0] * 3, rel=0.25)


def test_attitude_errors_have_the_sigmas_asked_for() -> None:
    motion = gestures(60.0, rate=60.0)
    placement = Placement(preset("sip6", motion.skeleton).sites)
    settings = PLAIN(attitude_error=1.0, imu_rate=30.0)
    noisy, clean = (simulate_recording(motion, placement, s, seed=2) for s in (settings, PLAIN(imu_rate=30.0)))
    error = np.concatenate(
        [log(noisy.imus[s].R_inertial_sensor @ transpose(clean.imus[s].R_inertial_sensor)) for s in noisy.imus]
    )
    assert np.rad2deg(error.std(axis=0)) == pytest.approx([1.0, 1.0, 2.5], rel=0.15)
    # A mistake of the filter does not move the accelerometer.
    assert noisy.imus["head"].specific_force == pytest.approx(clean.imus["head"].specific_force)


def test_realistic_errors_lie_where_measured_ones_do() -> None:
    """3–6° and 1–3 m/s² at moving limbs, less on the head (design figures from TotalCapture and TNT15)."""
    motion = gestures(30.0, rate=120.0)
    sensors = ("left_thigh", "right_thigh", "left_shank", "right_upper_arm")
    placement = Placement(tuple(sensor_site(sensor, motion.skeleton) for sensor in sensors))
    settings = SimulateSettings(phases=False, packet_loss=0.0, gap_s=0.0, position_error_m=0.0)
    real = simulate_recording(motion, placement, settings)
    ideal = simulate_recording(motion, placement, PLAIN())
    for sensor in sensors:
        R_real, R_ideal = real.imus[sensor].R_inertial_sensor, ideal.imus[sensor].R_inertial_sensor
        assert 2.5 < np.rad2deg(np.sqrt(np.mean(angle_between(R_real, R_ideal) ** 2))) < 6.5
        difference = world_acceleration(real, sensor) - world_acceleration(ideal, sensor)
        assert 0.6 < np.sqrt(np.mean(np.sum(difference**2, axis=1))) < 3.0


def test_same_seed_same_recording_and_sensors_are_independent(motion: Motion) -> None:
    sites = preset("sip6", motion.skeleton).sites
    few, many = Placement(sites[:2]), Placement(sites[2:4] + sites[1::-1])
    settings = SimulateSettings(heading_offset_deg=45.0)
    once, again, more = (simulate_recording(motion, p, settings, seed=7) for p in (few, few, many))
    other = simulate_recording(motion, few, settings, seed=8)
    for sensor, stream in once.imus.items():
        for same in (again, more):
            np.testing.assert_array_equal(stream.specific_force, same.imus[sensor].specific_force)
            np.testing.assert_array_equal(stream.R_inertial_sensor, same.imus[sensor].R_inertial_sensor)
        assert once.truth.calibration[sensor].heading != other.truth.calibration[sensor].heading


def test_lost_samples_are_absent_and_sensors_out_of_phase(motion: Motion, placement: Placement) -> None:
    recording = simulate_recording(motion, placement, PLAIN(phases=True, packet_loss=0.1, gap_s=0.5))
    starts = [stream.time[0] for stream in recording.imus.values()]
    assert len(set(starts)) == len(starts)
    for stream in recording.imus.values():
        assert np.diff(stream.gaps).max() > 0.5
        steps = np.diff(stream.time) * 100.0
        assert steps == pytest.approx(np.round(steps), abs=1e-6)
