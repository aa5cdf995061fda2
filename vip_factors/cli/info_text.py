"""What ``vip-factors info`` says of recordings, scenes, motions and estimates: lines and tables in plain text."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from vip_factors.body.hinges import HingeEstimate
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.estimate import (
    BodyEstimate,
    CameraEstimate,
    DetectorEstimate,
    Estimate,
    SensorPlaceEstimate,
    SolveReport,
    StartChoice,
    WearerEstimate,
)
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import SITES, SensorCalibration, site_axes, site_name
from vip_factors.sensors.camera_model import CameraModel, VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream, gaps_of, rate_of
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene, SceneTruth, Video

if TYPE_CHECKING:
    from vip_factors.io.mcap_source import RecordingIndex

MANY = 7.0  # nats: a thousand times
MEASURED = {"orientation_deg": ("orientation", "°"), "acceleration_m_s2": ("acceleration", " m/s²")}


def motion_text(motion: Motion, frames: int | None = None) -> str:
    """Length, rate and body of a motion, or of one of so many frames that are not with it."""
    frames = len(motion) if frames is None else frames
    lasts = f", {motion.start:.2f} to {motion.start + (frames - 1) / motion.rate:.2f} s" if frames else ""
    return (
        f"  {frames} frames at {motion.rate:g} Hz{lasts}\n"
        f"  body: {motion.skeleton.source}\n  {lengths_text(motion.skeleton)}"
    )


def recording_text(recording: Recording, index: "RecordingIndex | None" = None) -> str:
    """Who wore what, and what each sensor gave; by the index of its file, where its samples were not read."""
    subject = recording.subject
    lines = [
        f"recording '{recording.name}'",
        f"  subject: {subject.name}, {subject.body().source}",
        f"  placement: {recording.placement.name}; initial pose: {recording.initial_pose}",
    ]
    if subject.body_note:
        lines.insert(2, f"  body: {subject.body_note}")
    if recording.imus:
        start, end = recording.interval
        lines.append(f"  time: {start:.2f} to {end:.2f} s, {len(recording.imus)} sensors")
    lines += _sensor_lines(recording, {} if index is None else index.time)
    if recording.truth is not None:
        with_calibration = " and calibration" if recording.truth.calibration else ""
        lines += [
            f"  truth: motion{with_calibration}",
            "  "
            + motion_text(recording.truth.motion, None if index is None else index.truth_frames).replace("\n", "\n  "),
        ]
    lines += [f"  note: {line}" for line in recording.notes.splitlines() if line]
    if index is not None:
        lines.append("  note: told by the file's index: between the first and the last, samples were not read")
    return "\n".join(lines)


def _sensor_lines(recording: Recording, time: Mapping[str, Array]) -> list[str]:
    body = recording.subject.body()
    sites = {site.sensor: (site_name(site, body) or "elsewhere", site.bone) for site in recording.placement.sites}
    rows = [("sensor", "site", "bone", "samples", "rate", "gaps", "gives")]
    for name, imu in recording.imus.items():
        rows.append((name, *sites.get(name, ("not placed", "")), *stream_words(imu, time.get(name))))
    return ["  " + line for line in aligned(rows, left=len(rows[0]))]


def stream_words(imu: ImuStream, time: Array | None = None) -> tuple[str, str, str, str]:
    """Samples, rate, gaps and what the sensor gives; ``time`` of all its samples, where they are not with it."""
    time = imu.time if time is None else time
    gives = [
        word
        for word, values in (
            ("orientation", imu.R_inertial_sensor),
            ("specific force", imu.specific_force),
            ("angular rate", imu.angular_rate),
        )
        if values is not None
    ]
    gaps = gaps_of(time)
    missing = f"{len(gaps)} ({(gaps[:, 1] - gaps[:, 0]).sum():.2f} s)" if len(gaps) else "none"
    return str(len(time)), f"{rate_of(time):.1f} Hz", missing, ", ".join(gives)


def start_lines(start: StartChoice | None) -> list[str]:
    """Which start was chosen, the next that differs, and how much less likely that is."""
    if start is None:
        return []
    lines = [f"  start: {start.supposition}"]
    if start.rival:
        times = f"{math.exp(start.margin):.1f}" if start.margin < MANY else f"{math.exp(MANY):.0f} or more"
        lines.append(f"    next (a sensor turned by more than 60°): {start.rival}: {times} times less likely")
    if start.doubtful:
        lines.append(f"    not settled: {', '.join(start.doubtful)}")
    return lines


def verdict_lines(estimate: Estimate) -> list[str]:
    """Whether to rely on it, and what is odd about it."""
    return [f"  verdict: {estimate.verdict}", *(f"  {one.severity}: {one}" for one in estimate.all_findings)]


def estimate_text(estimate: WearerEstimate, only_estimate: bool = True, verbose: bool = False) -> str:
    """How it was made, and how far it is from what was measured; of one of several without the verdict."""
    lines = [f"estimate '{estimate.name}', method {estimate.method}", motion_text(estimate.motion)]
    lines += verdict_lines(Estimate.of_one(estimate)) if only_estimate else []
    lines += start_lines(estimate.start)
    lines.append(f"  standard deviations: {'yes' if estimate.covariance is not None else 'no'}")
    lines += report_lines(estimate.reports, verbose)
    for kind, values in estimate.residuals.items():
        finite, (name, unit) = values[np.isfinite(values)], MEASURED.get(kind, (kind, ""))
        if len(finite):
            half, most = np.quantile(finite, [0.5, 0.95])
            lines.append(
                f"  motion and sensors differ in {name} by {half:.2f}{unit} (median), 95 % below {most:.2f}{unit}"
            )
    if estimate.body is not None:
        lines += [f"  {line}" for line in body_lines(estimate.body)]
    lines += [f"  {line}" for line in sensor_place_lines(estimate.sensor_places)]
    bones = {one.sensor: one.bone for one in estimate.sensor_places}  # in files of older versions, nowhere else
    for name, one in estimate.calibration.items():
        bone = one.bone or bones.get(name, "")
        where, heading, mounting = f" (on {bone})" if bone else "", heading_text(one), mounting_text(one)
        lines.append(f"  heading of {name}{where}: {heading}; mounting {mounting} in the bone's axes")
    return "\n".join(lines)


def lengths_text(skeleton: Skeleton) -> str:
    """The lengths of the left limbs and the widths between joint centres, in millimetres."""
    ends = {"thigh": "left_knee", "shank": "left_ankle", "upper arm": "left_elbow", "forearm": "left_wrist"}
    limbs = ", ".join(f"{name} {1e3 * skeleton.bone_length(end):.0f}" for name, end in ends.items())
    rest = skeleton.p_pelvis_joint
    hips, shoulders = (
        1e3 * (rest[joint_index(f"left_{name}"), 0] - rest[joint_index(f"right_{name}"), 0])
        for name in ("hip", "shoulder")
    )
    return f"{limbs} mm; hips {hips:.0f}, shoulders {shoulders:.0f} mm apart"


def report_lines(reports: Sequence[SolveReport], verbose: bool) -> list[str]:
    """How long the computation took, and what stopped before it settled; if asked for, how each solve went."""
    if verbose or not reports:
        return [f"  {_solve_text(report)}" for report in reports]
    open_ends = dict.fromkeys(report.stage for report in reports if not report.converged)
    told = f"; stopped before it settled: {', '.join(open_ends)}" if open_ends else ""
    return [f"  computed in {sum(report.seconds for report in reports):.1f} s{told}"]


def _solve_text(report: SolveReport) -> str:
    before, after = sum(report.initial_cost.values()), sum(report.final_cost.values())
    ended = "" if report.converged else ", stopped before it settled"
    return (
        f"{report.stage}: {len(report.iterations)} steps, cost {before:.4g} to {after:.4g}, "
        f"{report.seconds:.1f} s{ended}"
    )


def mounting_text(calibration: SensorCalibration) -> str:
    """The turn of the sensor's axes in those of what it sits on, with the standard deviation if there is one."""
    w, x, y, z = quaternion_from_matrix(calibration.R_bone_sensor, Order.WXYZ)
    sigma = np.rad2deg(calibration.mounting_sigma)
    sure = f" ± {sigma.max():.1f}° (worst axis)" if np.all(np.isfinite(sigma)) else ""
    return f"wxyz {w:.3f} {x:.3f} {y:.3f} {z:.3f}{sure}"


def heading_text(calibration: SensorCalibration) -> str:
    """Degrees, with the standard deviation if there is one."""
    sigma, path = calibration.heading_sigma, np.rad2deg(calibration.heading_path)
    drift = f", {path[-1] - path[0]:+.1f}° by the end" if len(path) else ""
    return f"{np.rad2deg(calibration.heading):.1f}{f' ± {np.rad2deg(sigma):.1f}' if np.isfinite(sigma) else ''}°{drift}"


def body_lines(body: BodyEstimate) -> list[str]:
    """A table of lengths, before and after, in millimetres, then the hinges in degrees."""
    lines = []
    if body.names:
        rows = [("length (mm)", "before", "found", "")]
        values = zip(
            body.names, body.prior, body.prior_sigma, body.posterior, body.sigma, body.keeps_prior, strict=True
        )
        for name, prior, prior_sigma, found, sigma, keeps in values:
            kept = "hardly told by the data" if keeps else ""
            rows.append((name, with_sigma(1e3 * prior, 1e3 * prior_sigma), with_sigma(1e3 * found, 1e3 * sigma), kept))
        lines += aligned(rows, left=1)
    before = {one.joint: one for one in body.prior_hinges}
    for hinge in body.hinges:
        axis, sigmas = ", ".join(f"{value:.2f}" for value in hinge.axis), np.rad2deg(hinge.sigma)
        sure = f" ± {sigmas[0]:.1f}, {sigmas[1]:.1f}°" if np.all(np.isfinite(sigmas)) else ""
        supposed = f" (supposed {_carrying_angle(before[hinge.joint])})" if hinge.joint in before else ""
        name = hinge.joint.replace("_", " ")
        lines.append(f"{name}: carrying angle {_carrying_angle(hinge)}{supposed}, turns about ({axis}){sure}")
    return lines


def _carrying_angle(hinge: HingeEstimate) -> str:
    return f"{with_sigma(np.rad2deg(hinge.carrying_angle), np.rad2deg(hinge.carrying_sigma), 1)}°"


MM = 1e3
FORWARD, UP, LEFT = 2, 1, 0  # bone axes


def sensor_place_lines(places: Sequence[SensorPlaceEstimate]) -> list[str]:
    """A table: where each sensor was found, and where it was supposed; in bone axes, in millimetres."""
    rows: list[tuple[str, ...]] = [("sensor's place (mm; supposed)", "bone", "left", "up", "forward")]
    for one in places:
        cells = _cells((one.posterior, one.sigma), (one.prior, one.prior_sigma), (LEFT, UP, FORWARD))
        rows.append((one.sensor, one.bone, *cells))
    return aligned(rows, left=2) if places else []


def sites_text() -> str:
    """A table: every site by name, where it is, and the axes of a sensor there."""
    rows: list[tuple[str, ...]] = [("site", "where (from one joint to the next)", "x", "y", "z, out of the skin")]
    for name in SITES:
        where, axes = site_axes(name).split("; ")
        rows.append((name, where, *(one.partition(" ")[2] for one in axes.split(", "))))
    said = "left, right, up, down, front and back are the wearer's own, in a T-pose with the palms down"
    return "\n".join([*aligned(rows, left=5), said])


def detector_lines(detector: DetectorEstimate) -> list[str]:
    """A table: how far from where its table has it a detector puts each keypoint, of the left side, in millimetres."""
    rows: list[tuple[str, ...]] = [("keypoint's offset (mm; supposed)", "forward", "up", "outward")]
    for number, name in enumerate(detector.keypoints):
        found, prior = detector.posterior[number], detector.prior[number]
        sigma, prior_sigma = detector.sigma[number], detector.prior_sigma[number]
        rows.append((name, *_cells((found, sigma), (prior, prior_sigma), (FORWARD, UP, LEFT))))
    return aligned(rows, left=1)


def _cells(posterior: tuple[Array, Array], prior: tuple[Array, Array], axes: tuple[int, ...]) -> list[str]:
    """Text for each axis of values and standard deviations, both ``(3,)`` metres."""
    values, before = (MM * np.array(one) for one in (posterior, prior))
    return [
        f"{with_sigma(*values[:, axis])} ({with_sigma(before[0, axis], before[1, axis], sigma_decimals=0)})"
        for axis in axes
    ]


def aligned(rows: Sequence[Sequence[str]], left: int) -> list[str]:
    """Rows of as many cells each, as lines; the first ``left`` columns begin at their left, the others end right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if column < left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def with_sigma(value: float, sigma: float, decimals: int = 0, sigma_decimals: int = 1) -> str:
    """A value and its standard deviation, which is left out if it is not finite."""
    known = f" ± {sigma:.{sigma_decimals}f}" if np.isfinite(sigma) else ""
    return f"{value:z.{decimals}f}{known}"


CAMERA_AXES = "in the camera's axes (x right, y down, z forward)"
STANDS_M = 0.1  # what stays as near to one place was no walk: its poses tremble, and their steps add up to metres


def scene_text(scene: Scene) -> str:
    """The cameras and their detections, then every wearer."""
    names = ", ".join(scene.names)
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


def scene_estimate_text(estimate: Estimate, verbose: bool = False) -> str:
    """How it went, what was found odd, where the camera was, then every wearer."""
    lines = [f"estimate of scene '{estimate.name}', method {estimate.method}"]
    lines += verdict_lines(estimate)
    lines += report_lines(estimate.reports, verbose)
    if estimate.camera is not None:
        lines += _camera_estimate_lines(estimate.camera, [one.motion.name for one in estimate.wearers])
    given = estimate.wearer_of_detection
    if len(given):
        of = [f"{np.sum(given == index)} to {one.motion.name}" for index, one in enumerate(estimate.wearers)]
        lines.append(f"  detections: {', '.join(of)}, {np.sum(given < 0)} to nobody")
    lines += [f"  {sentence}" for sentence in estimate.association]
    if estimate.detector is not None:
        lines += [f"  {line}" for line in detector_lines(estimate.detector)]
    return "\n\n".join(["\n".join(lines), *(estimate_text(one, False, verbose) for one in estimate.wearers)])


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


def _count(number: int, one: str) -> str:
    return f"{number} {one if number == 1 else one + 's'}"
