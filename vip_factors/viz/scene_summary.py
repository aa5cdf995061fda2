"""The text panel of a scene: what is odd first, then how good it is, who wears what, and how the solve went."""

from collections.abc import Sequence

import numpy as np

from vip_factors.viz.colours import colour_name
from vip_factors.viz.compare import APART
from vip_factors.viz.drawn_scene import NOBODY, DrawnScene, DrawnWearer
from vip_factors.viz.headings import rows_of
from vip_factors.viz.summary import solve_lines


def scene_summary(drawn: DrawnScene, metrics: str = "") -> str:
    """Markdown for the panel; ``metrics`` (Markdown) is put below the headline."""
    estimate = drawn.estimate
    lines = [f"# {drawn.name}", ""]
    if estimate is not None:
        count = f", {len(drawn.wearers)} wearers" if len(drawn.wearers) > 1 else ""
        lines += [f"**{estimate.method}**{count}", ""]
        lines += finding_lines(estimate.findings)
    if metrics:
        lines += [metrics, ""]
    lines += [*_wearer_table(drawn), *_colour_lines(drawn), *_camera_lines(drawn)]
    for wearer in drawn.wearers:
        lines += [*_body_table(wearer), *_sensor_table(wearer)]
    if estimate is not None:
        lines += solve_lines(estimate.reports)
    return "\n".join(lines)


def finding_lines(findings: Sequence[str]) -> list[str]:
    """What is odd, a point of a list each; nothing where nothing is."""
    if not findings:
        return []
    return ["## Notes", "", *(f"- {one}" for one in findings), ""]


def _colour_lines(drawn: DrawnScene) -> list[str]:
    """The legend of what is drawn, as a list."""
    lines = [
        f"- **{one.name}** is {colour_name(one.index)}; left limbs are lighter, right ones darker."
        for one in drawn.wearers
    ]
    if any(one.motion is not None and one.truth is not None for one in drawn.wearers):
        lines.append("- See-through and grey: the truth.")
    if drawn.detections is not None:
        lines.append("- In the picture: bodies are broad lines, detections dots and fine lines; grey are nobody's.")
    lines.append("- Small boxes are the sensors, each in the colour of its curves: see *Sensors' colours*.")
    if drawn.apart:
        lines.append(f"- **{APART}**")
    return ["## Colours", "", *lines, ""]


def _camera_lines(drawn: DrawnScene) -> list[str]:
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
    lines = ["| wearer | joint error mm | reprojection px | sensors |", "|---|---|---|---|"]
    for wearer in drawn.wearers:
        error = wearer.error_mm
        pixels = drawn.reprojection_px(wearer) if drawn.estimate is not None else None
        joint = f"{error.mean():.1f}" if error is not None else "-"
        median = f"{np.nanmedian(pixels):.1f}" if pixels is not None else "-"
        sensors = len(wearer.recording.placed) if wearer.recording is not None else "-"
        lines.append(f"| {wearer.name} | {joint} | {median} | {sensors} |")
    return [*lines, ""]


def _body_table(wearer: DrawnWearer) -> list[str]:
    """Lengths before and after; none where no body was looked for."""
    body = wearer.estimate.body if wearer.estimate is not None else None
    if body is None or not body.names:
        return []
    lines = [f"| {wearer.name} | likely mm | ± mm | found mm | ± mm |", "|---|---|---|---|---|"]
    rows = zip(body.names, body.prior, body.prior_sigma, body.found, body.sigma, strict=True)
    lines += [f"| {name} | " + " | ".join(_text(1e3 * value) for value in values) + " |" for name, *values in rows]
    return [*lines, ""]


def _sensor_table(wearer: DrawnWearer) -> list[str]:
    rows = rows_of(wearer)
    if not rows:
        return []
    lines = [f"| {wearer.name} | heading ° | ± ° | error ° |", "|---|---|---|---|"]
    lines += [f"| {r.sensor} | {_text(r.heading)} | {_text(r.sigma)} | {_text(r.error)} |" for r in rows]
    return [*lines, ""]


def _text(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"
