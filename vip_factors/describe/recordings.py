"""Facts about motions, recordings and scenes."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import SITES, site_axes, site_name
from vip_factors.sensors.camera import CameraModel, VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream, gaps_of, rate_of
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, CameraTruth, Scene
from vip_factors.tables import MM, Quantity, Row, Table, bone_words, count, facts, joint_words

STREAMS = {"R_inertial_sensor": "orientation", "specific_force": "acceleration", "angular_rate": "turning rate"}


def motion_facts(motion: Motion, title: str = "", frames: int | None = None) -> Table:
    """Table of a motion's duration, rate and body; ``frames`` is their number if they were not read."""
    frames = len(motion) if frames is None else frames
    interval = f", {motion.start:.2f} to {motion.start + (frames - 1) / motion.rate:.2f} s" if frames else ""
    return facts(
        title,
        ("motion", f"{frames} frames at {motion.rate:g} Hz{interval}"),
        ("body", motion.skeleton.source),
        ("lengths", _lengths_text(motion.skeleton)),
    )


def _lengths_text(skeleton: Skeleton) -> str:
    ends = {"thigh": "left_knee", "shank": "left_ankle", "upper arm": "left_elbow", "forearm": "left_wrist"}
    limbs = ", ".join(f"{name} {MM * skeleton.bone_length(end):.0f}" for name, end in ends.items())
    p_pelvis_joint = skeleton.p_pelvis_joint
    hips, shoulders = (
        MM * (p_pelvis_joint[joint_index(f"left_{name}"), 0] - p_pelvis_joint[joint_index(f"right_{name}"), 0])
        for name in ("hip", "shoulder")
    )
    return f"{limbs} mm; hips {hips:.0f}, shoulders {shoulders:.0f} mm apart"


def recording_facts(recording: Recording) -> Table:
    """Table of subject, placement and time."""
    subject = recording.subject
    rows = [("subject", f"{subject.name}, {subject.body().source}")]
    if subject.body_note:
        rows.append(("body", subject.body_note))
    rows += [("placement", recording.placement.name), ("initial pose", recording.initial_pose)]
    if recording.imus:
        start, end = recording.interval
        rows.append(("time", f"{start:.2f} to {end:.2f} s, {count(len(recording.imus), 'sensor')}"))
    rows += [("note", line) for line in recording.notes.splitlines() if line]
    return facts(f"recording '{recording.name}'", *rows)


def sensor_table(recording: Recording, time: Mapping[str, Array] | None = None) -> Table:
    """Table of the sensors' sites and samples; ``time`` are sample times by sensor if samples were not read."""
    body = recording.subject.body()
    sites = dict[str, str]()
    for site in recording.placement.sites:
        place = site_name(site, body)
        sites[site.sensor] = f"{bone_words(site.bone)} (elsewhere)" if place is None else joint_words(place)
    start, end = recording.interval if recording.imus else (0.0, 0.0)
    rows = []
    for name, stream in recording.imus.items():
        samples = stream.time if time is None else time[name]
        gaps = gaps_of(samples)
        lost = float((gaps[:, 1] - gaps[:, 0]).sum())
        missing = f"{lost:.2f} s ({100 * lost / max(end - start, 1e-9):.1f} %)" if len(gaps) else "none"
        rate = Quantity(rate_of(samples), unit="Hz", decimals=1)
        where = sites.get(name, "not placed, not used")
        rows.append((name, where, _stream_words(stream), str(len(samples)), rate, str(len(gaps)), missing))
    return Table(("sensor", "worn on", "measures", "samples", "rate", "gaps", "missing"), rows, words=3)


def _stream_words(stream: ImuStream) -> str:
    return ", ".join(word for name, word in STREAMS.items() if getattr(stream, name) is not None)


def truth_facts(recording: Recording, frames: int | None = None) -> Table:
    """Table of the reference motion; ``frames`` is their number if they were not read."""
    truth = recording.truth
    if truth is None:
        return facts("")
    motion = motion_facts(truth.motion, frames=frames)
    return facts("truth: motion and calibration" if truth.calibration else "truth: motion", *motion.rows)


def camera_facts(camera: Camera) -> Table:
    """Table of a camera's image, IMU, clock and detections."""
    rows: list[Row] = [("image", image_text(camera.model, camera.focal_sigma))]
    if camera.mount is not None:
        imu = camera.mount.imu
        gaps = f"{len(imu.gaps)} ({np.ptp(imu.gaps, axis=1).sum():.2f} s)" if len(imu.gaps) else "none"
        rows.append(("sensor", f"{imu.name}, {len(imu)} samples, {imu.rate:.1f} Hz, gaps {gaps}, {_stream_words(imu)}"))
    if camera.known_path is not None:
        rows.append(("pose known at", count(len(camera.known_path), "instant")))
    if camera.odometry is not None:
        scale = ", of unknown scale" if camera.scale_free_odometry else ""
        rows.append(("odometry", f"{count(len(camera.odometry), 'pose')}{scale}"))
    rows += [*clock_rows(camera.clock), *detection_rows(camera.detections)]
    video = camera.video
    if video is not None and video.path is not None:
        rows.append(("file", f"{video.path}{'' if video.path.is_file() else ' (not there)'}"))
    if video is not None and video.images:
        size = sum(map(len, video.images.values())) / 1e6
        rows.append(("images", f"{count(len(video.images), 'frame')} embedded, {size:.1f} MB"))
    return facts(f"camera '{camera.name}', {'moving' if camera.moving else 'standing still'}", *rows)


def image_text(model: CameraModel, focal_sigma: float | None = None) -> str:
    """Describe image size and lens; ``focal_sigma`` is the standard deviation of the focal length's logarithm."""
    bent = f"{len(model.distortion)} distortion coefficients" if model.distortion else "no distortion"
    known_to = f" ± {100 * focal_sigma:.1f} %" if focal_sigma else ""
    focal = f"focal length {model.focal[0]:.0f}, {model.focal[1]:.0f} px{known_to}"
    return f"{model.width} by {model.height} pixels, {focal}, {bent}"


def clock_rows(clock: VideoClock, sigma: tuple[float, float] | None = None) -> list[Row]:
    """Rows of offset and drift of the video's clock."""
    rows: list[Row] = []
    offset_sigma, drift_sigma = (math.nan, math.nan) if sigma is None else sigma
    if clock.offset or clock.drift or sigma is not None:
        rows.append(("video behind the sensors by", Quantity(MM * clock.offset, MM * offset_sigma, "ms", 1)))
    if clock.drift or sigma is not None:
        rows.append(("and more a minute", Quantity(60 * MM * clock.drift, 60 * MM * drift_sigma, "ms", 1)))
    return rows


def detection_rows(detections: Detections) -> list[Row]:
    """Rows of a video's frames, rate and detections."""
    keypoints, frames = detections.keypoints, len(detections.time)
    rows: list[Row] = [("keypoints", f"{keypoints.name} ({len(keypoints)})")]
    if not frames:
        return [*rows, ("video", "no frame")]
    time = detections.time
    rows.append(("video", f"{count(frames, 'frame')} at {detections.rate:.4g} Hz, {time[0]:z.2f} to {time[-1]:.2f} s"))
    people, often = np.unique(np.bincount(detections.frame, minlength=frames), return_counts=True)
    shares = ", ".join(f"{number or 'nobody'} in {times}" for number, times in zip(people, often, strict=True))
    rows.append(("detections", f"{len(detections)}; people per frame: {shares}"))
    if len(detections):
        is_detected = detections.seen
        middle = np.median(detections.confidence[is_detected]) if np.any(is_detected) else 0.0
        rows.append(("keypoints seen", f"{100 * is_detected.mean():.0f} %, median confidence {middle:.2f}"))
    if detections.torso_colour is not None:
        coloured = int(np.sum(np.isfinite(detections.torso_colour).all(axis=1)))
        rows.append(("colours of clothes", f"in {coloured} of them, to tell who is who"))
    return rows


def path_text(p_world_camera: Array) -> str:
    """Describe a camera's position or the length of its path; positions ``(T, 3)`` in metres."""
    stands = 0.1  # m: within it a camera counts as static
    middle = np.median(p_world_camera, axis=0)
    where = f"stood at {', '.join(f'{value:.2f}' for value in middle)} m"
    if len(p_world_camera) == 1:
        return where
    reach = np.linalg.norm(p_world_camera - middle, axis=1).max()
    if reach < stands:
        return f"{where}, within {100 * reach:.0f} cm, in {len(p_world_camera)} poses"
    length = np.linalg.norm(np.diff(p_world_camera, axis=0), axis=1).sum()
    return f"{length:.2f} m in {len(p_world_camera)} poses"


def _camera_truth_facts(truth: CameraTruth, names: Sequence[str]) -> Table:
    counts = [f"{np.sum(truth.wearer == index)} of {name}" for index, name in enumerate(names)]
    rows = [("path", path_text(truth.path.p_world_camera))]
    rows += [] if truth.model is None else [("image", image_text(truth.model))]
    references = {"heading and mounting of its sensor": truth.calibration, "true pixels": truth.pixels}
    rows += [("also", name) for name, value in references.items() if value is not None]
    rows.append(("detections", f"{', '.join(counts)}, {np.sum(truth.wearer < 0)} of others or nobody"))
    return facts("truth of the camera", *rows)


def recording_tables(
    recording: Recording, time: Mapping[str, Array] | None = None, truth_frames: int | None = None
) -> Iterator[Table]:
    """Yield all tables of a recording; ``time`` and ``truth_frames`` replace samples that were not read."""
    yield recording_facts(recording)
    yield sensor_table(recording, time)
    yield truth_facts(recording, truth_frames)


def scene_tables(scene: Scene) -> Iterator[Table]:
    """Yield all tables of a scene: cameras, then wearers."""
    rows = [(count(len(scene.wearers), "wearer"), ", ".join(scene.names))]
    yield facts(f"scene '{scene.name}'", *rows, *([] if scene.cameras else [("camera", "none")]))
    for camera in scene.cameras:
        yield camera_facts(camera)
        if camera.truth is not None:
            yield _camera_truth_facts(camera.truth, scene.names)
    for wearer in scene.wearers:
        yield from recording_tables(wearer)


def site_table() -> Table:
    """Table of sensor sites: name, position and axes."""
    rows = []
    for name in SITES:
        where, axes = site_axes(name).split("; ")
        rows.append((name, where, *(axis.partition(" ")[2] for axis in axes.split(", "))))
    head = ("site", "where (from one joint to the next)", "x", "y", "z, out of the skin")
    return Table(head, rows, "axes in the wearer's own directions, in a T-pose with the palms down", words=5)
