"""The table of real recordings, and the same as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np

from tests.studies.real import RealTrial
from tests.studies.walk import AngleError
from vip_factors.evaluate.table import json_text, number


def real_table(trials: Sequence[RealTrial]) -> str:
    """Markdown: RMSE in degrees, mean of both sides, in brackets with the mean removed; findings batch, live.

    Where a whole body's markers are known, a table of what they tell; where a video or strides are, one of how far
    these agree.
    """
    lines = [
        "| recording | s | knee ° | hip ° | centres mm | live: knee ° | hip ° | mm | headings ° | findings |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in trials:
        cells = [one.recording, f"{one.seconds:.0f}", _both(one.batch, "knee"), _both(one.batch, "hip")]
        cells += [number(one.centres_mm[0]), _both(one.live, "knee"), _both(one.live, "hip"), number(one.centres_mm[1])]
        cells += [_headings(one.heading_deg)]
        lines.append("| " + " | ".join([*cells, f"{len(one.batch_findings)}, {len(one.live_findings)}"]) + " |")
        if one.other is not None:
            name, errors = one.other
            lines.append(f"| — {name} | | {_both(errors, 'knee')} | {_both(errors, 'hip')} | | | | | | |")
    parts = (
        (_body_lines, [one for one in trials if one.body_mm[0]]),
        (_video_lines, [one for one in trials if one.video]),
        (_stride_lines, [one for one in trials if one.strides is not None]),
    )
    return "\n".join([*lines, *(line for write, some in parts if some for line in write(some)), ""])


def _body_lines(trials: Sequence[RealTrial]) -> list[str]:
    """Of the whole body: errors of batch, then of live; the last row is the mean of all."""
    parts = ("body", "legs", "shoulders", "arms")
    lines = [
        "",
        f"| recording | trunk ° | thorax ° | {' | '.join(f'{one} mm' for one in parts)} | live: trunk ° | mm |",
    ]
    lines.append("|---" * (len(parts) + 5) + "|")
    rows = []
    for one in trials:
        live = [*_pair(one.live.get("trunk")), one.body_mm[1].get("body", np.nan)]
        lean = [*_pair(one.batch.get("trunk")), *_pair(one.batch.get("thorax"))]
        rows.append([*lean, *(one.body_mm[0][part] for part in parts), *live])
    for name, row in [
        *((one.recording, row) for one, row in zip(trials, rows, strict=True)),
        ("mean", np.mean(rows, 0)),
    ]:
        cells = [name, _offset(*row[:2]), _offset(*row[2:4]), *(number(value) for value in row[4:8])]
        cells += [_offset(*row[8:10]), number(row[10])]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _video_lines(trials: Sequence[RealTrial]) -> list[str]:
    """Of what somebody else's video saw of a joint: lag, correlation, difference, and how far the joint bends."""
    lines = ["", "| recording | by | joint | lag s | r | difference ° | bends ° |", "|---|---|---|---|---|---|---|"]
    for one in trials:
        for name, seen in one.video.items():
            cells = [one.recording, name, seen.joint, number(seen.lag_s), number(seen.correlation)]
            cells += [_offset(seen.degrees, seen.without_offset), f"{seen.least:.0f} to {seen.most:.0f}"]
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def _stride_lines(trials: Sequence[RealTrial]) -> list[str]:
    """Of strides: how many, how long, and how far ours are off."""
    lines = ["", "| recording | strides | length m | error: mean cm | standard deviation cm |", "|---|---|---|---|---|"]
    for one in trials:
        if (seen := one.strides) is not None:
            errors = f"{100 * seen.error_mean:+.1f} | {100 * seen.error_sd:.1f}"
            lines.append(f"| {one.recording} | {seen.count} | {seen.length:.2f} | {errors} |")
    return lines


def _pair(error: AngleError | None) -> tuple[float, float]:
    return (np.nan, np.nan) if error is None else (error.rmse, error.without_offset)


def _offset(whole: float, without: float) -> str:
    return f"{whole:.1f} ({without:.1f})" if np.isfinite(whole) else "n/a"


def real_json(trials: Sequence[RealTrial]) -> str:
    """Everything, as JSON."""
    return json_text({one.recording: asdict(one) for one in trials})


def _both(errors: Mapping[str, AngleError], joint: str) -> str:
    if f"left_{joint}" not in errors:
        return "n/a"
    left, right = errors[f"left_{joint}"], errors[f"right_{joint}"]
    return _offset((left.rmse + right.rmse) / 2, (left.without_offset + right.without_offset) / 2)


def _headings(degrees: tuple[float, float]) -> str:
    return f"{degrees[0]:.0f}, at most {degrees[1]:.0f}" if np.isfinite(degrees[0]) else "n/a"
