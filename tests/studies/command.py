"""``python -m tests.studies``: accuracy and speed, measured again on any machine."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from tests.studies import command_stream as benchmark_stream
from tests.studies.command_fuzz import FuzzOptions, fuzz
from tests.studies.command_options import (
    RealOptions,
    RecordingsOptions,
    SpeedOptions,
    StartsOptions,
    StreamFaultsOptions,
    WalkOptions,
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
    | WalkOptions
    | RecordingsOptions
    | StartsOptions
    | RealOptions
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
        | Annotated[WalkOptions, tyro.conf.subcommand("walk")]
        | Annotated[RecordingsOptions, tyro.conf.subcommand("recordings")]
        | Annotated[StartsOptions, tyro.conf.subcommand("starts")]
        | Annotated[RealOptions, tyro.conf.subcommand("real")]
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
    if isinstance(options, RecordingsOptions):
        return _recordings(options, tell, write)
    if isinstance(options, StartsOptions):
        return _starts(options, tell)
    if isinstance(options, RealOptions):
        return _real(options, tell, write)
    if isinstance(options, FuzzOptions):
        return fuzz(options, tell)
    if isinstance(options, StreamFaultsOptions):
        return _stream_faults(options, tell)
    return _speed(options, tell) if isinstance(options, SpeedOptions) else _walk(options, tell)


def _recordings(options: RecordingsOptions, tell: Tell, write: Write) -> tuple[str, str]:
    from tests.studies.recordings import RecordingTrial, recordings_json, recordings_table, run_recordings

    def keep(so_far: tuple[RecordingTrial, ...]) -> None:
        write(recordings_json(so_far))

    results = run_recordings(options.recordings, options.live, tell, keep)
    return recordings_table(results), recordings_json(results)


def _starts(options: StartsOptions, tell: Tell) -> tuple[str, str]:
    from tests.studies.starts import run_starts, starts_json, starts_table

    results = run_starts(options.recordings, tell)
    return starts_table(results), starts_json(results)


def _real(options: RealOptions, tell: Tell, write: Write) -> tuple[str, str]:
    from tests.studies.real import run_real
    from tests.studies.real_table import real_json, real_table
    from tests.studies.recordings import RecordingTrial, recordings_json, recordings_table, run_recordings

    real = run_real(
        options.data, options.named, options.live, tell, lambda so_far: write(real_json(so_far)), options.camera
    )
    table, content = real_table(real), json.loads(real_json(real))
    if options.scenes:

        def keep(so_far: tuple[RecordingTrial, ...]) -> None:
            write(json.dumps(content | json.loads(recordings_json(so_far)), indent=2))

        scenes = run_recordings(options.scenes, options.live, tell, keep)
        table += "\n" + recordings_table(scenes)
        content |= json.loads(recordings_json(scenes))
    return table, json.dumps(content, indent=2)


def _walk(options: WalkOptions, tell: Tell) -> tuple[str, str]:
    from tests.studies.walk import run_walk
    from vip_factors.settings import Settings

    result = run_walk(options.folder, Settings(), tell)
    return result.to_table(), result.to_json()


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
