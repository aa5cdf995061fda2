"""What the user can mend ends in one line on stderr and exit code 2; nothing half-written is ever left."""

import os
from pathlib import Path

import pytest
from cli.conftest import assert_one_sentence


@pytest.mark.parametrize("command", ["info", "smooth", "evaluate", "view"])
def test_no_recording(run, tmp_path: Path, command: str) -> None:
    assert_one_sentence(run(command, tmp_path / "none.mcap"), "none.mcap")
    (tmp_path / "a.mcap").write_text("hello")
    assert_one_sentence(run(command, tmp_path / "a.mcap"), "a.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_the_wrong_kind_of_file(run, files, tmp_path: Path) -> None:
    assert_one_sentence(run("smooth", files.estimate), "estimate")
    assert_one_sentence(run("evaluate", files.recording, "--truth", files.recording), "walk.mcap")
    assert_one_sentence(run("view", files.recording, files.recording, "--save", tmp_path / "a.rrd"), "second recording")
    assert_one_sentence(run("info", tmp_path), "folder")
    (tmp_path / "a.docx").write_text("x")
    assert_one_sentence(run("info", tmp_path / "a.docx"), ".mcap")


@pytest.mark.parametrize("option", ["--out", "--json", "--save", "--picture"])
def test_existing_outputs_are_kept(run, files, tmp_path: Path, option: str) -> None:
    suffix = {"--out": ".mcap", "--json": ".json", "--save": ".rrd", "--picture": ".png"}[option]
    precious = tmp_path / f"a{suffix}"
    precious.write_text("precious")
    command = {
        "--out": ("smooth", files.recording),
        "--json": ("evaluate", files.estimate, "--truth", files.recording),
    }.get(option, ("view", files.recording))
    assert_one_sentence(run(*command, option, precious), "exists")
    assert precious.read_text() == "precious"


def test_simulate_and_convert_refuse_before_they_work(run, files, tmp_path: Path) -> None:
    assert_one_sentence(run("simulate", "gestures", files.recording), "exists")
    assert_one_sentence(run("simulate", tmp_path / "none.bvh", tmp_path / "a.mcap"), "none.bvh")
    assert_one_sentence(run("simulate", "gestures", tmp_path / "a.mcap", "--packet-loss", "1.5"), "--packet-loss")
    assert_one_sentence(run("convert", tmp_path / "none", tmp_path / "a.mcap"), "none")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("frame_rte = 30", ("frame_rte", "frame_rate")),
        ("\ufeff[solve]\r\nmax_iteration = 3", ("solve.max_iteration", "did you mean 'max_iterations'")),
        ("frame_rate = 'fast'", ("frame_rate", "expected number")),
        ("solve = 3", ("solve", "table")),
        ("[factors.orientation.loss]\nloss = 'hubber'", ("hubber", "huber")),
        ("frame_rate = ", ("TOML",)),
        ("acceleration = 1", ("acceleration",)),
    ],
)
def test_settings_files_with_mistakes(run, files, tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    settings = tmp_path / "s.toml"
    settings.write_text(text, encoding="utf-8")
    out = tmp_path / "e.mcap"
    assert_one_sentence(run("smooth", files.recording, "--out", out, "--settings", settings), "s.toml", *words)
    assert not out.exists()


def test_settings_that_are_no_file(run, files, tmp_path: Path) -> None:
    smooth = ("smooth", files.recording, "--overwrite")
    assert_one_sentence(run(*smooth, f"--settings={tmp_path / 'none.toml'}"), "none.toml")
    assert_one_sentence(run(*smooth, "--settings", tmp_path), "Is a directory")


def test_a_truncated_recording_gives_what_it_holds_and_says_so(run, files, tmp_path: Path) -> None:
    content = files.recording.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: int(0.6 * len(content))])
    told = run("info", tmp_path / "cut.mcap")
    assert told.code == 0
    assert "left_forearm" in told.out
    assert "vip-factors: note: " in told.err
    assert told.err.count("the file is cut off") == 1
    assert ".py" not in told.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--seconds", "-1"), "--seconds is -1.0: expected a finite number, more than 0"),
        (("--imu-rate", "inf"), "--imu-rate is inf: expected a finite number, more than 0 and 10000 at most"),
        (("--camera", "fixed", "--distance-m", "1e308"), "--distance-m is 1e+308"),
    ],
)
def test_simulate_refuses_numbers_out_of_range(run, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    assert_one_sentence(run("simulate", "gestures", tmp_path / "a.mcap", *words), said)


def test_other_commands_refuse_them_too(run, files, tmp_path: Path) -> None:
    out = tmp_path / "a.mcap"
    assert_one_sentence(run("smooth", files.recording, "--out", out, "--frame-rate", "1e308"), "--frame-rate is 1e+308")
    assert_one_sentence(run("graph", files.recording, "--frame", "-1"), "--frame is -1")
    assert_one_sentence(run("export", files.estimate, tmp_path / "a.bvh", "--frame-rate", "0"), "--frame-rate is 0")
    assert_one_sentence(run("report", files.estimate, "--out", tmp_path / "a\0.html"), "the name of a file")
    assert list(tmp_path.iterdir()) == []


def test_run_looks_at_all_its_words_first(run, files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = ("run", "--log", files.recording, "--out", tmp_path / "made")
    assert_one_sentence(run(*log, "--smooth-options", '"'), "No closing quotation")
    assert_one_sentence(run(*log, "--export", tmp_path / "a.xyz"), "a.xyz", ".bvh")
    assert_one_sentence(run(*log, "--export", files.recording), files.recording.name)
    assert_one_sentence(run(*log, "--out", files.recording), "is a file: expected a folder")
    assert list(tmp_path.iterdir()) == []
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    assert_one_sentence(run("run", "--log", "."), "not a sensor log of a known format")


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
        ("export", estimate, tmp_path / "a.bvh", estimate),
    ):
        assert_one_sentence(run(*words, "--overwrite"), "is an input and would be overwritten: choose another")
    assert_one_sentence(run("export", estimate, tmp_path / "a.bvh", tmp_path / "a.bvh"), "named twice")
    assert {path: path.read_bytes() for path in before} == before
    assert [path.name for path in tmp_path.iterdir()] == ["other.mcap"]


@pytest.mark.parametrize(
    ("command", "option", "name", "suffix"),
    [
        ("smooth", "--out", "a.bvh", ".mcap"),
        ("stream", "--out", "a", ".mcap"),
        ("graph", "--picture", "a.png", ".svg"),
        ("report", "--out", "a.pdf", ".html"),
        ("view", "--picture", "a.mcap", ".png"),
        ("view", "--save", "a.bvh", ".rrd"),
        ("sync", "--out", "a.toml", ".mcap"),
    ],
)
def test_a_suffix_tells_what_is_in_it(run, files, tmp_path: Path, command, option, name, suffix) -> None:
    told = run(command, files.recording, option, tmp_path / name)
    assert_one_sentence(told, name, f"expected a name that ends in {suffix}")
    assert list(tmp_path.iterdir()) == []


def test_devices_and_pipes_are_no_files(run, files, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    for command in ("smooth", "info", "graph", "stream"):
        assert_one_sentence(run(command, tmp_path / "pipe.mcap"), "is a device or a pipe")
    assert_one_sentence(run("graph", tmp_path), "is a folder: expected an MCAP file")
    told = run("smooth", files.recording, "--overwrite", "--out", tmp_path / "pipe.mcap")
    assert_one_sentence(told, "is a device or a pipe: give the name of a file to write")
    assert [path.name for path in tmp_path.iterdir()] == ["pipe.mcap"]
