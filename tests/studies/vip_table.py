"""The trials of :mod:`tests.studies.vip` as tables beside the thesis's, and as JSON."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tests.studies import thesis
from tests.studies.vip import SensorError, Trial, VipResults
from tests.studies.vip_suite import StartErrors, VipTrials

# Pairs of variants whose MPJPE is to be compared.
COMPARED = (
    ("VIP", "IT"), ("VIP-IT", "IT"), ("VIP-Cam", "VIP"), ("VIP-25", "VIP"), ("VIP-45", "VIP"),
    ("VIP-gtip-25", "VIP-gtip"), ("VIP-gtip-45", "VIP-gtip"),
)  # fmt: skip
CALIBRATION_HEAD = ("mean", "95 %", "feet and hands", "95 %")


def means_by_kind(trials: Sequence[Trial], variant: str) -> dict[str, tuple[float, float]]:
    """``(MPJPE mm, MPJAE deg)`` of a variant by kind of motion, every recording alike, and ``mean`` of the kinds."""
    own = [trial for trial in trials if trial.variant == variant]
    kinds = list(dict.fromkeys(trial.kind for trial in own))
    table = {
        kind: (
            _mean(trial.mpjpe_mm for trial in own if trial.kind == kind),
            _mean(trial.mpjae_deg for trial in own if trial.kind == kind),
        )
        for kind in kinds
    }
    return table | {"mean": (_mean(p for p, _ in table.values()), _mean(a for _, a in table.values()))}


def vip_table(results: VipResults, title: str, published: bool = True) -> str:
    """Markdown: accuracy, then calibration, camera, association and time of every variant.

    Args:
        results: with at least one trial.
        title: what was recorded, and how.
        published: whether the thesis's own figures by activity follow.
    """
    trials, start = results.trials, results.start
    variants = list(dict.fromkeys(trial.variant for trial in trials))
    blocks = [
        [title, *([_start_line(start)] if start is not None else [])],
        _accuracy_lines(trials, variants),
        *([compared] if (compared := _compared_lines(trials, variants)) else []),
        ["Errors of headings and mountings in degrees (after the common yaw), and all else", "",
         *_calibration_lines(trials, variants)],
    ]  # fmt: skip
    if published:
        blocks.append(_thesis_lines())
    failures = [f"- {t.variant}, {t.clip}, seed {t.seed}: {t.failure}" for t in trials if t.failure]
    if failures:
        blocks.append(["Not solved, and left out of the means:", *failures])
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def simulated_title(results: VipResults, settings: VipTrials) -> str:
    """What was simulated."""
    recordings = len({(trial.clip, trial.seed) for trial in results.trials})
    return (
        f"MPJPE mm / MPJAE deg of 13 simulated sensors and a {settings.camera} camera, {recordings} recordings of "
        f"{settings.seconds:g} s after a T-pose held {settings.pose_error_deg:g} deg off per joint and axis; "
        f"straps {settings.sensors.mounting_error_deg:g} deg off per axis; {settings.keypoints} detections"
    )


def _start_line(start: StartErrors) -> str:
    return (
        f"At the start headings are off by {start.heading_deg:.1f} deg on average, mountings by "
        f"{start.mounting_deg:.1f} ({start.pose_alone_deg:.1f} with true headings)"
    )


def _accuracy_lines(trials: Sequence[Trial], variants: Sequence[str]) -> list[str]:
    kinds = list(dict.fromkeys(trial.kind for trial in trials))
    columns = [*kinds, "mean"] if len(kinds) > 1 else ["mean"]
    lines = [
        f"| variant | {' | '.join(columns)} | thesis, mean |",
        "|---|" + "---:|" * (len(columns) + 1),
    ]
    for variant in variants:
        row = means_by_kind(trials, variant)
        cells = [_pair(row.get(column)) for column in columns]
        lines.append(f"| {variant} | {' | '.join(cells)} | {_pair(thesis.VARIANTS.get(variant))} |")
    return lines


def _compared_lines(trials: Sequence[Trial], variants: Sequence[str]) -> list[str]:
    """MPJPE of one variant against another's, ours and the thesis's; over the recordings that both solved."""
    lines = []
    for one, other in COMPARED:
        if one not in variants or other not in variants:
            continue
        first, second = (
            {(t.clip, t.seed): t for t in trials if t.variant == name and not t.failure} for name in (one, other)
        )
        both = [key for key in first if key in second]
        if not both:
            continue
        a, b = (means_by_kind([table[key] for key in both], name)["mean"][0]
                for table, name in ((first, one), (second, other)))  # fmt: skip
        published = ""
        if one in thesis.VARIANTS and other in thesis.VARIANTS:
            theirs, reference = thesis.VARIANTS[one][0], thesis.VARIANTS[other][0]
            published = f" (thesis {100 * theirs / reference:.1f} %, {theirs - reference:+.1f} mm)"
        lines.append(f"- MPJPE of {one} is {100 * a / b:.1f} % of {other}'s, {a - b:+.1f} mm{published}")
    return lines


def _calibration_lines(trials: Sequence[Trial], variants: Sequence[str]) -> list[str]:
    head = [
        *(f"heading {one}" for one in CALIBRATION_HEAD), *(f"mounting {one}" for one in CALIBRATION_HEAD),
        "camera mm", "camera deg", "precision %", "recall %", "solve s", "all s",
    ]  # fmt: skip
    lines = [f"| variant | {' | '.join(head)} |", "|---|" + "---:|" * len(head)]
    for variant in variants:
        row = _details([trial for trial in trials if trial.variant == variant])
        lines.append(f"| {variant} | {' | '.join(_one(value) for value in row)} |")
    return lines


def _details(own: Sequence[Trial]) -> list[float]:
    sensors = [sensor for trial in own for sensor in trial.sensors]
    ends = [sensor for sensor in sensors if sensor.at_end]
    rest = [sensor for sensor in sensors if not sensor.at_end]
    cells: list[float] = []
    for name in ("heading_deg", "mounting_deg"):
        for group in (rest, ends):
            cells += _mean_and_95(group, name)
    camera_mm = 1000 * _mean(trial.camera_m for trial in own)
    others = [_mean(getattr(t, name) for t in own)
              for name in ("camera_deg", "precision", "recall", "solve_seconds", "seconds")]  # fmt: skip
    return [*cells, camera_mm, *others]


def _mean_and_95(sensors: Sequence[SensorError], name: str) -> tuple[float, float]:
    values = np.array([getattr(sensor, name) for sensor in sensors])
    return (float(values.mean()), float(np.quantile(values, 0.95))) if len(values) else (float("nan"), float("nan"))


def _thesis_lines() -> list[str]:
    kinds = list(thesis.BY_ACTIVITY["VIP"])
    lines = [
        "Thesis, on TotalCapture (other motions, real sensors; tables 4.2 and 4.3)",
        "",
        f"| variant | {' | '.join(kinds)} |",
        "|---|" + "---:|" * len(kinds),
    ]
    for variant, row in thesis.BY_ACTIVITY.items():
        lines.append(f"| {variant} | {' | '.join(_pair(row[kind]) for kind in kinds)} |")
    return lines


def _mean(values: Iterable[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")


def _pair(errors: tuple[float, float] | None) -> str:
    return "" if errors is None else " / ".join(_one(value) for value in errors)


def _one(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "n/a"


def vip_json(results: VipResults, settings: Any) -> str:
    """Every trial, the means, and the settings (a dataclass) they were made with."""
    trials, start = results.trials, results.start
    variants = list(dict.fromkeys(trial.variant for trial in trials))
    means = {
        variant: {kind: {"mpjpe_mm": p, "mpjae_deg": a} for kind, (p, a) in means_by_kind(trials, variant).items()}
        for variant in variants
    }
    content = plain(
        {
            "means": means,
            "start": None if start is None else asdict(start),
            "published": {name: thesis.VARIANTS[name] for name in variants if name in thesis.VARIANTS},
            "trials": [asdict(trial) for trial in trials],
            "settings": asdict(settings),
        }
    )
    return json.dumps(content, indent=2) + "\n"


def plain(value: object) -> object:
    """What JSON can hold; what is not defined is null."""
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, float):
        return float(value) if np.isfinite(value) else None
    return value
