"""Headings that drift, without noise: steps follow them, a constant heading cannot; short recordings need none."""

from dataclasses import replace

import numpy as np
import pytest
from test_recovery import EXACT

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.evaluate.metrics import common_frames, mpjpe
from vip_factors.geometry.rotations import rotation_z
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import Calibration, Placement, SensorSite
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.settings import AssignmentSettings, CalibrationSettings, Settings, StartSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings

SECONDS = 8.0
BETWEEN = np.linspace(1.0, SECONDS - 1.0)  # the middles of the first and the last time without a step
SETTINGS = Settings(
    frame_rate=15.0,
    covariance=False,
    assignment=AssignmentSettings(check=False),
    calibration=CalibrationSettings(
        estimate_mountings=False, heading_drift_from_s=1.0, start=StartSettings(search=False)
    ),
    calibration_rate=15.0,
    factors=replace(EXACT, heading_walk=replace(EXACT.heading_walk, drift_deg=20.0, unknown_drift_deg=20.0)),
)


@pytest.fixture(scope="module")
def drifting() -> tuple[Recording, Calibration]:
    """A sensor on every bone; each heading drifts evenly, all of them together not at all."""
    sites = [SensorSite(name, name, np.array([0.03, -0.02, 0.04]), np.eye(3), 0.1) for name in JOINT_NAMES]
    motion = gestures(SECONDS)
    sensors = SimulateSettings.noise_free(imu_rate=400.0, heading_offset_deg=15.0)
    recording = simulate_recording(motion, Placement(tuple(sites)), sensors, seed=2)
    recording = replace(recording, subject=Subject(skeleton=motion.skeleton))
    rates = np.deg2rad(0.3) * np.random.default_rng(4).standard_normal(len(sites))  # 18° in a minute
    # A drift that all share turns the wearer, and nothing tells it from one: the walk's prior shares it out.
    ends = np.array([0.0, SECONDS])
    drift = ends[:, None] * (rates - rates.mean())
    assert recording.truth is not None
    imus, truth = {}, dict(recording.truth.calibration or {})
    for number, (name, stream) in enumerate(recording.imus.items()):
        assert stream.R_inertial_sensor is not None
        turn = rotation_z(-np.interp(stream.time, ends, drift[:, number]))
        imus[name] = replace(stream, R_inertial_sensor=turn @ stream.R_inertial_sensor)
        path = truth[name].heading + drift[:, number]
        truth[name] = replace(truth[name], heading_time=ends, heading_path=path)
    return replace(recording, imus=imus), truth


def heading_error_deg(estimate: Calibration, truth: Calibration, time: np.ndarray) -> float:
    """The largest heading error at any time, the yaw that all share removed."""
    errors = np.array([estimate[name].heading_at(time) - truth[name].heading_at(time) for name in estimate])
    gauge = np.angle(np.exp(1j * errors).sum())
    return float(np.rad2deg(np.abs(np.angle(np.exp(1j * (errors - gauge)))).max()))


def test_drift_comes_back(drifting: tuple[Recording, Calibration]) -> None:
    recording, truth = drifting
    assert recording.truth is not None
    estimate = smooth(recording, SETTINGS).wearer()
    ours, true, _ = common_frames(estimate.motion, recording.truth.motion)
    assert heading_error_deg(estimate.calibration, truth, BETWEEN) < 1.0
    assert mpjpe(ours, true) < 2.0  # mm


def test_constant_headings_cannot_follow(drifting: tuple[Recording, Calibration]) -> None:
    recording, truth = drifting
    constant = replace(SETTINGS, calibration=replace(SETTINGS.calibration, heading_drift_from_s=None))
    estimate = smooth(recording, constant).wearer()
    assert heading_error_deg(estimate.calibration, truth, BETWEEN) > 1.5
    assert all(len(one.heading_path) == 0 for one in estimate.calibration.values())


def test_a_short_recording_has_constant_headings(drifting: tuple[Recording, Calibration]) -> None:
    imus = {name: stream.cut(0.0, 2.0) for name, stream in drifting[0].imus.items()}
    settings = replace(SETTINGS, calibration=replace(SETTINGS.calibration, heading_drift_from_s=3.0))
    estimate = smooth(replace(drifting[0], imus=imus), settings).wearer()
    assert all(len(one.heading_path) == 0 for one in estimate.calibration.values())
