"""Without a camera too, every heading and mounting has a standard deviation that holds the truth."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.model_errors import UNFILMED
from vip_factors.body.skeleton import joint_index
from vip_factors.evaluate.evaluation import evaluate
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.recording import Recording
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings

SMALL = replace(Settings(), frame_rate=20.0)


@pytest.fixture(scope="module")
def recording() -> Recording:
    motion = gestures(4.0)
    errors = SimulateSettings(heading_offset_deg=20.0)
    return simulate_recording(motion, preset("sip6", motion.skeleton), errors, seed=2, name="walk")


@pytest.mark.parametrize("in_windows", [False, True])
def test_they_are_told_and_hold_the_truth(recording: Recording, in_windows: bool) -> None:
    windows = replace(SMALL.windows, above_s=2.0, window_s=2.0, overlap_s=0.5) if in_windows else SMALL.windows
    estimate = smooth(recording, replace(SMALL, windows=windows)).only_wearer
    headings = np.array([one.heading_sigma for one in estimate.calibration.values()])
    mountings = np.stack([one.mounting_sigma for one in estimate.calibration.values()])
    assert np.sum(headings < np.deg2rad(0.2)) == 1  # the pelvis's, which is the world's
    assert np.all((headings > 0) & (headings < np.deg2rad(40.0)))
    assert np.all((mountings > 0) & (mountings < np.deg2rad(40.0)))
    assert recording.truth is not None
    evaluation = evaluate(estimate, recording.truth)
    assert evaluation["nees_heading"] < 4.0
    assert evaluation["nees_mounting"] < 4.0


@pytest.mark.parametrize("in_windows", [False, True])
def test_what_models_leave_out_is_told_as_well(recording: Recording, in_windows: bool) -> None:
    """But what defines the world has the sigma of a convention, and poses are as they were."""
    windows = replace(SMALL.windows, above_s=2.0, window_s=2.0, overlap_s=0.5) if in_windows else SMALL.windows
    settings = replace(SMALL, windows=windows, covariance=True)
    told = smooth(recording, settings).only_wearer
    alone = smooth(recording, replace(settings, model_errors=False)).only_wearer
    assert told.covariance is not None
    assert alone.covariance is not None
    for name, one in alone.calibration.items():
        added = 0.0 if one.heading_sigma < np.deg2rad(0.15) else UNFILMED.heading
        mounting = UNFILMED.mounting[joint_index(one.bone)]
        assert told.calibration[name].heading_sigma == pytest.approx(np.hypot(one.heading_sigma, added))
        assert told.calibration[name].mounting_sigma == pytest.approx(np.hypot(one.mounting_sigma, mounting))
    knee = joint_index("left_knee")
    assert told.covariance.joints[:, knee] == pytest.approx(
        UNFILMED.joint[knee] ** 2 * alone.covariance.joints[:, knee]
    )
    assert told.covariance.root == pytest.approx(UNFILMED.root**2 * alone.covariance.root)
    assert np.array_equal(told.motion.R_parent_child, alone.motion.R_parent_child)


def test_what_is_no_variable_has_none(recording: Recording) -> None:
    kept = replace(SMALL.calibration, estimate_mountings=False)
    estimate = smooth(recording, replace(SMALL, calibration=kept)).only_wearer
    assert all(np.isfinite(one.heading_sigma) for one in estimate.calibration.values())
    assert not any(np.isfinite(one.mounting_sigma).any() for one in estimate.calibration.values())
