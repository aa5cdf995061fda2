"""Parameters are found by name, studies go on where they stopped, and a recording never judges its own settings."""

import contextlib
import re
import sqlite3
import tomllib
from pathlib import Path

import pytest

from vip_factors.cli.settings_file import read_settings
from vip_factors.errors import InputError, SolveError
from vip_factors.settings import Settings
from vip_factors.tune.parameters import DEFAULT_PARAMETERS, Parameter, changed, parsed, value_of
from vip_factors.tune.study import Study, Task, Trial, best, leave_one_out, loss, report_lines, settings_text, verdict

SIGMA = Parameter("factors.orientation.sigma_deg", 2.0, 10.0)
TASK = Task(("a", "b"), (SIGMA,), {SIGMA.name: 4.0}, "mpjpe at 60 Hz")


def test_parameters_are_settings_by_name() -> None:
    assert parsed("factors.orientation.sigma-deg:2:10:log") == SIGMA
    assert parsed("factors.smoothness.time:0:1") == Parameter("factors.smoothness.time", 0.0, 1.0, log=False)
    settings = changed(Settings(), {SIGMA.name: 5.5, "solve.max_iterations": 7.2})
    assert settings.factors.orientation.sigma_deg == 5.5
    assert settings.solve.max_iterations == 7
    assert changed(settings, {SIGMA.name: 4.0, "solve.max_iterations": Settings().solve.max_iterations}) == Settings()


@pytest.mark.parametrize("parameter", DEFAULT_PARAMETERS, ids=lambda one: one.name)
def test_the_usual_parameters_lie_within_their_bounds(parameter: Parameter) -> None:
    assert parameter.low < value_of(Settings(), parameter.name) < parameter.high


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("factors.orientation.sigma", "did you mean factors.orientation.sigma_deg"),
        ("factors.orientation.sigma_deg:2", "NAME:LOW:HIGH"),
        ("factors.orientation.sigma_deg:2:ten", "numbers for 2 and ten"),
        ("factors.orientation.sigma_deg:5:2", "growing"),
        ("factors.orientation.sigma_deg:0:2:log", "above 0"),
        ("fusion.use_camera:0:1", "is a number"),
        ("factors.orientation:0:1", "is a number"),
    ],
)
def test_what_is_no_parameter_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parsed(text if ":" in text else f"{text}:1:2")


def test_a_left_out_recording_has_no_say_in_its_settings() -> None:
    before = {"a": 10.0, "b": 10.0, "c": 10.0}
    trials = [
        Trial(0, {}, before),
        Trial(1, {}, {"a": 1.0, "b": 11.0, "c": 12.0}),  # very good for a alone
        Trial(2, {}, {"a": 12.0, "b": 8.0, "c": 8.0}),
    ]
    assert best(trials, before).number == 1
    judged = {one.name: one for one in leave_one_out(trials, before)}
    assert (judged["a"].chosen, judged["a"].after, judged["a"].fitted) == (2, 12.0, 1.0)
    assert (judged["b"].chosen, judged["b"].after) == (1, 11.0)
    assert "keep the settings as they are" in verdict(list(judged.values()))
    assert loss(before, before) == 1.0
    assert best(trials[:1] * 2, before) is trials[0]


def quadratic(name: str, values: dict[str, float]) -> float:
    """Errors that are least at 6 degrees for one and 7 for the other."""
    return 10.0 + (values[SIGMA.name] - {"a": 6.0, "b": 7.0}[name]) ** 2


def test_a_study_goes_on_after_an_interrupt(tmp_path: Path) -> None:
    calls: list[float] = []

    def interrupted(name: str, values: dict[str, float]) -> float:
        calls.append(values[SIGMA.name])
        if len(calls) == 10:  # the settings as they are, three trials, and half of a fourth
            raise KeyboardInterrupt
        return quadratic(name, values)

    with pytest.raises(KeyboardInterrupt):
        Study(tmp_path / "s.log", TASK).run(5, interrupted)
    again = Study(tmp_path / "s.log", TASK)
    kept = again.trials
    assert [trial.values for trial in kept] == [{SIGMA.name: value} for value in calls[:8:2]]
    again.run(5, quadratic)
    assert again.trials[: len(kept)] == kept
    assert len(again.trials) == 6  # the settings as they were, and five
    again.run(5, lambda *_: pytest.fail("there is nothing left to do"))
    chosen = best(again.trials, again.before)
    assert loss(chosen.errors, again.before) < 1.0
    assert len({trial.values[SIGMA.name] for trial in again.trials}) == 6


def test_settings_that_cannot_be_solved_are_a_failed_trial(tmp_path: Path) -> None:
    def failing(name: str, values: dict[str, float]) -> float:
        if values[SIGMA.name] != 4.0:
            raise SolveError("not determined")
        return 10.0

    study = Study(tmp_path / "s.log", TASK)
    study.run(3, failing)
    assert [trial.number for trial in study.trials] == [0]


def test_a_study_of_something_else_is_not_continued(tmp_path: Path) -> None:
    Study(tmp_path / "s.db", TASK)
    with pytest.raises(InputError, match="other recordings"):
        Study(tmp_path / "s.db", Task(("a", "c"), TASK.parameters, TASK.untouched, TASK.about))
    with pytest.raises(InputError, match="other measured"):
        Study(tmp_path / "s.db", Task(TASK.recordings, TASK.parameters, TASK.untouched, "mpjpe at 20 Hz"))
    for name in ("no.db", "no.log"):
        (tmp_path / name).write_text("this is no study, but a text that is long enough to be taken for one\n" * 20)
        with pytest.raises(InputError, match="as a study"):
            Study(tmp_path / name, TASK)


def test_what_was_found_is_a_settings_file_that_says_where_it_comes_from(tmp_path: Path) -> None:
    before = {"walk.mcap": 20.0, "run.mcap": 40.0}
    trials = [
        Trial(0, {SIGMA.name: 4.0, "frame_rate": 60.0}, before),
        Trial(1, {SIGMA.name: 5.25, "frame_rate": 50.0}, {"walk.mcap": 19.0, "run.mcap": 36.0}),
    ]
    parameters = (SIGMA, Parameter("frame_rate", 20.0, 60.0))
    lines = report_lines(trials, parameters, before, "mm")
    text = settings_text(trials[1], ["of two recordings", "", *lines])
    (tmp_path / "tuned.toml").write_text(text, encoding="utf-8")
    settings = read_settings(tmp_path / "tuned.toml", Settings())
    assert settings == changed(Settings(), trials[1].values)
    assert tomllib.loads(text)["frame_rate"] == 50
    comments = [line for line in text.splitlines() if line.startswith("#")]
    for words in ("walk.mcap", "1 trials on 2 recordings", "0.925 times", "left out"):
        assert any(words in line for line in comments), words
    assert any(
        "one recording judges itself" in line
        for line in report_lines([Trial(0, trials[0].values, {"a": 1.0})], parameters, {"a": 1.0}, "mm")
    )


def test_a_damaged_study_is_refused_with_the_line(tmp_path: Path) -> None:
    path, one = tmp_path / "study.log", DEFAULT_PARAMETERS[0]
    task = Task(("a.mcap",), (one,), {one.name: one.low})
    Study(path, task).run(1, lambda name, values: values[one.name])
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    path.write_bytes(whole[:-9])  # killed while it wrote
    with pytest.raises(InputError, match=rf"study\.log: .*line {len(lines)} is cut off .* delete that line"):
        Study(path, task)
    path.write_bytes(b"".join(lines[:-1]))  # as it says
    Study(path, task).run(1, lambda name, values: values[one.name])
    for damaged in (
        whole.replace(b'"study_id":0', b'"study_id":{}'),
        whole.replace(b'"op_code":0', b'"op_code":99'),
        whole.replace(b'"errors":{', b'"errors":1,"other":{'),
        whole.replace(b'"errors"', b'"others"'),
        re.sub(rb'("before":{"a.mcap":)[-\d.e]+', rb"\1 0", whole),
    ):
        assert damaged != whole
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"study\.log: cannot be read or written as a study"):
            Study(path, task)


def test_a_database_of_another_version_is_refused(tmp_path: Path) -> None:
    path, one = tmp_path / "study.db", DEFAULT_PARAMETERS[0]
    task = Task(("a.mcap",), (one,), {one.name: one.low})
    Study(path, task)
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE alembic_version SET version_num = 'x'")
        database.commit()
    with pytest.raises(InputError, match=r"study\.db: cannot be read or written as a study"):
        Study(path, task)
