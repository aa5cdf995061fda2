"""``vip-factors benchmark``: accuracy and speed, measured again on any machine."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import Flag, parse
from vip_factors.cli.terminal import Tell, progress_bar


@dataclass(frozen=True)
class SipOptions:
    """Six simulated sensors on the motions held out of the pose prior, beside the thesis's tables."""

    motions: Path
    """Folder of the CMU motions as BVH, searched with all folders below it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""
    seconds: float = 8.0
    """Of each clip, from its middle."""
    seeds: int = 1
    """Recordings of each clip, each with other sensor errors."""
    pose_error_deg: float = 8.0
    """How imperfectly the T-pose before each clip is held, sigma of each joint and axis; it adds up along a limb."""
    frame_rate: float = 60.0
    """Frames per second of the reconstructions."""


@dataclass(frozen=True)
class SpeedOptions:
    """Seconds per iteration by part, and peak memory, on a simulated walk."""

    quick: Flag = False
    """A few frames and iterations only."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


@dataclass(frozen=True)
class WalkOptions:
    """Seven real sensors on a walk with optical reference, beside Xsens MVN."""

    folder: Path
    """The folder xsens_vicon_walk, with raw_mtw, vicon and mvn in it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


@dataclass(frozen=True)
class BenchmarkOptions:
    """Measure accuracy on motions with known truth, or speed and memory."""

    what: Annotated[
        Annotated[SipOptions, tyro.conf.subcommand("sip")]
        | Annotated[SpeedOptions, tyro.conf.subcommand("speed")]
        | Annotated[WalkOptions, tyro.conf.subcommand("walk")],
        tyro.conf.arg(name=""),
    ]


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(BenchmarkOptions, prog, arguments).what
    from vip_factors.io.atomic import atomic_open, check_target

    if options.json is not None:
        check_target(options.json, options.overwrite)
    with progress_bar() as tell:
        table, content = _run(options, tell)
    print(table, end="")
    if options.json is not None:
        with atomic_open(options.json, "w", options.overwrite) as file:
            file.write(content)


def _run(options: SipOptions | SpeedOptions | WalkOptions, tell: Tell) -> tuple[str, str]:
    """The table to print and the JSON to write."""
    if isinstance(options, SipOptions):
        return _sip(options, tell)
    return _speed(options, tell) if isinstance(options, SpeedOptions) else _walk(options, tell)


def _walk(options: WalkOptions, tell: Tell) -> tuple[str, str]:
    from vip_factors.benchmark.walk import run_walk
    from vip_factors.settings import Settings

    result = run_walk(options.folder, Settings(), tell)
    return result.to_table(), result.to_json()


def _sip(options: SipOptions, tell: Tell) -> tuple[str, str]:
    from vip_factors.benchmark.sip import SipTrials, run_sip
    from vip_factors.benchmark.sip_table import sip_json, sip_table
    from vip_factors.settings import Settings

    settings = Settings(frame_rate=options.frame_rate)
    trials = SipTrials(options.seconds, options.seeds, options.pose_error_deg, settings=settings)
    results = run_sip(options.motions, trials, tell)
    return sip_table(results, trials), sip_json(results, trials)


def _speed(options: SpeedOptions, tell: Tell) -> tuple[str, str]:
    from vip_factors.benchmark.speed import SpeedTrials, run_speed, speed_json, speed_table

    speed = run_speed(SpeedTrials.quick() if options.quick else None, tell)
    return speed_table(speed), speed_json(speed)
