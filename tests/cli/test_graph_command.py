"""The factor graph of a small recording, drawn from the command line."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from vip_factors.cli.main import main

TIMES = "\N{MULTIPLICATION SIGN}"
SMALL = ("--frame-rate", "20", "--solve.max-iterations", "3")
needs_graphviz = pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wearer of six sensors before a camera that stands."""
    path = tmp_path_factory.mktemp("graph") / 'a "scene".mcap'
    simulate = ("simulate", "gestures", str(path), "--seconds", "1", "--placement", "sip6", "--camera", "fixed")
    assert main([*simulate, "--seed", "1"]) == 0
    return path


def path_with(folder: Path, script: str | None) -> str:
    """A search path on which ``dot`` is a script, or missing."""
    folder.mkdir()
    if script is not None:
        program = folder / "dot"
        program.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
        program.chmod(0o755)
    return str(folder)


@pytest.mark.parametrize("script", [None, "exit 1"], ids=["missing", "failing"])
def test_without_graphviz_the_graph_is_written_for_it(
    run: Callable, filmed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str | None
) -> None:
    monkeypatch.setenv("PATH", path_with(tmp_path / "bin", script))
    told = run("graph", filmed, "--picture", tmp_path / "graph.svg", "--frame", "4", *SMALL)
    assert told.code == 0, told.err
    graph = tmp_path / "graph.dot"
    assert told.out.splitlines()[-1] == str(graph)
    assert f"dot -Tsvg -O {graph}" in told.err
    assert not (tmp_path / "graph.svg").exists()
    text = graph.read_text(encoding="utf-8")
    number = {label: name for name, label in re.findall(r'(\w+)\[.*label="(.*?)"\];', text) if "subgraph" not in name}
    edges = {frozenset(ends) for ends in re.findall(r"(\w+)--(\w+)\[", text)}
    # What an acceleration sees: rotations and roots of three frames, headings, and the places of sensors.
    for label, nodes in (
        (f"acceleration {TIMES} 5", 3 + 3 + 2),
        (f"heading prior {TIMES} 6", 1),
    ):
        assert sum(number[label] in ends for ends in edges) == nodes
    assert {"frame 4", "frame 5", "frame 6"} <= set(re.findall(r"frame \d+", text))


def test_each_of_two_cameras_has_variables_of_its_own(run: Callable, tmp_path: Path) -> None:
    scene = tmp_path / "two.mcap"
    words = ("--camera", "fixed", "--cameras", "2", "--no-calibrated", "--seconds", "1", "--placement", "sip6")
    assert run("simulate", "gestures", scene, *words).code == 0
    told = run("graph", scene, *SMALL)
    assert told.code == 0, told.err
    text = Path(told.out.splitlines()[-1]).read_text(encoding="utf-8")
    for kind in ("camera pose", "focal length", "clock offset", "clock drift", "lens prior", "reprojection"):
        for number in (1, 2):
            assert f"{kind}, camera {number}" in text


@needs_graphviz
def test_picture_and_table_of_a_scene(run: Callable, filmed: Path, tmp_path: Path) -> None:
    picture = tmp_path / "graph.svg"
    told = run("graph", filmed, "--picture", picture, *SMALL)
    assert told.code == 0, told.err
    lines = told.out.splitlines()
    assert lines[-1] == str(picture)
    counts = dict(line.strip().rsplit(maxsplit=1) for line in lines if line.startswith("  "))
    frames = int(lines[0].split()[0])
    assert int(counts["joint rotation"]) == 24 * frames
    assert (counts["heading"], counts["camera pose"]) == ("6", "1")
    assert int(counts["smoothness"]) == frames - 1
    assert int(counts["reprojection"]) > frames
    texts = {element.text for element in ElementTree.parse(picture).iter() if element.tag.endswith("text")}
    assert {
        'Factor graph of a "scene"',
        "joint rotation",
        "camera pose",
        f"joint limit {TIMES} 23",
        "smoothness",
    } <= texts
    assert [path.name for path in tmp_path.iterdir()] == ["graph.svg"]


def test_a_frame_that_there_is_not_leaves_the_picture_as_it_was(run: Callable, filmed: Path, tmp_path: Path) -> None:
    existing = tmp_path / "a.svg"
    existing.write_text("mine", encoding="utf-8")
    told = run("graph", filmed, "--picture", existing, "--overwrite", "--frame", "10000", *SMALL)
    assert told.code == 2
    assert "frame 10000" in told.err
    assert existing.read_text(encoding="utf-8") == "mine"
