"""``vip-factors info``: what a file holds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from vip_factors.body.motion import Motion
from vip_factors.cli.files import open_one
from vip_factors.cli.options import parse
from vip_factors.estimate import Estimate
from vip_factors.sensors.recording import Recording


@dataclass(frozen=True)
class InfoOptions:
    """Say what a recording, an estimate or a motion holds: who, which sensors, how long, with which gaps."""

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """Recording or estimate (.mcap), or motion (.bvh …)."""


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(InfoOptions, prog, arguments)
    opened = open_one(options.file)
    parts = []
    if opened.recording is not None:
        parts.append(recording_text(opened.recording))
    if opened.estimate is not None:
        parts.append(estimate_text(opened.estimate))
    if opened.motion is not None:
        parts.append(f"motion '{opened.motion.name}'\n" + motion_text(opened.motion))
    print("\n\n".join(parts))


def motion_text(motion: Motion) -> str:
    """Length, rate and body of a motion."""
    return (
        f"  {len(motion)} frames at {motion.rate:g} Hz, {motion.time[0]:.2f} to {motion.time[-1]:.2f} s\n"
        f"  body: {motion.skeleton.source}"
    )


def recording_text(recording: Recording) -> str:
    """Who wore what, and what each sensor gave."""
    subject = recording.subject
    lines = [
        f"recording '{recording.name}'",
        f"  subject: {subject.name}, {subject.body().source}",
        f"  placement: {recording.placement.name}; initial pose: {recording.initial_pose}",
    ]
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
    bones = {site.sensor: site.bone for site in recording.placement.sites}
    rows = [("sensor", "bone", "samples", "rate", "gaps", "gives")]
    for name, imu in recording.imus.items():
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
        bone = bones.get(name, "not placed")
        rows.append((name, bone, str(len(imu)), f"{imu.rate:.1f} Hz", missing, ", ".join(gives)))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def estimate_text(estimate: Estimate) -> str:
    """How it was made, how the solves went, and how large the residuals are."""
    lines = [f"estimate '{estimate.name}', method {estimate.method}", motion_text(estimate.motion)]
    lines.append(f"  covariance: {'yes' if estimate.covariance is not None else 'no'}")
    for report in estimate.reports:
        before, after = sum(report.initial_cost.values()), sum(report.final_cost.values())
        ended = "" if report.converged else ", stopped before it settled"
        lines.append(
            f"  {report.stage}: {len(report.iterations)} steps, cost {before:.4g} to {after:.4g}, "
            f"{report.seconds:.1f} s{ended}"
        )
    for kind, values in estimate.residuals.items():
        finite = values[np.isfinite(values)]
        if len(finite):
            lines.append(
                f"  residual {kind}: median {np.median(finite):.2f}, 95 % below {np.quantile(finite, 0.95):.2f}"
            )
    for name, one in estimate.calibration.items():
        sigma = f" ± {np.rad2deg(one.heading_sigma):.1f}" if np.isfinite(one.heading_sigma) else ""
        lines.append(f"  heading of {name}: {np.rad2deg(one.heading):.1f}{sigma}°")
    return "\n".join(lines)
