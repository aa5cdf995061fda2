"""``vip-factors benchmark``: accuracy and speed, measured again on any machine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import tyro

from vip_factors.cli.benchmark_options import SipOptions, SpeedOptions, VipOptions, WalkOptions
from vip_factors.cli.options import parse
from vip_factors.cli.terminal import Tell, progress_bar

Options = SipOptions | SpeedOptions | VipOptions | WalkOptions
Write = Callable[[str], None]


@dataclass(frozen=True)
class BenchmarkOptions:
    """Measure accuracy on motions with known truth, or speed and memory."""

    what: Annotated[
        Annotated[SipOptions, tyro.conf.subcommand("sip")]
        | Annotated[VipOptions, tyro.conf.subcommand("vip")]
        | Annotated[SpeedOptions, tyro.conf.subcommand("speed")]
        | Annotated[WalkOptions, tyro.conf.subcommand("walk")],
        tyro.conf.arg(name=""),
    ]


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(BenchmarkOptions, prog, arguments).what
    from vip_factors.io.atomic import atomic_open, check_target

    written = False
    if options.json is not None:
        check_target(options.json, options.overwrite)

    def write(content: str) -> None:
        nonlocal written
        if options.json is not None:  # once written, it is this run's own to replace
            with atomic_open(options.json, "w", options.overwrite or written) as file:
                file.write(content)
            written = True

    with progress_bar() as tell:
        table, content = _run(options, tell, write)
    print(table, end="")
    write(content)


def _run(options: Options, tell: Tell, write: Write) -> tuple[str, str]:
    """The table to print and the JSON to write; what takes hours writes before it is done."""
    if isinstance(options, SipOptions):
        return _sip(options, tell)
    if isinstance(options, VipOptions):
        return _vip(options, tell, write)
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


def _vip(options: VipOptions, tell: Tell, write: Write) -> tuple[str, str]:
    from vip_factors.benchmark.vip import chosen_clips, run_vip
    from vip_factors.benchmark.vip_suite import VipTrials
    from vip_factors.benchmark.vip_table import simulated_title, vip_json, vip_table
    from vip_factors.errors import InputError
    from vip_factors.settings import Settings
    from vip_factors.solve.levenberg_marquardt import SolveSettings

    if options.motions is None:
        raise InputError("give --motions with the folder of the CMU motions")
    settings = Settings(frame_rate=options.frame_rate, solve=SolveSettings(max_iterations=options.iterations))
    trials = VipTrials(options.seconds, options.seeds, options.pose_error_deg, options.camera, settings=settings)
    results = run_vip(
        options.motions, trials, options.variants, tell, chosen_clips(options.kinds, options.clips),
        lambda so_far: write(vip_json(so_far, trials)),
    )  # fmt: skip
    return vip_table(results, simulated_title(results, trials)), vip_json(results, trials)


def _speed(options: SpeedOptions, tell: Tell) -> tuple[str, str]:
    from vip_factors.benchmark.speed import SpeedTrials, run_speed, speed_json, speed_table

    speed = run_speed(SpeedTrials.quick() if options.quick else None, tell)
    return speed_table(speed), speed_json(speed)
