"""What files hold, and the commands that show it: in words, as a factor graph, as a page, in Rerun or as a picture."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.atomic import atomic_open
from vip_factors.cli.options import (
    RERUN_FILE,
    UNPREFIXED,
    FailOn,
    Flag,
    Output,
    SettingsOptions,
    WritingOptions,
    fail_on,
)
from vip_factors.cli.terminal import note, print_tables, progress_bar, say
from vip_factors.errors import FileFormatError, InputError
from vip_factors.ranges import Range
from vip_factors.settings import Settings
from vip_factors.viz.viewer import check_display

if TYPE_CHECKING:
    from vip_factors.body.kinematics import Motion
    from vip_factors.estimate import Estimate
    from vip_factors.sensors.recording import Recording
    from vip_factors.sensors.scene import Scene
    from vip_factors.tables import Table


@dataclass(frozen=True)
class Opened:
    """Contents of files that belong together; a recording is a scene of one wearer without a camera."""

    scene: "Scene | None" = None
    estimate: "Estimate | None" = None
    motion: "Motion | None" = None

    @property
    def recording(self) -> "Recording | None":
        """The recording, for a scene of one wearer without a camera."""
        scene = self.scene
        return scene.wearers[0] if scene is not None and scene.camera is None and len(scene.wearers) == 1 else None

    @property
    def is_scene(self) -> bool:
        """Whether several wearers or a camera are among it."""
        filmed = self.scene is not None and self.recording is None
        return filmed or (self.estimate is not None and not self.estimate.is_plain)


def open_all(paths: Sequence[Path]) -> Opened:
    """Open files and put together what they hold.

    Raises:
        InputError: if two of them hold a thing of the same kind, or one is missing.
        FileFormatError: if one holds neither a recording, an estimate nor a motion.
    """
    together: dict[str, Motion | Scene | Estimate] = {}
    source: dict[str, Path] = {}
    for path in paths:
        opened = open_one(path)
        for kind, content in vars(opened).items():
            if content is None:
                continue
            if kind in together:
                what = "recording" if kind == "scene" and opened.recording is not None else kind
                raise InputError(f"{path} holds a second {what} beside that of {source[kind]}: give one of each kind")
            together[kind], source[kind] = content, path
    return Opened(**together)  # type: ignore[arg-type]


def open_one(path: Path) -> Opened:
    """Open one file, by its suffix and content."""
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected a file")
    if path.suffix.lower() == ".mcap":
        from vip_factors.io import mcap_estimate, mcap_recording
        from vip_factors.io.mcap_reader import read_contents

        contents = read_contents(path, lambda topic: mcap_estimate.is_read(topic) or mcap_recording.is_read(topic))
        if not (topics := contents.topics):
            raise FileFormatError(f"{path} is empty: expected a recording or an estimate")
        is_estimate = any(topic.startswith(mcap_estimate.ESTIMATE) for topic in topics)
        is_recording = any(topic in ("/recording/info", mcap_recording.SCENE_INFO) for topic in topics)
        scene = mcap_recording.read_scene(contents) if is_recording or not is_estimate else None
        return Opened(scene, mcap_estimate.read_estimate(contents) if is_estimate else None)
    from vip_factors.io.motions.files import MOTION_SUFFIXES, read_motion

    if path.suffix.lower() not in MOTION_SUFFIXES:
        suffixes = ", ".join((".mcap", *MOTION_SUFFIXES))
        raise InputError(
            f"{path}: expected a file that ends in {suffixes}; vip-factors convert brings sensor logs into .mcap"
        )
    return Opened(motion=read_motion(path))


READ_S = 300.0  # seconds of a recording that are read: of longer ones the index tells, in a second instead of minutes


@dataclass(frozen=True)
class InfoOptions:
    """Summarise a recording, an estimate or a motion: wearers, sensors, duration and gaps.

    A scene also lists cameras and detections. For a recording without a camera above five minutes, only the file's
    index is read.
    """

    file: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = None
    """Recording or estimate (.mcap), or motion (.bvh …)."""
    sites: Flag = False
    """Print the sensor sites and their default axes, instead of a file."""
    verbose: Flag = False
    """Also print the iterations and costs of each solve of an estimate."""


def execute_info(options: InfoOptions) -> None:
    """Run ``vip-factors info``."""

    if (options.file is None) != options.sites:
        raise InputError("info takes either a FILE or --sites")
    if options.file is not None:
        print_tables(file_tables(options.file, options.verbose))
        return
    from vip_factors.describe.recordings import site_table

    print_tables([site_table()])


def file_tables(path: Path, verbose: bool = False) -> Iterator["Table"]:
    """Facts about a recording, an estimate or a motion."""
    from vip_factors.describe.estimates import estimate_tables
    from vip_factors.describe.recordings import motion_facts, recording_tables, scene_tables
    from vip_factors.tables import facts

    if path.suffix.lower() == ".mcap":
        from vip_factors.io.mcap_source import indexed_recording

        index = indexed_recording(path, READ_S)
        if index is not None:
            yield from recording_tables(index.head, index.time, index.truth_frames)
            yield facts("", ("note", "from the file's index; samples between first and last were not read"))
            return
    opened = open_one(path)
    if opened.recording is not None:
        yield from recording_tables(opened.recording)
    elif opened.scene is not None:
        yield from scene_tables(opened.scene)
    if opened.estimate is not None:
        yield from estimate_tables(opened.estimate, verbose)
    if opened.motion is not None:
        yield motion_facts(opened.motion, f"motion '{opened.motion.name}'")


@dataclass(frozen=True)
class GraphOptions(SettingsOptions, WritingOptions):
    """Draw three frames of a recording's factor graph, and count its variables and factors.

    The graph is that of the calibration, at the calibration rate. Without Graphviz a .dot file is written.

    Every setting of the pipeline is an option; --settings reads them from a file, and options win over it.
    """

    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap); vip-factors convert makes one from foreign files."""
    picture: Annotated[Path | None, Output(".svg")] = None
    """Picture (.svg) to write; default: RECORDING.graph.svg."""
    frame: Annotated[int | None, Range(least=0)] = None
    """First of the three frames, counted from 0; default: the middle of the recording."""
    settings: Annotated[Settings, UNPREFIXED] = field(default_factory=Settings)


def execute_graph(options: GraphOptions) -> None:
    """Run ``vip-factors graph``."""
    from vip_factors.io.mcap_recording import read_scene

    picture = options.target(options.picture, options.recording, ".graph.svg")
    scene = read_scene(options.recording)
    from vip_factors.factor_graph.dot import dot, svg
    from vip_factors.pipeline import factor_graph
    from vip_factors.tables import Table

    with progress_bar() as progress:
        graph = factor_graph(scene, options.settings, progress)
    text = dot(graph, f"Factor graph of {scene.name}", options.frame)
    drawing = svg(text)
    if drawing is None:
        picture, drawing = picture.with_suffix(".dot"), text.encode()
    with atomic_open(picture, "wb", options.overwrite) as file:
        file.write(drawing)
    seconds = graph.time[-1] - graph.time[0]
    say(f"{len(graph.time)} frames in {seconds:.2f} s, of {', '.join(scene.names)}")
    kinds = (("variables", graph.variable_counts), ("factors", graph.factor_counts))
    print_tables(
        Table((name, str(sum(counts.values()))), [(kind, str(count)) for kind, count in counts.items()])
        for name, counts in kinds
    )
    say(picture)
    if picture.suffix == ".dot":
        note(f"Graphviz did not lay the picture out: install it, then dot -Tsvg -O {picture}")


@dataclass(frozen=True)
class ReportOptions(WritingOptions):
    """Write one HTML page: verdict, findings, results with uncertainty, and a 3D view.

    The page needs no network. --recording adds sensors, gaps and video.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap)."""
    recording: Path | None = None
    """Recording (.mcap) of the estimate; default: the one in the estimate's file."""
    truth: Path | None = None
    """Recording (.mcap) with the truth; default: --recording."""
    video: Annotated[tuple[Path, ...] | None, tyro.conf.arg(metavar="[FILM …]")] = None
    """Also write a film (.mp4) for each camera, with skeletons over the given videos or those of the recording; needs
    vip-factors[film]."""
    video_height: Annotated[int, Range(least=64, most=2160)] = 480
    """Height of the film in pixels."""
    video_seconds: tuple[float, float] | None = None
    """First and last second of the film; default: the whole recording."""
    out: Annotated[Path | None, Output(".html")] = None
    """Page (.html) to write; default: beside the estimate."""
    fail_on: FailOn = "never"
    """Exit with code 3 if the verdict is this or worse; files are written anyway."""


def execute_report(options: ReportOptions) -> None:
    """Run ``vip-factors report``."""
    out = options.target(options.out, options.estimate, ".html")
    if options.video is not None:
        from vip_factors.viz.film import check_film

        check_film(out.with_suffix(".mp4"))
    from vip_factors.io.mcap_recording import read_scene

    with progress_bar() as progress:
        progress("reading", 0.0)
        opened = open_one(options.estimate)
        if (estimate := opened.estimate) is None:
            raise InputError(f"{options.estimate} holds no estimate: expected a file of vip-factors smooth")
        scene = opened.scene if options.recording is None else read_scene(options.recording)
        truth = None if options.truth is None else read_scene(options.truth)
        from vip_factors.report.page import write_report  # late: input is checked first

        for camera in scene.cameras if options.video == () and scene is not None else ():
            video = camera.video
            if video is not None and video.path is not None and not video.path.is_file() and not video.images:
                note(f"note: no video at {video.path}: the film has a plain ground instead; --video FILM names it")
        films = write_report(
            estimate,
            out,
            scene,
            truth,
            options.overwrite,
            progress,
            options.video or options.video is not None,
            video_height=options.video_height,
            video_seconds=options.video_seconds,
        )
    say(out)
    for path in films:
        say(path)
    fail_on(options.fail_on, estimate.verdict)


INSTEAD_OF_A_WINDOW = "--save FILE.rrd or --picture"


@dataclass(frozen=True)
class ViewOptions(WritingOptions):
    """Show recordings and estimates in Rerun, or write them as a file or picture.

    With an estimate and its recording, the viewer also shows sensors, truth, video, assigned detections and bodies over
    the image.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE [FILE …]")]
    """Recording or scene, estimate (.mcap), motion (.bvh …): one of each kind at most."""
    save: Annotated[Path | None, RERUN_FILE] = None
    """Write a Rerun file (.rrd) instead of opening the viewer."""
    picture: Annotated[Path | None, Output(".png")] = None
    """Write a picture (.png): poses in a row, or frames of the video; needs no display."""


def execute_view(options: ViewOptions) -> None:
    """Run ``vip-factors view``."""
    if not options.files:
        raise InputError("no file given: expected a recording, an estimate or a motion")
    opened = open_all(options.files)
    in_a_window = options.save is None and options.picture is None
    if in_a_window:
        check_display(INSTEAD_OF_A_WINDOW)
    if opened.is_scene and opened.motion is not None:
        raise InputError(f"a motion ('{opened.motion.name}') beside a scene: expected the scene's own file for truth")
    from vip_factors.viz.drawn_scene import drawn_scene, drawn_wearer

    if opened.is_scene:
        drawn = drawn_scene(opened.scene, opened.estimate)
    else:
        estimate = None if opened.estimate is None else opened.estimate.wearer()
        drawn = drawn_wearer(opened.recording, estimate, opened.motion)
    if options.picture is not None:
        from vip_factors.viz.picture import filmstrip

        filmstrip(drawn, options.picture, overwrite=options.overwrite)
        say(options.picture)
    if options.save is not None or in_a_window:
        from vip_factors.viz.rerun_view import show

        show(drawn, options.save, options.overwrite)
    if options.save is not None:
        say(options.save)
