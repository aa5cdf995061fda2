"""``vip-factors smooth``: an estimate from a recording; ``run``: from a video and sensor logs, step by step."""

import shlex
import sys
import time
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.cli.convert import ConvertOptions, DetectOptions, LogArguments, camera_options, import_options
from vip_factors.cli.options import (
    UNPREFIXED,
    FailOn,
    Flag,
    ManyOptions,
    Output,
    SettingsOptions,
    beside,
    fail_on,
    parse,
)
from vip_factors.cli.terminal import progress_bar, say
from vip_factors.errors import InputError
from vip_factors.io.settings import LogOptions
from vip_factors.settings import Settings

if TYPE_CHECKING:
    from vip_factors.workflow import RunOptions as Run


@dataclass(frozen=True)
class SmoothOptions(SettingsOptions, ManyOptions):
    """Reconstruct a recording: motion, headings and mountings of the sensors, as an estimate file.

    With cameras, all wearers and the cameras' paths are in one world. Without, each wearer is solved alone. Recordings
    longer than --windows.above-s are solved in windows.

    Every setting is an option; --settings reads a file, and options override it.
    """

    recording: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap) from vip-factors convert. Several recordings without a camera are consecutive parts of one."""
    out: Annotated[Path | None, Output(".mcap")] = None
    """Estimate (.mcap) to write; default: RECORDING.estimate.mcap."""
    fail_on: FailOn = "never"
    """Exit with code 3 if the verdict is this or worse; files are written anyway."""
    settings: Annotated[Settings, UNPREFIXED] = field(default_factory=Settings)


def execute_smooth(options: SmoothOptions) -> None:
    """Run ``vip-factors smooth``."""
    from vip_factors.cli.workers import windows_elsewhere
    from vip_factors.workflow import estimate_lines, smooth_file

    if not options.recording:
        raise InputError("no RECORDING.mcap to smooth is named")
    out = options.target(options.out, options.recording[0], ".estimate.mcap")
    with progress_bar() as progress, windows_elsewhere(options.jobs, options.cluster) as map_fn:
        estimate, frames = smooth_file(
            options.recording, out, options.settings, progress, map_fn=map_fn, overwrite=options.overwrite
        )
    for line in estimate_lines(estimate, frames):
        say(line)
    say(out)
    if sys.stdout.isatty():
        written, recording = (shlex.quote(str(path)) for path in (out, options.recording[0]))
        say(
            f"next: vip-factors view {written} {recording}, vip-factors report {written} --recording {recording}, "
            f"vip-factors export {written} {shlex.quote(str(beside(out, '.bvh')))}"
        )
    fail_on(options.fail_on, estimate.verdict)


@dataclass(frozen=True)
class RunOptions(LogArguments):
    """Reconstruct motion from videos and sensor logs in one command: run --video walk.mp4 --log xsens/ --placement
    p.toml

    Runs detect, convert, sync, smooth, report and export, and writes their files into one folder. A later run repeats
    only the steps whose inputs or options changed.

    Several wearers: repeat --log and --placement, in the same order. Without --video and --detections, only the sensors
    are used.
    """

    log: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="LOG")] = ()
    """Sensor log of a wearer: file or folder in any format of convert."""
    placement: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PLACEMENT")] = ()
    """Sites of the sensors: placement file (.toml, .json) or preset (sip6, tnt10, totalcapture13, mvn17); default: from
    the names of the sensors. The file may also hold the wearer's name, stature and initial pose."""
    video: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="VIDEO")] = ()
    """Video of the wearers, once for each camera."""
    camera: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="CAMERA")] = ()
    """Camera file from vip-factors calibrate-camera, once for all cameras or once for each; default: the focal length
    is estimated."""
    out: Path | None = None
    """Folder for all files; default: VIDEO_motion beside the video."""
    export: Annotated[
        tuple[Path, ...], Output(may_exist=True), tyro.conf.UseAppendAction, tyro.conf.arg(metavar="FILE")
    ] = ()
    """Export file; the suffix selects the format. Repeatable."""
    report: bool = True
    """Write report.html, a page with the verdict, the results and a 3D view."""
    static_camera: Flag = False
    """The camera stands still."""
    carried_camera: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="NAME")] = ()
    """Name of a camera (its video file without suffix) that is carried although --static-camera is given."""
    camera_path: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PATH")] = ()
    """Path of a carried camera from ARKit, ARCore or SLAM (TUM format), once for each carried camera."""
    time_offset_s: Annotated[tuple[float, ...], tyro.conf.UseAppendAction] = ()
    """Seconds to add to the video's times to match the sensors; default: sync estimates them."""
    detections: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="POSES")] = ()
    """2D poses of an earlier detection, once for each camera; the detector does not run."""
    video_rate: Annotated[tuple[float, ...], tyro.conf.UseAppendAction] = ()
    """Frames per second of --detections, if neither they nor a video give times."""
    overlay: Flag = False
    """Also write poses.mp4, the video with the 2D poses."""
    detect_options: Annotated[str, tyro.conf.arg(metavar="WORDS")] = ""
    """Further options of vip-factors detect, quoted after =: --detect-options="--model rtmpose.onnx"."""
    convert_options: Annotated[str, tyro.conf.arg(metavar="WORDS")] = ""
    """Further options of vip-factors convert, for every log: --convert-options="--camera-imu phone"."""
    smooth_options: Annotated[str, tyro.conf.arg(metavar="WORDS")] = ""
    """Further options of vip-factors smooth."""
    assign: Flag = False
    """Exchange sensors that are listed in each other's place."""
    fail_on: FailOn = "never"
    """Exit with code 3 if the verdict is this or worse; files are written anyway."""
    overwrite: Flag = False
    """Replace files that an earlier run did not write."""


def execute_run(options: RunOptions) -> None:
    """Run ``vip-factors run``."""
    from vip_factors.cli.workers import windows_elsewhere
    from vip_factors.io.mcap_estimate import read_estimate
    from vip_factors.workflow import ESTIMATE, check, steps, take

    begin = time.perf_counter()
    run, smooth = run_options(options), _smooth_options(options)
    check(run)
    run.out.mkdir(parents=True, exist_ok=True)
    with windows_elsewhere(smooth.jobs, smooth.cluster) as map_fn:
        for step in steps(run, map_fn):
            with progress_bar() as progress:
                result = take(step, run.out / "steps", run.overwrite, progress)
            when = "as before" if result.seconds is None else f"{result.seconds:.1f} s"
            say(f"{step.name:<16} {when:>9}  {'  '.join(map(str, result.files))}")
            for line in result.lines:
                say(f"  {line}")
    say(f"{time.perf_counter() - begin:.1f} s in all, files in {run.out}")
    fail_on(options.fail_on, read_estimate(run.out / ESTIMATE).verdict)


def _check(options: RunOptions) -> None:
    """Refuse options that do not go together."""
    if not options.log:
        raise InputError("no --log is given: expected the file or folder of a wearer's sensors")
    if options.placement and len(options.placement) != len(options.log):
        raise InputError(
            f"{len(options.log)} --log and {len(options.placement)} --placement are given: expected one placement for "
            "each log, in the same order"
        )
    if options.then and len(options.log) > 1:
        raise InputError(f"{len(options.log)} --log and --then are given: convert the parts of each wearer before")
    if not options.video:
        usual = RunOptions()
        poses = bool(options.detections)
        of_poses = (
            () if poses else ("camera", "static_camera", "carried_camera", "camera_path", "time_offset_s", "video_rate")
        )
        of_video = (*of_poses, "overlay")
        names = [f"--{name.replace('_', '-')}" for name in of_video if getattr(options, name) != getattr(usual, name)]
        if names:
            raise InputError(f"{', '.join(names)} given without --video{'' if poses else ' or --detections'}")
    if options.detections and (options.overlay or options.detect_options):
        raise InputError("--detections replaces the detector: leave out --overlay and --detect-options")
    if any(word.startswith("--fail-on") for word in _words(options.smooth_options)):
        raise InputError(f"{options.smooth_options}: give --fail-on to run, not in --smooth-options")


def usual_folder(options: RunOptions) -> Path:
    """Beside the video, or else the first log."""
    source = (options.video or options.log)[0]
    if not source.name:  # this folder
        source = source.resolve()
    return source.with_name(f"{source.stem if source.is_file() else source.name}_motion")


def run_options(options: RunOptions) -> "Run":
    """Translate the command line into the options of :func:`vip_factors.workflow.run`.

    Raises:
        InputError: for options that do not go together.
        SystemExit: for options that are passed on and that no step knows.
    """
    _check(options)
    from vip_factors.workflow import RunOptions as Run

    folder = options.out or usual_folder(options)
    filmed = _camera_words(options, folder)
    placements: list[list[str]] = [["--placement", placement] for placement in options.placement] or [[]] * len(
        options.log
    )
    words = [*_words(options.convert_options), *filmed]
    converted = [
        parse(
            ConvertOptions,
            "vip-factors convert",
            [str(log), str(folder / "recording.mcap"), *placement, *words],
        )
        for log, placement in zip(options.log, placements, strict=True)
    ]
    values = {field.name: getattr(options, field.name) for field in fields(LogOptions)}
    declared = {name: value for name, value in values.items() if value != getattr(LogOptions(), name)}
    detector = None
    if options.video and not options.detections:
        words = [str(options.video[0]), *_words(options.detect_options)]
        detector = parse(DetectOptions, "vip-factors detect", words).settings
    return Run(
        logs=tuple(
            (log, replace(import_options(parsed), **declared))
            for log, parsed in zip(options.log, converted, strict=True)
        ),
        out=folder,
        cameras=tuple(camera_options(converted[0])) if filmed else (),
        detector=detector,
        overlay=options.overlay,
        sync=not options.time_offset_s,
        settings=_smooth_options(options).settings,
        report=options.report,
        exports=options.export,
        overwrite=options.overwrite,
    )


def _camera_words(options: RunOptions, folder: Path) -> list[str]:
    """Return the words that ``convert`` would get about the cameras."""
    if not (options.video or options.detections):
        return []
    names = ["poses"] if len(options.video) == 1 else [f"poses-{number + 1}" for number in range(len(options.video))]
    words = ["--static-camera"] * options.static_camera
    for option, values in {
        "--detections": options.detections or [folder / f"{name}.json" for name in names],
        "--camera": options.camera,
        "--video": options.video,
        "--video-rate": options.video_rate,
        "--time-offset-s": options.time_offset_s,
        "--carried-camera": options.carried_camera,
        "--camera-path": options.camera_path,
        "--camera-name": [video.stem for video in options.video] if len(options.video) > 1 else (),
    }.items():
        for value in values:
            words += [option, str(value)]
    return words


def _smooth_options(options: RunOptions) -> SmoothOptions:
    words = ["recording.mcap", *["--assign"] * options.assign, *_words(options.smooth_options)]
    return parse(SmoothOptions, "vip-factors smooth", words)


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError as error:
        raise InputError(f"{text}: expected options as on a command line; {error}") from error
