"""Weights of factors by Bayesian optimisation; each recording is judged by the trial that was best on the others."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import optuna
import tyro
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from tests.studies.study import Study, Tell, no_news, table
from vip_factors.atomic import atomic_open, check_target
from vip_factors.cli.options import Output, read_settings
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.io.mcap_recording import read_scene
from vip_factors.pipeline import smooth
from vip_factors.ranges import MaybeRate
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings, flatten

UNITS = {"mpjpe": "mm", "mpjae": "deg", "scene_position_error": "cm"}


@dataclass(frozen=True)
class Parameter:
    """A setting and the bounds of the search.

    Attributes:
        name: dotted, as in a settings file.
        low, high: bounds, both included.
        log: whether to search in ratios, as of standard deviations, instead of differences.
    """

    name: str
    low: float
    high: float
    log: bool = True

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(f"parameter {self.name} from {self.low:g} to {self.high:g}: expected two growing numbers")
        if self.log and self.low <= 0:
            raise InputError(f"parameter {self.name} from {self.low:g}, in ratios: expected a number above 0")


# About half to two and a half times the package's own values: beyond, a factor is off or nothing else counts.
PARAMETERS = (
    Parameter("factors.orientation.sigma_deg", 2.0, 10.0),
    Parameter("factors.acceleration.sigma", 0.6, 4.0),
    Parameter("factors.pose_prior.scale", 0.15, 1.0),
    Parameter("factors.joint_limit.sigma_deg", 1.2, 8.0),
    Parameter("factors.smoothness.time", 0.03, 0.18),
    Parameter("factors.foot_contact.sigma", 0.06, 0.4),
    Parameter("camera.reprojection.spread", 0.2, 1.2),
    Parameter("camera.ground_contact.sigma", 0.06, 0.4),
)


@dataclass(frozen=True)
class Trial:
    """Settings, and the error of every recording with them; the first trial has the settings as they were."""

    number: int
    values: Mapping[str, float]
    errors: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Tune(Study):
    """Tune weights of factors by Bayesian optimisation, on recordings whose truth is known.

    Every trial reconstructs all recordings with other settings. The same command continues after Ctrl-C, or with more
    --trials. The result is a settings file for vip-factors smooth --settings.
    """

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings (.mcap) with a truth; three and more, as different as those that the settings are for."""
    journal: Path = Path("study.log")
    """Optuna's journal of the trials, continued if it exists."""
    parameters: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME:LOW:HIGH[:log] …")] = ()
    """Settings to tune and their bounds, such as factors.orientation.sigma-deg:2:10:log; eight weights of factors if
    absent."""
    trials: int = 50
    """Trials in all, those of the journal counted."""
    out: Annotated[Path, Output(".toml")] = Path("tuned.toml")
    """Settings file to write; --overwrite replaces it."""
    measure: Literal["mpjpe", "mpjae", "scene_position_error"] = "mpjpe"
    """What is to become small: positions or orientations after a rigid alignment of every frame, or positions in the
    world. Recordings count alike: each by the ratio to its error before."""
    settings: Path | None = None
    """TOML file with the settings to begin with."""
    frame_rate: MaybeRate = None
    """Frames per second of the trials; fewer are quicker, and weights count by time, not by the frame."""

    def rows(self, tell: Tell) -> Iterator[Trial]:
        check_target(self.out, self.overwrite)
        begin = Settings() if self.settings is None else read_settings(self.settings, Settings())
        begin = begin if self.frame_rate is None else replace(begin, frame_rate=self.frame_rate)
        parameters = tuple(map(parsed, self.parameters)) or PARAMETERS
        if not (scenes := recordings_with_truth(self.recordings)):
            raise InputError("no recording to tune on: expected some with a truth")

        def errors(values: Mapping[str, float]) -> dict[str, float]:
            settings = changed(begin, values)
            return {name: measured(scene, settings, self.measure) for name, scene in scenes.items()}

        about = f"{self.measure} at {begin.frame_rate:g} Hz of {', '.join(scenes)}"
        before, made = {one.name: value_of(begin, one.name) for one in parameters}, []
        for trial in search(self.journal, parameters, before, errors, self.trials, about, tell):
            made.append(trial)
            yield trial
        notes = [f"python -m tests.studies tune, {len(made) - 1} trials of optuna's TPE sampler, {about}", ""]
        notes += "\n\n".join(self.tables(made)).splitlines()
        with atomic_open(self.out, "w", self.overwrite) as file:
            file.writelines(f"# {note}".rstrip() + "\n" for note in notes)
            file.writelines(f"{name} = {value:.6g}\n" for name, value in best(made).values.items())

    def tables(self, rows: Sequence[Trial]) -> Iterator[str]:
        """The best settings, then each recording judged by the others'."""
        before, chosen = rows[0], best(rows)
        yield f"{len(rows) - 1} trials on {len(before.errors)} recordings; best is trial {chosen.number}"
        lines = [[name, f"{value:.4g}", f"{chosen.values[name]:.4g}"] for name, value in before.values.items()]
        yield table(["setting", "before", "best"], lines)
        if len(before.errors) < 2:
            ratio = loss(chosen.errors, before.errors)
            yield f"{ratio:.3f} times the error before; to know what this is worth on another recording, give more"
            return
        judged = leave_one_out(rows)
        head = ["recording", f"before, {UNITS[self.measure]}", "tuned on all", "left out", "trial"]
        yield table(head, [[name, *(f"{error:.3f}" for error in errors), trial] for name, *errors, trial in judged])
        yield verdict(judged)


def search(
    journal: Path,
    parameters: Sequence[Parameter],
    before: Mapping[str, float],
    measure: Callable[[Mapping[str, float]], Mapping[str, float]],
    count: int,
    about: str = "",
    tell: Tell = no_news,
) -> Iterator[Trial]:
    """The journal's trials, then new ones until there are ``count`` beside the settings as they were.

    Settings with which a recording cannot be solved are a failed trial: it counts, but is not among those returned. A
    trial that was interrupted does not count.

    Args:
        journal: optuna's, made if absent.
        parameters: what is tuned.
        before: values of the parameters to begin with.
        measure: from values of the parameters to the error of each recording.
        count: trials in all.
        about: what is measured, on which recordings; a journal of another task is refused.
        tell: called with the stage and the fraction done.
    """
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    bounds: dict[str, BaseDistribution] = {p.name: FloatDistribution(p.low, p.high, log=p.log) for p in parameters}
    storage = JournalStorage(JournalFileBackend(str(journal)))
    study = optuna.create_study(storage=storage, study_name="tune", load_if_exists=True)
    task = f"{about}; {', '.join(map(str, parameters))}; from {dict(before)}"
    if study.user_attrs.get("task", task) != task:
        raise InputError(f"{journal} is the journal of another task ({study.user_attrs['task']}): expected {task}")
    study.set_user_attr("task", task)
    earlier = study.get_trials()
    # Continued, the sampler does not draw the same numbers again.
    study.sampler = optuna.samplers.TPESampler(n_startup_trials=min(10, 1 + count // 5), seed=len(earlier))
    complete = [trial for trial in earlier if trial.state == TrialState.COMPLETE]
    yield from (Trial(trial.number, trial.params, trial.user_attrs["errors"]) for trial in complete)
    made = sum(trial.state.is_finished() for trial in earlier)
    errors_before = complete[0].user_attrs["errors"] if complete else None
    for number in range(made, count + 1):
        if errors_before is None:
            study.enqueue_trial(dict(before))
        tell(f"trial {number} of {count}", number / (count + 1))
        trial = study.ask(bounds)
        try:
            errors = dict(measure(trial.params))
        except VipFactorsError:
            if errors_before is None:
                raise
            study.tell(trial, state=TrialState.FAIL)
            continue
        errors_before = errors_before or errors
        trial.set_user_attr("errors", errors)
        study.tell(trial, loss(errors, errors_before))
        yield Trial(trial.number, trial.params, errors)


def parsed(text: str) -> Parameter:
    """A parameter from ``NAME:LOW:HIGH`` or ``NAME:LOW:HIGH:log``.

    Raises:
        InputError: if it is not written so, there is no such setting, or it is no number.
    """
    try:
        name, *bounds = text.removesuffix(":log").split(":")
        low, high = map(float, bounds)
    except ValueError:
        raise InputError(f"parameter '{text}': expected NAME:LOW:HIGH or NAME:LOW:HIGH:log, with numbers") from None
    parameter = Parameter(name.replace("-", "_"), low, high, log=text.endswith(":log"))
    value_of(Settings(), parameter.name)
    return parameter


def value_of(settings: Settings, name: str) -> float:
    """The number that a setting has.

    Raises:
        InputError: if there is no such setting, or it is no number.
    """
    texts = flatten(settings)
    if name not in texts:
        raise InputError(f"unknown setting '{name}'")
    try:
        return float(texts[name])
    except ValueError:
        raise InputError(f"setting '{name}' is {texts[name]}: expected one whose value is a number") from None


def changed(settings: Any, values: Mapping[str, float]) -> Any:
    """The settings with other numbers at dotted names; whole numbers stay whole."""
    for name, value in values.items():
        key, _, rest = name.partition(".")
        current = getattr(settings, key)
        value = changed(current, {rest: value}) if rest else round(value) if isinstance(current, int) else value
        settings = replace(settings, **{key: value})
    return settings


def recordings_with_truth(paths: Iterable[Path]) -> dict[str, Scene]:
    """Recordings by file name."""
    scenes: dict[str, Scene] = {}
    for path in paths:
        if path.name in scenes:
            raise InputError(f"two recordings are called {path.name}: expected different names")
        scenes[path.name] = read_scene(path)
        if all(wearer.truth is None for wearer in scenes[path.name].wearers):
            raise InputError(f"{path} holds no truth to tune on")
    return scenes


def measured(scene: Scene, settings: Settings, measure: str) -> float:
    """The error of a scene's estimate.

    Raises:
        InputError: if there is no such error to compare others with.
        SolveError: if the problem is not determined with these settings.
    """
    value = evaluate_scene(smooth(scene, settings), scene)[measure]
    if not np.isfinite(value) or value <= 0:
        raise InputError(f"scene '{scene.name}': {measure} is {value:g}: expected an error above 0")
    return value


def loss(errors: Mapping[str, float], before: Mapping[str, float], without: str = "") -> float:
    """Mean ratio of errors to those before, of all recordings but ``without``."""
    return float(np.mean([errors[name] / before[name] for name in before if name != without]))


def best(trials: Sequence[Trial], without: str = "") -> Trial:
    """The trial of the least loss; the first of equals, so that nothing is changed for nothing."""
    return min(trials, key=lambda trial: loss(trial.errors, trials[0].errors, without))


class Judged(NamedTuple):
    """Errors of a recording: before, with the trial that is best on all, with that which is best on the others."""

    name: str
    before: float
    tuned_on_all: float
    left_out: float
    trial: int


def leave_one_out(trials: Sequence[Trial]) -> list[Judged]:
    """Each recording, judged by the trial that is best on the others."""
    overall, judged = best(trials), []
    for name, error in trials[0].errors.items():
        chosen = best(trials, without=name)
        judged.append(Judged(name, error, overall.errors[name], chosen.errors[name], chosen.number))
    return judged


def verdict(judged: Sequence[Judged]) -> str:
    """Whether settings carry over to a recording that they were not tuned on."""
    apparent = np.mean([recording.tuned_on_all / recording.before for recording in judged])
    honest = np.mean([recording.left_out / recording.before for recording in judged])
    text = f"tuned on all: {apparent:.3f} times the error before; left out of the tuning: {honest:.3f} times"
    return f"{text}. It does not carry over: keep the settings as they are" if honest >= 1.0 else text
