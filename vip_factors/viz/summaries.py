"""Text panels of the viewers in Markdown: verdict and findings, figures, colours, and facts about every wearer."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from vip_factors.describe.estimates import (
    calibration_table,
    camera_estimate_facts,
    detection_table,
    figure_table,
    length_table,
    solve_table,
    verdict_facts,
)
from vip_factors.describe.recordings import detection_rows, recording_facts
from vip_factors.estimate import Estimate
from vip_factors.findings import Finding, verdict
from vip_factors.sensors.scene import Scene
from vip_factors.tables import Quantity, Row, Table, facts, markdown, plain
from vip_factors.viz.colours import colour_name
from vip_factors.viz.compare import APART, Compare
from vip_factors.viz.drawn_scene import DrawnScene

KEPT = 40  # findings of a stream that are shown: an hour's list would be sent again with each
LIMBS = "left limbs are lighter, right ones darker"
SENSORS = "- Small boxes are the sensors, each in the colour of its curves."
IMAGE = "- In the picture: bodies are broad lines, detections dots and fine lines; grey are nobody's."
_PLACED = {
    Compare.ROOT: "turned about the vertical once, drawn on the true root path",
    Compare.WORLD: "turned about the vertical and shifted once",
    Compare.SIDE: "turned about the vertical once, stepped aside",
}


def scene_summary(drawn: DrawnScene) -> str:
    """Markdown for the panel."""
    lines = [f"# {plain(drawn.name)}", ""]
    for table in _overview_tables(drawn):
        lines += markdown(table)
    lines += _colour_lines(drawn)
    for table in _detail_tables(drawn):
        lines += markdown(table)
    return "\n".join(lines)


def _estimate_of(drawn: DrawnScene) -> Estimate | None:
    if drawn.estimate is not None:
        return drawn.estimate
    estimates = [wearer.estimate for wearer in drawn.wearers if wearer.estimate is not None]
    return Estimate.of_one(estimates[0]) if estimates else None


def _overview_tables(drawn: DrawnScene) -> Iterator[Table]:
    estimate = _estimate_of(drawn)
    if estimate is not None:
        yield verdict_facts(estimate)
        yield figure_table(estimate)
    yield _error_table(drawn)


def _error_table(drawn: DrawnScene) -> Table:
    """How far each wearer is from the truth and from the picture."""
    rows: list[Row] = []
    for wearer in drawn.wearers:
        error = wearer.error_mm if wearer.error_mm is not None else np.zeros(0)
        pixels = drawn.reprojection_px(wearer) if drawn.estimate is not None else None
        mean, most = (error.mean(), np.percentile(error, 95)) if len(error) else (np.nan, np.nan)
        median = np.nan if pixels is None else float(np.nanmedian(pixels))
        if np.isfinite([mean, median]).any():
            rows.append((wearer.name, *(Quantity(float(value), decimals=1) for value in (mean, most, median))))
    return Table(("wearer", "joint error, mm", "95 % below", "reprojection, px"), rows)


def _detail_tables(drawn: DrawnScene) -> Iterator[Table]:
    estimate, names = drawn.estimate, [wearer.name for wearer in drawn.wearers]
    if drawn.detections is not None:
        yield facts("camera", *detection_rows(drawn.detections))
    if estimate is not None and estimate.camera is not None:
        yield camera_estimate_facts(estimate.camera)
        yield detection_table(estimate, names)
    if drawn.path is not None and drawn.true_path is not None:
        true_path = drawn.true_path.at(drawn.path.time)
        error = 100 * np.linalg.norm(drawn.path.p_world_camera - true_path.p_world_camera, axis=1)
        yield facts("", ("off the true path by", f"{error.mean():.1f} cm on average, at most {error.max():.1f} cm"))
    for wearer in drawn.wearers:
        if wearer.recording is not None:
            yield recording_facts(wearer.recording)
        if wearer.estimate is not None:
            yield length_table(wearer.estimate.body)
            yield calibration_table(wearer.estimate, wearer.recording)
    whole = _estimate_of(drawn)
    yield solve_table(() if whole is None else whole.all_reports, with_cost=True)


def _colour_lines(drawn: DrawnScene) -> list[str]:
    """Legend of what is drawn."""
    compared = any(wearer.motion is not None and wearer.truth is not None for wearer in drawn.wearers)
    lines = [f"- **{plain(wearer.name)}** is {colour_name(wearer.index)}; {LIMBS}." for wearer in drawn.wearers]
    if drawn.one_alone:
        lines = ["- **Orange** is the wearer's left, **blue** the right."]
    if compared and drawn.compare is not None:
        lines.append(f"- In colour: the estimate, {_PLACED[drawn.compare]}.")
    if compared:
        lines.append("- See-through and grey: the truth.")
    return _legend(lines, drawn.detections is not None, drawn.apart)


def _legend(lines: Iterable[str], has_camera: bool, apart: bool) -> list[str]:
    return ["## Colours", "", *lines, *[IMAGE] * has_camera, SENSORS, *[f"- **{APART}**"] * apart, ""]


def live_summary(setup: Scene, findings: Sequence[tuple[float, Finding]], apart: bool) -> str:
    """Markdown for the panel of a stream.

    Args:
        setup: what is streamed.
        findings: with the seconds at which they were made, in their order.
        apart: whether the wearers are set apart.
    """
    lines = [f"# {plain(setup.name)}", ""]
    if findings:
        newest = [(f"{time:.1f} s", str(finding)) for time, finding in reversed(findings[-KEPT:])]
        lines += markdown(facts("Findings", ("verdict", str(verdict(finding for _, finding in findings))), *newest))
    colours = [
        f"- **{plain(name)}**, newest: {colour_name(index)}, solid; {LIMBS}." for index, name in enumerate(setup.names)
    ]
    colours.append("- Newest, preliminary (the first seconds, from little data): dark grey, solid.")
    colours.append("- Smoothed, a moment earlier: dark grey, see-through.")
    return "\n".join([*lines, *_legend(colours, setup.camera is not None, apart)])
