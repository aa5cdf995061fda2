"""Numbers with units, as Markdown for people and JSON for programs."""

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


def json_text(value: object) -> str:
    """As JSON; what is not defined is null."""
    return json.dumps(_without_nan(value), indent=2) + "\n"


def _without_nan(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _without_nan(inner) for key, inner in value.items()}
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
