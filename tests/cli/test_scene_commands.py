"""Scenes on the command line: looked at and evaluated."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from scene_sample import Injected, estimate_of, scene_sample

from vip_factors.io.mcap_estimate import write_estimate
from vip_factors.io.mcap_recording import write_recording


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    scene = scene_sample(0.5)
    write_recording(scene, folder / "scene.mcap")
    write_estimate(estimate_of(scene, Injected(yaw=1.0, apart_m=0.05)), folder / "vip.mcap")
    return folder


def test_evaluate_prints_the_scene_and_writes_json(run: Callable, folder: Path, tmp_path: Path) -> None:
    done = run("evaluate", folder / "vip.mcap", "--truth", folder / "scene.mcap", "--json", tmp_path / "e.json")
    assert done.code == 0, done.err
    for row in ("| camera_translation |", "| association_precision | 100.00 |", "## bob"):
        assert row in done.out
    assert json.loads((tmp_path / "e.json").read_text())["metrics"]["scene_position_error"]["value"] > 1
