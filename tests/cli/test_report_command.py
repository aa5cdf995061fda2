"""``vip-factors report``: the page appears beside the estimate, and what the user can mend is told in one line."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from cli.conftest import SMALL
from films import write_video
from scene_sample import Injected, estimate_of, scene_sample

from tests.io.mcap_samples import copy_messages
from vip_factors.cli.main import main
from vip_factors.io.mcap_estimate import write_estimate
from vip_factors.io.mcap_messages import MessageWriter
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.sensors.camera import VideoClock


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene, its estimate, and a file that holds both."""
    folder = tmp_path_factory.mktemp("report")
    scene = scene_sample(0.2, wearers=1)
    write_recording(scene, folder / "scene.mcap")
    write_estimate(estimate_of(scene), folder / "scene.estimate.mcap")
    with (folder / "both.mcap").open("wb") as file, MessageWriter(file) as writer:
        for name in ("scene.mcap", "scene.estimate.mcap"):
            copy_messages(folder / name, writer._writer)
    return folder


def test_the_page_is_beside_the_estimate(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(files / "scene.estimate.mcap")]) == 0
    page = files / "scene.estimate.html"
    assert capsys.readouterr().out == f"{page}\n"
    assert "Against the truth" not in page.read_text(encoding="utf-8")
    assert main(["report", str(files / "scene.estimate.mcap")]) == 2
    assert "exists" in capsys.readouterr().err


def test_the_truth_is_named(files: Path, tmp_path: Path) -> None:
    page, estimate, scene = tmp_path / "page.html", files / "scene.estimate.mcap", files / "scene.mcap"
    assert main(["report", str(estimate), "--truth", str(scene), "--out", str(page)]) == 0
    assert "Against the truth" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["missing.mcap"], "missing.mcap"),
        (["scene.mcap"], "estimate"),
        (["scene.estimate.mcap", "--out", "page.html", "--video"], "filmed recording"),
        (["scene.estimate.mcap", "--out", "page.html", "--video", "scene.mcap"], "not a video"),
        (["scene.estimate.mcap", "--out", "page.html", "--video", "gone.mp4"], "no such video"),
        (["scene.estimate.mcap", "--out", "page.html", "--video", "gone.mp4", "b.mp4"], "no such video"),
        (
            ["scene.estimate.mcap", "--out", "page.html", "--video", "--video-height", "8"],
            "64 or more and 2160 at most",
        ),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], told: str, files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    assert main(["report", *words]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert "Traceback" not in error
    assert not (files / "page.html").exists()


def test_a_film_is_beside_the_page(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, film = tmp_path / "a page.html", tmp_path / "a page.mp4"
    few = ["--video-height", "64"]
    words = ["report", str(files / "both.mcap"), *few, "--out", str(page), "--video"]
    assert main(words) == 0
    assert capsys.readouterr().out == f"{page}\n{film}\n"
    assert film.stat().st_size > 1000
    text = page.read_text(encoding="utf-8")
    assert "Against the truth" in text  # of the recording in the same file
    assert 'src="a%20page.mp4" data-start="0.0"' in text
    assert float(text.partition('data-pace="')[2].partition('"')[0]) == pytest.approx(1.0)
    page.unlink()
    assert main(words) == 2
    assert f"{film} exists" in capsys.readouterr().err
    assert not page.exists()


def test_two_cameras_have_films_frusta_and_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = scene_sample(0.2, wearers=1)
    left = replace(scene.camera, name="left", video=None, focal_sigma=0.1)
    estimate = estimate_of(scene, Injected(camera_m=0.1))
    found = replace(estimate.camera, name="left", focal_sigma=0.03, clock=VideoClock(0.02))
    write_recording(replace(scene, cameras=(scene.camera, left)), tmp_path / "scene.mcap")
    write_estimate(replace(estimate, cameras=(estimate.camera, found)), tmp_path / "found.mcap")
    words = ["report", str(tmp_path / "found.mcap"), "--recording", str(tmp_path / "scene.mcap")]
    assert main([*words, "--video-height", "64", "--video"]) == 0
    films = [tmp_path / f"found.{name}.mp4" for name in ("phone", "left")]
    assert capsys.readouterr().out.splitlines()[1:] == list(map(str, films))
    text = (tmp_path / "found.html").read_text(encoding="utf-8")
    for part in (*(f'src="{film.name}"' for film in films), "± 3.0 %", ">phone</button>", ">left</button>"):
        assert part in text
    assert text.count("<h3>Camera “left”</h3>") == 2  # as it was found, and as it was recorded
    assert main([*words, "--overwrite", "--video", str(films[0])]) == 2
    assert "1 video files for 2 cameras (phone, left)" in capsys.readouterr().err


def test_a_film_is_of_the_video_that_is_named(files: Path, tmp_path: Path) -> None:
    scene, video, page = read_scene(files / "scene.mcap"), tmp_path / "v.avi", tmp_path / "page.html"
    write_video(video, [np.full((720, 1280, 3), (0, 200, 0), np.uint8)] * len(scene.camera.detections.time), 30.0)
    words = ["report", str(files / "scene.estimate.mcap"), "--recording", str(files / "scene.mcap")]
    assert main([*words, "--video-height", "96", "--video", str(video), "--out", str(page)]) == 0
    good, picture = cv2.VideoCapture(str(page.with_suffix(".mp4"))).read()
    assert good
    assert np.abs(picture[2:8, 2:80].mean(axis=(0, 1)) - [0, 200, 0]).max() < 20
    assert "Against the truth" in page.read_text(encoding="utf-8")


def test_the_page_tells_the_uncertainty_of_angles_without_being_asked(run: Callable, tmp_path: Path) -> None:
    recording, estimate, page = (tmp_path / name for name in ("walk.mcap", "walk.estimate.mcap", "walk.estimate.html"))
    run("simulate", "gestures", recording, "--seconds", "2", "--placement", "sip6")
    assert run("smooth", recording, *SMALL).code == 0
    assert run("report", estimate).code == 0
    text = page.read_text(encoding="utf-8")
    assert "typical of the limbs" in text
    assert "± unknown" not in text
