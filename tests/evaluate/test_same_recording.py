"""A truth of another recording is told; sensors that are called otherwise are left out, not refused."""

from dataclasses import replace

import pytest

from vip_factors.estimate import Estimate, SceneEstimate
from vip_factors.evaluate.evaluation import EvaluationWarning, evaluate
from vip_factors.evaluate.same_recording import doubts
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording


@pytest.fixture(scope="module")
def recording() -> Recording:
    motion = gestures(2.0)
    return simulate_recording(motion, preset("sip6", motion.skeleton), name="walk")


def estimate_of(recording: Recording) -> SceneEstimate:
    assert recording.truth is not None
    assert recording.truth.calibration is not None
    one = Estimate(
        recording.name, "SIP", recording.truth.motion, recording.truth.calibration, sensors=tuple(recording.imus)
    )
    return SceneEstimate(recording.name, "SIP", (one,))


def test_nothing_is_said_of_the_same_recording(recording: Recording) -> None:
    assert doubts(estimate_of(recording), Scene("walk", (recording,))) == ""


def test_names_times_and_sensors_tell(recording: Recording) -> None:
    estimate = estimate_of(recording)
    named = doubts(estimate, Scene("run", (replace(recording, name="run"),)))
    assert "'walk'" in named
    assert "'run'" in named
    later = Scene("walk", (replace(recording, start_ns=10**18),))
    assert "100 s apart" in doubts(estimate, later, 10**18 - 100 * 10**9)
    other = replace(estimate, wearers=(replace(estimate.wearers[0], sensors=("00B40B91",)),))
    assert "00B40B91" in doubts(other, Scene("walk", (recording,)))
    assert recording.truth is not None
    short = replace(recording, truth=replace(recording.truth, motion=recording.truth.motion.frames(slice(0, 40))))
    assert "the truth covers" in doubts(estimate, Scene("walk", (short,)))


def test_calibrations_without_a_common_sensor_are_left_out_with_a_note(recording: Recording) -> None:
    estimate = estimate_of(recording).wearers[0]
    numbered = {f"00B4{number}": one for number, one in enumerate(estimate.calibration.values())}
    assert recording.truth is not None
    with pytest.warns(EvaluationWarning, match="00B40, 00B41"):
        evaluation = evaluate(replace(estimate, calibration=numbered), recording.truth)
    assert "heading_error" not in evaluation.metrics
    assert evaluation["mpjpe"] == pytest.approx(0.0, abs=1e-6)
