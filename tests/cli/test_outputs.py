"""What a command writes is named for what it holds, and is never one of its inputs, ``--overwrite`` or not."""

import os
from pathlib import Path

import pytest


def assert_refused(told, *words: str) -> None:
    assert told.code == 2
    assert told.err.count("\n") == 1
    for word in words:
        assert word in told.err


def test_no_input_is_written_over(run, files, tmp_path: Path) -> None:
    before = {path: path.read_bytes() for path in (files.recording, files.estimate)}
    again = tmp_path / "other.mcap"
    again.symlink_to(files.recording)
    recording, estimate = files.recording, files.estimate
    for words in (
        ("smooth", recording, "--out", again),
        ("convert", recording, f"{recording.parent}/./{recording.name}"),
        ("stream", recording, "--out", recording),
        ("simulate", recording, recording),
        ("evaluate", estimate, "--truth", recording, "--json", estimate),
        ("report", estimate, "--recording", recording, "--out", recording),
        ("export", estimate, tmp_path / "a.bvh", estimate),
    ):
        assert_refused(run(*words, "--overwrite"), "is read, and would be written over: choose another name")
    assert {path: path.read_bytes() for path in before} == before
    assert [path.name for path in tmp_path.iterdir()] == ["other.mcap"]


def test_two_outputs_have_two_names(run, files, tmp_path: Path) -> None:
    picture = tmp_path / "a.png"
    assert_refused(run("view", files.estimate, "--picture", picture, "--chart", picture), "named twice")
    assert_refused(run("export", files.estimate, tmp_path / "a.bvh", tmp_path / "a.bvh"), "named twice")


@pytest.mark.parametrize(
    ("command", "option", "name", "suffix"),
    [
        ("smooth", "--out", "a.bvh", ".mcap"),
        ("stream", "--out", "a", ".mcap"),
        ("graph", "--picture", "a.png", ".svg"),
        ("view", "--picture", "a.mcap", ".png"),
        ("view", "--save", "a.bvh", ".rrd"),
        ("sync", "--out", "a.toml", ".mcap"),
    ],
)
def test_a_suffix_tells_what_is_in_it(run, files, tmp_path: Path, command, option, name, suffix) -> None:
    told = run(command, files.recording, option, tmp_path / name)
    assert_refused(told, name, f"expected a name that ends in {suffix}")
    assert list(tmp_path.iterdir()) == []


def test_devices_and_pipes_are_no_files(run, files, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    for command in ("smooth", "info", "graph", "stream"):
        assert_refused(run(command, tmp_path / "pipe.mcap"), "is a device or a pipe")
    assert_refused(run("graph", tmp_path), "is a folder: expected an MCAP file")
    told = run("smooth", files.recording, "--overwrite", "--out", tmp_path / "pipe.mcap")
    assert_refused(told, "is a device or a pipe: give the name of a file to write")
    assert [path.name for path in tmp_path.iterdir()] == ["pipe.mcap"]
