import json
import re
from pathlib import Path

import numpy as np
import pytest

from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_recording import read_scene


def test_version(run) -> None:
    assert run("--version").out.startswith("vip-factors ")


def test_info_tells_sensors_and_solves(run, files) -> None:
    told = run("info", files.recording)
    assert "left_forearm" in told.out
    assert "truth: motion and calibration" in told.out
    told = run("info", files.estimate)
    assert "computed in: " in told.out
    assert re.search(r"mounting, wxyz(.|\n)*  pelvis +pelvis +[-0-9.]+°, by convention", told.out)


def test_info_of_a_long_recording_reads_no_samples(run, files, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run("info", files.recording).out.splitlines()
    monkeypatch.setattr("vip_factors.cli.views.READ_S", 0.0)
    told = run("info", files.recording).out.splitlines()
    assert told[:-2] == whole
    assert "index" in told[-1]
    assert "mounting, wxyz" in run("info", files.estimate).out  # whose solves no index tells


def test_evaluate_prints_a_page_and_writes_everything_as_json(run, files, tmp_path: Path) -> None:
    told = run("evaluate", files.estimate, "--truth", files.recording, "--json", tmp_path / "e.json")
    assert told.code == 0
    assert told.out.startswith("positions ")
    assert told.out.count("\n") <= 40
    assert "| knee |" in told.out
    written = json.loads((tmp_path / "e.json").read_text(encoding="utf-8"))
    assert np.isfinite(written["metrics"]["mpjpe"]["value"])


def test_a_wearer_has_one_name(files) -> None:
    estimate, (recording,) = read_estimate(files.estimate), read_scene(files.recording).wearers
    names = {finding.wearer for finding in estimate.all_findings if finding.wearer}
    assert names | {estimate.wearer().motion.name} == {recording.subject.name}


def test_view_writes_what_is_asked(run, files, tmp_path: Path) -> None:
    told = run(
        "view", files.recording, files.estimate, "--save", tmp_path / "a.rrd", "--picture", tmp_path / "a.png",
    )  # fmt: skip
    assert told.code == 0, told.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.rrd"]
    assert run("view", files.recording, "--save", tmp_path / "b.rrd").code == 0


def test_settings_file_and_options_over_it(run, files, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text("frame_rate = 10\nacceleration = false\n[solve]\nmax_iterations = 2\n", encoding="utf-8")
    told = run(
        "smooth", files.recording, "--out", tmp_path / "e.mcap", "--settings", settings, "--solve.max-iterations", "1"
    )
    assert told.code == 0, told.err
    estimate = read_estimate(tmp_path / "e.mcap").wearer()
    assert estimate.method == "SOP"
    assert estimate.motion.rate == pytest.approx(10.0)
    assert estimate.settings["solve.max_iterations"] == "1"


def test_demo_makes_everything(run, tmp_path: Path) -> None:
    told = run("demo", "--out", tmp_path / "demo", "--seconds", "1.5", "--placement", "sip6", "--frame-rate", "20")
    assert told.code == 0, told.err
    made = sorted(path.name for path in (tmp_path / "demo").iterdir())
    assert made == ["demo.png", "demo.rrd", "estimate.mcap", "evaluation.json", "recording.mcap"]
    for name in made:
        assert name in told.out
    again = run("demo", "--out", tmp_path / "demo")
    assert again.code == 2
    assert "exists" in again.err


@pytest.mark.parametrize("camera", ["fixed", "walking"])
def test_a_simulated_scene_is_what_was_asked_for(run, tmp_path: Path, camera: str) -> None:
    path = tmp_path / "scene.mcap"
    told = run(
        "simulate", "gestures", path, "--seconds", "2", "--placement", "sip6", "--camera", camera, "--also", "gestures",
        "--bystanders", "1", "--keypoints", "coco17", "--detector.mixed", "0", "--width", "1280", "--height", "720",
    )  # fmt: skip
    assert told.code == 0
    assert f"2 wearers with 12 sensors, {camera} camera" in told.out
    scene = read_scene(path)
    assert [len(wearer.imus) for wearer in scene.wearers] == [6, 6]
    assert (scene.camera.model.width, scene.camera.moving) == (1280, camera == "walking")
    assert (scene.camera.mount is None) == (camera == "fixed")
    assert scene.camera.detections.keypoints.name == "coco17"
    assert set(np.unique(scene.camera.truth.wearer)) == {-1, 0, 1}


def test_further_people_need_a_camera(run, tmp_path: Path) -> None:
    told = run("simulate", "gestures", tmp_path / "scene.mcap", "--bystanders", "2")
    assert told.code != 0
    assert "--camera" in told.err
    assert not (tmp_path / "scene.mcap").exists()
