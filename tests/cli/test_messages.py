"""What commands say: in the words of the command line, once, and what may be done next."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli.conftest import assert_one_sentence

from vip_factors.cli.main import main
from vip_factors.describe.recordings import path_text
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.sensors.calibration import Placement


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("smooth", "a.mcap", "--frame-rate", "fast"), "--frame-rate: could not convert string to float: 'fast'"),
        (("smooth", "a.mcap", "--fail-on", "nver"), "Expected one of ('never', 'care', 'doubt')"),
        (("smooth", "a.mcap", "--frame-rat", "3"), "Unrecognized options: --frame-rat, 3"),
        (("smooth", "a.mcap", "--windows.window-s", "3"), "windows.window_s is 3: expected 2 times windows.overlap_s"),
        (("report",), "Missing from vip-factors report:"),
        (("smoth",), "Unrecognized options: smoth"),
        ((), "Missing subcommand"),
    ],
)
def test_words_that_do_not_fit_are_told(run, words: tuple[str, ...], told: str) -> None:
    outcome = run(*words)
    assert outcome.code == 2
    assert told in " ".join(line.strip("│ ") for line in outcome.err.splitlines())
    assert "Traceback" not in outcome.err


def test_sentences_name_options_and_no_functions(run, files, tmp_path: Path) -> None:
    assert_one_sentence(run("smooth", files.recording), "--overwrite")
    assert_one_sentence(
        run("smooth", files.recording, "--overwrite", "--calibration-rate=-1"), "--calibration-rate is -1"
    )
    assert_one_sentence(run("evaluate", files.estimate), "--truth")
    assert_one_sentence(run("evaluate", files.recording), "holds no estimate")
    for told in (run("evaluate", files.estimate), run("smooth", files.estimate, "--out", tmp_path / "e.mcap")):
        assert_one_sentence(told)
        assert not re.search(r"\((read|smooth|write)_", told.err)


def test_a_true_motion_may_be_compared_with(run, files, tmp_path: Path) -> None:
    assert run("export", files.estimate, tmp_path / "found.bvh", "--no-plant-feet").code == 0
    told = run("evaluate", files.estimate, "--truth", tmp_path / "found.bvh")
    assert told.code == 0
    assert re.search(r"positions +0\.\d+ mm", told.out)


def test_the_truth_of_another_recording_is_doubted(run, files, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    assert run("simulate", "gestures", other, "--seconds", "3", "--placement", "tnt10").code == 0
    told = run("evaluate", files.estimate, "--truth", other)
    assert told.code == 0
    assert "is this the truth of the same recording? the estimate is of 'walk', the truth of 'other'" in told.err
    assert run("evaluate", files.estimate, "--truth", files.recording).err == ""


def test_a_stream_of_sensors_nowhere_says_what_to_do(run, files, tmp_path: Path) -> None:
    nowhere = tmp_path / "nowhere.mcap"
    recording = read_scene(files.recording).wearers[0]
    write_recording(replace(recording, placement=Placement()), nowhere)
    for command in ("stream", "smooth"):
        assert_one_sentence(run(command, nowhere), "is placed on the body: say where they sit", "--placement")


def test_a_camera_that_trembles_stands() -> None:
    trembling = np.array([1.0, 2.0, 1.5]) + 0.01 * np.random.default_rng(0).normal(size=(300, 3))
    assert path_text(trembling).startswith("stood at 1.00, 2.00, 1.50 m, within ")
    walked = np.stack([np.linspace(0, 3, 300), np.zeros(300), np.ones(300)], axis=1)
    assert path_text(walked) == "3.00 m in 300 poses"


def test_streams_have_no_settings_that_they_cannot_honour(run, files, tmp_path: Path) -> None:
    names = ("--windows.", "--solver", "--covariance", "--accelerometers.", "--sensor-clocks.", "--assignment.")
    text = run("stream", "--help").out
    assert not [name for name in names if re.search(rf"{name}(?!-)", text)]
    refused = run("stream", files.recording, "--windows.above-s", "10")
    assert refused.code == 2
    assert "--windows.above-s" in refused.err
    file = tmp_path / "earlier.toml"
    file.write_text("[windows]\nabove_s = 10.0\n", encoding="utf-8")
    assert_one_sentence(run("stream", files.recording, "--settings", file), "unknown setting 'windows'")


def test_what_users_read_speaks_of_motion_not_of_the_solver(run, files, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert run("report", files.estimate, "--recording", files.recording, "--out", page).code == 0
    visible = re.sub(r"(?s)<(script|style).*?</\1>|<[^>]+>", " ", page.read_text(encoding="utf-8"))
    words = r"(?i)(?<![\w.-])(costs?|iterations?|converge\w*|residuals?|marginals?|chi2|jacobian\w*|nats)\b"
    smoothed = run("smooth", files.recording, "--out", tmp_path / "again.mcap", "--frame-rate", "5")
    told = run("info", files.estimate)
    for text in (visible, smoothed.out, told.out, run("evaluate", files.estimate, "--truth", files.recording).out):
        assert re.findall(words, text) == []
    assert "computed in: " in told.out
    assert re.search(r"time +steps +cost\n", run("info", files.estimate, "--verbose").out)


def test_smooth_says_what_to_do_next_to_a_person_alone(
    files, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["smooth", str(files.recording), "--frame-rate", "5", "--solve.max-iterations", "1", "--out"]
    assert main([*command, str(tmp_path / "a.mcap")]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path / "a.mcap")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert main([*command, str(tmp_path / "an estimate.mcap")]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith(f"next: vip-factors view '{tmp_path}/an estimate.mcap' ")
    assert "vip-factors report " in last
    assert "vip-factors export " in last
