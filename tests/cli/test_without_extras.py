"""Without the extras every command that needs one says how to install it, before it works and before it fetches."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from vip_factors.detect import models

EXTRAS = (
    "ai_edge_litert",
    "av",
    "distributed",
    "ezc3d",
    "onnxruntime",
    "pygltflib",
    "pythonosc",
    "upath",
    "websockets",
)

# Modules that are imported only with an extra, and import it at once.
NEEDING = tuple(f"vip_factors.io.{name}" for name in ("live_network", "live_server"))


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after ``pip install .``: none of the extras' packages can be imported."""
    for name in [*EXTRAS, *(name for name in sys.modules if name.partition(".")[0] in EXTRAS)]:
        monkeypatch.setitem(sys.modules, name, None)
    for name in NEEDING:
        monkeypatch.delitem(sys.modules, name, raising=False)


def unasked(source: Path | None, tell: Callable[[str], None]) -> None:
    raise AssertionError("models were fetched for a library that is not there")


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        ("detect VIDEO", "detect"),
        ("detect VIDEO --model MODEL", "detect"),
        ("run --video VIDEO --camera camera.toml --log RECORDING --out OUT", "detect"),
        ("run --log RECORDING --out OUT --export walk.c3d", "export"),
        ("export none.mcap walk.c3d", "export"),
        ("export none.mcap walk.bvh walk.glb", "export"),
        ("report none.mcap --video", "film"),
        ("stream ws://127.0.0.1:0", "live"),
        ("stream RECORDING --vmc 127.0.0.1:39539", "live"),
        ("stream RECORDING --web 8080", "live"),
        ("smooth RECORDING --cluster tcp://127.0.0.1:1 --summary all.csv --out OUT", "cluster"),
        ("smooth s3://lab/walk.mcap", "cluster"),
    ],
)
def test_the_extra_is_named(
    words: str, extra: str, run: Callable, files: object, bare: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(models, "blazepose_files", unasked)
    for name in ("walk.mp4", "pose.onnx"):
        Path(name).write_bytes(b"none")
    named = {"VIDEO": "walk.mp4", "MODEL": "pose.onnx", "RECORDING": files.recording, "OUT": tmp_path / "out"}
    told = run(*(named.get(word, word) for word in words.split()))
    assert told.code == 2
    assert f"pip install 'vip-factors[{extra}]'" in told.err
    assert ".part" not in told.err, "the temporary name is not the user's"
    made = {path.name for path in tmp_path.iterdir()} - {"walk.mp4", "pose.onnx", "out"}
    assert not made
