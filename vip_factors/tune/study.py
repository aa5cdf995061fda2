"""A study: trials of settings, kept in a file as they are made, to be continued at any time; their report.

Leaving one out tells what tuning is worth on a recording that it has not seen.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import InputError, VipFactorsError
from vip_factors.tune.parameters import Parameter

Errors = Mapping[str, float]
"""Error of each recording, by name, in the unit of the measure."""


@dataclass(frozen=True)
class Trial:
    """Some settings, and how large the errors were with them.

    Attributes:
        number: in the study; 0 are the settings as they were.
        values: of the parameters.
        errors: of every recording.
    """

    number: int
    values: Mapping[str, float]
    errors: Errors


@dataclass(frozen=True)
class Judged:
    """A recording, judged by the trial that was best on all others.

    Attributes:
        name: of the recording.
        before: its error with the settings as they were.
        chosen: number of the trial that was best on the others.
        after: its error with that trial's settings.
        fitted: its error with the settings that were best on all, itself among them: what tuning seems to be worth.
    """

    name: str
    before: float
    chosen: int
    after: float
    fitted: float


def loss(errors: Errors, before: Errors, without: str | None = None) -> float:
    """Mean ratio of errors to those before: 1 is as good as it was, whatever a recording's size of error.

    Args:
        errors: with some settings.
        before: with the settings as they were.
        without: a recording to leave out.
    """
    return float(np.mean([errors[name] / before[name] for name in before if name != without]))


def best(trials: Sequence[Trial], before: Errors, without: str | None = None) -> Trial:
    """The trial of the least loss; of equals the first, so that nothing is changed for nothing."""
    return min(trials, key=lambda trial: loss(trial.errors, before, without))


def leave_one_out(trials: Sequence[Trial], before: Errors) -> tuple[Judged, ...]:
    """Every recording judged by what was best on the others.

    The trials themselves were drawn with all recordings in view, which favours tuning a little: a sampler that looks
    where errors were small leaves more trials there. Only recordings that no study ever saw tell more.

    Raises:
        InputError: for fewer than two recordings, or no trial.
    """
    if len(before) < 2 or not trials:
        raise InputError(f"{len(trials)} trials on {len(before)} recordings: to leave one out takes at least two")
    overall = best(trials, before)
    judged = []
    for name in before:
        chosen = best(trials, before, without=name)
        judged.append(Judged(name, before[name], chosen.number, chosen.errors[name], overall.errors[name]))
    return tuple(judged)


NAME = "vip-factors"
DATABASES = (".db", ".sqlite", ".sqlite3")
STARTUP = 10  # trials at random at most, before the sampler has something to go by: optuna's own number
STARTUP_SHARE = 5  # and of few trials in all only every fifth
Judge = Callable[[str, Mapping[str, float]], float]
"""The error of a recording (by name) with some values of the parameters."""


@dataclass(frozen=True)
class Task:
    """What a study is of; a study that was begun for something else is not continued.

    Attributes:
        recordings: names.
        parameters: what is tuned.
        untouched: the parameters' values before.
        about: further words that have to be the same: what is measured, at which rate.
    """

    recordings: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    untouched: Mapping[str, float]
    about: str = ""

    def words(self) -> dict[str, str]:
        """As the file keeps it."""
        return {
            "recordings": ", ".join(self.recordings),
            "parameters": ", ".join(one.text for one in self.parameters),
            "settings": ", ".join(f"{name} = {value:g}" for name, value in self.untouched.items()),
            "measured": self.about,
        }


class Study:
    """Trials in a file as optuna writes it, so that its dashboard opens it too.

    Args:
        path: of the file, made if absent: SQLite if it ends in .db, else optuna's journal, a text.
        task: what the study is of.
        seed: of the sampler.

    Raises:
        InputError: if the file holds a study of something else, is none, or optuna is not installed.
    """

    def __init__(self, path: Path, task: Task, seed: int = 0) -> None:
        self._optuna, self._task, self._seed = _optuna(), task, seed
        self._distributions = {
            one.name: self._optuna.distributions.FloatDistribution(one.low, one.high, log=one.log)
            for one in task.parameters
        }
        if path.suffix.lower() not in DATABASES and path.is_file():
            _check_journal(path)
        with _readable(path):
            self._study = self._optuna.create_study(
                storage=_storage(path), study_name=NAME, load_if_exists=True, direction="minimize"
            )
            known = {name: self._study.user_attrs.get(name) for name in task.words()}
            self._check_errors()
        for name, words in task.words().items():
            if known[name] is None:
                self._study.set_user_attr(name, words)
            elif known[name] != words:
                raise InputError(
                    f"{path} is a study of other {name} ({known[name]}): expected {words}; give another --study"
                )

    def _check_errors(self) -> None:
        """Raise a ValueError if what was measured is missing, or no numbers of the recordings."""
        complete = self._study.get_trials(states=[self._optuna.trial.TrialState.COMPLETE])
        kept = [one.user_attrs.get("errors") for one in complete]
        for errors in kept if self.before is None else [self.before, *kept]:
            numbers = [errors.get(name) for name in self._task.recordings] if isinstance(errors, dict) else [None]
            if not all(isinstance(one, (int, float)) and math.isfinite(one) for one in numbers):
                raise ValueError(f"a trial has the errors {errors}: expected a number for each recording")
        if self.before is not None and not all(self.before[name] > 0 for name in self._task.recordings):
            raise ValueError(f"the errors before are {self.before}: expected numbers above 0")

    @property
    def before(self) -> Errors | None:
        """Errors with the settings as they were; None until they are measured."""
        kept: dict[str, float] | None = self._study.user_attrs.get("before")
        return kept

    @property
    def trials(self) -> tuple[Trial, ...]:
        """All that came to an end, beginning with the settings as they were."""
        if self.before is None:
            return ()
        complete = self._study.get_trials(states=[self._optuna.trial.TrialState.COMPLETE])
        made = [Trial(one.number + 1, dict(one.params), one.user_attrs["errors"]) for one in complete]
        return (Trial(0, dict(self._task.untouched), self.before), *made)

    def run(
        self, count: int, judge: Judge, on_progress: Callable[[str, float], None] = lambda stage, done: None
    ) -> None:
        """Go on until there are ``count`` trials, beside the settings as they were.

        Settings with which a recording cannot be solved are a trial that failed; an interrupt leaves all before it.

        Args:
            count: trials in all, those of earlier runs counted.
            judge: measures.
            on_progress: called with what is done and the fraction of all.
        """
        self._study.sampler = self._optuna.samplers.TPESampler(
            n_startup_trials=min(STARTUP, max(1, count // STARTUP_SHARE)),
            seed=self._seed + len(self._study.trials),  # continued, it does not draw the same numbers again
        )
        if self.before is None:
            on_progress("settings as they are", 0.0)
            self._study.set_user_attr("before", self._errors(self._task.untouched, judge))
        while (made := self._made()) < count:
            on_progress(f"trial {made + 1} of {count}", made / count)
            self._try_one(judge)

    def _made(self) -> int:
        """Trials that came to an end, good or bad; not one that was interrupted."""
        return sum("ended" in one.user_attrs for one in self._study.trials)

    def _try_one(self, judge: Judge) -> None:
        assert self.before is not None
        trial = self._study.ask(self._distributions)
        try:
            errors = self._errors(trial.params, judge)
        except VipFactorsError as error:
            trial.set_user_attr("ended", str(error))
            self._study.tell(trial, state=self._optuna.trial.TrialState.FAIL)
            return
        except BaseException:
            self._study.tell(trial, state=self._optuna.trial.TrialState.FAIL)
            raise
        trial.set_user_attr("errors", errors)
        trial.set_user_attr("ended", "")
        self._study.tell(trial, loss(errors, self.before))

    def _errors(self, values: Mapping[str, float], judge: Judge) -> dict[str, float]:
        return {name: judge(name, values) for name in self._task.recordings}


def _optuna() -> Any:
    """The package, which is an extra.

    Raises:
        InputError: if it is not installed.
    """
    try:
        import optuna
    except ImportError as missing:
        raise InputError("tuning needs optuna: pip install 'vip-factors[tune]'") from missing
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """A file that is no study, as a sentence.

    Raises:
        InputError: if it is none.
    """
    # A journal is replayed as it stands: its numbers are taken for keys and places without a look.
    foreign: tuple[type[Exception], ...] = (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError,
                                            ValueError)  # fmt: skip
    if path.suffix.lower() in DATABASES:
        from optuna.exceptions import StorageInternalError
        from sqlalchemy.exc import SQLAlchemyError

        foreign = (*foreign, SQLAlchemyError, StorageInternalError, RuntimeError)  # of another version of its tables
    try:
        yield
    except foreign as error:
        raise InputError(f"{path}: cannot be read or written as a study: {error}") from error


def _check_journal(path: Path) -> None:
    """Refuse a journal with a line that is cut off: optuna passes over it once, and fails for good when it goes on.

    Raises:
        InputError: naming the line.
    """
    for number, line in enumerate(path.read_bytes().splitlines(keepends=True), start=1):
        try:
            whole = line.endswith(b"\n") and isinstance(json.loads(line), dict)
        except (ValueError, RecursionError):
            whole = False
        if not whole:
            raise InputError(
                f"{path}: cannot be read or written as a study: line {number} is cut off or no JSON; delete that line, "
                "with which a trial is lost, or give another --study"
            )


def _storage(path: Path) -> Any:
    """Optuna's name or object for a file."""
    if path.suffix.lower() in DATABASES:
        return f"sqlite:///{path}"
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    return JournalStorage(JournalFileBackend(str(path)))


def report_lines(trials: Sequence[Trial], parameters: Sequence[Parameter], before: Errors, unit: str) -> list[str]:
    """What was found, and what it is worth on recordings that it was not found on.

    Args:
        trials: of the study, the settings as they were first.
        parameters: what was tuned.
        before: errors with the settings as they were.
        unit: of the errors.
    """
    chosen = best(trials, before)
    lines = [f"{len(trials) - 1} trials on {len(before)} recordings; best is trial {chosen.number}"]
    width = max(len(one.name) for one in parameters)
    for one in parameters:
        lines.append(f"  {one.name:<{width}}  {trials[0].values[one.name]:8.4g} -> {chosen.values[one.name]:.4g}")
    if len(before) < 2:
        lines.append(f"{loss(chosen.errors, before):.3f} times the error before, on the recording it was tuned on")
        return [*lines, "one recording judges itself: give more to know what this is worth on another"]
    judged = leave_one_out(trials, before)
    lines += ["", *_table(judged, unit), "", verdict(judged)]
    return lines


def verdict(judged: Sequence[Judged]) -> str:
    """Whether settings carry over to a recording that they were not tuned on, in a sentence."""
    apparent = float(np.mean([one.fitted / one.before for one in judged]))
    honest = float(np.mean([one.after / one.before for one in judged]))
    worse = sum(one.after > one.before for one in judged)
    told = f"tuned on all: {apparent:.3f} times the error before; left out of the tuning: {honest:.3f} times"
    if honest >= 1.0:
        return f"{told}. It does not carry over to other recordings: keep the settings as they are"
    return f"{told}{f', worse on {worse} of {len(judged)}' if worse else ''}"


def _table(judged: Sequence[Judged], unit: str) -> list[str]:
    width = max(len("recording"), *(len(one.name) for one in judged))
    lines = [f"{'recording':<{width}}  {f'before, {unit}':>12}  {'tuned on all':>12}  {'left out':>12}  trial"]
    for one in judged:
        lines.append(f"{one.name:<{width}}  {one.before:12.3f}  {one.fitted:12.3f}  {one.after:12.3f}  {one.chosen:5d}")
    return lines


def settings_text(chosen: Trial, notes: Sequence[str]) -> str:
    """A settings file (TOML) of a trial's values, with the notes as comments before it."""
    lines = [*(f"# {note}".rstrip() for note in notes)]
    tables: dict[str, dict[str, float]] = {}
    for name, value in chosen.values.items():
        table, _, key = name.rpartition(".")
        tables.setdefault(table, {})[key] = value
    for table, values in sorted(tables.items()):  # keys of no table come first, as TOML wants them
        lines += ["", *([f"[{table}]"] if table else []), *_keys(values)]
    return "\n".join(lines) + "\n"


def _keys(values: Mapping[str, float]) -> list[str]:
    return [f"{key} = {value:.6g}" if value != int(value) else f"{key} = {int(value)}" for key, value in values.items()]
