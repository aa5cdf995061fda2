"""``vip-factors tune``: weights of factors from recordings whose truth is known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from vip_factors.atomic import atomic_open, check_target
from vip_factors.cli.options import Output, WritingOptions
from vip_factors.cli.terminal import note, progress_bar
from vip_factors.errors import InputError
from vip_factors.ranges import MaybeRate, NotNegativeInt

if TYPE_CHECKING:
    from vip_factors.sensors.scene import Scene
    from vip_factors.settings import Settings
    from vip_factors.tune.parameters import Parameter
    from vip_factors.tune.study import Study


@dataclass(frozen=True)
class TuneOptions(WritingOptions):
    """Tune weights of factors by Bayesian optimisation, on recordings whose truth is known.

    Every trial reconstructs all recordings with other settings. The study is a file: the same command continues it
    after Ctrl-C, or with more --trials. What it is worth is told by leaving out: each recording is judged by the
    settings that were best on the others, never by those that it helped to choose.

    The result is a settings file for vip-factors smooth --settings.
    """

    common: ClassVar = ("study", "parameters", "trials", "out", "measure", "settings")
    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING [RECORDING …]")]
    """Recordings or scenes (.mcap) with a truth; three and more, as different as those that the settings are for."""
    study: Annotated[Path, Output()] = Path("study.log")
    """File of the trials, continued if it exists: optuna's journal, or SQLite if it ends in .db."""
    parameters: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME:LOW:HIGH[:log] …")] = ()
    """Settings to tune and their bounds, such as factors.orientation.sigma-deg:2:10:log; eight weights of factors if
    absent."""
    trials: int = 50
    """Trials in all, those that the study holds counted."""
    out: Annotated[Path, Output(".toml")] = Path("tuned.toml")
    """Settings file to write."""
    measure: Literal["mpjpe", "mpjae", "scene_position_error"] = "mpjpe"
    """What is to become small: positions or orientations after a rigid alignment of every frame, or positions in the
    world. Recordings count alike: each by the ratio to its error before."""
    settings: Path | None = None
    """TOML file with the settings to begin with."""
    frame_rate: MaybeRate = None
    """Frames per second of the trials; fewer are quicker, and weights count by time, not by the frame."""
    seed: NotNegativeInt = 0
    """Of the sampler."""


def main(options: TuneOptions) -> None:
    """Run the command."""
    from vip_factors.tune.parameters import UNITS, Measure, changed, measured, value_of
    from vip_factors.tune.study import Study, Task, best, report_lines, settings_text

    if not options.recordings:
        raise InputError("no recording to tune on: expected some with a truth, such as vip-factors simulate makes")
    if options.trials < 1:
        raise InputError(f"--trials {options.trials}: expected a number above 0")
    check_target(options.out, options.overwrite)
    settings, parameters, measure = _settings(options), _parameters(options), Measure(options.measure)
    scenes = _scenes(options.recordings)
    untouched = {one.name: value_of(settings, one.name) for one in parameters}
    about = f"{measure.value} at {settings.frame_rate:g} Hz"
    study = Study(options.study, Task(tuple(scenes), parameters, untouched, about), options.seed)

    def judge(name: str, values: Mapping[str, float]) -> float:
        return measured(scenes[name], changed(settings, values), measure)

    try:
        with progress_bar() as progress:
            study.run(options.trials, judge, progress)
    except KeyboardInterrupt:
        note(f"{len(study.trials)} trials are kept in {options.study}: the same command goes on from there")
        raise
    before = study.before
    assert before is not None
    lines = report_lines(study.trials, parameters, before, UNITS[measure])
    print("\n".join(lines))
    with atomic_open(options.out, "w", options.overwrite) as file:
        file.write(settings_text(best(study.trials, before), [*_provenance(options, study, about), *lines]))
    print(options.out)


def _settings(options: TuneOptions) -> "Settings":
    from dataclasses import replace

    from vip_factors.cli.settings_file import read_settings
    from vip_factors.configurations import configured
    from vip_factors.settings import Settings

    own = Settings()
    if options.settings is not None:
        own = read_settings(options.settings, own, lambda name: configured(Settings(), name))
    return own if options.frame_rate is None else replace(own, frame_rate=options.frame_rate)


def _parameters(options: TuneOptions) -> "tuple[Parameter, ...]":
    from vip_factors.tune.parameters import DEFAULT_PARAMETERS, parsed

    found = tuple(parsed(text) for text in options.parameters) or DEFAULT_PARAMETERS
    names = [one.name for one in found]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise InputError(f"parameter {', '.join(sorted(twice))} is given twice")
    return found


def _scenes(paths: Sequence[Path]) -> "dict[str, Scene]":
    """The recordings by file name; of files of the same name, by the folder too."""
    from vip_factors.io.mcap_recording import read_scene

    alike = len({path.name for path in paths}) < len(paths)
    scenes: dict[str, Scene] = {}
    for path in paths:
        name = f"{path.resolve().parent.name}/{path.name}" if alike else path.name
        if name in scenes:
            raise InputError(f"two recordings are called {name}: expected each once")
        scenes[name] = read_scene(path)
        if all(wearer.truth is None for wearer in scenes[name].wearers):
            raise InputError(f"{path} holds no truth to tune on")
    return scenes


def _provenance(options: TuneOptions, study: "Study", about: str) -> list[str]:
    from vip_factors import __version__

    return [
        f"vip-factors tune {__version__}, {len(study.trials) - 1} trials by optuna's TPE sampler, {about}",
        f"study {options.study.name}, of {', '.join(study.before or ())}",
        "",
    ]
