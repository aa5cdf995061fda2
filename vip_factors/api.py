"""The package in a page of functions, for scripts and notebooks: ``import vip_factors as vip``.

A recording of one wearer and a filmed scene of several are both a :class:`~vip_factors.sensors.scene.Scene` here, so
that one set of functions does. Commands of the same names call what these call.

With ``overwrite`` files that exist are replaced. What cannot be read, used or written raises an
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
from vip_factors.repetitions.repetitions import all_repetitions
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene, as_scene
from vip_factors.simulate.settings import CameraKind, SceneSettings

if TYPE_CHECKING:  # these take a while, and not every command that calls a function of this page needs them
    from vip_factors.evaluate.evaluation import Evaluation
    from vip_factors.factor_graph.extra import ExtraFactors
    from vip_factors.gait.analysis import Gait
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
    """A recording or scene (.mcap) that :func:`write`, :func:`convert` or the command line made.

    Args:
        path: of the file.
        then: parts of the same recording that follow in time, of one without a camera.
    """
    from vip_factors.io.scene_building import read_scenes

    return read_scenes([Path(path), *map(Path, then)])


def write(content: Recording | Scene | Moved, path: StrPath, overwrite: bool = False) -> Path:
    """Write a recording, a scene or an estimate into an MCAP file, with its truth if it has one."""
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
    """A sensor log of any known format as a recording: Xsens, MVNX, OpenSense, TotalCapture, ROS 2, tables …

    Args:
        log: file or folder.
        options: who wore what where, and what was held at the start.
        cameras: what filmed the wearers, one or several: the 2D poses that a detector found, and what is known of each.
        join: recordings (.mcap) of further wearers at the same time.
    """
    from vip_factors.io.scene_building import add_cameras, join_wearers, read_log_as_scene

    options = options or ImportOptions()
    scene = read_log_as_scene(Path(log), options)
    if join:
        others = [read_log_as_scene(Path(path), ImportOptions()) for path in join]
        scene = join_wearers([scene, *others], options.name)
    several = [cameras] if isinstance(cameras, CameraOptions) else list(cameras)
    return add_cameras(scene, several) if several else scene


def sync(scene: Scene, max_offset: float = 10.0) -> Scene:
    """The scene with the offsets between the clocks of its videos and its sensors, found from how people move.

    Offsets of up to ``max_offset`` seconds either way are looked at.
    """
    from vip_factors.initialise.clock import find_clock_offset

    for number, camera in enumerate(scene.cameras):
        offset = find_clock_offset(scene, max_offset, number)
        if not offset.determined:
            raise InputError(f"scene '{scene.name}', camera '{camera.name}': {offset.sentence}")
        scene = with_clock(scene, offset.clock, number)
    return scene


def with_clock(scene: Scene, clock: VideoClock, number: int = 0) -> Scene:
    """The scene in which the video's clock of the camera of a number is so far off the sensors'."""
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
    """The 2D poses of everybody in a video, followed from frame to frame: what a :class:`Camera` holds.

    Args:
        video: file (.mp4, .mov …).
        settings: how people are searched for, and by which models.
        out: file (.json) to write them to as well, which ``convert`` and ``run`` take.
        progress: called with what goes on and the fraction of it that is done.
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
    """What sensors on people would have measured, with the truth in it; and what a 2D pose detector would have found.

    Args:
        motion: of each wearer.
        placement: name of a preset: sip6, tnt10, totalcapture13 or mvn17.
        camera: that films them; nothing films if absent.
        seconds: of the package's own motion (20 if absent); before a camera, files are repeated or cut to it too.
        seed: of all errors.
        settings: camera, detector, and the errors of sensors; ``camera`` counts beside them.
        initial_pose: that the wearers hold first.
        pose_error_deg: how imperfectly, sigma of each joint and axis; 3 add up to 10 to 15 at the hands.
        bystanders: people without sensors in the picture; they repeat the wearers' motions elsewhere, out of step.
        names: of the wearers.
        name: of the recording.
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
        own = posed(clips[0], 0)
        worn = preset(placement, own.skeleton)
        recording = simulate_recording(own, worn, settings.imu, seed, name, initial_pose)
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
        Performer(who, own, preset(placement, own.skeleton), initial_pose)
        for who, own in zip(called, wearers, strict=True)
    ]
    others = staged(passing, seed + 1, wearers, BYSTANDER_REACH_M)
    performers += [Performer(f"bystander_{number}", own) for number, own in enumerate(others, start=1)]
    return simulate_scene(performers, replace(settings, camera=camera), seed, name)


def _played(source: Played, seconds: float | None, number: int) -> Motion:
    """A motion; of the package's own one out of step with that of others."""
    if isinstance(source, Motion):
        return source
    if source not in (GESTURES, WALK):
        from vip_factors.io.motions import read_motion

        return read_motion(Path(source))
    from vip_factors.simulate.gestures import gestures
    from vip_factors.simulate.staging import from_time

    shift = OUT_OF_STEP_S * number
    return from_time(gestures((SECONDS if seconds is None else seconds) + shift, straight=source == WALK), shift)


def evaluate(estimate: Moved, truth: Recording | Scene) -> "Evaluation":
    """How far an estimate is from the truth that a recording holds; printed, it begins with the most important.

    Args:
        estimate: of :func:`smooth`, or a motion on the recording's clock.
        truth: the recording with its truth.
    """
    from vip_factors.evaluate.evaluation import evaluate_scene

    return evaluate_scene(as_estimate(estimate), as_scene(truth))


def gait(
    estimate: Moved, recording: Recording | Scene | None = None, *, count: Collection["Unsteady"] = (),
    out: StrPath | None = None, overwrite: bool = False,
) -> "tuple[Gait, ...]":  # fmt: skip
    """How each wearer walked: events, strides, figures with their ±, joint angles over the cycle.

    Args:
        estimate: of one wearer or several.
        recording: that it was made from: sensors on the feet tell events and lengths better than a motion does.
        count: strides that are in the means as well: ``start``, ``stop``, ``turn``, ``pause``.
        out: folder for tables, JSON and a picture of it, made if need be; none if absent.
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
    """Squats, lunges, jumps and curls of each wearer: times, depth, tempo, ranges, symmetry, jump height, with their ±.

    Args:
        estimate: of one wearer or several.
        out: folder for a table, JSON and a picture of it, made if need be; none if absent.
    """
    wearers = all_repetitions(as_estimate(estimate))
    if out is not None:
        from vip_factors.repetitions.files import write_repetitions

        write_repetitions(wearers, Path(out), overwrite)
    return wearers


def export(
    estimate: Moved, path: StrPath, settings: ExportSettings | None = None, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write an estimate into a file of another program; the suffix tells the format.

    Args:
        estimate: of one wearer or several.
        path: of the file; several wearers in a format that holds one get a file each.
        settings: what is written.
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
    video: bool | StrPath = False,
    video_height: int = 480,
    video_seconds: tuple[float, float] | None = None,
) -> Path:
    """Write an estimate as one HTML page for people, with a film beside it if one is wanted.

    Args:
        estimate: of one wearer or several.
        path: of the page.
        recording: what it was made from: then the page tells of sensors and video too.
        truth: a recording whose truth counts, if it is not the one above.
        video: a film (.mp4) is to be beside the page, of skeletons over the camera's pictures and of the room: of the
            recording's own video, or of that in a file.
        video_height: of the film, pixels.
        video_seconds: first and last second of the recording that the film shows; all of it if None.
    """
    from vip_factors.report.page import write_report

    scene, true = (None if one is None else as_scene(one) for one in (recording, truth))
    write_report(
        as_estimate(estimate), path, scene, true, overwrite, None, video, video_height=video_height,
        video_seconds=video_seconds,
    )  # fmt: skip
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
    """The answers to a live source, as they come, until it ends: what the command ``stream`` does with it.

    Args:
        source: recording (.mcap), ``-`` for standard input, or ``ws://host:port`` to listen there.
        settings: of all rooms.
        follow: another program still writes the file.
        real_time: play a recording in its own time instead of as fast as it can be tracked.
        token_file: with a secret that senders must have.
        limits: of what senders may do.
        extra_factors: makes GTSAM factors of your own.
    """
    from vip_factors.io.live.open import open_source, read_token
    from vip_factors.live.stream import Stream
    from vip_factors.settings import LiveSettings

    token = read_token(token_file)
    with open_source(source, follow=follow, real_time=real_time, settings=limits, token=token) as opened:
        tracked = Stream(opened.setup, settings or LiveSettings(), extra_factors, real_time=not opened.is_played)
        for item in opened:
            yield from tracked.take(item, opened.waited_s)
        yield from tracked.finish()


def serve(worn: Recording | Scene, port: int = 8080, host: str = "127.0.0.1", token: str = "") -> "LiveServer":
    """A web page that shows a stream's answers as they are written to it, and has them as JSON; to be closed at last.

    Args:
        worn: who wears what, as the stream has it.
        port: of this machine, where the page is.
        host: address that is listened to: this machine alone, or 0.0.0.0 for those in all its networks.
        token: that readers need; without one this machine's need none, and one is made for those of other machines.
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
    """Draw a filmstrip (.png): poses in a row, or frames of the video with the bodies over them.

    Args:
        shown: an estimate, a motion, or a recording with its truth.
        path: of the picture.
        recording: what an estimate was made from: sensors, video and truth are drawn too.
        title: above the picture.
        poses: how many, evenly over the time.
    """
    from vip_factors.viz.drawn_scene import drawn_scene, drawn_wearer
    from vip_factors.viz.picture import filmstrip

    own = shown if isinstance(shown, Recording | Scene) else recording
    scene = None if own is None else as_scene(own)
    estimate = None if isinstance(shown, Recording | Scene) else as_estimate(shown)
    if scene is not None and scene.camera is not None and not isinstance(shown, WearerEstimate | Motion):
        drawn = drawn_scene(scene, estimate)
    else:
        one, worn = None if estimate is None else estimate.wearer(), None if scene is None else scene.wearers[0]
        drawn = drawn_wearer(worn, one)
    filmstrip(drawn, Path(path), frames=poses, title=title, overwrite=overwrite)
    return Path(path)
