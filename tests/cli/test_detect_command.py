"""The command around the detector: files, complaints, what it tells."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from detect.stub_people import People
from films import write_video

from vip_factors.detect import blazepose, models, tracks
from vip_factors.detect.tracks import Tracker
from vip_factors.io.detections import read_detections


@pytest.fixture
def video(tmp_path: Path) -> Path:
    return write_video(tmp_path / "walk.mp4", np.zeros((10, 240, 640, 3), np.uint8))


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> People:
    people = People({"a": (150, 120), "b": (450, 120)})
    monkeypatch.setattr(models, "blazepose_files", lambda source, tell: None)
    monkeypatch.setattr(blazepose, "check_interpreter", lambda: None)
    monkeypatch.setattr(tracks, "blazepose_tracker", lambda files, settings, threads: Tracker(people, people, settings))
    return people


def test_poses_and_an_overlay(run: Callable, video: Path, seen: People, tmp_path: Path) -> None:
    told = run("detect", video, "--overlay", tmp_path / "seen.mp4")
    assert told.code == 0, told.err
    assert "10 of 10 frames of walk.mp4 looked at" in told.out
    assert "person 2: 10 frames, 0.0 to 0.9 s" in told.out
    assert told.out.endswith(f"{tmp_path / 'walk.poses.json'}\n{tmp_path / 'seen.mp4'}\n")
    assert len(read_detections(tmp_path / "walk.poses.json", 10.0)) == 20
    again = run("detect", video)
    assert again.code == 2
    assert "exists already" in again.err


def test_run_detects_and_needs_no_camera_file(run: Callable, video: Path, seen: People, tmp_path: Path) -> None:
    words = ("run", "--video", video, "--log", tmp_path / "none", "--overlay", "--out", tmp_path / "made")
    told = run(*words)
    assert told.code == 2
    assert "step convert: " in told.err
    assert "10 of 10 frames of walk.mp4 looked at" in told.out
    made = {"poses.json", "poses.mp4"}
    assert {path.name for path in (tmp_path / "made").iterdir() if path.is_file()} == made
    assert run(*words).out.startswith("detect           as before  ")


def test_nobody_is_told(run: Callable, video: Path, seen: People) -> None:
    seen.places.clear()
    told = run("detect", video)
    assert told.code == 0
    assert "nobody was found" in told.out


def test_what_cannot_be(run: Callable, video: Path, seen: People, tmp_path: Path) -> None:
    for words, expected in (
        ((tmp_path / "none.mp4",), "no such video file"),
        ((video, "--keypoints", "coco17"), "without a model"),
        ((video, "--start-s", "20"), "there is no frame"),
        ((video, "--model", tmp_path / "none.onnx"), "no such model file"),
        ((video, "--tile-levels", "9"), "--tile-levels is 9"),
    ):
        told = run("detect", *words)
        assert told.code == 2
        assert expected in told.err
    assert not (tmp_path / "walk.poses.json").exists()
