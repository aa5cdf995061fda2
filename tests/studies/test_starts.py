"""Starts are judged by the bones that they turn; what is wrong is told, flagged or not."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies.__main__ import main
from tests.studies.starts import StartTrial, bones_off, run_starts, starts_json, starts_table
from vip_factors.geometry.rotations import exp
from vip_factors.initialise.calibration import known_calibration
from vip_factors.io.mcap_recording import write_recording
from vip_factors.sensors.frames import resample
from vip_factors.sensors.placement import preset
from vip_factors.sensors.recording import Recording
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.stance import with_initial_pose


@pytest.fixture(scope="module")
def recording() -> Recording:
    motion = with_initial_pose(gestures(4.0), "n-pose", hold_s=1.0)
    sensors = replace(SimulateSettings.noise_free(), imu_rate=30.0)
    return simulate_recording(motion, preset("sip6", motion.skeleton), sensors, seed=4, initial_pose="n-pose")


def test_a_start_is_as_wrong_as_it_turns_bones(recording: Recording) -> None:
    assert recording.truth is not None
    assert recording.truth.calibration is not None
    frames = resample(recording, 15.0)
    start = known_calibration(frames, dict(recording.truth.calibration))
    assert np.max(bones_off(recording, frames, start)) < np.deg2rad(3)
    assert np.max(bones_off(recording, frames, replace(start, headings=start.headings + 1.0))) < np.deg2rad(3)
    turned = start.R_bone_sensor.copy()
    turned[2] = exp([0.0, 1.2, 0.0]) @ turned[2]
    off = bones_off(recording, frames, replace(start, R_bone_sensor=turned))
    assert off[2] == pytest.approx(1.2, abs=0.05)
    assert np.max(np.delete(off, 2)) < np.deg2rad(3)


def test_a_row_for_each_wearer_and_one_for_all(recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "gestures.mcap"
    write_recording(recording, path)
    (one,) = run_starts([path], lambda stage, done: None)
    assert one.initial_pose == "n-pose"
    assert list(one.off_deg) == list(recording.placed)
    assert starts_table([one]).count("| 6 | 0 | 0 |") == 2
    assert list(json.loads(starts_json([one]))) == [f"gestures.mcap {recording.subject.name}"]


def test_what_is_wrong_is_counted_flagged_or_not() -> None:
    one = StartTrial("r", "w", "none", {"a": 70.0, "b": 100.0, "c": 10.0, "d": 5.0}, ("b", "c"), 1.0)
    assert one.wrong == ("a", "b")
    assert "| all |  |  | 8 | 4 | 2 | 2 | 2.0 |" in starts_table([one, one])


def test_no_recording_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["starts"]) == 2
    assert "recordings with a truth" in capsys.readouterr().err
