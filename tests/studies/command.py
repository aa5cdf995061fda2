"""``python -m tests.studies``: accuracy and speed, measured again on any machine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from tests.studies import command_stream as benchmark_stream
from tests.studies.command_fuzz import FuzzOptions, fuzz
from tests.studies.command_options import (
    SpeedOptions,
    StreamFaultsOptions,
)
from tests.studies.command_stream_options import (
    DiskFullOptions,
    LongOptions,
    StreamHourOptions,
    StreamKillOptions,
    StreamLatencyOptions,
    StreamSlowOptions,
)
from vip_factors.cli.options import parse
from vip_factors.cli.terminal import Tell, progress_bar
from vip_factors.io.atomic import atomic_open, check_target

if TYPE_CHECKING:
    pass

Options = (
    SpeedOptions
    | StreamFaultsOptions
    | StreamLatencyOptions
    | StreamHourOptions
    | StreamSlowOptions
    | StreamKillOptions
    | DiskFullOptions
    | LongOptions
    | FuzzOptions
)
PROGRAM = "python -m tests.studies"
Write = Callable[[str], None]


@dataclass(frozen=True)
class BenchmarkOptions:
    """Measure accuracy on motions with known truth, honesty of covariances, or speed and memory."""

    what: Annotated[
        Annotated[SpeedOptions, tyro.conf.subcommand("speed")]
        | Annotated[StreamFaultsOptions, tyro.conf.subcommand("stream-faults")]
        | Annotated[StreamLatencyOptions, tyro.conf.subcommand("stream-latency")]
        | Annotated[StreamHourOptions, tyro.conf.subcommand("stream-hour")]
        | Annotated[StreamSlowOptions, tyro.conf.subcommand("stream-slow")]
        | Annotated[StreamKillOptions, tyro.conf.subcommand("stream-kill")]
        | Annotated[DiskFullOptions, tyro.conf.subcommand("disk-full")]
        | Annotated[LongOptions, tyro.conf.subcommand("long")]
        | Annotated[FuzzOptions, tyro.conf.subcommand("fuzz")],
        tyro.conf.arg(name=""),
    ]


def measure(arguments: Sequence[str]) -> None:
    options = parse(BenchmarkOptions, PROGRAM, arguments).what

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
    if isinstance(options, StreamLatencyOptions):
        return benchmark_stream.stream_latency(options, tell)
    if isinstance(options, StreamHourOptions):
        return benchmark_stream.stream_hour(options, tell, write)
    if isinstance(options, StreamSlowOptions):
        return benchmark_stream.stream_slow(options, tell)
    if isinstance(options, StreamKillOptions):
        return benchmark_stream.stream_kill(options, tell)
    if isinstance(options, DiskFullOptions):
        return benchmark_stream.disk_full(options, tell)
    if isinstance(options, LongOptions):
        return benchmark_stream.long(options, tell)
    if isinstance(options, FuzzOptions):
        return fuzz(options, tell)
    if isinstance(options, StreamFaultsOptions):
        return _stream_faults(options, tell)
    return _speed(options, tell)


def _speed(options: SpeedOptions, tell: Tell) -> tuple[str, str]:
    from tests.studies.speed import SpeedTrials, run_speed, speed_json, speed_table

    speed = run_speed(SpeedTrials.quick() if options.quick else None, tell)
    return speed_table(speed), speed_json(speed)


def _stream_faults(options: StreamFaultsOptions, tell: Tell) -> tuple[str, str]:
    from tests.studies.stream_fault_table import stream_fault_json, stream_fault_table
    from tests.studies.stream_faults import StreamTrials, run_stream_faults
    from vip_factors.live.recalibration_settings import RecalibrationSettings
    from vip_factors.live.settings import LiveSettings

    anew = RecalibrationSettings(use=options.recalibration)
    trials = StreamTrials(
        options.seconds, options.fault_s, options.cameras, options.faults,
        settings=LiveSettings(frame_rate=options.frame_rate, recalibration=anew), processes=options.processes,
    )  # fmt: skip
    results = run_stream_faults(trials, options.motions, options.clips, tell)
    return stream_fault_table(results, trials), stream_fault_json(results, trials)
