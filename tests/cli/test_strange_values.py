"""Numbers, names and settings files as nobody means them: told before any work."""

from pathlib import Path

import pytest


def assert_one_sentence(told, *words: str) -> None:
    assert told.code == 2
    assert told.err.count("\n") == 1
    for word in words:
        assert word in told.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--seed", "-1"), "--seed is -1: expected a finite number, 0 or more"),
        (("--seconds", "-1"), "--seconds is -1.0: expected a finite number, more than 0"),
        (("--seconds", "1e308"), "86400 at most"),
        (("--imu-rate", "1e308"), "10000 at most"),
        (("--camera", "fixed", "--video-rate", "1e308"), "--video-rate is 1e+308"),
        (("--camera", "fixed", "--distance-m", "1e308"), "--distance-m is 1e+308"),
    ],
)
def test_simulate(run, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    assert_one_sentence(run("simulate", "gestures", tmp_path / "a.mcap", *words), said)


def test_other_commands(run, files, tmp_path: Path) -> None:
    out = tmp_path / "a.mcap"
    assert_one_sentence(run("smooth", files.recording, "--out", out, "--frame-rate", "1e308"), "--frame-rate is 1e+308")
    assert_one_sentence(run("view", files.estimate, "--serve", "--port", "65535"), "65534 at most")
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


def test_a_folder_is_no_settings_file(run, files, tmp_path: Path) -> None:
    assert_one_sentence(run("smooth", files.recording, "--overwrite", "--settings", tmp_path), "Is a directory")
