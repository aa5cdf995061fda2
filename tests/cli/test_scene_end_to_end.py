"""A filmed scene through all commands: made, looked at, reconstructed, compared, drawn; and what cannot be."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vip_factors.cli.main import main
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.sensors.scene import Scene

QUICK = ("--frame-rate", "15", "--no-covariance", "--fusion.rounds", "1", "--solve.max-iterations", "3")
HASTY = (*QUICK, "--assignment.no-check", "--calibration.start.no-search")


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("filmed") / "scene.mcap"
    command = ["simulate", "gestures", str(path), "--seconds", "4", "--placement", "tnt10", "--camera", "hand-held"]
    assert main([*command, "--initial-pose", "none", "--bystanders", "1"]) == 0
    return path


def test_a_scene_goes_through_all_commands(run: Callable, filmed: Path, tmp_path: Path) -> None:
    told = run("info", filmed)
    assert told.code == 0, told.err
    assert "1 wearer:" in told.out
    assert re.search(r"keypoints: +openpose18 \(18\)", told.out)

    made = tmp_path / "scene.estimate.mcap"
    told = run("smooth", filmed, "--out", made, *QUICK)
    assert told.code == 0, told.err
    assert "VIP, " in told.out
    assert "detections are of wearers" in told.out
    assert told.out.endswith(f"{made}\n")

    told = run("info", made)
    assert told.code == 0, told.err
    assert "method VIP" in told.out

    told = run("evaluate", made, "--truth", filmed, "--json", tmp_path / "e.json")
    assert told.code == 0, told.err
    metrics = json.loads((tmp_path / "e.json").read_text())["metrics"]
    assert metrics["mpjpe"]["value"] < 60.0
    assert metrics["association_precision"]["value"] > 90.0

    told = run("view", filmed, made, "--save", tmp_path / "a.rrd", "--picture", tmp_path / "a.png")
    assert told.code == 0, told.err
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("a.rrd", "a.png"))


def test_findings_are_told_by_their_weight(run: Callable, filmed: Path, tmp_path: Path) -> None:
    scene = read_scene(filmed)
    assert scene.camera is not None
    nobody = scene.camera.detections.select(np.zeros(len(scene.camera.detections), bool))
    write_recording(
        replace(scene, cameras=(replace(scene.camera, detections=nobody, truth=None),)), tmp_path / "empty.mcap"
    )
    told = run("smooth", tmp_path / "empty.mcap", *HASTY)
    assert told.code == 0, told.err
    assert "care: the video is not used: nobody is visible" in told.out
    assert "of the IMUs alone" in told.out


@pytest.mark.parametrize("share", [0.3, 0.8])
def test_a_damaged_scene_is_used_as_far_as_it_goes_or_refused(
    run: Callable, filmed: Path, tmp_path: Path, share: float
) -> None:
    content = filmed.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: int(share * len(content))])
    told = run("smooth", tmp_path / "cut.mcap", *HASTY)
    assert "cut.mcap" in told.err
    assert "cut off at byte" in told.err
    assert "Traceback" not in told.err
    assert told.code in (0, 2)
    assert (tmp_path / "cut.estimate.mcap").exists() == (told.code == 0)


def test_wearers_who_share_no_time_are_refused(run: Callable, filmed: Path, tmp_path: Path) -> None:
    scene = read_scene(filmed)
    first = scene.wearers[0]
    late = {name: replace(stream, time=stream.time + 60.0) for name, stream in first.imus.items()}
    second = replace(first, imus=late, subject=replace(first.subject, name="bob"), truth=None)
    write_recording(Scene("apart", (first, second), (scene.camera,)), tmp_path / "apart.mcap")
    told = run("smooth", tmp_path / "apart.mcap", *HASTY)
    assert told.code == 2
    assert told.err.count("\n") == 1
    assert "'apart'" in told.err
    assert "all wearers have" in told.err
    assert not (tmp_path / "apart.estimate.mcap").exists()
