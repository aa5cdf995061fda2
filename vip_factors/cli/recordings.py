"""Commands that make a recording: simulated, with or without its reconstruction, or with another clock."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from vip_factors.atomic import atomic_open, check_target
from vip_factors.cli.options import UNPREFIXED, Flag, Input, Output, WritingOptions
from vip_factors.cli.terminal import progress_bar, say, waiting
from vip_factors.errors import InputError
from vip_factors.ranges import NotNegativeInt, Range, Rate
from vip_factors.settings import MAX_OFFSET_S
from vip_factors.simulate.settings import DetectorSettings, FilmSettings, SceneSettings, SimulateSettings

if TYPE_CHECKING:
    from vip_factors.initialise.clock import ClockOffset


PresetName = Literal["sip6", "tnt10", "totalcapture13", "mvn17"]


@dataclass(frozen=True)
class SimulateOptions(WritingOptions):
    """Simulate the sensors of a moving person, as a recording with known truth.

    --camera adds cameras and simulated 2D detections; --also and --bystanders add people.
    """

    none_is_a_value: ClassVar = True
    motion: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MOTION"), Input()]
    """Motion file (.bvh …), or a synthetic motion: gestures, or walk (straight ahead)."""
    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING"), Output(".mcap")]
    """Recording (.mcap) to write."""
    placement: PresetName = "totalcapture13"
    """Preset of sensor sites."""
    seed: NotNegativeInt = 0
    """Seed of all random errors; the same seed gives the same recording."""
    initial_pose: Literal["none", "n-pose", "t-pose"] = "n-pose"
    """Calibration pose that the person holds before the motion."""
    pose_error_deg: float = 3.0
    """Standard deviation of the calibration pose in degrees, for each joint and axis; 3 gives 10 to 15 at the hands."""
    seconds: Annotated[float | None, Range(above=0, most=86_400)] = None
    """Duration in seconds; default: 20 for synthetic motions, the file's duration otherwise. With a camera, files are
    repeated or cut to it."""
    noise_free: Flag = False
    """Sensors without errors; error options are ignored."""
    also: Annotated[tuple[str, ...], Input()] = ()
    """Motions of further wearers, as for MOTION."""
    bystanders: int = 0
    """Number of people without sensors; they repeat the wearers' motions at other places and times."""
    film: Annotated[FilmSettings, UNPREFIXED] = field(default_factory=partial(FilmSettings, camera=None))
    errors: Annotated[SimulateSettings, UNPREFIXED] = field(default_factory=SimulateSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)


def execute_simulate(options: SimulateOptions) -> None:
    """Run ``vip-factors simulate``."""
    from vip_factors.api import simulate
    from vip_factors.io.mcap_recording import write_recording

    film = options.film
    if film.camera is None and (options.also or options.bystanders or film.cameras > 1 or film.known_camera_pose):
        raise InputError("--also, --bystanders and --cameras make a scene: expected a --camera as well")
    with waiting("simulating"):
        errors = SceneSettings(**vars(film), imu=options.errors, detector=options.detector)
        scene = simulate(
            (options.motion, *options.also),
            options.placement,
            film.camera,
            options.seconds,
            options.seed,
            settings=SceneSettings.noise_free(film) if options.noise_free else errors,
            name=options.out.stem,
            initial_pose=options.initial_pose,
            pose_error_deg=options.pose_error_deg,
            bystanders=options.bystanders,
        )
        content = scene.wearers[0] if film.camera is None else scene
        write_recording(content, options.out, overwrite=options.overwrite)
    sensors = sum(len(wearer.imus) for wearer in scene.wearers)
    if film.camera is None:
        start, end = scene.wearers[0].interval
        say(f"{sensors} sensors, {end - start:.1f} s")
    else:
        detections = [filmed.detections for filmed in scene.cameras]
        further = f" and {len(detections) - 1} further" if len(detections) > 1 else ""
        say(
            f"{len(scene.wearers)} wearers with {sensors} sensors, {film.camera} camera{further}, "
            f"{len(detections[0].time)} video frames, {sum(map(len, detections))} detections"
        )
    say(options.out)


@dataclass(frozen=True)
class DemoOptions(WritingOptions):
    """Simulate a walk with unknown headings and mountings, reconstruct it, and compare and draw the result."""

    out: Path = Path("vip_factors_demo")
    """Folder for the files."""
    placement: PresetName = "totalcapture13"
    """Preset of sensor sites."""
    seconds: Annotated[float, Range(above=0, most=86_400)] = 12.0
    """Length of the walk, after a calibration pose of two seconds."""
    seed: NotNegativeInt = 0
    """Seed of the sensor errors."""
    frame_rate: Rate = 60.0
    """Frames per second of the reconstruction."""


HEADING_OFFSET_DEG = 45.0  # thesis 4.4.2: "imprecise" placement
MOUNTING_ERROR_DEG = 10.0  # straps put on by eye


def execute_demo(options: DemoOptions) -> None:
    """Run ``vip-factors demo``."""
    from vip_factors.api import simulate, write
    from vip_factors.evaluate.evaluation import evaluate
    from vip_factors.pipeline import smooth
    from vip_factors.settings import Settings
    from vip_factors.simulate.settings import SceneSettings, SimulateSettings
    from vip_factors.viz.drawn_scene import drawn_wearer
    from vip_factors.viz.picture import filmstrip
    from vip_factors.viz.rerun_view import show

    files = {
        name: options.out / name
        for name in ("recording.mcap", "estimate.mcap", "evaluation.json", "demo.png", "demo.rrd")
    }
    options.out.mkdir(parents=True, exist_ok=True)
    for path in files.values():
        check_target(path, options.overwrite)
    with progress_bar() as progress:
        progress("simulating", 0.0)
        errors = SimulateSettings(heading_offset_deg=HEADING_OFFSET_DEG, mounting_error_deg=MOUNTING_ERROR_DEG)
        recording = simulate(
            placement=options.placement, seconds=options.seconds, seed=options.seed, settings=SceneSettings(imu=errors)
        ).wearers[0]
        write(recording, files["recording.mcap"], options.overwrite)
        estimate = smooth(recording, Settings(frame_rate=options.frame_rate), progress).wearer()
        write(estimate, files["estimate.mcap"], options.overwrite)
        progress("drawing", 0.0)
        truth = recording.truth
        assert truth is not None
        evaluation = evaluate(estimate, truth)
        with atomic_open(files["evaluation.json"], "w", options.overwrite) as file:
            file.write(evaluation.to_json())
        drawn = drawn_wearer(recording, estimate)
        title = f"A simulated walk, reconstructed from body-worn sensors, {estimate.method}"
        filmstrip(drawn, files["demo.png"], title=title, overwrite=options.overwrite)
        show(drawn, files["demo.rrd"], options.overwrite)
    for name in ("mpjpe", "mpjae", "heading_error", "mounting_error"):
        if name in evaluation.metrics:
            metric = evaluation.metrics[name]
            say(f"{name:<15} {metric.value:6.1f} {metric.unit}")
    for path in files.values():
        say(path)


@dataclass(frozen=True)
class SyncOptions(WritingOptions):
    """Estimate the offset between the clocks of video and sensors, and write it into a copy of the scene.

    The offset, in seconds to add to the video's times, is estimated from the motion of people. If the motion does not
    determine it, an error names the reason and no file is written. Above one minute the clock drift is estimated too.
    """

    scene: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
    """Scene (.mcap): sensors, and a camera with detections."""
    out: Annotated[Path | None, Output(".mcap")] = None
    """Scene (.mcap) to write; default: SCENE.synced.mcap."""
    seconds: float | None = None
    """Known offset in seconds; it is written without an estimate."""
    dry_run: Flag = False
    """Print the estimate and write no file."""
    max_offset: float = MAX_OFFSET_S
    """Largest offset to search, in seconds in both directions."""


def execute_sync(options: SyncOptions) -> None:
    """Run ``vip-factors sync``."""
    from vip_factors.api import with_clock
    from vip_factors.initialise.clock import find_clock_offset
    from vip_factors.io.mcap_recording import read_scene, write_recording
    from vip_factors.sensors.camera import VideoClock

    out = options.out if options.dry_run else options.target(options.out, options.scene, ".synced.mcap")
    scene = read_scene(options.scene)
    if scene.camera is None:
        raise InputError(f"{options.scene} has no camera: there is no clock to compare with the sensors'")
    seconds = options.seconds
    for number, camera in enumerate(scene.cameras):
        clock, label = VideoClock(seconds or 0.0), f"camera '{camera.name}': " if len(scene.cameras) > 1 else ""
        if seconds is None:
            with waiting("comparing video and sensors"):
                offset = find_clock_offset(scene, options.max_offset, number)
            say(label + offset_text(offset, camera.clock.offset))
            if not offset.determined:
                if options.dry_run:
                    continue
                raise InputError(f"{options.scene}: {label}{offset.sentence}; or give the offset as --seconds")
            clock = offset.clock
        scene = with_clock(scene, clock, number)
    if options.dry_run or out is None:
        return
    write_recording(scene, out, overwrite=options.overwrite)
    say(out)


def offset_text(offset: "ClockOffset", previous_s: float = 0.0) -> str:
    """Format an offset as a small table with the other candidates."""
    lines = [offset.sentence] if offset.determined else []
    if offset.determined and previous_s:
        lines.append(f"the scene said {previous_s:+.3f} s before")
    lines.append(f"  {'offset':>10}  agreement")
    sigma = f"± {1e3 * offset.sigma:.0f} ms" if offset.determined else "undetermined"
    lines.append(f"  {offset.seconds:+8.3f} s  {100:7.0f} %  {sigma}")
    lines += [f"  {seconds:+8.3f} s  {100 * share:7.0f} %" for seconds, share in offset.alternatives[:4]]
    return "\n".join(lines)
