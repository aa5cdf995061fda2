"""Scenes on the command line: looked at and evaluated."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from scene_sample import Injected, estimate_of, scene_sample

from vip_factors.io.mcap_estimate_writer import write_estimate
from vip_factors.io.mcap_recording import write_recording


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    scene = scene_sample(0.5)
    write_recording(scene, folder / "scene.mcap")
    for name, error in (("vip", Injected(yaw=1.0, apart_m=0.05)), ("other", Injected(heading=0.3))):
        write_estimate(estimate_of(scene, error), folder / f"{name}.mcap")
    bare = replace(scene, truth=None, wearers=tuple(replace(one, truth=None) for one in scene.wearers))
    write_recording(bare, folder / "bare.mcap")
    return folder


def test_evaluate_prints_the_scene_and_writes_json(run: Callable, folder: Path, tmp_path: Path) -> None:
    done = run("evaluate", folder / "vip.mcap", "--truth", folder / "scene.mcap", "--json", tmp_path / "e.json")
    assert done.code == 0, done.err
    for row in ("| camera_translation |", "| association_precision | 100.00 |", "## bob"):
        assert row in done.out
    assert json.loads((tmp_path / "e.json").read_text())["metrics"]["scene_position_error"]["value"] > 1


def test_a_chart_takes_several_estimates_of_one_scene(run: Callable, folder: Path, tmp_path: Path) -> None:
    estimates = (folder / "vip.mcap", folder / "other.mcap")
    done = run("view", folder / "scene.mcap", *estimates, "--chart", tmp_path / "c.png")
    assert done.code == 0, done.err
    assert run("view", folder / "scene.mcap", *estimates, "--save", tmp_path / "a.rrd").code == 2
    done = run("view", folder / "scene.mcap", folder / "bare.mcap", estimates[0], "--chart", tmp_path / "d.png")
    assert "several scenes" in done.err
    done = run("view", folder / "scene.mcap", "--chart", tmp_path / "d.png")
    assert "no estimate" in done.err
