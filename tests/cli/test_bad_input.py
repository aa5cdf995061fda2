"""What the user can mend ends in one line on stderr and exit code 2; nothing half-written is ever left."""

from pathlib import Path

import pytest

from vip_factors.cli.main import main


def assert_one_sentence(told, *words: str) -> None:
    assert told.code == 2
    assert told.err.startswith("vip-factors: ")
    assert told.err.count("\n") == 1
    assert "Traceback" not in told.err
    for word in words:
        assert word in told.err


@pytest.mark.parametrize("command", ["info", "smooth", "evaluate", "view"])
def test_missing_file(run, tmp_path: Path, command: str) -> None:
    assert_one_sentence(run(command, tmp_path / "none.mcap"), "none.mcap")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["info", "smooth", "evaluate", "view"])
def test_not_an_mcap(run, tmp_path: Path, command: str) -> None:
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


def test_missing_settings_file(run, files, tmp_path: Path) -> None:
    assert_one_sentence(run("smooth", files.recording, f"--settings={tmp_path / 'none.toml'}"), "none.toml")


def test_ctrl_c_leaves_nothing_half_written(run, files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("vip_factors.io.mcap_writer.MessageWriter.add_in_order", interrupted)
    told = run(
        "smooth", files.recording, "--out", tmp_path / "e.mcap", "--frame-rate", "5", "--solve.max-iterations", "1"
    )
    assert told.code == 130
    assert told.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []

    monkeypatch.setattr("vip_factors.viz.rerun_view.log_skin", interrupted)
    assert run("view", files.estimate, "--save", tmp_path / "a.rrd").code == 130
    assert list(tmp_path.iterdir()) == []


def test_what_is_unforeseen_keeps_its_traceback(files, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a bug of ours")

    monkeypatch.setattr("vip_factors.describe.recordings.recording_tables", broken)
    with pytest.raises(ZeroDivisionError):
        main(["info", str(files.recording)])


def test_a_truncated_recording_gives_what_it_holds_and_says_so(run, files, tmp_path: Path) -> None:
    content = files.recording.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: int(0.6 * len(content))])
    told = run("info", tmp_path / "cut.mcap")
    assert told.code == 0
    assert "left_forearm" in told.out
    assert "vip-factors: note: " in told.err
    assert ".py" not in told.err
