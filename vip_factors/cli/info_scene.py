"""What ``vip-factors info`` says of a scene and of its estimate."""

from dataclasses import replace

import numpy as np

from vip_factors.cli.info_places import detector_lines
from vip_factors.cli.info_recording import (
    estimate_text,
    heading_text,
    mounting_text,
    recording_text,
    report_text,
    stream_words,
)
from vip_factors.estimate import CameraEstimate, Estimate
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel, VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Camera, Scene, SceneTruth, Video

CAMERA_AXES = "in the camera's axes (x right, y down, z forward)"
STANDS_M = 0.1  # what stays as near to one place was no walk: its poses tremble, and their steps add up to metres


def scene_text(scene: Scene) -> str:
    """The cameras and their detections, then every wearer."""
    names = ", ".join(wearer.subject.name for wearer in scene.wearers)
    lines = [f"scene '{scene.name}'", f"  {_count(len(scene.wearers), 'wearer')}: {names}"]
    if scene.camera is None:
        lines.append("  no camera")
    else:
        truths = (scene.truth, *scene.truth.further) if scene.truth is not None else (None,) * len(scene.cameras)
        for camera, truth in zip(scene.cameras, truths, strict=True):
            lines += _camera_lines(camera)
            if truth is not None:
                lines += _truth_lines(truth, names.split(", "))
    return "\n\n".join(["\n".join(lines), *(recording_text(wearer) for wearer in scene.wearers)])


def _camera_lines(camera: Camera) -> list[str]:
    stands = "moving" if camera.moving else "standing still"
    lines = [f"  camera '{camera.name}', {stands}: {_model_text(camera.model)}"]
    if camera.mount is not None:
        samples, rate, gaps, gives = stream_words(camera.mount.imu)
        lines.append(f"  camera's sensor: {camera.mount.imu.name}, {samples} samples, {rate}, gaps {gaps}, {gives}")
    if camera.known_path is not None:
        lines.append(f"  camera's pose known, at {_count(len(camera.known_path), 'instant')}")
    lines += _clock_lines(camera.clock)
    return lines + _detection_lines(camera.detections) + _video_lines(camera.video)


def _model_text(model: CameraModel) -> str:
    bent = f"{len(model.distortion)} distortion coefficients" if model.distortion else "no distortion"
    focal = f"focal length {model.focal[0]:.0f}, {model.focal[1]:.0f} px"
    return f"{model.width} by {model.height} pixels, {focal}, {bent}"


def _detection_lines(detections: Detections) -> list[str]:
    keypoints, frames = detections.keypoints, len(detections.time)
    lines = [f"  detections: keypoints {keypoints.name} ({len(keypoints)})"]
    if not frames:
        return [*lines, "  no video frame"]
    time, rate = detections.time, f"{detections.rate:.4g} Hz"
    lines.append(f"  {_count(frames, 'video frame')} at {rate}, {time[0]:.2f} to {time[-1]:.2f} s")
    numbers, counts = np.unique(np.bincount(detections.frame, minlength=frames), return_counts=True)
    shares = ", ".join(f"{number or 'nobody'} in {count}" for number, count in zip(numbers, counts, strict=True))
    lines.append(f"  {_count(len(detections), 'detection')}; people per frame: {shares}")
    if len(detections):
        seen = detections.seen
        middle = np.median(detections.confidence[seen]) if np.any(seen) else 0.0
        lines.append(f"  {100 * seen.mean():.0f} % of their keypoints found, median confidence {middle:.2f}")
    if detections.torso_colour is not None:
        looks = int(np.sum(np.isfinite(detections.torso_colour).all(axis=1)))
        lines.append(f"  colours of clothes in {looks} of them, to tell who is who")
    return lines


def _video_lines(video: Video | None) -> list[str]:
    if video is None:
        return []
    lines = []
    if video.path is not None:
        lines.append(f"  video: {video.path}{'' if video.path.is_file() else ' (not there)'}")
    if video.images:
        size = sum(map(len, video.images.values())) / 1e6
        lines.append(f"  {_count(len(video.images), 'frame')} embedded, {size:.1f} MB")
    return lines


def _truth_lines(truth: SceneTruth, names: list[str]) -> list[str]:
    of = [f"{np.sum(truth.wearer == index)} of {name}" for index, name in enumerate(names)]
    known = [f"camera {_path_text(truth.camera.p_world_camera)}"]
    known += ["heading and mounting of its sensor"] if truth.camera_calibration is not None else []
    known += ["true pixels"] if truth.pixels is not None else []
    return [
        f"  truth: {', '.join(known)}",
        f"  truth: detections are {', '.join(of)}, {np.sum(truth.wearer < 0)} of others or nobody",
    ]


def scene_estimate_text(estimate: Estimate) -> str:
    """How it went, what was found odd, where the camera was, then every wearer."""
    lines = [f"estimate of scene '{estimate.name}', method {estimate.method}"]
    lines += [f"  finding: {one}" for one in estimate.findings]
    lines += [f"  {report_text(report)}" for report in estimate.reports]
    if estimate.camera is not None:
        lines += _camera_estimate_lines(estimate.camera, [one.motion.name for one in estimate.wearers])
    given = estimate.wearer_of_detection
    if len(given):
        of = [f"{np.sum(given == index)} to {one.motion.name}" for index, one in enumerate(estimate.wearers)]
        lines.append(f"  detections: {', '.join(of)}, {np.sum(given < 0)} to nobody")
    lines += [f"  {sentence}" for sentence in estimate.association]
    if estimate.detector is not None:
        lines += [f"  {line}" for line in detector_lines(estimate.detector)]
    return "\n\n".join(["\n".join(lines), *(estimate_text(replace(one, findings=())) for one in estimate.wearers)])


def _camera_estimate_lines(camera: CameraEstimate, names: list[str]) -> list[str]:
    lines = [f"  camera '{camera.name}': {_path_text(camera.path.p_world_camera)}"]
    if camera.covariance is not None:
        variance = np.diagonal(camera.covariance, axis1=1, axis2=2)
        turn = np.rad2deg(np.sqrt(np.median(variance[:, :3].max(axis=1))))
        shift = np.sqrt(np.median(variance[:, 3:].max(axis=1)))
        lines.append(f"  camera known to {turn:.2f}° and {100 * shift:.1f} cm (median, worst axis)")
    if camera.residual_px is not None:
        for name, values in zip(names, camera.residual_px.T, strict=True):
            seen = values[np.isfinite(values)]
            middle = f"median {np.median(seen):.1f} px in {len(seen)} frames" if len(seen) else "never seen"
            lines.append(f"  reprojection of {name}: {middle}")
    if camera.calibration is not None:
        lines.append(f"  heading of the camera's sensor: {heading_text(camera.calibration)}")
        lines.append(f"  mounting of the camera's sensor: {mounting_text(camera.calibration)} {CAMERA_AXES}")
    return lines + _clock_lines(camera.clock, camera.clock_sigma)


def _clock_lines(clock: VideoClock, sigma: tuple[float, float] | None = None) -> list[str]:
    lines = []
    if clock.offset or clock.drift:
        lines.append(f"  video's clock: {clock.offset:+.3f} s to the sensors' at its time 0")
    if clock.drift:
        sure = "" if sigma is None else f" ± {1e6 * sigma[1]:.0f}"
        lines[-1] += f", and drifts by {1e6 * clock.drift:+.0f}{sure} ppm ({60e3 * clock.drift:+.1f} ms a minute)"
    return lines


def _path_text(p_world_camera: Array) -> str:
    if len(p_world_camera) == 1:
        return f"stood at {', '.join(f'{value:.2f}' for value in p_world_camera[0])} m"
    middle = np.median(p_world_camera, axis=0)
    if (reach := np.linalg.norm(p_world_camera - middle, axis=1).max()) < STANDS_M:
        where = ", ".join(f"{value:.2f}" for value in middle)
        return f"stood at {where} m, within {100 * reach:.0f} cm, in {len(p_world_camera)} poses"
    length = np.linalg.norm(np.diff(p_world_camera, axis=0), axis=1).sum()
    return f"{len(p_world_camera)} poses, a path of {length:.1f} m"


def _count(number: int, one: str, more: str = "") -> str:
    return f"{number} {one if number == 1 else more or one + 's'}"
