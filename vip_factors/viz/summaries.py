"""The text panel: what is odd first, then how good it is, who wears what, and how the solve went (Markdown)."""

from collections.abc import Sequence

import numpy as np

from vip_factors.estimate import Estimate, SolveReport
from vip_factors.findings import Finding, verdict
from vip_factors.geometry.rotations import angle_between
from vip_factors.sensors.scene import Scene
from vip_factors.viz.colours import colour_name
from vip_factors.viz.compare import APART, Compare
from vip_factors.viz.drawn_scene import NOBODY, DrawnScene, DrawnWearer, rows_of

KEPT = 40  # findings of a stream that are shown: an hour's list would be sent again with each
LIMBS = "left limbs are lighter, right ones darker"
SENSORS = "- Small boxes are the sensors, each in the colour of its curves: see *Sensors' colours*."
IMAGE = "- In the picture: bodies are broad lines, detections dots and fine lines; grey are nobody's."
_PLACED = {
    Compare.ROOT: "turned about the vertical once, drawn on the true root path",
    Compare.WORLD: "turned about the vertical and shifted once",
    Compare.SIDE: "turned about the vertical once, stepped aside",
}


def scene_summary(drawn: DrawnScene) -> str:
    """Markdown for the panel."""
    estimates = [one.estimate for one in drawn.wearers if one.estimate is not None]
    lines = [f"# {drawn.name}", ""]
    if estimates:
        method, motion = (
            drawn.estimate.method if drawn.estimate is not None else estimates[0].method,
            estimates[0].motion,
        )
        count = f", {len(drawn.wearers)} wearers" if len(drawn.wearers) > 1 else ""
        sensors = (
            f", {sum(len(one.sensors) for one in estimates)} sensors" if any(one.sensors for one in estimates) else ""
        )
        lines += [f"**{method}**{count}, {len(motion)} frames at {motion.rate:g} Hz{sensors}", ""]
        lines += finding_lines(drawn.estimate or Estimate.of_one(estimates[0]))
    lines += [*_wearer_table(drawn), *_colour_lines(drawn), *_camera_lines(drawn)]
    for wearer in drawn.wearers:
        lines += [*_recording_lines(wearer, drawn.one_alone), *_body_table(wearer), *_sensor_table(wearer)]
    reports = drawn.estimate.reports if drawn.estimate is not None else [r for one in estimates for r in one.reports]
    return "\n".join([*lines, *solve_lines(reports)])


def finding_lines(estimate: Estimate) -> list[str]:
    """The verdict, and what is odd, a point of a list each."""
    return [f"**{estimate.verdict}**", "", *(f"- {one.severity}: {one}" for one in estimate.all_findings), ""]


def _colour_lines(drawn: DrawnScene) -> list[str]:
    """The legend of what is drawn, as a list."""
    compared = any(one.motion is not None and one.truth is not None for one in drawn.wearers)
    lines = [f"- **{one.name}** is {colour_name(one.index)}; {LIMBS}." for one in drawn.wearers]
    if drawn.one_alone:
        lines = ["- **Orange** is the wearer's left, **blue** the right."]
    if compared and drawn.compare is not None:
        lines.append(f"- In colour: the estimate, {_PLACED[drawn.compare]}.")
    if compared:
        lines.append("- See-through and grey: the truth.")
    return _legend(lines, drawn.detections is not None, drawn.apart)


def _legend(lines: Sequence[str], has_camera: bool, apart: bool) -> list[str]:
    return ["## Colours", "", *lines, *[IMAGE] * has_camera, SENSORS, *[f"- **{APART}**"] * apart, ""]


def _camera_lines(drawn: DrawnScene) -> list[str]:
    if drawn.one_alone:
        return []
    detections, labels = drawn.detections, drawn.labels
    if detections is None or labels is None or drawn.model is None:
        seen = "estimated; what it saw is in the scene's own file" if drawn.path is not None else "none"
        return [f"Camera: {seen}.", ""]
    text = (
        f"Camera: {drawn.model.width} by {drawn.model.height} pixels, {len(detections.time)} frames at "
        f"{detections.rate:.4g} Hz, {len(detections)} people detected ({detections.keypoints.name}), "
        f"{int(np.sum(labels != NOBODY))} of them given to wearers (coloured; grey is nobody)."
    )
    lines = [text, ""]
    if drawn.path is not None and drawn.true_path is not None:
        other = drawn.true_path.at(drawn.path.time)
        off = 100 * np.linalg.norm(drawn.path.p_world_camera - other.p_world_camera, axis=1)
        lines += [f"**Camera {off.mean():.1f} cm** from its true path on average, at most {off.max():.1f} cm.", ""]
    return lines


def _wearer_table(drawn: DrawnScene) -> list[str]:
    lines = ["| wearer | joint error mm | 95 % below | reprojection px | sensors |", "|---|---|---|---|---|"]
    for wearer in drawn.wearers:
        error = wearer.error_mm
        pixels = drawn.reprojection_px(wearer) if drawn.estimate is not None else None
        joint = (
            [f"{error.mean():.1f}", f"{np.percentile(error, 95):.1f}"]
            if error is not None and len(error)
            else ["-"] * 2
        )
        median = f"{np.nanmedian(pixels):.1f}" if pixels is not None else "-"
        sensors = str(len(wearer.recording.placed)) if wearer.recording is not None else "-"
        lines.append("| " + " | ".join([wearer.name, *joint, median, sensors]) + " |")
    return [*lines, ""]


def _body_table(wearer: DrawnWearer) -> list[str]:
    """Lengths before and after; none where no body was looked for."""
    body = wearer.estimate.body if wearer.estimate is not None else None
    if body is None or not body.names:
        return []
    lines = [f"| {wearer.name} | likely mm | ± mm | found mm | ± mm |", "|---|---|---|---|---|"]
    rows = zip(body.names, body.prior, body.prior_sigma, body.posterior, body.sigma, strict=True)
    lines += [f"| {name} | " + " | ".join(_text(1e3 * value) for value in values) + " |" for name, *values in rows]
    return [*lines, ""]


def _sensor_table(wearer: DrawnWearer) -> list[str]:
    """Heading and mounting per sensor in degrees; headings relative to the truth share one free turn."""
    rows = rows_of(wearer)
    if not rows or wearer.estimate is None:
        return []
    truth = wearer.recording.truth.calibration if wearer.recording is not None and wearer.recording.truth else {}
    lines = [f"| {wearer.name} | heading ° | ± ° | error ° | mounting error ° |", "|---|---|---|---|---|"]
    for row in rows:
        found, known = wearer.estimate.calibration[row.sensor], (truth or {}).get(row.sensor)
        off = np.nan if known is None else float(np.rad2deg(angle_between(found.R_bone_sensor, known.R_bone_sensor)))
        lines.append(
            f"| {row.sensor} | {_text(row.heading)} | {_text(row.sigma)} | {_text(row.error)} | {_text(off)} |"
        )
    return [*lines, ""]


def _recording_lines(wearer: DrawnWearer, with_notes: bool) -> list[str]:
    if wearer.recording is None:
        return []
    recording = wearer.recording
    subject, (start, end) = recording.subject, recording.interval
    stature = f"{subject.stature_m:.2f} m" if subject.stature_m is not None else "of unknown stature"
    lines = [
        f"Recording: {end - start:.1f} s, {len(recording.imus)} IMUs ({len(recording.placed)} placed, "
        f"{recording.placement.name}), worn by {subject.name}, {stature}, initial pose {recording.initial_pose}.",
        "",
    ]
    return [*lines, *(paragraphs(recording.notes) if with_notes else [])]


def paragraphs(text: str) -> list[str]:
    """Lines of a text each of which stays a line of its own: Markdown would run them together."""
    return [line for one in text.splitlines() if one.strip() for line in (one.strip(), "")]


def _text(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"


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


def live_summary(setup: Scene, findings: Sequence[tuple[float, Finding]], apart: bool) -> str:
    """The text.

    Args:
        setup: of what is streamed.
        findings: and the seconds at which they were made, in their order.
        apart: whether the wearers are set apart.
    """
    lines = [f"# {setup.name}", ""]
    if findings:
        lines += ["## Findings", "", f"**{verdict(one for _, one in findings)}**", ""]
        lines += [f"- **{time:.1f} s** {one}" for time, one in reversed(findings[-KEPT:])]
        lines.append("")
    colours = [f"- **{name}**, newest: {colour_name(index)}, solid; {LIMBS}." for index, name in enumerate(setup.names)]
    colours.append("- Newest, preliminary (the first seconds, from little data): dark grey, solid.")
    colours.append("- Smoothed, a moment earlier: dark grey, see-through.")
    return "\n".join([*lines, *_legend(colours, setup.camera is not None, apart)])
