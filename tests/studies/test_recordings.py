"""Any recording becomes a row: batch and live beside its truth; starts are judged by the bones that they turn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filmed_gestures import filmed_gestures

from tests.studies.__main__ import main
from tests.studies.recordings import Recordings, Starts, StartTrial, bones_off, who_is_who
from tests.studies.study import markdown, run
from vip_factors.geometry.rotations import exp
from vip_factors.initialise.calibration import known_calibration
from vip_factors.io.mcap_recording import write_recording, write_scene
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = filmed_gestures("fixed", 2.5)
    path = tmp_path_factory.mktemp("recordings") / "gestures.mcap"
    write_scene(Scene("gestures", scene.wearers), path)
    return path


def test_a_row_has_errors_of_batch_and_live(recording: Path) -> None:
    study, told = Recordings(recordings=(recording,)), list[str]()
    (one,) = trials = run(study, lambda stage, done: told.append(stage))
    assert told == ["gestures.mcap"]
    assert one.wearer == "anna"
    for errors in (one.batch, one.live, one.late):
        assert 0 < errors[0] < 100
        assert 0 < errors[1] < 40
    assert one.late != one.live
    assert "| gestures.mcap | anna | 2 |" in markdown(study, trials)


def test_no_recording_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    for name, sentence in (("recordings", "expected one .mcap file or more"), ("starts", "recordings with a truth")):
        assert main([name]) == 2
        assert sentence in capsys.readouterr().err


def test_who_is_who_is_measured_where_the_recording_says_whom_it_shows() -> None:
    scene = filmed_gestures("fixed", 2.5)
    assert scene.truth is not None
    given = scene.truth.wearer.copy()
    theirs = np.flatnonzero(given == 0)
    assert who_is_who(scene, given, 0) == (100.0, 100.0)
    given[theirs[: len(theirs) // 2]] = -1
    precision, recall = who_is_who(scene, given, 0)
    assert precision == 100.0
    assert recall == pytest.approx(50.0, abs=1)
    assert np.isnan(who_is_who(replace(scene, truth=None), given, 0)).all()


@pytest.fixture(scope="module")
def worn() -> Recording:
    motion = with_initial_pose(gestures(4.0), "n-pose", hold_s=1.0)
    sensors = replace(SimulateSettings.noise_free(), imu_rate=30.0)
    return simulate_recording(motion, preset("sip6", motion.skeleton), sensors, seed=4, initial_pose="n-pose")


def test_a_start_is_as_wrong_as_it_turns_bones(worn: Recording) -> None:
    assert worn.truth is not None
    assert worn.truth.calibration is not None
    frames = resample(worn, 15.0)
    start = known_calibration(frames, dict(worn.truth.calibration))
    assert np.max(bones_off(worn, frames, start)) < np.deg2rad(3)
    assert np.max(bones_off(worn, frames, replace(start, headings=start.headings + 1.0))) < np.deg2rad(3)
    turned = start.R_bone_sensor.copy()
    turned[2] = exp([0.0, 1.2, 0.0]) @ turned[2]
    off = bones_off(worn, frames, replace(start, R_bone_sensor=turned))
    assert off[2] == pytest.approx(1.2, abs=0.05)
    assert np.max(np.delete(off, 2)) < np.deg2rad(3)


def test_a_row_for_each_wearer_and_one_for_all(worn: Recording, tmp_path: Path) -> None:
    path = tmp_path / "gestures.mcap"
    write_recording(worn, path)
    study = Starts(recordings=(path,))
    (one,) = trials = run(study)
    assert one.initial_pose == "n-pose"
    assert list(one.off_deg) == list(worn.placed)
    assert markdown(study, trials).count("| 6 | 0 | 0 |") == 2


def test_what_is_wrong_is_counted_flagged_or_not() -> None:
    one = StartTrial("r", "w", "none", {"a": 70.0, "b": 100.0, "c": 10.0, "d": 5.0}, ("b", "c"), 1.0)
    assert "| all |  |  | 8 | 4 | 2 | 2 | 2.0 |" in markdown(Starts(), [one, one])
