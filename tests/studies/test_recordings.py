"""Any recording becomes a row: batch and live beside its truth."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filmed_gestures import filmed_gestures

from tests.studies.__main__ import main
from tests.studies.recordings import _who_is_who, recordings_json, recordings_table, run_recordings
from vip_factors.io.mcap_scene_recording import write_scene
from vip_factors.sensors.scene import Scene


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = filmed_gestures("fixed", 2.5)
    path = tmp_path_factory.mktemp("recordings") / "gestures.mcap"
    write_scene(Scene("gestures", scene.wearers), path)
    return path


def test_a_row_has_errors_of_batch_and_live(recording: Path) -> None:
    told: list[str] = []
    trials = run_recordings([recording], True, lambda stage, done: told.append(stage))
    assert told == ["gestures.mcap"]
    (one,) = trials
    assert one.wearer == "anna"
    for errors in (one.batch, one.live, one.late):
        assert 0 < errors[0] < 100
        assert 0 < errors[1] < 40
    assert one.late != one.live
    assert "| gestures.mcap | anna | 2 |" in recordings_table(trials)
    assert json.loads(recordings_json(trials))["gestures.mcap anna"]["batch"][0] == pytest.approx(one.batch[0])


def test_no_recording_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recordings"]) == 2
    assert "expected one .mcap file or more" in capsys.readouterr().err


def test_who_is_who_is_measured_where_the_recording_says_whom_it_shows() -> None:
    scene = filmed_gestures("fixed", 2.5)
    assert scene.truth is not None
    given = scene.truth.wearer.copy()
    theirs = np.flatnonzero(given == 0)
    assert _who_is_who(scene, given, 0) == (100.0, 100.0)
    given[theirs[: len(theirs) // 2]] = -1
    precision, recall = _who_is_who(scene, given, 0)
    assert precision == 100.0
    assert recall == pytest.approx(50.0, abs=1)
    assert np.isnan(_who_is_who(replace(scene, truth=None), given, 0)).all()
