"""What ``vip-factors info`` says of a recording, a motion and an estimate of one wearer."""

import math

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.cli.info_body import body_lines
from vip_factors.cli.info_places import sensor_place_lines
from vip_factors.cli.text_table import aligned
from vip_factors.estimate import SolveReport, StartChoice, WearerEstimate
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.sensors.calibration import SensorCalibration, site_name
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording

MANY = 7.0  # nats: a thousand times


def motion_text(motion: Motion) -> str:
    """Length, rate and body of a motion."""
    lasts = f", {motion.time[0]:.2f} to {motion.time[-1]:.2f} s" if len(motion) else ""
    return (
        f"  {len(motion)} frames at {motion.rate:g} Hz{lasts}\n"
        f"  body: {motion.skeleton.source}\n  {lengths_text(motion.skeleton)}"
    )


def recording_text(recording: Recording) -> str:
    """Who wore what, and what each sensor gave."""
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
    lines += _sensor_lines(recording)
    if recording.truth is not None:
        with_calibration = " and calibration" if recording.truth.calibration else ""
        lines += [
            f"  truth: motion{with_calibration}",
            "  " + motion_text(recording.truth.motion).replace("\n", "\n  "),
        ]
    lines += [f"  note: {line}" for line in recording.notes.splitlines() if line]
    return "\n".join(lines)


def _sensor_lines(recording: Recording) -> list[str]:
    body = recording.subject.body()
    sites = {site.sensor: (site_name(site, body) or "elsewhere", site.bone) for site in recording.placement.sites}
    rows = [("sensor", "site", "bone", "samples", "rate", "gaps", "gives")]
    for name, imu in recording.imus.items():
        rows.append((name, *sites.get(name, ("not placed", "")), *stream_words(imu)))
    return ["  " + line for line in aligned(rows, left=len(rows[0]))]


def stream_words(imu: ImuStream) -> tuple[str, str, str, str]:
    """Samples, rate, gaps and what the sensor gives."""
    gives = [
        word
        for word, values in (
            ("orientation", imu.R_inertial_sensor),
            ("specific force", imu.specific_force),
            ("angular rate", imu.angular_rate),
        )
        if values is not None
    ]
    gaps = imu.gaps
    missing = f"{len(gaps)} ({(gaps[:, 1] - gaps[:, 0]).sum():.2f} s)" if len(gaps) else "none"
    return str(len(imu)), f"{imu.rate:.1f} Hz", missing, ", ".join(gives)


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


def estimate_text(estimate: WearerEstimate) -> str:
    """How it was made, how the solves went, and how large the residuals are."""
    lines = [f"estimate '{estimate.name}', method {estimate.method}", motion_text(estimate.motion)]
    lines += [f"  finding: {one}" for one in estimate.findings]
    lines += start_lines(estimate.start)
    lines.append(f"  covariance: {'yes' if estimate.covariance is not None else 'no'}")
    lines += [f"  {report_text(report)}" for report in estimate.reports]
    for kind, values in estimate.residuals.items():
        finite = values[np.isfinite(values)]
        if len(finite):
            lines.append(
                f"  residual {kind}: median {np.median(finite):.2f}, 95 % below {np.quantile(finite, 0.95):.2f}"
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


def report_text(report: SolveReport) -> str:
    """How one solve went."""
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
