"""``vip-factors convert``: a recording from sensor logs, with 2D poses a scene; ``detect``: 2D poses from a video."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.cli.options import UNPREFIXED, Input, Output, WritingOptions, beside
from vip_factors.cli.terminal import note, print_tables, progress_bar, say, waiting
from vip_factors.detect.settings import DetectSettings
from vip_factors.errors import InputError
from vip_factors.io.settings import CameraOptions, LogOptions

if TYPE_CHECKING:
    from vip_factors.io.convert import ImportOptions

# Options of a camera that several cameras have each for itself: said once they stand for all, else for each in turn.
PATHS = Annotated[tuple[Path, ...], tyro.conf.UseAppendAction]
TEXTS = Annotated[tuple[str, ...], tyro.conf.UseAppendAction]
OF_EACH_CAMERA = {
    "detections": PATHS,
    "camera": PATHS,
    "video": PATHS,
    "keypoints": TEXTS,
    "camera_name": TEXTS,
    "camera_path": PATHS,
    "video_rate": Annotated[tuple[float, ...], tyro.conf.UseAppendAction],
    "time_offset_s": Annotated[tuple[float, ...], tyro.conf.UseAppendAction],
    "first_frame": Annotated[tuple[int, ...], tyro.conf.UseAppendAction],
}
OF_ONE_CAMERA = ("detections", "video", "camera_name")  # of these, what two cameras cannot share
OF_CARRIED_CAMERA = "camera_path"  # said for each camera that does not stand still
CameraArguments = make_dataclass(
    "CameraArguments",
    [(name, hint, field(default=())) for name, hint in OF_EACH_CAMERA.items()],
    bases=(CameraOptions,),
    frozen=True,
)
"""What filmed a scene: the options of one camera or of several."""


@dataclass(frozen=True, kw_only=True)
class LogArguments(LogOptions):
    """Options of a log and its wearer, as words of the command line."""

    pose_from: Annotated[str | None, tyro.conf.arg(metavar="LOG[:SAMPLE]")] = None
    then: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="LOG")] = ()


@dataclass(frozen=True)
class ConvertOptions(LogArguments, WritingOptions):
    """Convert a sensor log to a recording (MCAP). LOG is a file, a folder, or the common start of the file names.

    --placement gives the sites of the sensors; without it, their names must state the sites. --columns describes a
    table of unknown format. --template writes a first version of both files.

    --detections and --camera add the 2D poses of a video. Several wearers: convert each log, then join the recordings:
    convert a.mcap both.mcap --join b.mcap

    Consecutive files of a session: convert 1.csv all.mcap --then 2.csv --then 3.csv

    Several cameras: repeat --detections for each. Give --camera, --video-rate, --keypoints, --first-frame and
    --time-offset-s once for all cameras, or once for each in the same order, and --camera-path once for each carried
    camera. --camera-imu belongs to the first camera.
    """

    log: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
    """File or folder: Xsens .txt, .mvnx, DOT .csv, OpenSense .sto, TotalCapture .sensors, ROS 2 .mcap and others."""
    out: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING"), Output(".mcap")] = None
    """Recording (.mcap) to write."""
    template: Annotated[Path | None, tyro.conf.arg(metavar="NAME")] = None
    """Write a first version of NAME_placement.toml and, for a table of unknown format, NAME_columns.toml, instead of a
    recording."""
    placement: Annotated[str | None, Input()] = None
    """Sites of the sensors: preset (sip6, tnt10, totalcapture13, mvn17) or placement file (.toml, .json, or OpenSense's
    sensor mapping .xml)."""
    name: str | None = None
    """Name of the recording; default: that of the log."""
    join: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="RECORDING")] = ()
    """Recording (.mcap) of another wearer at the same time. Repeatable."""
    camera_options: Annotated[CameraOptions, UNPREFIXED, tyro.conf.FlagCreatePairsOff] = field(
        default_factory=CameraArguments
    )
    carried_camera: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="NAME")] = ()
    """Name of a camera that is carried although --static-camera is given. Repeatable."""


def execute_convert(options: ConvertOptions) -> None:
    """Run ``vip-factors convert``."""
    from vip_factors.api import convert
    from vip_factors.describe.recordings import recording_tables, scene_tables
    from vip_factors.io.mcap_recording import write_recording

    if options.template is not None:
        _write_templates(options)
        return
    if options.out is None:
        raise InputError("no RECORDING.mcap to write is named: convert LOG RECORDING.mcap, or LOG --template NAME")
    cameras = camera_options(options)
    with waiting(f"reading {options.log}"):
        scene = convert(options.log, import_options(options), cameras, join=options.join)
        if scene.camera is None and len(scene.wearers) == 1:
            write_recording(scene.wearers[0], options.out, overwrite=options.overwrite)
            tables = recording_tables(scene.wearers[0])
        else:
            write_recording(scene, options.out, overwrite=options.overwrite)
            tables = scene_tables(scene)
    print_tables(tables)
    say(options.out)


def import_options(options: ConvertOptions) -> "ImportOptions":
    """The options of the log and its wearer."""
    from vip_factors.io.convert import ImportOptions

    return ImportOptions(**{field.name: getattr(options, field.name) for field in fields(ImportOptions)})


def _write_templates(options: ConvertOptions) -> None:
    from vip_factors.io.convert import write_templates

    assert options.template is not None
    if options.out is not None:
        raise InputError(f"{options.out} given beside --template, which writes no recording: leave one of them out")
    with waiting(f"reading {options.log}"):
        files = write_templates(options.log, options.template, options.overwrite, options.rate_hz)
    columns = f" --columns {files.columns}" if files.columns is not None else ""
    for sentence in files.undeclared:
        note(f"note: {sentence}")
    say("check these files, then run:")
    say(f"  vip-factors convert {options.log} RECORDING.mcap{columns} --placement {files.placement}")
    for path in (files.columns, files.placement):
        if path is not None:
            say(path)


def camera_options(options: ConvertOptions) -> list[CameraOptions]:
    """The options of each camera, in turn; none without options of cameras.

    Raises:
        InputError: if detections are missing, or options do not fit their number.
    """
    from vip_factors.io.camera_file import read_camera_file

    declared, cameras = options.camera_options, list[CameraOptions]()
    values = {field.name: getattr(declared, field.name) for field in fields(declared)}
    given_options = [field.name for field in fields(declared) if values[field.name] != field.default]
    count = len(values["detections"])
    if given_options and not count:
        words = ", ".join(_option(name) for name in given_options)
        raise InputError(f"{words} given without --detections, the 2D poses of the video's frames")
    for name in (name for name in OF_EACH_CAMERA if name != OF_CARRIED_CAMERA):
        if len(values[name]) not in ({0, count} if name in OF_ONE_CAMERA else {0, 1, count}):
            raise InputError(
                f"{_option(name)} is said {len(values[name])} times of {count} cameras (--detections): expected "
                f"{'one' if name in OF_ONE_CAMERA else 'one for all, or one'} for each"
            )
    names = values["camera_name"] or (["camera"] if count == 1 else _names(values["detections"]))
    unknown = sorted(set(options.carried_camera) - set(names))
    if unknown:
        raise InputError(f"--carried-camera {unknown[0]}: expected the name of a camera: {', '.join(names)}")
    carried = [name for name in names if not declared.static_camera or name in options.carried_camera]
    paths = values[OF_CARRIED_CAMERA]
    if len(paths) not in (0, len(carried)):
        raise InputError(
            f"--camera-path is said {len(paths)} times: expected one path for each camera that is carried, of which "
            f"there are {len(carried)} here ({', '.join(carried) or 'all stand still'})"
        )
    for number, name in enumerate(names):
        camera_values = {key: values[key][number % len(values[key])] for key in OF_EACH_CAMERA if values[key]}
        camera_values |= {OF_CARRIED_CAMERA: paths[carried.index(name)] if paths and name in carried else None}
        shared = {key: values[key] for key in values if key not in OF_EACH_CAMERA and (number == 0 or "imu" not in key)}
        shared["static_camera"] = name not in carried
        if count > 1 and declared.known_camera_pose and "camera" in camera_values:
            shared["known_camera_pose"] = read_camera_file(camera_values["camera"]).floor is not None
        cameras.append(CameraOptions(**shared | camera_values | {"camera_name": name}))
    return cameras


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _names(detections: Sequence[Path]) -> list[str]:
    """Names of several cameras: those of the files of their detections, or else of the folders that these are in."""
    for parts in ([path.stem for path in detections], [path.resolve().parent.name for path in detections]):
        if len(set(parts)) == len(parts):
            return parts
    return [f"camera {number + 1}" for number in range(len(detections))]


@dataclass(frozen=True)
class DetectOptions(WritingOptions):
    """Detect and track the 2D poses of all people in a video.

    The file has MMPose's format, with keypoint names, frame times and a track number per person, for convert
    --detections. Needs: pip install 'vip-factors[detect]'.

    The model is BlazePose with 33 keypoints, downloaded once with pip; --model uses another ONNX model.
    """

    video: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="VIDEO")]
    """Video (.mp4, .mov …)."""
    out: Annotated[Path | None, Output(".json")] = None
    """File (.json) to write; VIDEO.poses.json if absent."""
    overlay: Annotated[Path | None, Output(".mp4")] = None
    """Also write the video (.mp4) with the poses drawn over it."""
    settings: Annotated[DetectSettings, UNPREFIXED] = field(default_factory=DetectSettings)


def execute_detect(options: DetectOptions) -> None:
    """Run ``vip-factors detect``."""
    from vip_factors.detect.video import detect_people, poses_summary

    out = options.out or beside(options.video, ".poses.json")
    with progress_bar() as progress:
        poses = detect_people(
            options.video, options.settings, progress, out=out, overlay=options.overlay, overwrite=options.overwrite
        )
    say("\n".join(poses_summary(poses)))
    for path in filter(None, (out, options.overlay)):
        say(path)
