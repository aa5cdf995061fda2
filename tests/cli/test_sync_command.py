"""The command finds a scene's offset and writes it, or says that it cannot."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.sensors.calibration import preset
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings

OFFSET = 0.634


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    motion = gestures(12.0)
    settings = SceneSettings.noise_free(camera="fixed", time_offset_s=OFFSET)
    scene = simulate_scene([Performer("a", motion, preset("sip6", motion.skeleton))], settings)
    path = tmp_path_factory.mktemp("sync") / "scene.mcap"
    write_recording(scene, path)
    return path


def test_the_offset_is_found_and_written(run, filmed: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    told = run("sync", filmed, "--out", out, "--max-offset", "2")
    assert told.code == 0, told.err
    assert "motion" in told.out
    assert "ms" in told.out
    before, after = read_scene(filmed), read_scene(out)
    assert after.camera.clock.offset == pytest.approx(OFFSET, abs=0.005)
    np.testing.assert_array_equal(after.camera.detections.pixels, before.camera.detections.pixels)
    np.testing.assert_array_equal(after.camera.detections.time, before.camera.detections.time)
    assert after.wearers[0].imus.keys() == before.wearers[0].imus.keys()


def test_a_known_offset_is_written_as_it_is(run, filmed: Path, tmp_path: Path) -> None:
    assert run("sync", filmed, "--out", tmp_path / "a.mcap", "--seconds", "-1.5").code == 0
    assert read_scene(tmp_path / "a.mcap").camera.clock.offset == -1.5


def test_dry_runs_write_nothing(run, filmed: Path) -> None:
    told = run("sync", filmed, "--dry-run", "--max-offset", "2")
    assert told.code == 0
    assert "agreement" in told.out
    assert [path.name for path in filmed.parent.iterdir()] == ["scene.mcap"]


def test_what_cannot_be_known_is_not_written(run, files, filmed: Path, tmp_path: Path) -> None:
    scene = read_scene(filmed)
    still = np.repeat(scene.camera.detections.pixels[:1], len(scene.camera.detections), axis=0)
    frozen = replace(scene.camera, detections=replace(scene.camera.detections, pixels=still))
    write_recording(replace(scene, cameras=(frozen,)), tmp_path / "still.mcap")
    told = run("sync", tmp_path / "still.mcap")
    assert told.code == 2
    assert "undetermined" in told.err
    assert "--seconds" in told.err
    assert "no camera" in run("sync", files.recording, "--out", tmp_path / "b.mcap").err
    assert [path.name for path in tmp_path.iterdir()] == ["still.mcap"]
