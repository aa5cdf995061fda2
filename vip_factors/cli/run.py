"""``vip-factors run``: from a video and sensor logs to motion, exports and a report, step by step in one command."""

import io
import json
import shlex
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from vip_factors import __version__
from vip_factors.atomic import check_target
from vip_factors.cli.options import FailOn, Flag, Output, fail_on, run_command
from vip_factors.cli.terminal import note
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.ranges import MaybeRate

if TYPE_CHECKING:
    from vip_factors.estimate import Estimate

# Phones that film with their main camera: 60 to 65 degrees along the longer side, a little less when they steady it.
FIELD_OF_VIEW_DEG = 60.0
ESTIMATE = "estimate.mcap"
Words = tuple[str, ...]
Main = Callable[[str, Sequence[str]], None]


@dataclass(frozen=True)
class Step:
    """One command, and the files between which it stands.

    Attributes:
        name: as the user is told; unlike any other step's.
        command: of ``vip-factors``.
        words: its arguments.
        inputs: files and folders that it reads; a change of one makes it run again.
        outputs: files that it writes; those that it prints, if none are named.
        hint: what a user can do who is told that it failed.
        tells: whether all that it prints is shown, not its notes alone.
    """

    name: str
    command: str
    words: tuple[str, ...]
    inputs: tuple[Path, ...]
    outputs: tuple[Path, ...]
    hint: str = ""
    tells: bool = False

    @property
    def line(self) -> str:
        """The command as one would type it."""
        return shlex.join(["vip-factors", self.command, *self.words])


@dataclass(frozen=True)
class RunOptions:
    """From a video and the sensors' log to motion, in one command: run --video walk.mp4 --log xsens/ --placement p.toml

    It does what these commands do, one after another, and keeps each one's file in a folder: detect, convert, sync,
    smooth, report, export. What is there already is used again, unless its inputs or options have changed.

    Several wearers: say --log and --placement once for each, in the same order. With --detections the video itself is
    not needed, and with neither of the two the sensors are alone.
    """

    log: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="LOG")] = ()
    """File or folder of a wearer's sensors, in any format that convert reads."""
    placement: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="PLACEMENT")] = ()
    """Where they sit: placement file (.toml, .json) or preset (sip6, tnt10, totalcapture13, mvn17); absent, the
    sensors' names must tell. The file may also hold the wearer's name, stature and initial pose."""
    video: Path | None = None
    """Video of the wearers."""
    camera: Path | None = None
    """Camera file (vip-factors calibrate-camera makes one); absent, its field of view is guessed, and a note says
    so."""
    out: Path | None = None
    """Folder for all files, made if it is not there; VIDEO_motion beside the video if absent."""
    export: Annotated[tuple[Path, ...], Output(), tyro.conf.UseAppendAction, tyro.conf.arg(metavar="FILE")] = ()
    """File of another program to write in the end; the suffix tells the format. May be said several times."""
    report: bool = True
    """Write report.html, a page that tells what was found."""
    static_camera: Flag = False
    """The camera stands still."""
    field_of_view_deg: float = FIELD_OF_VIEW_DEG
    """Of the video along its longer side, if there is no camera file."""
    time_offset_s: float | None = None
    """Seconds to add to the video's times to get the sensors', if you know them; absent, sync finds them."""
    detections: Path | None = None
    """2D poses that were found before, instead of detecting: without --video, --camera is needed beside them."""
    video_rate: MaybeRate = None
    """Frames a second of these, if neither they nor a video tell their times."""
    overlay: Flag = False
    """Also write poses.mp4, the video with the 2D poses drawn over it."""
    detect_options: Annotated[str, tyro.conf.arg(metavar="WORDS")] = ""
    """More options of vip-factors detect, as one word behind =, such as --detect-options="--model rtmpose.onnx"."""
    convert_options: Annotated[str, tyro.conf.arg(metavar="WORDS")] = ""
    """The same of vip-factors convert, for every log: --convert-options="--stature-m 1.75 --initial-pose n-pose"."""
    smooth_options: Annotated[str, tyro.conf.arg(metavar="WORDS")] = ""
    """The same of vip-factors smooth."""
    assign: Flag = False
    """Take sensors for one another that are found in each other's places."""
    fail_on: FailOn = "never"
    """End with exit code 3 if the verdict is this or worse; what is written is written all the same."""
    overwrite: Flag = False
    """Replace files that were there before and are not of an earlier run."""


def main(options: RunOptions) -> None:
    """Run the command."""
    began = time.perf_counter()
    folder = _run_steps(options)
    print(f"{time.perf_counter() - began:.1f} s in all, files in {folder}")
    if options.fail_on != "never":
        from vip_factors.io.mcap_estimate import read_estimate

        fail_on(options.fail_on, read_estimate(folder / ESTIMATE).verdict)


def run(options: RunOptions) -> "Estimate":
    """From a video (or 2D poses) and sensor logs to motion, exports and a report, as the command does; steps are told.

    Raises:
        InputError: for options that cannot be, or with the name of the step that failed.
    """
    from vip_factors.io.mcap_estimate import read_estimate

    return read_estimate(_run_steps(options) / ESTIMATE)


def _run_steps(options: RunOptions) -> Path:
    """All that is asked for; the folder that it is in."""
    check(options)
    folder = options.out or usual_folder(options)
    folder.mkdir(parents=True, exist_ok=True)
    if options.video is not None and options.camera is None:
        guess_camera(options.video, options.field_of_view_deg, folder / "camera.toml")
    for step in steps(options, folder):
        take(step, folder / "steps", options.overwrite)
    return folder


def check(options: RunOptions) -> None:
    """What cannot be, before anything is done.

    Raises:
        InputError: naming the option.
    """
    if not options.log:
        raise InputError("no --log is given: expected the file or folder of a wearer's sensors")
    if options.placement and len(options.placement) != len(options.log):
        raise InputError(
            f"{len(options.log)} --log and {len(options.placement)} --placement are given: expected one placement for "
            "each log, in the same order"
        )
    if options.video is None:
        usual = RunOptions()
        poses = options.detections is not None
        of_poses = () if poses else ("camera", "static_camera", "time_offset_s", "video_rate")
        of_video = (*of_poses, "field_of_view_deg", "overlay")
        given = [f"--{name.replace('_', '-')}" for name in of_video if getattr(options, name) != getattr(usual, name)]
        if given:
            raise InputError(f"{', '.join(given)} given without --video{'' if poses else ' or --detections'}")
        if poses and options.camera is None:
            raise InputError("--detections given without --video: its camera is not known, give --camera FILE.toml")
    elif not options.video.is_file():
        raise InputError(f"{options.video}: no such video file")
    if options.detections is not None and (options.overlay or options.detect_options):
        raise InputError("--detections given: nothing is detected, so leave out --overlay and --detect-options")
    if options.out is not None and options.out.exists() and not options.out.is_dir():
        raise InputError(f"--out {options.out} is a file: expected a folder for all files")
    for text in (options.detect_options, options.convert_options, options.smooth_options):
        if any(word.startswith("--fail-on") for word in _words(text)):
            raise InputError(f"{text}: say --fail-on to run itself")
    from vip_factors.io.export.files import FORMATS

    for target in options.export:
        if target.suffix.lower() not in FORMATS:
            raise InputError(f"--export {target}: expected a file that ends in {', '.join(FORMATS)}")
        check_target(target, overwrite=True)  # whether an earlier run wrote it is not known yet
    if not 0 < options.field_of_view_deg < 180:
        raise InputError(f"--field-of-view-deg {options.field_of_view_deg}: expected degrees between 0 and 180")
    from vip_factors.io.export.files import export_format

    for target in options.export:
        export_format(target)


def usual_folder(options: RunOptions) -> Path:
    """Beside the video, or else the first log."""
    source = options.video or options.log[0]
    if not source.name:  # this folder
        source = source.resolve()
    return source.with_name(f"{source.stem if source.is_file() else source.name}_motion")


def steps(options: RunOptions, folder: Path) -> Iterator[Step]:
    """All steps in order."""
    placements: Sequence[str | None] = options.placement or [None] * len(options.log)
    more = _words(options.convert_options)
    each = [_wearer(log, placement) for log, placement in zip(options.log, placements, strict=True)]
    recording = folder / "recording.mcap"
    filmed: Words = ()
    seen: tuple[Path, ...] = ()
    if options.video is not None or options.detections is not None:
        if options.video is not None and options.detections is None:
            yield _detect(options, options.video, folder)
        poses, camera = options.detections or folder / "poses.json", options.camera or folder / "camera.toml"
        video = () if options.video is None else (options.video,)
        filmed, seen = _has_camera(options, poses, camera), (*video, poses, camera)
    if len(each) == 1:
        words, inputs = each[0]
        yield Step("convert", "convert", _put(words, recording, *more, *filmed), (*inputs, *seen), (recording,))
    else:
        parts = [folder / f"wearer{number}.mcap" for number in range(1, len(each) + 1)]
        for (words, inputs), part in zip(each, parts, strict=True):
            yield Step(f"convert {part.stem}", "convert", _put(words, part, *more), inputs, (part,))
        join = [word for part in parts[1:] for word in ("--join", str(part))]
        words = (str(parts[0]), str(recording), *join, *filmed)
        yield Step("convert", "convert", words, (*parts, *seen), (recording,))
    if seen and options.time_offset_s is None:
        synced = folder / "synced.mcap"
        hint = "if you know the offset, give it as --time-offset-s"
        yield Step("sync", "sync", (str(recording), "--out", str(synced)), (recording,), (synced,), hint, True)
        recording = synced
    yield from _results(options, recording, folder)


def _results(options: RunOptions, recording: Path, folder: Path) -> Iterator[Step]:
    """What is made of a recording."""
    estimate, page = folder / ESTIMATE, folder / "report.html"
    # How sure it is comes first in the report.
    assign = ("--assign",) if options.assign else ()
    words = (str(recording), "--out", str(estimate), "--covariance", *assign, *_words(options.smooth_options))
    yield Step("smooth", "smooth", words, (recording,), (estimate,), tells=True)
    if options.report:
        words = (str(estimate), "--recording", str(recording), "--out", str(page))
        yield Step("report", "report", words, (estimate, recording), (page,))
    for target in options.export:
        yield Step(f"export {target.name}", "export", (str(estimate), str(target)), (estimate,), ())


def _detect(options: RunOptions, video: Path, folder: Path) -> Step:
    poses, drawn = folder / "poses.json", folder / "poses.mp4"
    overlay = ("--overlay", str(drawn)) if options.overlay else ()
    words = (str(video), "--out", str(poses), *overlay, *_words(options.detect_options))
    return Step("detect", "detect", words, (video,), (poses, drawn) if options.overlay else (poses,), tells=True)


def _wearer(log: Path, placement: str | None) -> tuple[Words, tuple[Path, ...]]:
    """A log as convert's words, and the files it is read from."""
    if placement is None:
        return (str(log),), (log,)
    return (str(log), "--placement", placement), (log, Path(placement))


def _put(words: Words, recording: Path, *more: str) -> Words:
    """The recording's name behind the log's."""
    return (words[0], str(recording), *words[1:], *more)


def _has_camera(options: RunOptions, poses: Path, camera: Path) -> Words:
    video = () if options.video is None else ("--video", str(options.video))
    rate = () if options.video_rate is None else ("--video-rate", str(options.video_rate))
    words = (*video, "--detections", str(poses), "--camera", str(camera), *rate)
    still = ("--static-camera",) if options.static_camera else ()
    known = () if options.time_offset_s is None else ("--time-offset-s", str(options.time_offset_s))
    return (*words, *still, *known)


def _words(text: str) -> Words:
    try:
        return tuple(shlex.split(text))
    except ValueError as wrong:
        raise InputError(f"{text}: expected options as on a command line; {wrong}") from wrong


def guess_camera(video: Path, field_of_view_deg: float, path: Path) -> None:
    """Write a camera file of a guessed field of view, and say so; the file stays as it is if it says the same.

    Raises:
        InputError, FileFormatError: if the video cannot be opened.
    """
    import math

    from vip_factors.io.camera_file import read_camera_file, write_camera_file
    from vip_factors.io.video import video_size
    from vip_factors.sensors.camera_model import CameraModel

    width, height = video_size(video)
    focal = round(max(width, height) / 2 / math.tan(math.radians(field_of_view_deg) / 2), 1)
    model = CameraModel(width, height, (focal, focal), (width / 2, height / 2))
    note(
        f"note: no --camera is given: a field of view of {field_of_view_deg:g} degrees along the longer side is taken "
        f"(a focal length of {focal:g} px), without distortion: postures hardly suffer, but where the true length is a "
        "tenth more or less, so are distances from the camera; vip-factors calibrate-camera measures it"
    )
    if not path.is_file() or read_camera_file(path) != model:
        how = {"how": f"guessed: a field of view of {field_of_view_deg:g} degrees along the longer side"}
        write_camera_file(path, model, calibration=how, overwrite=True)


def take(step: Step, folder: Path, overwrite: bool = False, main: Main | None = None) -> bool:
    """Run a step unless its outputs are there, made by the same words from the same inputs; say in a line which.

    What the command prints is kept with the words in a file of ``folder``, of which notes are shown, or all of it.

    Args:
        step: to take.
        folder: for such files.
        overwrite: whether files may be replaced that no step wrote.
        main: of the command; that of its module if None.

    Returns:
        Whether it was run.

    Raises:
        InputError: with the step's name, if the command fails by what the user can mend.
    """
    record = folder / f"{step.name.replace(' ', '_')}.json"
    before = _read(record)
    if _is_fresh(step, before):
        _print_steps(step, before, "as before")
        return False
    began = time.perf_counter()
    told = _run(step, overwrite or bool(before), main)
    files = [str(path) for path in step.outputs] or [line for line in told if Path(line).is_file()]
    folder.mkdir(parents=True, exist_ok=True)
    now = {"command": step.line, "version": __version__, "inputs": _stamps(step), "outputs": files, "told": told}
    record.write_text(json.dumps(now, indent=1) + "\n", encoding="utf-8")
    _print_steps(step, now, f"{time.perf_counter() - began:.1f} s")
    return True


def _run(step: Step, overwrite: bool, main: Main | None) -> list[str]:
    """What the command prints, line by line."""
    if main is None:
        main = partial(run_command, step.command)
    printed = io.StringIO()
    hint = f"; {step.hint}" if step.hint else ""
    try:
        with redirect_stdout(printed):
            main(f"vip-factors {step.command}", [*step.words, *(["--overwrite"] if overwrite else [])])
    except VipFactorsError as error:
        raise InputError(f"step {step.name}: {error}{hint}") from error
    except OSError as error:
        raise InputError(f"step {step.name}: {error.filename or step.line}: {error.strerror or error}") from error
    except SystemExit as stop:  # the options were not understood, or help was asked for
        raise InputError(f"step {step.name}: expected options that it knows: {step.line}") from stop
    return printed.getvalue().splitlines()


def _print_steps(step: Step, record: dict[str, Any], when: str) -> None:
    print(f"{step.name:<16} {when:>9}  {'  '.join(record['outputs'])}", flush=True)
    for line in record["told"]:
        if line.startswith("note:") or (step.tells and line not in record["outputs"]):
            print(f"  {line}", flush=True)


def _read(record: Path) -> dict[str, Any]:
    """What was written of a step before; nothing if it was never taken, or the file is none of ours."""
    try:
        content = json.loads(record.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):  # of brackets within brackets
        return {}
    return content if isinstance(content, dict) and all(_are_words(content.get(one)) for one in WORDS) else {}


WORDS = ("outputs", "told")  # of a record


def _are_words(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(one, str) for one in value)


def _is_fresh(step: Step, before: dict[str, Any]) -> bool:
    same = before.get("command") == step.line and before.get("version") == __version__
    return same and before.get("inputs") == _stamps(step) and all(Path(path).is_file() for path in before["outputs"])


def _stamps(step: Step) -> dict[str, list[int]]:
    """Size and time of change of every file that a step reads."""
    return {str(file): _stamp(file) for path in step.inputs for file in _files(path)}


def _stamp(file: Path) -> list[int]:
    status = file.stat()
    return [status.st_size, status.st_mtime_ns]


def _files(path: Path) -> list[Path]:
    """A file; those in a folder; those whose names begin so; without a camera's name behind a colon."""
    if path.is_file():
        return [path]
    if path.is_dir():
        return sorted(one for one in path.rglob("*") if one.is_file())
    if ":" in path.name:
        return _files(path.with_name(path.name.rpartition(":")[0]))
    return sorted(one for one in path.parent.glob(f"{path.name}*") if one.is_file()) if path.parent.is_dir() else []
