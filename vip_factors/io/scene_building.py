"""Scenes from recordings of wearers and the detections in videos, with checks that these belong together."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vip_factors.errors import InputError, nearest
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.io.body_file import read_body_file, scene_with_body
from vip_factors.io.camera_file import CameraFile, read_camera_file, read_camera_path
from vip_factors.io.convert import ImportOptions, detect_format, import_recording, read_log
from vip_factors.io.detections import read_detections
from vip_factors.io.mcap_recording import read_scene
from vip_factors.io.settings import CameraOptions
from vip_factors.io.video import (
    METADATA_FOCAL_SIGMA,
    VideoFacts,
    check_video,
    embed_video,
    focal_from_metadata,
    video_facts,
    with_torso_colours,
)
from vip_factors.sensors.camera import (
    UNCALIBRATED_FOCAL_SIGMA,
    CameraModel,
    CameraPath,
    VideoClock,
    uncalibrated_camera,
)
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream, with_orientation
from vip_factors.sensors.multi_file import join_scenes
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import UNKNOWN_MOUNTING_SIGMA, Camera, CameraMount, Scene, Video

USUAL_SIZES = ((640, 480), (1280, 720), (1920, 1080), (2704, 1520), (3840, 2160), (7680, 4320))  # pixels


class SceneWarning(UserWarning):
    """Assumption about a scene, or a doubt."""


def read_log_as_scene(path: Path, options: ImportOptions) -> Scene:
    """A sensor log of any known format, or a recording or scene of ours, as a scene named as the options say."""
    if options.columns is not None or (options.format or detect_format(path)) != "recording":
        recording = import_recording(path, options)
        return Scene(recording.name, (recording,))
    if replace(options, name=None, body=None, then=()) != ImportOptions(format=options.format):
        raise InputError(
            f"{path} is a recording of this package already: it can be read, but takes no import options besides a body"
        )
    scene = read_scenes((path, *options.then))
    if options.body is not None:
        scene = scene_with_body(scene, read_body_file(options.body), options.body)
    if options.name is None:
        return scene
    wearers = tuple(replace(wearer, name=options.name) for wearer in scene.wearers)
    return replace(scene, name=options.name, wearers=wearers)


def read_scenes(paths: Sequence[Path]) -> Scene:
    """A scene from a recording's file, or from several that are its parts, one after another in time."""
    scenes = [read_scene(path) for path in paths]
    return join_scenes(scenes, [str(path) for path in paths]) if len(scenes) > 1 else scenes[0]


def join_wearers(scenes: Sequence[Scene], name: str | None = None) -> Scene:
    """One scene of all wearers of several, on the clock of the first; the camera is that of the one scene that has one.

    Recordings with an absolute start are brought onto one clock by it; the others' first instants are taken as one.

    Raises:
        InputError: if two scenes have a camera, or two wearers the same name.
    """
    names = [wearer.subject.name for scene in scenes for wearer in scene.wearers]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two wearers are called '{twice}': give each a name of their own when converting (subject)")
    filmed = [scene for scene in scenes if scene.camera is not None]
    if len(filmed) > 1:
        scene_names = ", ".join(f"'{scene.name}'" for scene in filmed)
        raise InputError(f"scenes {scene_names} have a camera each: expected one camera in all; leave the others' out")
    reference = scenes[0].wearers[0]
    wearers = []
    for scene in scenes:
        for wearer in scene.wearers:
            if scene is not scenes[0] and not (wearer.start_ns and reference.start_ns):
                _warn(
                    f"'{wearer.name}' of {wearer.subject.name} has no absolute time in common with "
                    f"'{reference.name}': their times 0 are taken as the same instant"
                )
                wearers.append(replace(wearer, start_ns=reference.start_ns))
            else:
                wearers.append(_on_clock(wearer, reference.start_ns))
    cameras = filmed[0].cameras if filmed else ()
    if filmed and filmed[0] is not scenes[0]:  # truths count the wearers of their own scene
        cameras = tuple(replace(camera, truth=None) for camera in cameras)
    start_ns = filmed[0].wearers[0].start_ns if filmed else 0
    if start_ns and reference.start_ns and start_ns != reference.start_ns:
        seconds = (start_ns - reference.start_ns) / 1e9
        cameras = tuple(_shifted_camera(camera, seconds) for camera in cameras)
    return Scene(name or scenes[0].name, tuple(wearers), cameras)


def _on_clock(wearer: Recording, start_ns: int) -> Recording:
    """The recording with its times counted from another absolute start."""
    seconds = (wearer.start_ns - start_ns) / 1e9
    if not seconds:
        return wearer
    truth = wearer.truth
    if truth is not None:
        truth = replace(truth, motion=replace(truth.motion, start=truth.motion.start + seconds))
    imus = {name: replace(stream, time=stream.time + seconds) for name, stream in wearer.imus.items()}
    return replace(wearer, imus=imus, truth=truth, start_ns=start_ns)


def _shifted_camera(camera: Camera, seconds: float) -> Camera:
    mount, path = camera.mount, camera.known_path
    return replace(
        camera,
        clock=replace(camera.clock, offset=camera.clock.offset + seconds),
        mount=replace(mount, imu=replace(mount.imu, time=mount.imu.time + seconds)) if mount is not None else None,
        known_path=replace(path, time=path.time + seconds) if path is not None else None,
    )


def add_cameras(scene: Scene, cameras: Sequence[CameraOptions]) -> Scene:
    """The scene with cameras and their detections, in place of those it had.

    All cameras of known pose must have been shown the same board, lying in the same place.
    """
    added = list[Camera]()
    for options in cameras:
        scene, mount = _with_mount(scene, options)
        added.append(replace(_camera(scene, options), mount=mount))
    scene = replace(scene, cameras=tuple(added))
    return embed_video(scene) if cameras[0].embed_video else scene


def _camera(scene: Scene, options: CameraOptions) -> Camera:
    """A camera with its detections, without a sensor."""
    poses = options.detections
    if poses is None:
        raise InputError("a camera needs its 2D poses (detections)")
    facts = video_facts(options.video) if options.video is not None else None
    rate = facts.rate if facts is not None else options.video_rate
    detections = read_detections(poses, rate, options.keypoints, options.first_frame)
    file = read_camera_file(options.camera) if options.camera is not None else None
    path = _known_path(options, file)
    model, focal_sigma = (file.model, file.focal_sigma) if file is not None else _usual_lens(facts, detections)
    video = Video(options.video) if options.video is not None else None
    moving, clock = not options.static_camera, VideoClock(options.time_offset_s)
    camera = Camera(options.camera_name, model, detections, moving, None, path, clock, video, focal_sigma=focal_sigma)
    if options.camera_path is not None:
        odometry = _odometry(options.camera_path, detections)
        camera = replace(camera, odometry=odometry, scale_free_odometry=options.scale_free_path)
    if facts is not None:
        check_video(facts, camera)
        if len(detections.time) < 0.6 * len(facts):  # every second frame would stay below
            _warn(
                f"{poses} ends at frame {len(detections.time)} of the {len(facts)} in {facts.path}: "
                "if the detector left frames out, its numbers are wrong; detect in every frame"
            )
        camera = replace(camera, detections=replace(detections, time=facts.time))  # all frames of the video
        if options.video_rate is not None and abs(options.video_rate / facts.rate - 1) > 0.01:
            _warn(
                f"{facts.path} has {facts.rate:.2f} frames a second, not {options.video_rate:g}: the file's times "
                "are used"
            )
    _check_detections(detections, model, options, size_known=facts is not None)
    _warn_of_clocks(scene, camera)
    return camera if video is None else replace(camera, detections=with_torso_colours(camera.detections, video))


def _usual_lens(facts: VideoFacts | None, detections: Detections) -> tuple[CameraModel, float]:
    """The intrinsics of a lens without a camera file, and the standard deviation of its focal length's logarithm."""
    # The smallest usual image that holds nearly all detected points, upright ones included.
    pixels = detections.pixels[detections.seen]
    reach = np.quantile(pixels, 0.99, axis=0) if len(pixels) else np.zeros(2)
    sizes = [size for landscape in USUAL_SIZES for size in (landscape, landscape[::-1])]
    size = next((size for size in sizes if np.all(reach <= size)), USUAL_SIZES[-1])
    size_text = "the smallest usual image that holds all points"
    model, sigma, source = uncalibrated_camera(*size), UNCALIBRATED_FOCAL_SIGMA, "that of a phone"
    if facts is not None:
        size, size_text = (facts.width, facts.height), "the video's"
        model, focal = uncalibrated_camera(*size), focal_from_metadata(facts.path, *size)
        if focal is not None:
            model, sigma = replace(model, focal=(focal, focal)), METADATA_FOCAL_SIGMA
            source = "what the video's metadata state"
    _warn(
        f"no camera file is given: the focal length is estimated with the motion, from {source} "
        f"(± {sigma:.0%}), for an image of {size[0]} by {size[1]} pixels ({size_text})"
    )
    return model, sigma


def _known_path(options: CameraOptions, file: CameraFile | None) -> CameraPath | None:
    if not options.known_camera_pose:
        return None
    if file is None:
        raise InputError("the camera's pose cannot be taken as known without its camera file (camera)")
    refusal = f"{options.camera}: its pose cannot be taken as known"
    if not options.static_camera:
        raise InputError(f"{refusal}: the camera is not declared to stand still (static_camera)")
    if file.floor is None:
        raise InputError(f"{refusal}: the file has no pose ([floor])")
    return CameraPath(np.zeros(1), file.floor[0][None], file.floor[1][None])


def _odometry(file: Path, detections: Detections) -> CameraPath:
    """The camera's path with times of the video; one on another clock begins with the video."""
    path, time = read_camera_path(file), detections.time
    if path.time[0] < time[-1] and path.time[-1] > time[0]:
        return path
    _warn(
        f"{file} lasts from {path.time[0]:.1f} to {path.time[-1]:.1f} s, the video from {time[0]:.1f} to "
        f"{time[-1]:.1f} s: its first pose is taken as that of the first video frame"
    )
    return replace(path, time=path.time - path.time[0] + time[0])


def _with_mount(scene: Scene, options: CameraOptions) -> tuple[Scene, CameraMount | None]:
    """The camera's own sensor from its log, or taken from the wearer among whose streams it came."""
    if options.camera_imu_log is not None:
        return scene, _mount(_logged_imu(options.camera_imu_log, options, scene.wearers[0].start_ns), options)
    if options.camera_imu is None:
        return scene, None
    owners = [wearer for wearer in scene.wearers if options.camera_imu in wearer.imus]
    if len(owners) != 1:
        names = ", ".join(name for wearer in scene.wearers for name in wearer.imus)
        subject = "several recordings have" if owners else "no wearer's recording has"
        raise InputError(f"{subject} a sensor '{options.camera_imu}' to be the camera's: sensors are {names}")
    owner = owners[0]
    sites = tuple(site for site in owner.placement.sites if site.sensor != options.camera_imu)
    imus = dict(owner.imus)
    stream = imus.pop(options.camera_imu)
    without = replace(owner, imus=imus, placement=replace(owner.placement, sites=sites))
    wearers = tuple(without if wearer is owner else wearer for wearer in scene.wearers)
    return replace(scene, wearers=wearers), _mount(stream, options)


def _mount(stream: ImuStream, options: CameraOptions) -> CameraMount:
    if options.camera_imu_wxyz is None:
        return CameraMount(stream, mounting_sigma=UNKNOWN_MOUNTING_SIGMA)
    return CameraMount(stream, matrix_from_quaternion(np.array(options.camera_imu_wxyz), Order.WXYZ))


def _logged_imu(path: Path, options: CameraOptions, start_ns: int) -> ImuStream:
    """The camera's sensor from a log of its own, on the recordings' clock, which begins at ``start_ns``."""
    log = read_log(path, columns=options.camera_imu_columns)
    if options.camera_imu is None and len(log.imus) > 1:
        raise InputError(f"{path} has the sensors {', '.join(log.imus)}: name the one on the camera (camera_imu)")
    name = next(iter(log.imus)) if options.camera_imu is None else options.camera_imu
    if name not in log.imus:
        raise InputError(f"{path} has no sensor '{name}'{nearest(name, log.imus)}")
    offset = options.camera_imu_offset_s
    if offset is None:
        offset = (log.start_ns - start_ns) / 1e9 if log.start_ns and start_ns else 0.0
        if not (log.start_ns and start_ns):
            _warn(
                f"{path} has no absolute time in common with the wearers' logs: their first samples are taken as one "
                "instant; say otherwise in seconds"
            )
    stream = with_orientation(log.imus[name])
    return replace(stream, time=stream.time + offset)


def _check_detections(detections: Detections, model: CameraModel, options: CameraOptions, size_known: bool) -> None:
    """Refuse detections that show nobody, or that were made at another resolution than the calibration."""
    path, source = options.detections, options.camera or "the lens"
    margin = 0.05  # of the image's size: detectors put points a little beyond its border
    if not np.any(detections.seen):
        raise InputError(
            f"{path}: in none of {len(detections.time)} video frames is anybody: every confidence is zero; "
            "run the detector again, or check that these are its results"
        )
    pixels = detections.pixels[detections.seen]
    size = np.array([model.width, model.height])
    out = np.any((pixels < -margin * size) | (pixels > (1 + margin) * size), axis=1)
    reach = np.quantile(pixels, 0.99, axis=0)
    if np.mean(out) > 0.02:
        raise InputError(
            f"{path}: {100 * np.mean(out):.0f} % of the points lie outside the image of {model.width} by "
            f"{model.height} pixels that {source} is for (they reach to {reach[0]:.0f}, {reach[1]:.0f}): "
            "the detector saw another resolution; calibrate at that one, or detect at this one"
        )
    # A detector that is run at half the resolution stays within half of both sides.
    if not size_known and len(detections) >= 10 and np.all(reach < 0.55 * size):
        _warn(
            f"{path}: all people lie within {reach[0]:.0f} by {reach[1]:.0f} pixels of an image of {model.width} by "
            f"{model.height} ({source}): if the detector saw a smaller image, calibrate at its resolution"
        )


def _warn_of_clocks(scene: Scene, camera: Camera) -> None:
    """Warn where video and sensors have little or no time in common."""
    time = camera.timed_detections.time
    for wearer in scene.wearers:
        if not wearer.imus:
            continue
        start, end = wearer.interval
        common = min(end, time[-1]) - max(start, time[0])
        if common < 0.5 * min(end - start, time[-1] - time[0]):
            _warn(
                f"the video lasts from {time[0]:.1f} to {time[-1]:.1f} s, the sensors of {wearer.subject.name} from "
                f"{start:.1f} to {end:.1f} s: little in common; vip-factors sync finds the offset of their clocks"
            )


def _warn(sentence: str) -> None:
    warnings.warn(SceneWarning(sentence), stacklevel=3)
