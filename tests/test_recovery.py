"""Simulate without noise, solve, and the truth must come back: the test that checks everything at once."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.evaluate.calibration import calibration_error
from vip_factors.evaluate.metrics import align_frames, common_frames, mpjpe, orientation_error
from vip_factors.factor_settings import (
    AccelerationSettings,
    FactorSettings,
    FootContactSettings,
    HeadingPriorSettings,
    OrientationSettings,
    PosePriorSettings,
    RobustLoss,
    SmoothnessSettings,
)
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import Placement, SensorSite
from vip_factors.sensors.recording import Subject
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings

# Measurements believed, everything learnt or assumed all but switched off.
EXACT = FactorSettings(
    correlation_s=1e-3,  # every frame is exact by itself
    orientation=OrientationSettings(sigma_deg=0.1, loss=RobustLoss()),
    acceleration=AccelerationSettings(sigma=0.05, loss=RobustLoss()),
    pose_prior=PosePriorSettings(scale=1e-4, mean_scale=1e-4),
    smoothness=SmoothnessSettings(use=False),
    foot_contact=FootContactSettings(use=False),
    heading_prior=HeadingPriorSettings(least_sigma_deg=60.0),
)


@pytest.fixture(scope="module")
def every_bone() -> Placement:
    """A sensor on every bone, five centimetres off the joint, mounting known."""
    sites = [SensorSite(name, name, np.array([0.03, -0.02, 0.04]), np.eye(3), 0.1) for name in JOINT_NAMES]
    return Placement(tuple(sites))


def test_poses_and_headings_come_back(every_bone: Placement) -> None:
    motion = gestures(2.5)
    sensors = SimulateSettings.noise_free(imu_rate=400.0, heading_offset_deg=15.0)
    recording = simulate_recording(motion, every_bone, sensors, seed=2)
    recording = replace(recording, subject=Subject(skeleton=motion.skeleton))
    calibration = CalibrationSettings(estimate_mountings=False)
    settings = Settings(
        frame_rate=30.0, calibration=calibration, calibration_rate=30.0, factors=EXACT, covariance=False
    )
    estimate = smooth(recording, settings).wearer()
    assert recording.truth is not None
    assert recording.truth.calibration is not None
    ours, truth, _ = common_frames(estimate.motion, recording.truth.motion)
    assert mpjpe(ours, truth) < 1.0  # mm
    turned = orientation_error(ours, truth, align_frames(ours, truth))  # the world's yaw is a choice
    assert np.rad2deg(turned).max() < 0.1
    error = calibration_error(estimate.calibration, recording.truth.calibration)
    assert np.rad2deg(error.heading_magnitude).max() < 0.1
