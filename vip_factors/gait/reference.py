"""How healthy adults walk at some speeds: joint angles over the cycle, to lay beneath somebody's own.

``data/reference.csv`` holds them, and says where they are from: ``python -m tests.studies train-gait`` computes it from
the optical part of the Geneva data set (Grouvel et al. 2023, Sci. Data 10: 180; CC BY 4.0), with this package's angles.
"""

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from vip_factors.geometry.rotations import Array

SOURCE = "Grouvel et al. 2023, doi 10.1038/s41597-023-02077-3, CC BY 4.0"
FILE = "data/reference.csv"
COLUMNS = ("pace", "speed_m_s", "people", "strides", "angle", "percent", "mean_deg", "sd_deg")
FARTHEST_M_S = 0.3  # from a reference's speed: curves of another pace are no reference


@dataclass(frozen=True)
class ReferenceCurve:
    """A joint angle over the cycle, of either side.

    Attributes:
        pace: what the people were asked for.
        speed: their mean, m/s.
        people, strides: how many.
        angle: without side, such as ``knee_flexion``.
        mean, sd: ``(101,)`` degrees, and standard deviation of all strides.
    """

    pace: str
    speed: float
    people: int
    strides: int
    angle: str
    mean: Array
    sd: Array


@cache
def references() -> tuple[ReferenceCurve, ...]:
    """All curves of the package."""
    text = (files("vip_factors.gait") / FILE).read_text(encoding="utf-8")
    rows: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        rows.setdefault((row["pace"], row["angle"]), []).append(row)
    return tuple(
        ReferenceCurve(
            pace, float(own[0]["speed_m_s"]), int(own[0]["people"]), int(own[0]["strides"]), angle,
            *(np.array([float(row[name]) for row in own]) for name in ("mean_deg", "sd_deg")),
        )
        for (pace, angle), own in rows.items()
    )  # fmt: skip


def reference_at(speed: float, angle: str, curves: Iterable[ReferenceCurve] | None = None) -> ReferenceCurve | None:
    """The curve of the nearest speed in m/s; None if there is none of such an angle, or none near.

    ``angle`` may name a side: ``left_knee_flexion``.
    """
    plain = angle.removeprefix("left_").removeprefix("right_")
    near = [one for one in (references() if curves is None else curves) if one.angle == plain]
    best = min(near, key=lambda one: abs(one.speed - speed), default=None)
    return best if best is not None and abs(best.speed - speed) <= FARTHEST_M_S else None
