"""The text panel: what is shown, how good it is, and how each sensor was found to sit (Markdown)."""

from collections.abc import Sequence

import numpy as np

from vip_factors.estimate import SolveReport, WearerEstimate
from vip_factors.geometry.rotations import angle_between, wrap_angle
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.recording import Recording
from vip_factors.viz.compare import Compare

_PLACED = {
    Compare.ROOT: "turned about the vertical once, drawn on the true root path",
    Compare.WORLD: "turned about the vertical and shifted once",
    Compare.SIDE: "turned about the vertical once, stepped aside",
}


def summary(
    recording: Recording | None,
    estimate: WearerEstimate | None,
    error_mm: np.ndarray | None,
    compare: Compare,
    metrics: str = "",
) -> str:
    """Markdown for the panel; ``metrics`` (Markdown or plain text) is put below the headline."""
    name = estimate.name if estimate is not None else recording.name if recording is not None else "motion"
    lines = [f"# {name}", ""]
    if estimate is not None:
        motion = estimate.motion
        lines += [
            f"**{estimate.method}**, {len(motion)} frames at {motion.rate:g} Hz, {len(motion) / motion.rate:.1f} s, "
            f"{len(estimate.sensors)} sensors",
            "",
        ]
    compared = error_mm is not None and len(error_mm) > 0
    if error_mm is not None and compared:
        lines += [
            f"**Joint error {error_mm.mean():.1f} mm** (each frame aligned), "
            f"95th percentile {np.percentile(error_mm, 95):.1f} mm",
            "",
        ]
    lines += _colour_lines(compare if compared else None)
    if metrics:
        lines += [metrics, ""]
    if recording is not None:
        lines += _recording_lines(recording)
    if estimate is not None:
        truth = recording.truth.calibration if recording is not None and recording.truth is not None else None
        lines += _calibration_table(estimate.calibration, truth)
        lines += solve_lines(estimate.reports)
    return "\n".join(lines)


def _colour_lines(compare: Compare | None) -> list[str]:
    """The legend of what is drawn, as a list."""
    lines = ["- **Orange** is the wearer's left, **blue** the right."]
    if compare is not None:
        lines += [f"- In colour: the estimate, {_PLACED[compare]}.", "- See-through and grey: the truth."]
    lines.append("- Small boxes are the sensors, each in the colour of its curves: see *Sensors' colours*.")
    return [*lines, ""]


def paragraphs(text: str) -> list[str]:
    """Lines of a text each of which stays a line of its own: Markdown would run them together."""
    return [line for one in text.splitlines() if one.strip() for line in (one.strip(), "")]


def _recording_lines(recording: Recording) -> list[str]:
    subject, (start, end) = recording.subject, recording.interval
    stature = f"{subject.stature_m:.2f} m" if subject.stature_m is not None else "of unknown stature"
    lines = [
        f"Recording: {end - start:.1f} s, {len(recording.imus)} IMUs ({len(recording.placed)} placed, "
        f"{recording.placement.name}), worn by {subject.name}, {stature}, "
        f"initial pose {recording.initial_pose}.",
        "",
    ]
    return [*lines, *paragraphs(recording.notes)]


def _degrees(radians: float) -> str:
    return f"{np.rad2deg(radians):.1f}" if np.isfinite(radians) else "-"


def _calibration_table(calibration: Calibration, truth: Calibration | None) -> list[str]:
    """Heading and mounting per sensor in degrees; headings relative to the truth share one free turn."""
    if not calibration:
        return []
    known = [sensor for sensor in calibration if truth is not None and sensor in truth]
    head = "| sensor | heading ° | ± ° |" + (" heading error ° | mounting error ° |" if known else "")
    lines = [head, "|---|---|---|" + ("---|---|" if known else "")]
    gauge = 0.0
    if truth is not None and known:
        errors = np.array([calibration[sensor].heading - truth[sensor].heading for sensor in known])
        gauge = float(np.angle(np.exp(1j * errors).mean()))
    for sensor, one in calibration.items():
        row = f"| {sensor} | {_degrees(float(wrap_angle(one.heading)))} | {_degrees(one.heading_sigma)} |"
        if truth is not None and sensor in truth:
            heading_error = float(wrap_angle(one.heading - truth[sensor].heading - gauge))
            mounting_error = float(angle_between(one.R_bone_sensor, truth[sensor].R_bone_sensor))
            row += f" {_degrees(heading_error)} | {_degrees(mounting_error)} |"
        elif known:
            row += " - | - |"
        lines.append(row)
    return [*lines, ""]


def solve_lines(reports: Sequence[SolveReport]) -> list[str]:
    """A table (Markdown) of how the solves went; empty without any."""
    if not reports:
        return []
    lines = ["| solve | steps | cost | s |", "|---|---|---|---|"]
    for report in reports:
        before, after = sum(report.initial_cost.values()), sum(report.final_cost.values())
        ended = "" if report.converged else " (stopped)"
        lines.append(
            f"| {report.stage} | {len(report.iterations)}{ended} | {before:.4g} → {after:.4g} | {report.seconds:.1f} |"
        )
    return [*lines, ""]
