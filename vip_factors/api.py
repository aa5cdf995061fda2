"""The package in a page of functions, for scripts and notebooks: ``import vip_factors as vip``.

A recording of one wearer and a filmed scene of several are both a :class:`~vip_factors.sensors.scene.Scene` here, so
that one set of functions does. Commands of the same names call what these call.

Functions that write replace existing files only with ``overwrite``. What cannot be read, used or written raises an
:class:`~vip_factors.errors.InputError` (or a kind of it), whose message says what was expected.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from vip_factors.body.kinematics import Motion
from vip_factors.detect.settings import DetectSettings
from vip_factors.display import ProgressCallback, silent
from vip_factors.errors import InputError
from vip_factors.estimate import Moved, WearerEstimate, as_estimate
from vip_factors.io.convert import ImportOptions
from vip_factors.io.settings import CameraOptions, ExportSettings, LiveSourceSettings
from vip_factors.repetitions.repetition import WearerRepetitions
from vip_factors.repetitions.repetitions import repetitions_of
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene, as_scene
from vip_factors.simulate.settings import CameraKind, SceneSettings

if TYPE_CHECKING:  # these take a while, and not every command that calls a function of this page needs them
    from vip_factors.evaluate.evaluation import Evaluation
    from vip_factors.factor_graph.extra import ExtraFactors
    from vip_factors.gait.results import Gait
    from vip_factors.gait.strides import Unsteady
    from vip_factors.io.live_server import LiveServer
    from vip_factors.live_estimate import LiveEstimate
    from vip_factors.settings import LiveSettings

StrPath = str | PathLike[str]
GESTURES, WALK = "gestures", "walk"  # in place of a motion: the package's own
SECONDS = 20.0  # of it
OUT_OF_STEP_S = 3.7  # between people who show the package's own motion; no multiple of its periods
BYSTANDER_REACH_M = 3.0  # from the middle: some pass between camera and wearers, some leave the image
POSE_ERROR_DEG = 3.0
LIVE_LIMITS = LiveSourceSettings()


def read(path: StrPath, *then: StrPath) -> Scene:
    """Read a recording or scene (.mcap) that :func:`write`, :func:`convert` or the command line wrote.

    Args:
        path: the file.
        then: files that continue the same recording in time, without a camera.

    Example:
        >>> path = vip.write(scene, "walk.mcap")
        >>> vip.read(path).name
        'simulated'
    """
    from vip_factors.io.scene_building import read_scenes

    return read_scenes([Path(path), *map(Path, then)])


def write(content: Recording | Scene | Moved, path: StrPath, overwrite: bool = False) -> Path:
    """Write a recording, a scene or an estimate to an MCAP file, with its truth if it has one."""
    from vip_factors.io.mcap_estimate import write_estimate
    from vip_factors.io.mcap_recording import write_recording

    if isinstance(content, Recording | Scene):
        write_recording(as_scene(content), path, overwrite=overwrite)
    else:
        write_estimate(as_estimate(content), path, overwrite=overwrite)
    return Path(path)


def convert(
    log: StrPath,
    options: ImportOptions | None = None,
    cameras: CameraOptions | Sequence[CameraOptions] = (),
    *,
    join: Sequence[StrPath] = (),
) -> Scene:
    """Read a sensor log as a recording: Xsens, MVNX, OpenSense, TotalCapture, ROS 2 or a table.

    Args:
        log: file or folder.
        options: placement of the sensors, stature, initial pose and columns.
        cameras: one or several cameras that filmed the wearers: 2D poses and the known properties of each.
        join: recordings (.mcap) of other wearers at the same time.

    Raises:
        InputError: if a file cannot be read or contradicts the options.
    """
    from vip_factors.io.scene_building import add_cameras, join_wearers, read_log_as_scene

    options = options or ImportOptions()
    scene = read_log_as_scene(Path(log), options)
    if join:
        recordings = [read_log_as_scene(Path(path), ImportOptions()) for path in join]
        scene = join_wearers([scene, *recordings], options.name)
    several = [cameras] if isinstance(cameras, CameraOptions) else list(cameras)
    return add_cameras(scene, several) if several else scene


def sync(scene: Scene, max_offset: float = 10.0) -> Scene:
    """Estimate the offset between the clock of each video and the sensors' clock, from the motion of the wearers.

    Args:
        scene: wearers and cameras.
        max_offset: largest offset that is searched, in seconds, in both directions.

    Raises:
        InputError: if the motion does not determine an offset.
    """
    from vip_factors.initialise.clock import find_clock_offset

    for number, camera in enumerate(scene.cameras):
        offset = find_clock_offset(scene, max_offset, number)
        if not offset.determined:
            raise InputError(f"scene '{scene.name}', camera '{camera.name}': {offset.sentence}")
        scene = with_clock(scene, offset.clock, number)
    return scene


def with_clock(scene: Scene, clock: VideoClock, number: int = 0) -> Scene:
    """Return the scene with another clock for the video of camera ``number``."""
    cameras = list(scene.cameras)
    cameras[number] = replace(cameras[number], clock=clock)
    return replace(scene, cameras=tuple(cameras))


def detect(
    video: StrPath,
    settings: DetectSettings | None = None,
    *,
    out: StrPath | None = None,
    overwrite: bool = False,
    progress: ProgressCallback = silent,
) -> Detections:
    """Detect and track the 2D poses of all people in a video.

    Args:
        video: file (.mp4, .mov …).
        settings: detector and tracking.
        out: optional file (.json) for the poses, which ``convert`` and ``run`` read.
        progress: callback with the name of the stage and the fraction that is done.
    """
    from vip_factors.detect.video import detect_people

    target = None if out is None else Path(out)
    poses = detect_people(Path(video), settings or DetectSettings(), progress, out=target, overwrite=overwrite)
    return poses.detections


Played = Motion | StrPath
"""A motion, a motion file (.bvh …), or the words ``"gestures"`` and ``"walk"`` for what the package makes."""


def simulate(
    motion: Played | Sequence[Played] = GESTURES,
    placement: str = "totalcapture13",
    camera: CameraKind | None = None,
    seconds: float | None = None,
    seed: int = 0,
    *,
    settings: SceneSettings | None = None,
    initial_pose: Literal["none", "n-pose", "t-pose"] = "n-pose",
    pose_error_deg: float = POSE_ERROR_DEG,
    bystanders: int = 0,
    names: Sequence[str] = (),
    name: str = "simulated",
) -> Scene:
    """Simulate the sensors of one or several people, and a 2D pose detector; the result holds the truth.

    Args:
        motion: motion of each wearer.
        placement: preset: sip6, tnt10, totalcapture13 or mvn17.
        camera: kind of camera; None simulates sensors only.
        seconds: length of the package's own motion (20 by default). With a camera, files are repeated or cut to it.
        seed: seed of all errors.
        settings: cameras, detector and sensor errors; ``camera`` takes precedence over its camera.
        initial_pose: pose that the wearers hold first.
        pose_error_deg: standard deviation of each joint and axis in that pose; 3 adds up to 10 to 15 at the hands.
        bystanders: number of people without sensors in the picture.
        names: names of the wearers.
        name: name of the recording.

    Example:
        >>> scene = vip.simulate("walk", "sip6", camera="hand-held", seconds=4.0, seed=1)
        >>> len(scene.wearers), len(scene.cameras), len(scene.wearers[0].imus)
        (1, 1, 6)
    """
    from vip_factors.sensors.calibration import preset
    from vip_factors.simulate.recording import simulate_recording
    from vip_factors.simulate.scene import Performer, simulate_scene
    from vip_factors.simulate.staging import from_time, lasting, staged, with_initial_pose

    def posed(clip: Motion, number: int) -> Motion:
        if initial_pose == "none":
            return clip
        return with_initial_pose(clip, initial_pose, pose_error_deg=pose_error_deg, seed=seed + number)

    settings = settings or SceneSettings()
    sources = list(motion) if isinstance(motion, Sequence) and not isinstance(motion, str) else [motion]
    clips = [_played(source, seconds, number) for number, source in enumerate(sources)]
    if camera is None:
        if len(clips) > 1 or bystanders:
            raise InputError(f"{len(clips)} wearers and {bystanders} bystanders: expected one wearer without a camera")
        posed_motion = posed(clips[0], 0)
        worn = preset(placement, posed_motion.skeleton)
        recording = simulate_recording(posed_motion, worn, settings.imu, seed, name, initial_pose)
        if names:
            recording = replace(recording, subject=replace(recording.subject, name=names[0]))
        return as_scene(recording)
    if bystanders < 0:
        raise InputError(f"{bystanders} bystanders: expected 0 or more")
    if seconds is not None:
        clips = [lasting(clip, seconds) for clip in clips]
    wearers = staged([posed(clip, number) for number, clip in enumerate(clips)], seed)
    length = max(wearer.time[-1] for wearer in wearers)
    shifts = [OUT_OF_STEP_S * (number + 1) for number in range(bystanders)]
    passing = [from_time(lasting(clips[n % len(clips)], length + shift), shift) for n, shift in enumerate(shifts)]
    called = [*names, *(f"wearer_{number}" for number in range(len(names) + 1, len(wearers) + 1))]
    performers = [
        Performer(who, wearer, preset(placement, wearer.skeleton), initial_pose)
        for who, wearer in zip(called, wearers, strict=True)
    ]
    for number, bystander in enumerate(staged(passing, seed + 1, wearers, BYSTANDER_REACH_M), start=1):
        performers.append(Performer(f"bystander_{number}", bystander))
    return simulate_scene(performers, replace(settings, camera=camera), seed, name)


def _played(source: Played, seconds: float | None, number: int) -> Motion:
    """A motion; of the package's own one out of step with that of others."""
    if isinstance(source, Motion):
        return source
    if source not in (GESTURES, WALK):
        from vip_factors.io.motions.files import read_motion

        return read_motion(Path(source))
    from vip_factors.simulate.gestures import gestures
    from vip_factors.simulate.staging import from_time

    shift = OUT_OF_STEP_S * number
    return from_time(gestures((SECONDS if seconds is None else seconds) + shift, straight=source == WALK), shift)


def evaluate(estimate: Moved, truth: Recording | Scene) -> "Evaluation":
    """Compare an estimate with the truth of a recording; ``print`` shows the most important errors first.

    Args:
        estimate: result of :func:`smooth`, or a motion on the recording's clock.
        truth: recording that holds the truth.

    Example:
        >>> (wearer,) = vip.evaluate(estimate, scene).wearers.values()
        >>> wearer.metrics["mpjpe"].unit
        'mm'
    """
    from vip_factors.evaluate.evaluation import evaluate_scene

    return evaluate_scene(as_estimate(estimate), as_scene(truth))


def gait(
    estimate: Moved,
    recording: Recording | Scene | None = None,
    *,
    count: Collection["Unsteady"] = (),
    out: StrPath | None = None,
    overwrite: bool = False,
) -> "tuple[Gait, ...]":
    """Compute gait events, strides, spatio-temporal parameters with their ±, and joint angles over the gait cycle.

    Args:
        estimate: of one or several wearers.
        recording: the recording behind it; foot sensors give more accurate events and lengths than the motion.
        count: unsteady strides that count in the means as well: ``start``, ``stop``, ``turn``, ``pause``.
        out: optional folder for tables, JSON and a picture.

    Example:
        >>> (walk,) = vip.gait(estimate, scene)
        >>> sorted({stride.side for stride in walk.strides})
        ['left', 'right']
    """
    from vip_factors.gait.analysis import gaits_of
    from vip_factors.gait.files import write_gait

    gaits = gaits_of(as_estimate(estimate), None if recording is None else as_scene(recording), count)
    if out is not None:
        write_gait(gaits, Path(out), overwrite)
    return gaits


def repetitions(
    estimate: Moved, *, out: StrPath | None = None, overwrite: bool = False
) -> tuple[WearerRepetitions, ...]:
    """Detect squats, lunges, jumps and curls: times, depth, tempo, ranges, symmetry and height, with ±.

    Args:
        estimate: of one or several wearers.
        out: optional folder for a table, JSON and a picture.

    Example:
        >>> [len(wearer.repetitions) for wearer in vip.repetitions(estimate)]
        [0]
    """
    wearers = tuple(map(repetitions_of, as_estimate(estimate).wearers))
    if out is not None:
        from vip_factors.repetitions.files import write_repetitions

        write_repetitions(wearers, Path(out), overwrite)
    return wearers


def export(
    estimate: Moved, path: StrPath, settings: ExportSettings | None = None, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write an estimate to a file of another program; the suffix selects the format.

    Args:
        estimate: of one or several wearers.
        path: the file; formats for one person get one file per wearer.
        settings: format options.

    Example:
        >>> [path.name for path in vip.export(estimate, "walk.bvh")]
        ['walk.bvh']
    """
    from vip_factors.io.export.files import export as export_file

    return export_file(as_estimate(estimate), Path(path), settings or ExportSettings(), overwrite)


def report(
    estimate: Moved,
    path: StrPath,
    recording: Recording | Scene | None = None,
    *,
    truth: Recording | Scene | None = None,
    overwrite: bool = False,
    video: bool | StrPath | Sequence[StrPath] = False,
    video_height: int = 480,
    video_seconds: tuple[float, float] | None = None,
) -> Path:
    """Write an estimate as an HTML page to read and print, optionally with a film beside it.

    Args:
        estimate: of one or several wearers.
        path: the page.
        recording: the recording behind it; the page then covers sensors and video as well.
        truth: recording that holds the truth, if ``recording`` does not.
        video: True for films (.mp4) of skeletons over the recording's own videos, or video files, one for each camera.
        video_height: height of the film in pixels.
        video_seconds: first and last second of the recording in the film; None for all of it.

    Example:
        >>> vip.report(estimate, "walk.html", scene).name
        'walk.html'
    """
    from vip_factors.report.page import write_report

    scene, true = (None if source is None else as_scene(source) for source in (recording, truth))
    content = as_estimate(estimate), path, scene, true, overwrite, None, video
    write_report(*content, video_height=video_height, video_seconds=video_seconds)
    return Path(path)


def stream(
    source: StrPath,
    settings: "LiveSettings | None" = None,
    *,
    follow: bool = False,
    real_time: bool = False,
    token_file: Path | None = None,
    limits: LiveSourceSettings = LIVE_LIMITS,
    extra_factors: "ExtraFactors | None" = None,
) -> Iterator["LiveEstimate"]:
    """Track a live source and yield an estimate per frame until it ends, as the command ``stream`` does.

    Args:
        source: recording (.mcap), ``-`` for standard input, or ``ws://host:port`` to listen there.
        settings: all settings of the tracker.
        follow: whether another program is still writing the file.
        real_time: whether a recording plays at its own speed rather than as fast as possible.
        token_file: file with a secret that senders must present.
        limits: limits for senders.
        extra_factors: function that makes your own GTSAM factors.
    """
    from vip_factors.io.live_open import open_source, read_token
    from vip_factors.live.stream import Stream
    from vip_factors.settings import LiveSettings

    token = read_token(token_file)
    with open_source(source, follow=follow, real_time=real_time, settings=limits, token=token) as opened:
        tracked = Stream(opened.setup, settings or LiveSettings(), extra_factors, real_time=not opened.is_played)
        for message in opened:
            yield from tracked.take(message, opened.waited_s)
        yield from tracked.finish()


def serve(worn: Recording | Scene, port: int = 8080, host: str = "127.0.0.1", token: str = "") -> "LiveServer":
    """Start a web page that shows the frames of a stream and serves them as JSON; ``close`` it at the end.

    Args:
        worn: wearers and their sensors, as in the stream.
        port: port of the page.
        host: address to listen on: this machine (127.0.0.1) or all its networks (0.0.0.0).
        token: secret for readers. Without it, readers on this machine need none, and others get a generated one.
    """
    from vip_factors.io.live_server import LiveServer
    from vip_factors.report.page import live_page

    return LiveServer(as_scene(worn), live_page(as_scene(worn)), port, host, token)


def picture(
    shown: Moved | Recording | Scene,
    path: StrPath,
    recording: Recording | Scene | None = None,
    *,
    title: str | None = None,
    poses: int = 6,
    overwrite: bool = False,
) -> Path:
    """Draw a filmstrip (.png): poses in a row, or frames of the video with the bodies drawn over them.

    Args:
        shown: an estimate, a motion, or a recording with its truth.
        path: the picture.
        recording: the recording behind an estimate; sensors, video and truth are drawn as well.
        title: title of the picture.
        poses: number of poses, evenly spaced in time.

    Example:
        >>> vip.picture(estimate, "walk.png", scene).name
        'walk.png'
    """
    from vip_factors.viz.drawn_scene import drawn_scene, drawn_wearer
    from vip_factors.viz.picture import filmstrip

    measured = shown if isinstance(shown, Recording | Scene) else recording
    scene = None if measured is None else as_scene(measured)
    estimate = None if isinstance(shown, Recording | Scene) else as_estimate(shown)
    if scene is not None and scene.camera is not None and not isinstance(shown, WearerEstimate | Motion):
        drawn = drawn_scene(scene, estimate)
    else:
        wearer = None if estimate is None else estimate.wearer()
        drawn = drawn_wearer(None if scene is None else scene.wearers[0], wearer)
    filmstrip(drawn, Path(path), frames=poses, title=title, overwrite=overwrite)
    return Path(path)
