"""``vip-factors simulate``: a recording with known truth from a motion, or a filmed scene of several people."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from vip_factors.cli.options import UNPREFIXED, Flag, Input, Output, WritingOptions
from vip_factors.cli.terminal import say, waiting
from vip_factors.errors import InputError
from vip_factors.ranges import NotNegativeInt, Range
from vip_factors.simulate.settings import CameraKind, DetectorSettings, FilmSettings, SceneSettings, SimulateSettings

if TYPE_CHECKING:
    from vip_factors.sensors.scene import Scene

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


def main(options: SimulateOptions) -> None:
    """Run the command with its parsed options."""
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
    say(_summary(scene, film.camera))
    say(options.out)


def _summary(scene: "Scene", camera: CameraKind | None) -> str:
    sensors = sum(len(wearer.imus) for wearer in scene.wearers)
    if camera is None:
        start, end = scene.wearers[0].interval
        return f"{sensors} sensors, {end - start:.1f} s"
    detections = [filmed.detections for filmed in scene.cameras]
    further = f" and {len(detections) - 1} further" if len(detections) > 1 else ""
    return (
        f"{len(scene.wearers)} wearers with {sensors} sensors, {camera} camera{further}, "
        f"{len(detections[0].time)} video frames, {sum(map(len, detections))} detections"
    )
