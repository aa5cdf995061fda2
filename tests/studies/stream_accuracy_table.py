"""The trials of :mod:`tests.studies.stream_accuracy` as tables and as JSON."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace

import numpy as np

from tests.studies.live_measures import PoseErrors, SinceStart
from tests.studies.stream_accuracy import SETTLED_S, StreamTrial, StreamTrials
from tests.studies.vip_table import plain


def stream_accuracy_table(results: Sequence[StreamTrial], trials: StreamTrials) -> str:
    """Markdown: errors by camera, beginning and lag; then by time since the start."""
    clips = len({(one.clip, one.seed) for one in results})
    title = (
        f"{clips} recordings of {trials.scenes.seconds:g} s, 13 sensors; errors from {SETTLED_S:g} s on, "
        "each clip alike. newest: zero lag; smoothed: one lag later"
    )
    blocks = [[title], _errors_lines(results), ["By time since tracking began, newest poses, all clips"]]
    blocks[-1] += ["", *_since_lines(results)]
    failures = [f"- {t.clip}, {t.camera}, {t.begin}, {t.estimator}: {t.failure}" for t in results if t.failure]
    if failures:
        blocks.append(["No estimate, and left out of the means:", *failures])
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def _errors_lines(results: Sequence[StreamTrial]) -> list[str]:
    head = [
        "camera", "begin", "estimator", "newest mm", "deg", "root cm", "jitter", "smoothed mm", "deg", "root cm",
        "jitter", "of truth", "to batch", "heading", "95 %", "mounting", "95 %", "lost", "CPU ms", "95 %",
    ]  # fmt: skip
    lines = [f"| {' | '.join(head)} |", "|---|---|---|" + "---:|" * (len(head) - 3)]
    for camera, begin in dict.fromkeys((one.camera, one.begin) for one in results):
        rows = [one for one in results if (one.camera, one.begin) == (camera, begin)]
        for estimator in dict.fromkeys(one.estimator for one in rows):
            own = [one for one in rows if one.estimator == estimator]
            lines.append(f"| {camera} | {begin} | {estimator} | {' | '.join(_row(own, rows))} |")
    return lines


def _row(own: Sequence[StreamTrial], rows: Sequence[StreamTrial]) -> list[str]:
    cells = [*_errors([one.newest for one in own]), *_errors([one.smoothed for one in own])]
    cells += [_one(_mean(one.jitter_truth for one in own)), _to_batch(own, rows)]
    for name in ("heading_deg", "mounting_deg"):
        values = np.array([getattr(sensor, name) for one in own for sensor in one.sensors])
        cells += [_one(values.mean()), _one(np.quantile(values, 0.95))] if len(values) else ["", ""]
    times = [_one(_mean(one.cpu_ms for one in own)), _one(_mean(one.cpu_ms_95 for one in own))]
    return [*cells, str(sum(one.lost for one in own)), *times]


def _errors(errors: Sequence[PoseErrors | None]) -> list[str]:
    known = [one for one in errors if one is not None]
    names = ("mpjpe_mm", "mpjae_deg", "root_cm", "jitter")
    return [_one(_mean(getattr(one, name) for one in known)) for name in names]


def _to_batch(own: Sequence[StreamTrial], rows: Sequence[StreamTrial]) -> str:
    """MPJPE of newest and smoothed over batch's, over the recordings that both solved."""
    batch = {(one.clip, one.seed): one.smoothed for one in rows if one.lag_s is None and one.smoothed is not None}
    both = [one for one in own if one.lag_s is not None and (one.clip, one.seed) in batch and one.newest is not None]
    if not both:
        return ""
    reference = sum(batch[one.clip, one.seed].mpjpe_mm for one in both)
    ratios = [
        sum(errors.mpjpe_mm for one in both if (errors := pick(one)) is not None) / reference
        for pick in (lambda one: one.newest, lambda one: one.smoothed)
    ]
    return " / ".join(f"{ratio:.2f}" for ratio in ratios)


def _since_lines(results: Sequence[StreamTrial]) -> list[str]:
    spans = sorted({(span.since_s, span.until_s) for one in results for span in one.over_time})
    head = ["camera", "begin", "estimator"]
    for since, until in spans:
        name = f"{since:g} to {until:g} s" if np.isfinite(until) else f"from {since:g} s"
        head += [f"{name}: mm", "deg RMS", "expected"]
    lines = [f"| {' | '.join(head)} |", "|---|---|---|" + "---:|" * (len(head) - 3)]
    groups = dict.fromkeys((one.camera, one.begin, one.estimator) for one in results if one.over_time)
    for group in groups:
        own = [one for one in results if (one.camera, one.begin, one.estimator) == group]
        cells: list[str] = []
        for key in spans:
            cells += _span([span for one in own for span in one.over_time if (span.since_s, span.until_s) == key])
        lines.append(f"| {' | '.join(group)} | {' | '.join(cells)} |")
    return lines


def _span(spans: Sequence[SinceStart]) -> list[str]:
    if not spans:
        return ["", "", ""]
    squares = [np.sqrt(_mean(getattr(one, name) ** 2 for one in spans)) for name in ("error_deg", "sigma_deg")]
    return [_one(_mean(one.mpjpe_mm for one in spans)), *(_one(float(value)) for value in squares)]


def _mean(values: Iterable[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")


def _one(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else ""


def stream_accuracy_line(trial: StreamTrial) -> str:
    """One trial on one line."""
    where = f"{trial.clip}, camera {trial.camera}, {trial.begin}, {trial.estimator}"
    if trial.failure:
        return f"{where}: {trial.failure}"
    newest, smoothed = (
        "" if one is None else f"{one.mpjpe_mm:.1f} mm {one.mpjae_deg:.1f} deg root {one.root_cm:.1f} cm"
        for one in (trial.newest, trial.smoothed)
    )
    return f"{where}: newest {newest or 'none'}; smoothed {smoothed or 'none'}; CPU {trial.cpu_s:.1f} s"


def stream_accuracy_json(results: Sequence[StreamTrial], trials: StreamTrials) -> str:
    """Every trial and the settings; what is not defined is null."""
    finite = [
        replace(one, over_time=tuple(replace(s, until_s=min(s.until_s, 1e9)) for s in one.over_time)) for one in results
    ]
    content = plain({"trials": [asdict(one) for one in finite], "settings": asdict(trials)})
    return json.dumps(content, indent=2) + "\n"
