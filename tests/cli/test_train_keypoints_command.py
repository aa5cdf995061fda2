"""Offsets are learnt by one command and used by another."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.cli.main import main
from vip_factors.io.keypoint_offsets_file import read_keypoint_offsets

Run = Callable[..., Any]
QUICK = ["--frame-rate", "5", "--fusion.rounds", "1", "--fusion.refits", "0"]
LEARNED = "--camera.keypoint-offset.learned"


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("keypoints") / "scene.mcap"
    simulate = ["simulate", "gestures", str(made), "--camera", "fixed", "--seconds", "3", "--placement", "sip6"]
    assert main(simulate) == 0
    return made


def test_from_recordings_to_the_next_estimate(run: Run, scene: Path, tmp_path: Path) -> None:
    file = tmp_path / "offsets.toml"
    told = run("train", "keypoints", scene, "--out", file)
    assert told.code == 0, told.err
    assert "1 person" in told.out
    for name in OFFSET_KEYPOINTS:
        assert name in told.out
    read = read_keypoint_offsets(file)
    assert read.provenance.startswith("vip-factors train keypoints scene.mcap")
    assert len(read.sets) == 1
    told = run("smooth", scene, "--out", tmp_path / "e.mcap", LEARNED, file, *QUICK)
    assert told.code == 0, told.err


def test_a_recording_without_a_camera_is_refused(run: Run, files: Any, tmp_path: Path) -> None:
    told = run("train", "keypoints", files.recording, "--out", tmp_path / "o.toml")
    assert told.code == 2
    assert "has no camera" in told.err
    assert not (tmp_path / "o.toml").exists()
