"""``python -m tests.studies``: accuracy and speed, measured again on any machine."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from tests.studies import command_live as benchmark_live
from tests.studies import command_stream as benchmark_stream
from tests.studies.command_fuzz import FuzzOptions, fuzz
from tests.studies.command_live_options import KaichiOptions, StreamAccuracyOptions
from tests.studies.command_options import (
    AssociationOptions,
    ConsistencyOptions,
    RealOptions,
    RecordingsOptions,
    SipOptions,
    SpeedOptions,
    StartsOptions,
    StreamFaultsOptions,
    VipOptions,
    WalkOptions,
    WearersOptions,
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
    from vip_factors.settings import Settings

Options = (
    SipOptions
    | VipOptions
    | AssociationOptions
    | WearersOptions
    | ConsistencyOptions
    | SpeedOptions
    | StreamAccuracyOptions
    | StreamFaultsOptions
    | StreamLatencyOptions
    | StreamHourOptions
    | StreamSlowOptions
    | StreamKillOptions
    | DiskFullOptions
    | LongOptions
    | KaichiOptions
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
        Annotated[SipOptions, tyro.conf.subcommand("sip")]
        | Annotated[VipOptions, tyro.conf.subcommand("vip")]
        | Annotated[AssociationOptions, tyro.conf.subcommand("association")]
        | Annotated[WearersOptions, tyro.conf.subcommand("wearers")]
        | Annotated[ConsistencyOptions, tyro.conf.subcommand("consistency")]
        | Annotated[SpeedOptions, tyro.conf.subcommand("speed")]
        | Annotated[StreamAccuracyOptions, tyro.conf.subcommand("stream-accuracy")]
        | Annotated[KaichiOptions, tyro.conf.subcommand("kaichi")]
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
    if isinstance(options, SipOptions):
        return _sip(options, tell)
    if isinstance(options, VipOptions):
        return _vip(options, tell, write)
    if isinstance(options, AssociationOptions):
        return _association(options, tell)
    if isinstance(options, WearersOptions):
        return _wearers(options, tell)
    if isinstance(options, ConsistencyOptions):
        return _consistency(options, tell)
    if isinstance(options, StreamAccuracyOptions):
        return benchmark_live.stream_accuracy(options, tell, write)
    if isinstance(options, KaichiOptions):
        return benchmark_live.kaichi(options, tell, write)
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


def _sip(options: SipOptions, tell: Tell) -> tuple[str, str]:
    from tests.studies.sip import SipTrials, run_sip
    from tests.studies.sip_table import sip_json, sip_table
    from vip_factors.settings import Settings

    settings = Settings(frame_rate=options.frame_rate)
    trials = SipTrials(options.seconds, options.seeds, options.pose_error_deg, settings=settings)
    results = run_sip(options.motions, trials, tell)
    return sip_table(results, trials), sip_json(results, trials)


def _vip(options: VipOptions, tell: Tell, write: Write) -> tuple[str, str]:
    from vip_factors.errors import InputError
    from vip_factors.settings import Settings
    from vip_factors.solve.levenberg_marquardt import SolveSettings

    if (options.motions is None) == (options.totalcapture is None):
        raise InputError("give --motions with the folder of the CMU motions, or --totalcapture with that dataset's")
    settings = Settings(frame_rate=options.frame_rate, solve=SolveSettings(max_iterations=options.iterations))
    if options.totalcapture is not None:
        return _totalcapture(options, options.totalcapture, settings, tell, write)
    assert options.motions is not None
    from tests.studies.vip import chosen_clips, run_vip
    from tests.studies.vip_suite import VipTrials
    from tests.studies.vip_table import simulated_title, vip_json, vip_table

    seconds = 8.0 if options.seconds is None else options.seconds
    trials = VipTrials(
        seconds, options.seeds, options.pose_error_deg, options.camera, settings=settings, processes=options.processes
    )
    results = run_vip(
        options.motions, trials, options.variants, tell, chosen_clips(options.kinds, options.clips),
        lambda so_far: write(vip_json(so_far, trials)),
    )  # fmt: skip
    return vip_table(results, simulated_title(results, trials)), vip_json(results, trials)


def _totalcapture(options: VipOptions, folder: Path, settings: "Settings", tell: Tell, write: Write) -> tuple[str, str]:
    from tests.studies.totalcapture import TotalCaptureTrials, run_totalcapture
    from tests.studies.vip_table import vip_json, vip_table

    seconds = 30.0 if options.seconds is None else options.seconds
    trials = TotalCaptureTrials(seconds, options.totalcapture_camera, settings=settings)
    results, origin = run_totalcapture(
        folder, trials, options.variants, tell, options.clips, options.kinds,
        lambda so_far: write(vip_json(so_far, trials)),
    )  # fmt: skip
    length = f"{seconds:g} s of each sequence" if seconds > 0 else "whole sequences"
    title = f"MPJPE mm / MPJAE deg on TotalCapture, camera {trials.camera}, {length}. {origin}"
    return vip_table(results, title), vip_json(results, trials)


def _association(options: AssociationOptions, tell: Tell) -> tuple[str, str]:
    from tests.studies.association_trials import association_json, association_table, run_association
    from tests.studies.crowd import CrowdTrials

    trials = CrowdTrials(options.seconds, options.wearers, options.bystanders, options.seeds, options.camera)
    results = run_association(options.motions, trials, tell, options.whole)
    return association_table(results, trials), association_json(results, trials)


def _wearers(options: WearersOptions, tell: Tell) -> tuple[str, str]:
    from tests.studies.crowd import CrowdTrials
    from tests.studies.wearers import run_wearers, wearers_json, wearers_table

    trials = CrowdTrials(options.seconds, options.wearers, options.bystanders, options.seeds)
    results = run_wearers(options.motions, trials, options.cameras, tell)
    return wearers_table(results, trials), wearers_json(results, trials)


def _consistency(options: ConsistencyOptions, tell: Tell) -> tuple[str, str]:
    from tests.studies.consistency import (
        ConsistencyTrials,
        consistency_json,
        consistency_table,
        run_consistency,
    )

    trials = ConsistencyTrials(options.seeds, options.camera, options.seconds, options.sizes)
    result = run_consistency(trials, options.motions, tell)
    return consistency_table(result), consistency_json(result)


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
