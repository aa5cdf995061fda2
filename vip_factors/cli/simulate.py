"""``vip-factors simulate``: a recording with known truth from a motion, or a filmed scene of several people."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from vip_factors.atomic import check_target
from vip_factors.cli.options import UNPREFIXED, Flag, Input, Output, WritingOptions
from vip_factors.cli.terminal import say, waiting
from vip_factors.errors import InputError
from vip_factors.ranges import NotNegativeInt, Range, Rate
from vip_factors.simulate.settings import DetectorSettings, SimulateSettings

if TYPE_CHECKING:
    from vip_factors.sensors.recording import Recording
    from vip_factors.sensors.scene import Scene
    from vip_factors.simulate.settings import SceneSettings

PresetName = Literal["sip6", "tnt10", "totalcapture13", "mvn17"]
CameraName = Literal["none", "fixed", "hand-held", "walking"]


@dataclass(frozen=True)
class VideoOptions:
    """What films the people, if anything does."""

    camera: CameraName = "none"
    """On a tripod, in the hands of somebody who stands, or of somebody who walks along; none makes no scene."""
    cameras: int = 1
    """Cameras in all: further ones stand on tripods around the action, at known poses."""
    known_camera_pose: bool | None = None
    """Whether a fixed first camera's pose is known too; absent, if there are further cameras."""
    also: Annotated[tuple[str, ...], Input()] = ()
    """Motions of further wearers, as MOTION."""
    bystanders: int = 0
    """People without sensors in the scene; they repeat the motions of the wearers, elsewhere and out of step."""
    video_rate: Rate = 30.0
    """Frames per second."""
    image: tuple[int, int] = (1920, 1080)
    """Width and height in pixels."""
    fov_deg: float = 60.0
    """Horizontal field of view; a phone's when filming."""
    distance_m: Annotated[float | None, Range(above=0, most=1_000)] = None
    """From the action to the camera; absent, as far as it takes to see it."""
    keypoints: str = "openpose18"
    """Keypoint set of the simulated detector: coco17, openpose18, body25, body25b, halpe26 …"""
    time_offset_s: float = 0.0
    """To be added to the video's times to get the sensors'; what is written says 0."""
    camera_mounting_error_deg: float = 5.0
    """Of the IMU on the camera, each axis."""


@dataclass(frozen=True)
class SimulateOptions(WritingOptions):
    """Make a recording with known truth from a motion: what sensors on that person would have measured.

    With --camera it becomes a scene: one or more wearers, bystanders, a camera, and what a 2D pose detector would
    have found in its video.
    """

    none_is_a_value: ClassVar = True
    motion: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MOTION"), Input()]
    """Motion file (.bvh …), or the words gestures and walk (straight on) for motions that the package makes."""
    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING"), Output(".mcap")]
    """Recording (.mcap) to write."""
    placement: PresetName = "totalcapture13"
    """Where the sensors sit."""
    seed: NotNegativeInt = 0
    """Of all errors: the same seed gives the same recording."""
    initial_pose: Literal["none", "n-pose", "t-pose"] = "n-pose"
    """Calibration pose that the person holds before the motion."""
    pose_error_deg: float = 3.0
    """How imperfectly that pose is held, sigma of each joint and axis; 3 add up to 10 to 15 at the hands."""
    seconds: Annotated[float | None, Range(above=0, most=86_400)] = None
    """Length of the package's own motion (20 if absent); in a scene, files are repeated or cut to it too."""
    noise_free: Flag = False
    """Perfect sensors instead of realistic ones; error options given besides are ignored."""
    video: Annotated[VideoOptions, UNPREFIXED] = field(default_factory=VideoOptions)
    errors: Annotated[SimulateSettings, UNPREFIXED] = field(default_factory=SimulateSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)


def main(options: SimulateOptions) -> None:
    """Run the command."""
    from vip_factors.io.mcap_recording import write_recording

    video = options.video
    if video.camera == "none" and (video.also or video.bystanders or video.cameras > 1 or video.known_camera_pose):
        raise InputError("--also, --bystanders and --cameras make a scene: expected a --camera as well")
    check_target(options.out, options.overwrite)
    with waiting("simulating"):
        scene = simulated_scene(options)
        plain = options.video.camera == "none"
        write_recording(scene.wearers[0] if plain else scene, options.out, overwrite=options.overwrite)
    say(_summary(scene, options.video.camera))
    say(options.out)


def _summary(scene: "Scene", camera: CameraName) -> str:
    sensors = sum(len(wearer.imus) for wearer in scene.wearers)
    if camera == "none":
        start, end = scene.wearers[0].interval
        return f"{sensors} sensors, {end - start:.1f} s"
    found = [one.detections for one in scene.cameras]
    further = f" and {len(found) - 1} further" if len(found) > 1 else ""
    return (
        f"{len(scene.wearers)} wearers with {sensors} sensors, {camera} camera{further}, {len(found[0].time)} video "
        f"frames, {sum(map(len, found))} detections"
    )


def simulated(options: SimulateOptions) -> "Recording":
    """The recording that the options ask for."""
    return simulated_scene(options).wearers[0]


def simulated_scene(options: SimulateOptions) -> "Scene":
    """The scene that the options ask for."""
    from vip_factors.api import simulate

    camera = None if options.video.camera == "none" else options.video.camera
    own = (options.motion, *options.video.also)
    return simulate(
        own, options.placement, camera, options.seconds, options.seed,
        settings=_scene_settings(options), initial_pose=options.initial_pose, pose_error_deg=options.pose_error_deg,
        bystanders=options.video.bystanders, name=options.out.stem,
    )  # fmt: skip


def _scene_settings(options: SimulateOptions) -> "SceneSettings":
    from vip_factors.simulate.settings import SceneSettings

    video = options.video
    perfect = options.noise_free
    return SceneSettings(
        camera="fixed" if video.camera == "none" else video.camera,
        video_rate=video.video_rate,
        width=video.image[0],
        height=video.image[1],
        fov_deg=video.fov_deg,
        distance_m=video.distance_m,
        cameras=video.cameras,
        known_pose=video.known_camera_pose,
        keypoints=video.keypoints,
        time_offset_s=video.time_offset_s,
        camera_mounting_error_deg=0.0 if perfect else video.camera_mounting_error_deg,
        pose_error_deg=0.0 if perfect else SceneSettings.pose_error_deg,
        pose_error_m=0.0 if perfect else SceneSettings.pose_error_m,
        imu=SimulateSettings.noise_free() if perfect else options.errors,
        detector=DetectorSettings.noise_free() if perfect else options.detector,
    )
