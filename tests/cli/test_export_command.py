"""``vip-factors export``: every format by its suffix, and the sentences for what it cannot do."""

from collections.abc import Callable
from pathlib import Path

import pytest
from scene_sample import estimate_of, scene_sample

from vip_factors.io.mcap_estimate import write_estimate
from vip_factors.io.mcap_recording import write_recording
from vip_factors.io.motions.files import read_bvh


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a recording and its estimate."""
    folder, scene = tmp_path_factory.mktemp("export"), scene_sample(0.2)
    write_recording(scene, folder / "scene.mcap")
    write_estimate(estimate_of(scene), folder / "scene.estimate.mcap")
    return folder


def test_the_suffix_tells_the_format(run: Callable, folder: Path, tmp_path: Path) -> None:
    files = [tmp_path / f"walk{suffix}" for suffix in (".bvh", ".glb", ".npz", ".pkl")]
    done = run("export", folder / "scene.estimate.mcap", *files, "--recording", folder / "scene.mcap")
    assert done.code == 0, done.err
    names = ["walk.ann.bvh", "walk.bob.bvh", "walk.glb", "walk.ann.npz", "walk.bob.npz", "walk.pkl"]
    assert done.out.splitlines() == [str(tmp_path / name) for name in names]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


def test_options_reach_the_file(run: Callable, folder: Path, tmp_path: Path) -> None:
    options = ["--wearer", "bob", "--frame-rate", 30, "--bone-names", "humanik", "--bvh.up", "z", "--bvh.unit", "cm"]
    done = run("export", folder / "scene.estimate.mcap", tmp_path / "bob.bvh", *options)
    assert done.code == 0, done.err
    text = (tmp_path / "bob.bvh").read_text()
    assert "ROOT Hips" in text
    assert "Frames: 7" in text
    motion = read_bvh(tmp_path / "bob.bvh")
    assert motion.rate == 30
    assert 0.7 < motion.p_world_pelvis[0, 2] < 1.1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["a.doc"], ".bvh, .glb"),
        ([], "at least one file to write"),
        (["a.bvh", "--wearer", "eve"], "ann, bob"),
        (["a.bvh", "--frame-rate", "-1"], "more than 0"),
        (["a.pkl", "--recording", "none.mcap"], "none.mcap"),
        (["nowhere/a.glb"], "nowhere"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_line(
    words: list[str], told: str, run: Callable, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run("export", folder / "scene.estimate.mcap", *words)
    assert done.code == 2
    assert told in done.err
    assert len(done.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
