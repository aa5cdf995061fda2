"""Without a camera too, every heading and mounting has a standard deviation that holds the truth."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.evaluate.evaluation import evaluate
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.recording import Recording
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings

SMALL = Settings(frame_rate=15.0, covariance=False)


@pytest.fixture(scope="module")
def recording() -> Recording:
    motion = gestures(3.0)
    errors = SimulateSettings(heading_offset_deg=20.0)
    return simulate_recording(motion, preset("sip6", motion.skeleton), errors, seed=2, name="walk")


@pytest.mark.parametrize("in_windows", [False, True])
def test_they_hold_the_truth_and_little_more(recording: Recording, in_windows: bool) -> None:
    windows = replace(SMALL.windows, above_s=2.0, window_s=2.0, overlap_s=0.5) if in_windows else SMALL.windows
    estimate = smooth(recording, replace(SMALL, windows=windows)).wearer()
    headings = np.rad2deg([calibration.heading_sigma for calibration in estimate.calibration.values()])
    mountings = np.rad2deg([calibration.mounting_sigma for calibration in estimate.calibration.values()])
    pelvis = list(estimate.calibration).index("pelvis")
    assert 0 < headings[pelvis] < 0.2  # which is the world's
    assert np.all((np.delete(headings, pelvis) > 4) & (np.delete(headings, pelvis) < 20))
    assert np.all((mountings > 1) & (mountings < 36))  # straps let a sensor turn by so much
    assert recording.truth is not None
    evaluation = evaluate(estimate, recording.truth)
    assert 0.1 < evaluation["nees_heading"] < 4.0
    assert 0.05 < evaluation["nees_mounting"] < 2.0  # of what straps say and no motion of seconds does


def test_what_is_no_variable_has_none(recording: Recording) -> None:
    kept = replace(SMALL.calibration, estimate_mountings=False)
    estimate = smooth(recording, replace(SMALL, calibration=kept)).wearer()
    assert all(np.isfinite(calibration.heading_sigma) for calibration in estimate.calibration.values())
    assert not any(np.isfinite(calibration.mounting_sigma).any() for calibration in estimate.calibration.values())
