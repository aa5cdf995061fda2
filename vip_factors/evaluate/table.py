"""Numbers with units: Markdown for people, JSON for programs, and the five lines to read first, each with its gauge."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Metric:
    """A number with its unit (``""`` for a ratio); NaN where it is not defined for this recording."""

    value: float
    unit: str


def metric_lines(metrics: Mapping[str, Metric]) -> list[str]:
    """Lines of a Markdown table: one metric each."""
    rows = [f"| {name} | {number(one.value)} | {one.unit} |" for name, one in metrics.items()]
    return ["| metric | value | unit |", "|---|---:|---|", *rows]


def row_lines(title: str, rows: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Lines of a Markdown table with named columns, after an empty line; none if there are no rows."""
    if not rows:
        return []
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    lines = ["", f"| {title} | {' | '.join(columns)} |", "|---|" + "---:|" * len(columns)]
    nan = float("nan")
    return lines + [
        f"| {name} | {' | '.join(number(row.get(c, nan)) for c in columns)} |" for name, row in rows.items()
    ]


def number(value: float) -> str:
    """With two decimals, small ones with two digits, or ``n/a``."""
    if np.isnan(value):
        return "n/a"
    return f"{value:.2g}" if 0 < abs(value) < 0.1 else f"{value:.2f}"


def json_text(value: object, decimals: int | None = None) -> str:
    """As JSON: a number that is not defined is null, and what is None or empty is left out.

    Args:
        value: mappings, sequences and arrays of numbers and text.
        decimals: to which numbers are rounded; all that they have if None.
    """
    return json.dumps(_plain(value, decimals), indent=2, allow_nan=False) + "\n"


def _plain(value: object, decimals: int | None) -> object:
    if isinstance(value, Mapping):
        empty = {key for key, one in value.items() if one is None or (isinstance(one, Mapping) and not one)}
        return {key: _plain(one, decimals) for key, one in value.items() if key not in empty}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(inner, decimals) for inner in value]
    if isinstance(value, float | np.floating):
        return None if not np.isfinite(value) else float(value) if decimals is None else round(float(value), decimals)
    return value


Metrics = Mapping[str, Metric]

PER_FRAME = "each frame aligned rigidly"
NOTHING = "n/a"
UNKNOWN = "not compared: "


def summary_lines(scene: Metrics, wearers: Mapping[str, Metrics]) -> list[str]:
    """Five lines: positions, orientations, sensors, camera (or path), honesty; of a scene's (or lone wearer's) metrics,
    and those of each wearer.
    """
    every = list(wearers.values())
    camera = "camera_translation" in scene
    lines = {
        "positions": _positions(every, camera),
        "orientation": _orientation(every),
        "sensors": _sensors(scene, camera),
        "camera" if camera else "path": _camera(scene) if camera else _path(every),
        "honesty": _honesty(scene, every),
    }
    return [f"{name:<12} {text}" for name, text in lines.items()]


def _positions(wearers: list[Metrics], camera: bool) -> str:
    world, whole = ("scene_position_error", "scene") if camera else ("yaw_aligned_position_error", "recording")
    in_world = f"{_mean(wearers, world)} in the world (one yaw and shift of the {whole} removed)"
    return f"{_mean(wearers, 'mpjpe')}, {PER_FRAME} (MPJPE); {in_world}"


def _orientation(wearers: list[Metrics]) -> str:
    local = f"{_mean(wearers, 'mpjae_local')} relative to the bone above (no alignment)"
    return f"{_mean(wearers, 'mpjae')}, {PER_FRAME} (MPJAE); {local}"


def _sensors(scene: Metrics, camera: bool) -> str:
    if "heading_error" not in scene:
        return UNKNOWN + "the truth knows no headings and mountings"
    gauge = "the scene's yaw removed" if camera else "their mean removed"
    mountings = f"mountings {_one(scene, 'mounting_error')} (in the bone's frame)"
    return f"headings {_one(scene, 'heading_error')} ({gauge}); {mountings}"


def _camera(scene: Metrics) -> str:
    where = f"{_one(scene, 'camera_translation')} and {_one(scene, 'camera_rotation')}"
    labels = ""
    if "association_precision" in scene:
        right, found = _one(scene, "association_precision"), _one(scene, "association_recall")
        labels = f"; detections given to wearers: {right} right, {found} found"
    return f"{where} in the world (the same yaw and shift removed){labels}"


def _path(wearers: list[Metrics]) -> str:
    share = _mean(wearers, "root_translation_error_percent")
    where = f"{_mean(wearers, 'root_translation_error')} of the pelvis"
    return f"{where}{'' if share == NOTHING else f', {share} of its way'} (one rigid alignment of the path)"


def _honesty(scene: Metrics, wearers: list[Metrics]) -> str:
    told = {}
    for what in ("joints", "headings", "mountings", "camera", "lengths"):
        name = f"nees_{what.removesuffix('s') if what in ('headings', 'mountings') else what}"
        if name in scene:
            told[what] = number(scene[name].value)
        elif any(name in one for one in wearers):
            told[what] = _mean(wearers, name)
    if not told:
        return UNKNOWN + "the estimate tells no standard deviations, or the truth not what they are of"
    each = ", ".join(f"{what} {value}" for what, value in told.items())
    return f"squared error over the told variance (1 is honest, more is too sure): {each}"


def _one(metrics: Metrics, name: str) -> str:
    return _text(metrics[name].value, metrics[name].unit) if name in metrics else NOTHING


def _mean(wearers: list[Metrics], name: str) -> str:
    """Over the wearers of whom it is defined."""
    found = [one[name] for one in wearers if name in one and np.isfinite(one[name].value)]
    return _text(float(np.mean([one.value for one in found])), found[0].unit) if found else NOTHING


def _text(value: float, unit: str) -> str:
    return f"{number(value)}{'' if unit == '' else '°' if unit == 'deg' else f' {unit}'}"
