"""``vip-factors convert``: foreign sensor logs in, one recording out; with a video's 2D poses, a scene."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from vip_factors.cli.options import UNPREFIXED, Input, Output, WritingOptions
from vip_factors.cli.terminal import note, say, waiting
from vip_factors.errors import InputError
from vip_factors.io.settings import CameraOptions

if TYPE_CHECKING:
    from vip_factors.io.convert import ImportOptions

OF_DETECTOR = {"keypoints", "video_rate", "first_frame"}  # options that hold for further cameras too


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """What is known of a log and its wearer."""

    columns: Path | None = None
    """Column map (.toml) of a log that is a table, or tables, of no known format: which columns hold what, of which
    sensor, in which unit."""
    rate_hz: float | None = None
    """Samples per second of a table or an Xsens export, if it has no times and states no rate, or wrong ones."""
    stature_m: float | None = None
    """Height of the wearer in metres, without shoes; if absent, an adult's stands for it, and a note says so."""
    mass_kg: float | None = None
    """Mass of the wearer in kilograms; it tells widths, mostly."""
    sex: Literal["male", "female"] | None = None
    """Whose proportions the wearer is likely to have; those of both together if absent."""
    segment_lengths_m: dict[str, float] = field(default_factory=dict)
    """Measured lengths in metres, such as: thigh 0.43 shank 0.42; all others follow."""
    subject: str | None = None
    """Name of the wearer."""
    body: Path | None = None
    """Body file (.toml) that vip-factors body wrote of the wearer before, instead of stature, sex and lengths."""
    initial_pose: Literal["t-pose", "n-pose", "none"] | None = None
    """What the wearer held at the first moment kept."""
    pose_from: Annotated[str | None, tyro.conf.arg(metavar="LOG[:SAMPLE]")] = None
    """The initial pose was held in another log of the same sensors, or in one sample (1 is the first) of that log or of
    this one, facing anywhere; it is put before the recording."""
    start_s: float | None = None
    """Seconds of the log to leave out before."""
    end_s: float | None = None
    """Second of the log to end at."""
    format: str | None = None
    """Format of the log; found by its content if absent."""
    then: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="LOG")] = ()
    """Log of the same sensors that follows in time, as a part of the same recording; the pause between them stays. May
    be said several times."""


@dataclass(frozen=True)
class ConvertOptions(LogOptions, WritingOptions):
    """Bring a sensor log of any known format into a recording (MCAP): a file, a folder, or how its files' names begin.

    Say where the sensors sit with --placement; without it their names must tell. For tables of any other make say what
    the columns mean with --columns. First guesses of both files come from --template.

    With --detections and --camera the recording also holds what a 2D pose detector saw in a video. Several wearers:
    convert each log on its own, then join the recordings: convert a.mcap both.mcap --join b.mcap

    A session in several files, one after another, is one recording: convert 1.csv all.mcap --then 2.csv --then 3.csv.

    Several cameras: all but the first stand still where their camera files say (calibrate-camera --floor, with the
    same board in the same place for all of them).
    """

    log: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
    """File or folder: Xsens .txt, .mvnx, DOT .csv, OpenSense .sto, TotalCapture .sensors, ROS 2 .mcap and others."""
    out: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING"), Output(".mcap")] = None
    """Recording (.mcap) to write."""
    template: Annotated[Path | None, tyro.conf.arg(metavar="NAME")] = None
    """Write no recording, but first guesses to correct: NAME_placement.toml, where the sensors sit, and for a table of
    no known format NAME_columns.toml, what its columns mean."""
    placement: Annotated[str | None, Input()] = None
    """Name of a preset (sip6, tnt10, totalcapture13, mvn17) or a placement file (.toml, .json; or
    OpenSense's mapping of sensors to a model's frames, .xml)."""
    name: str | None = None
    """Name of the recording; the log's own if absent."""
    join: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="RECORDING")] = ()
    """Recording (.mcap) of another wearer at the same time, to be part of the scene; may be said several times."""
    filmed: Annotated[CameraOptions, UNPREFIXED, tyro.conf.FlagCreatePairsOff] = field(default_factory=CameraOptions)
    further_camera: Annotated[
        tuple[tuple[Path, Path, float], ...],
        tyro.conf.UseAppendAction,
        tyro.conf.arg(metavar="CAMERA.toml DETECTIONS OFFSET_S"),
    ] = ()
    """Another camera that stands still at the pose over the floor that its file tells, its 2D poses, and the seconds
    to add to its video's times; rate and keypoints are the first one's; may be said several times."""


def main(options: ConvertOptions) -> None:
    """Convert a log as the command line's arguments say."""
    from vip_factors.api import convert
    from vip_factors.cli.terminal import print_tables
    from vip_factors.describe.recordings import recording_tables, scene_tables
    from vip_factors.io.mcap_recording import write_recording

    if options.template is not None:
        _write_templates(options)
        return
    if options.out is None:
        raise InputError("no RECORDING.mcap to write is named: convert LOG RECORDING.mcap, or LOG --template NAME")
    camera = camera_options(options)
    further = [
        CameraOptions(
            detections, file, **{name: getattr(options.filmed, name) for name in OF_DETECTOR}, time_offset_s=offset_s,
            camera_name=file.name.rpartition(":")[2] if ":" in file.name else file.stem,
        )
        for file, detections, offset_s in options.further_camera
    ]  # fmt: skip
    with waiting(f"reading {options.log}"):
        scene = convert(options.log, import_options(options), camera, join=options.join, further_cameras=further)
        if scene.camera is None and len(scene.wearers) == 1:
            write_recording(scene.wearers[0], options.out, overwrite=options.overwrite)
            tables = recording_tables(scene.wearers[0])
        else:
            write_recording(scene, options.out, overwrite=options.overwrite)
            tables = scene_tables(scene)
    print_tables(tables)
    say(options.out)


def import_options(options: ConvertOptions) -> "ImportOptions":
    """What was said of the log and its wearer."""
    from vip_factors.io.convert import ImportOptions

    return ImportOptions(**{field.name: getattr(options, field.name) for field in fields(ImportOptions)})


def _write_templates(options: ConvertOptions) -> None:
    from vip_factors.io.convert_template import write_templates

    assert options.template is not None
    if options.out is not None:
        raise InputError(f"{options.out} given beside --template, which writes no recording: leave one of them out")
    with waiting(f"reading {options.log}"):
        files = write_templates(options.log, options.template, options.overwrite, options.rate_hz)
    columns = f" --columns {files.columns}" if files.columns is not None else ""
    for sentence in files.undeclared:
        note(f"note: {sentence}")
    say("first guesses; check them, then:")
    say(f"  vip-factors convert {options.log} RECORDING.mcap{columns} --placement {files.placement}")
    for path in (files.columns, files.placement):
        if path is not None:
            say(path)


def camera_options(options: ConvertOptions) -> CameraOptions | None:
    """What was said of the camera; None if nothing was.

    Raises:
        InputError: if detections are missing.
    """
    filmed = options.filmed
    if filmed.detections is not None:
        return filmed
    given = [field.name for field in fields(filmed) if getattr(filmed, field.name) != field.default]
    if not given or (options.further_camera and set(given) <= OF_DETECTOR):
        return None
    names = ", ".join("--" + name.replace("_", "-") for name in given)
    raise InputError(f"{names} given without --detections, the 2D poses of the video's frames")
