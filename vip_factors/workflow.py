"""From a video and sensor logs to motion, exports and a report, step by step, in one folder.

A step is taken again only when its inputs or parameters have changed, or its files are gone.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from vip_factors import __version__, api
from vip_factors.atomic import check_target
from vip_factors.detect.settings import DetectSettings
from vip_factors.display import ProgressCallback, silent
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.io.convert import ImportOptions
from vip_factors.io.export.files import export_format
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.settings import CameraOptions
from vip_factors.settings import Settings

if TYPE_CHECKING:
    from vip_factors.estimate import Estimate
    from vip_factors.solve.levenberg_marquardt import SolveReport
    from vip_factors.stages.windows import MapFn

ESTIMATE = "estimate.mcap"


@dataclass(frozen=True)
class Result:
    """Files that a step made, and what there is to say about them, line by line.

    Attributes:
        files, lines: these.
        seconds: that the step took; None where the files of an earlier run were still right.
    """

    files: tuple[Path, ...]
    lines: tuple[str, ...] = ()
    seconds: float | None = None


@dataclass(frozen=True)
class Step:
    """A step from files to files.

    Attributes:
        name: unlike any other step's.
        inputs: files and folders that it reads.
        parameters: all else that its result depends on.
        make: writes its files, given whether they may be replaced and a callback for progress.
        hint: what a user can do if it fails.
    """

    name: str
    inputs: tuple[Path, ...]
    parameters: object
    make: Callable[[bool, ProgressCallback], Result]
    hint: str = ""


@dataclass(frozen=True)
class _Record:
    """Record of a step: its inputs and outputs."""

    version: str
    parameters: str
    inputs: dict[str, tuple[int, int]]  # file → bytes, time of change in ns
    files: list[str]
    lines: list[str]


def take(step: Step, folder: Path, overwrite: bool = False, progress: ProgressCallback = silent) -> Result:
    """Take a step, unless its files are there, made with the same parameters from the same inputs.

    Args:
        step: to take.
        folder: for records of what was done.
        overwrite: whether files may be replaced that no step wrote.
        progress: called with what goes on and the fraction of it that is done.

    Raises:
        InputError: with the step's name, if it fails by what the user can mend.
    """
    path = folder / f"{step.name.replace(' ', '_')}.json"
    try:
        record = msgspec.json.decode(path.read_bytes(), type=_Record)
    except (OSError, ValueError, RecursionError):  # there is none, or the file is another program's
        record = None
    if record is not None and _is_fresh(step, record):
        return Result(tuple(map(Path, record.files)), tuple(record.lines))
    begin = time.perf_counter()
    progress(step.name, 0.0)
    try:
        result = step.make(overwrite or record is not None, progress)
    except VipFactorsError as error:
        raise InputError(f"step {step.name}: {error}{f'; {step.hint}' if step.hint else ''}") from error
    except OSError as error:
        raise InputError(f"step {step.name}: {error.filename or step.name}: {error.strerror or error}") from error
    record = _Record(
        __version__, repr(step.parameters), _stamps(step.inputs), list(map(str, result.files)), list(result.lines)
    )
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(record)) + b"\n")
    return replace(result, seconds=time.perf_counter() - begin)


def _is_fresh(step: Step, record: _Record) -> bool:
    made_alike = record.version == __version__ and record.parameters == repr(step.parameters)
    return made_alike and record.inputs == _stamps(step.inputs) and all(Path(file).is_file() for file in record.files)


def _stamps(inputs: Iterable[Path]) -> dict[str, tuple[int, int]]:
    """Size and time of change of every file that a step reads."""
    statuses = {str(file): file.stat() for path in inputs for file in _files(path)}
    return {name: (status.st_size, status.st_mtime_ns) for name, status in statuses.items()}


def _files(path: Path) -> list[Path]:
    """A file; those in a folder; those whose names begin so; without a camera's name behind a colon."""
    if path.is_file():
        return [path]
    if path.is_dir():
        return sorted(file for file in path.rglob("*") if file.is_file())
    if ":" in path.name:
        return _files(path.with_name(path.name.rpartition(":")[0]))
    return sorted(file for file in path.parent.glob(f"{path.name}*") if file.is_file()) if path.parent.is_dir() else []


@dataclass(frozen=True)
class RunOptions:
    """Inputs and outputs of a run.

    Attributes:
        logs: of each wearer, file or folder of the sensors and what is known of it.
        out: folder for all files, made if it is not there.
        cameras: what filmed the wearers, if anything did.
        detector: finds the 2D poses in each camera's video and writes them to its file of detections; None if these
            files are there already.
        overlay: whether to write each video with the poses drawn over it (.mp4) beside its detections.
        sync: whether to find the offsets between the clocks of videos and sensors.
        settings: of the reconstruction.
        report: whether to write ``report.html``.
        exports: files of other programs; the suffix tells the format.
        overwrite: whether files may be replaced that no earlier run wrote.
    """

    logs: tuple[tuple[Path, ImportOptions], ...]
    out: Path
    cameras: tuple[CameraOptions, ...] = ()
    detector: DetectSettings | None = None
    overlay: bool = False
    sync: bool = True
    settings: Settings = field(default_factory=Settings)
    report: bool = True
    exports: tuple[Path, ...] = ()
    overwrite: bool = False


def run(options: RunOptions, progress: ProgressCallback | None = None) -> "Estimate":
    """From a video (or 2D poses) and sensor logs to motion, exports and a report, as the command ``run`` does.

    Files of an earlier run are used again, unless their inputs or options have changed.

    Args:
        options: what to start from, and what to make.
        progress: called with the name of a stage and the fraction of it that is done.

    Raises:
        InputError: for options that cannot be, or with the name of the step that failed.
    """
    check(options)
    options.out.mkdir(parents=True, exist_ok=True)
    for step in steps(options):
        take(step, options.out / "steps", options.overwrite, progress or silent)
    return read_estimate(options.out / ESTIMATE)


def check(options: RunOptions) -> None:
    """Refuse what cannot be, before anything is done.

    Raises:
        InputError: for a run without a log, a detector without a video, or a file that cannot be written.
    """
    if not options.logs:
        raise InputError("a run without a log: expected the file or folder of a wearer's sensors")
    videos = [camera.video for camera in options.cameras]
    if options.detector is not None and (not videos or None in videos):
        raise InputError("a run with a detector and no video: expected the video of each camera to be a file")
    for video in videos:
        if video is not None and not video.is_file():
            raise InputError(f"{video}: no such video file")
    if options.out.exists() and not options.out.is_dir():
        raise InputError(f"{options.out} is a file: expected a folder for all files")
    for target in options.exports:
        export_format(target)
        check_target(target, overwrite=True)  # whether an earlier run wrote it is not known yet


def steps(options: RunOptions, map_fn: "MapFn" = map) -> Iterator[Step]:
    """All steps in order; ``map_fn`` solves the windows of a long recording, in other processes say."""
    folder, cameras = options.out, options.cameras
    recording, estimate, page = folder / "recording.mcap", folder / ESTIMATE, folder / "report.html"
    if options.detector is not None:
        yield from _detections(cameras, options.detector, options.overlay)
    logs, join = options.logs, list[Path]()
    if len(logs) > 1:
        recordings = [folder / f"wearer{number}.mcap" for number in range(1, len(logs) + 1)]
        for (log, log_options), wearer_recording in zip(logs, recordings, strict=True):
            make = partial(_convert, log, log_options, (), (), wearer_recording)
            yield Step(f"convert {wearer_recording.stem}", (log, *_files_named(log_options)), log_options, make)
        logs, join = ((recordings[0], ImportOptions()),), recordings[1:]
    ((log, log_options),) = logs
    inputs = (log, *_files_named(log_options), *join, *(file for camera in cameras for file in _files_named(camera)))
    yield Step("convert", inputs, (log_options, cameras), partial(_convert, log, log_options, cameras, join, recording))
    if cameras and options.sync:
        synced = folder / "synced.mcap"
        hint = "if you know the offset, give it as --time-offset-s"
        yield Step("sync", (recording,), None, partial(_sync, recording, synced), hint)
        recording = synced
    settings = options.settings
    yield Step("smooth", (recording,), settings, partial(_smooth, recording, estimate, settings, map_fn))
    if options.report:
        yield Step("report", (estimate, recording), None, partial(_report, estimate, recording, page))
    for target in options.exports:
        yield Step(f"export {target.name}", (estimate,), target, partial(_export, estimate, target))


def _detections(cameras: Sequence[CameraOptions], detector: DetectSettings, overlay: bool) -> Iterator[Step]:
    for camera in cameras:
        assert camera.video is not None
        assert camera.detections is not None
        drawn = camera.detections.with_suffix(".mp4") if overlay else None
        make = partial(_detect, camera.video, camera.detections, drawn, detector)
        name = "detect" if len(cameras) == 1 else f"detect {camera.camera_name}"
        yield Step(name, (camera.video,), (detector, drawn), make)


def _files_named(options: ImportOptions | CameraOptions) -> tuple[Path, ...]:
    """The files that options may name."""
    if isinstance(options, CameraOptions):
        sensor = options.camera_imu_log, options.camera_imu_columns
        named = [options.video, options.detections, options.camera, options.camera_path, *sensor]
    else:
        placement = options.placement if isinstance(options.placement, str | Path) else None
        names = (placement, options.columns, options.pose_from, options.body)
        named = [*(Path(name) for name in names if name), *options.then]
    return tuple(path for path in named if path is not None)


def _detect(
    video: Path, out: Path, overlay: Path | None, settings: DetectSettings, overwrite: bool, progress: ProgressCallback
) -> Result:
    from vip_factors.detect.video import detect_people, poses_summary

    poses = detect_people(video, settings, progress, out=out, overlay=overlay, overwrite=overwrite)
    return Result((out,) if overlay is None else (out, overlay), tuple(poses_summary(poses)))


def _convert(
    log: Path,
    log_options: ImportOptions,
    cameras: Sequence[CameraOptions],
    join: Sequence[Path],
    out: Path,
    overwrite: bool,
    progress: ProgressCallback,
) -> Result:
    check_target(out, overwrite)
    return Result((api.write(api.convert(log, log_options, cameras, join=join), out, overwrite),))


def _sync(recording: Path, out: Path, overwrite: bool, progress: ProgressCallback) -> Result:
    from vip_factors.initialise.clock import find_clock_offset

    check_target(out, overwrite)
    scene = api.read(recording)
    sentences = list[str]()
    for number, camera in enumerate(scene.cameras):
        offset, label = find_clock_offset(scene, number=number), f"{camera.name}: " if len(scene.cameras) > 1 else ""
        if not offset.determined:
            raise InputError(f"{recording}: {label}{offset.sentence}")
        scene = api.with_clock(scene, offset.clock, number)
        sentences.append(label + offset.sentence)
    return Result((api.write(scene, out, overwrite),), tuple(sentences))


def _smooth(
    recording: Path, out: Path, settings: Settings, map_fn: "MapFn", overwrite: bool, progress: ProgressCallback
) -> Result:
    estimate, frames = smooth_file((recording,), out, settings, progress, map_fn=map_fn, overwrite=overwrite)
    return Result((out,), tuple(estimate_lines(estimate, frames)))


def smooth_file(
    recordings: Sequence[Path],
    out: Path,
    settings: Settings,
    progress: ProgressCallback = silent,
    *,
    map_fn: "MapFn" = map,
    overwrite: bool = False,
) -> "tuple[Estimate, Sequence[int]]":
    """Reconstruct a recording into a file, window by window if it is long, in the memory of one.

    Args:
        recordings: the file, or parts of the same recording that follow in time.
        out: file to write.
        settings, progress, map_fn: as of :func:`vip_factors.pipeline.smooth_chunks`.
        overwrite: whether the file may be replaced.

    Returns:
        The estimate without its frames, and how many frames of each wearer there are.

    Raises:
        InputError, RecordingError, SolveError: as :func:`vip_factors.pipeline.smooth`.
    """
    from vip_factors.io.mcap_estimate import write_estimate
    from vip_factors.io.mcap_source import open_source
    from vip_factors.pipeline import smooth_chunks

    check_target(out, overwrite)
    has_windows = settings.windows.use and not settings.calibration.from_truth
    source = open_source(recordings, settings.windows.above_s if has_windows else float("inf"))
    reports: list[SolveReport] = []
    estimate = smooth_chunks(source, settings, progress, map_fn=map_fn)
    reported = replace(estimate, chunks=_reporting(estimate.chunks, reports))
    recorded = source.wearers[0].head
    write_estimate(reported, out, overwrite, recorded.start_ns, recorded.clock_s)
    head = estimate.head if estimate.closed is None else estimate.closed()
    return replace(head, reports=(*head.reports, *reports)), estimate.frames


def _reporting(chunks: "Iterator[Estimate]", reports: "list[SolveReport]") -> "Iterator[Estimate]":
    """The chunks; the reports of the solves that made them are appended to a list."""
    for chunk in chunks:
        reports += chunk.all_reports
        yield chunk


def estimate_lines(estimate: "Estimate", frames: Sequence[int]) -> Iterator[str]:
    """Summarise a reconstruction: frames, detections, seconds, the verdict and all findings."""
    for wearer, count in zip(estimate.wearers, frames, strict=True):
        who = f", {wearer.name}" if wearer.name else ""
        yield f"{wearer.method}{who}: {count} frames at {wearer.motion.rate:g} Hz from {len(wearer.sensors)} sensors"
    for camera in estimate.cameras:
        name = f"camera '{camera.name}'" if len(estimate.cameras) > 1 else "camera"
        labels = camera.wearer_of_detection
        yield f"{name}: {int((labels >= 0).sum())} of {len(labels)} detections are of wearers"
    yield f"computed in {sum(report.seconds for report in estimate.all_reports):.1f} s"
    yield f"verdict: {estimate.verdict}"
    yield from (f"{finding.severity}: {finding}" for finding in estimate.all_findings)


def _report(estimate: Path, recording: Path, out: Path, overwrite: bool, progress: ProgressCallback) -> Result:
    return Result((api.report(read_estimate(estimate), out, api.read(recording), overwrite=overwrite),))


def _export(estimate: Path, out: Path, overwrite: bool, progress: ProgressCallback) -> Result:
    return Result(api.export(read_estimate(estimate), out, overwrite=overwrite))
