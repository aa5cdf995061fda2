"""Any recording becomes a row: batch and live beside its truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filmed_gestures import filmed_gestures

from tests.studies.__main__ import main
from tests.studies.recordings import Recordings, who_is_who
from tests.studies.study import markdown, run
from vip_factors.estimate import CameraEstimate, Estimate
from vip_factors.io.mcap_recording import write_recording
from vip_factors.sensors.scene import Scene


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = filmed_gestures("fixed", 2.5)
    path = tmp_path_factory.mktemp("recordings") / "gestures.mcap"
    write_recording(Scene("gestures", scene.wearers), path)
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
    assert main(["recordings"]) == 2
    assert "expected one .mcap file or more" in capsys.readouterr().err


def test_who_is_who_is_measured_where_the_recording_says_whom_it_shows() -> None:
    scene = filmed_gestures("fixed", 2.5)
    assert scene.camera.truth is not None
    labels = scene.camera.truth.wearer.copy()
    path = scene.camera.truth.path
    camera = CameraEstimate(scene.camera.name, scene.camera.model, path, wearer_of_detection=labels)
    estimate = Estimate(scene.name, "VIP", (), (camera,))
    of_wearer = np.flatnonzero(labels == 0)
    assert who_is_who(scene, estimate, 0) == (100.0, 100.0)
    labels[of_wearer[: len(of_wearer) // 2]] = -1
    precision, recall = who_is_who(scene, estimate, 0)
    assert precision == 100.0
    assert recall == pytest.approx(50.0, abs=1)
    assert np.isnan(who_is_who(replace(scene, cameras=(replace(scene.camera, truth=None),)), estimate, 0)).all()
