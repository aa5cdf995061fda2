"""A sensor that slips, or whose heading jumps, is told; sound ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample_streams
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.stages.drift import slip_findings

SHANK = "left_shank"


def leaps(heading: Array, slip: Array) -> tuple[Finding, ...]:
    """Findings of the true motion, with one sensor turned from the middle on."""
    motion = gestures(12.0)
    recording = simulate_recording(motion, preset("totalcapture13", motion.skeleton), SimulateSettings(), seed=1)
    stream, truth = recording.imus[SHANK], recording.truth
    assert truth is not None
    assert truth.calibration is not None
    assert stream.R_inertial_sensor is not None
    middle = len(stream) // 2
    late = heading @ stream.R_inertial_sensor[middle:] @ slip
    turned = replace(stream, R_inertial_sensor=np.concatenate([stream.R_inertial_sensor[:middle], late]))
    imus = {**recording.imus, SHANK: turned}
    frames = resample_streams([imus[name] for name in truth.calibration], truth.motion.time)
    bones = truth.motion.state.R_world_bone
    return tuple(slip_findings("anna", recording, frames, bones, truth.calibration))


@pytest.mark.parametrize(
    ("heading", "slip", "how"),
    [(np.eye(3), exp([0.4, 0.0, 0.0]), "slipped"), (rotation_z(0.4), np.eye(3), "heading jumped")],
    ids=["slip", "heading"],
)
def test_a_sensor_that_turns_midway_is_told(heading: Array, slip: Array, how: str) -> None:
    (found,) = leaps(heading, slip)
    assert (found.kind, found.subject) == ("sensor turned", SHANK)
    assert how in str(found)
    assert found.numbers["degrees"] == pytest.approx(np.rad2deg(0.4), abs=5)
    assert found.numbers["time"] == pytest.approx(6.0, abs=0.5)


def test_sensors_that_stay_are_not_told() -> None:
    assert leaps(np.eye(3), np.eye(3)) == ()
