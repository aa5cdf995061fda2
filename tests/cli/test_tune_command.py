from pathlib import Path

from vip_factors.cli.settings_file import read_settings
from vip_factors.settings import Settings

ONE = ["--parameters", "factors.orientation.sigma-deg:3:6:log", "--frame-rate", "10"]


def test_tuning_writes_settings_that_smooth_takes(run, files, tmp_path: Path) -> None:
    study, out = tmp_path / "study.log", tmp_path / "tuned.toml"
    told = run("tune", files.recording, "--study", study, "--out", out, "--trials", "1", *ONE)
    assert told.code == 0, told.err
    assert "one recording judges itself" in told.out
    assert 3 <= read_settings(out, Settings()).factors.orientation.sigma_deg <= 6
    text = out.read_text(encoding="utf-8")
    assert files.recording.name in text
    assert "mpjpe at 10 Hz" in text
    again = run("tune", files.recording, "--study", study, "--out", out, "--trials", "1", "--overwrite", *ONE)
    assert again.out == told.out  # nothing left to try


def test_what_cannot_be_tuned_on_is_refused(run, files, tmp_path: Path) -> None:
    out = ["--study", tmp_path / "s.log", "--out", tmp_path / "t.toml"]
    assert "no recording" in run("tune", *out).err
    assert "did you mean" in run("tune", files.recording, *out, "--parameters", "factors.orientation.sigma:1:2").err
    assert "given twice" in run("tune", files.recording, *out, "--parameters", *[ONE[1]] * 2).err
    assert not (tmp_path / "s.log").exists()
