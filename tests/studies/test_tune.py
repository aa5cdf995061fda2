"""Tuning continues where it stopped, and a recording never judges its own settings."""

import tomllib
from pathlib import Path

import pytest

from tests.studies.__main__ import main
from tests.studies.tune import PARAMETERS, Parameter, Trial, best, changed, leave_one_out, parsed, search, value_of
from vip_factors.cli.main import main as vip_factors
from vip_factors.cli.options import read_settings
from vip_factors.errors import InputError, SolveError
from vip_factors.settings import Settings

SIGMA = Parameter("factors.orientation.sigma_deg", 2.0, 10.0)
BEFORE = {SIGMA.name: 4.0}


def test_parameters_are_settings_by_name() -> None:
    assert parsed("factors.orientation.sigma-deg:2:10:log") == SIGMA
    assert parsed("factors.smoothness.time:0:1") == Parameter("factors.smoothness.time", 0.0, 1.0, log=False)
    settings = changed(Settings(), {SIGMA.name: 5.5, "solve.max_iterations": 7.2})
    assert (settings.factors.orientation.sigma_deg, settings.solve.max_iterations) == (5.5, 7)
    assert all(one.low < value_of(Settings(), one.name) < one.high for one in PARAMETERS)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("factors.orientation.sigma:2:10", "unknown setting"),
        ("factors.orientation.sigma_deg:2", "NAME:LOW:HIGH"),
        ("factors.orientation.sigma_deg:2:ten", "with numbers"),
        ("factors.orientation.sigma_deg:5:2", "growing"),
        ("factors.orientation.sigma_deg:0:2:log", "above 0"),
        ("fusion.use_camera:0:1", "is a number"),
    ],
)
def test_what_is_no_parameter_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parsed(text)


def test_a_left_out_recording_has_no_say_in_its_settings() -> None:
    trials = [
        Trial(0, {}, {"a": 10.0, "b": 10.0, "c": 10.0}),
        Trial(1, {}, {"a": 1.0, "b": 11.0, "c": 12.0}),  # very good for a alone
        Trial(2, {}, {"a": 12.0, "b": 8.0, "c": 8.0}),
    ]
    assert best(trials).number == 1
    judged = {one.name: one for one in leave_one_out(trials)}
    assert (judged["a"].trial, judged["a"].left_out, judged["a"].tuned_on_all) == (2, 12.0, 1.0)
    assert (judged["b"].trial, judged["b"].left_out) == (1, 11.0)


def test_a_search_continues_after_an_interrupt(tmp_path: Path) -> None:
    calls: list[float] = []

    def quadratic(values: dict[str, float]) -> dict[str, float]:
        """Errors that are least at 6 and 7 degrees; some values cannot be solved, the fourth trial is interrupted."""
        calls.append(values[SIGMA.name])
        if len(calls) == 3:
            raise SolveError("not determined")
        if len(calls) == 4:
            raise KeyboardInterrupt
        return {name: 10.0 + (values[SIGMA.name] - least) ** 2 for name, least in (("a", 6.0), ("b", 7.0))}

    journal = tmp_path / "study.log"
    with pytest.raises(KeyboardInterrupt):
        list(search(journal, (SIGMA,), BEFORE, quadratic, 6))
    trials = list(search(journal, (SIGMA,), BEFORE, quadratic, 6))
    assert [trial.values[SIGMA.name] for trial in trials] == [4.0, calls[1], *calls[4:]]
    assert len(trials) == 6  # the settings as they were, and six of which one failed
    assert best(trials) is not trials[0]
    assert list(search(journal, (SIGMA,), BEFORE, pytest.fail, 6)) == trials
    with pytest.raises(InputError, match="of another task"):
        list(search(journal, (SIGMA,), {SIGMA.name: 5.0}, quadratic, 6))


def test_the_result_is_a_settings_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recordings = [tmp_path / "walk.mcap", tmp_path / "run.mcap"]
    for seed, recording in enumerate(recordings):
        simulate = ["simulate", "gestures", str(recording), "--seconds", "2", "--placement", "sip6"]
        assert vip_factors([*simulate, "--seed", str(seed)]) == 0
    out = tmp_path / "tuned.toml"
    words = ["--parameters", "factors.orientation.sigma-deg:3:6:log", "--frame-rate", "10", "--trials", "1"]
    files = ["--journal", str(tmp_path / "study.log"), "--out", str(out)]
    assert main(["tune", *map(str, recordings), *words, *files]) == 0
    assert "left out of the tuning" in capsys.readouterr().out
    text = out.read_text(encoding="utf-8")
    assert 3 <= read_settings(out, Settings()).factors.orientation.sigma_deg <= 6
    assert list(tomllib.loads(text)) == ["factors"]
    assert "mpjpe at 10 Hz of walk.mcap, run.mcap" in text
