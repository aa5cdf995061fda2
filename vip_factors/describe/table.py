"""Tables of facts: labels, words, and numbers with their standard deviations and units."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

UNKNOWN = "\u2013"  # a dash
MM = 1e3
BONES = {"hip": "thigh", "knee": "shank", "ankle": "foot", "shoulder": "upper arm", "elbow": "forearm", "wrist": "hand",
         "foot": "toes", "hand": "fingers", "collar": "collar bone", "spine1": "lower back", "spine2": "middle back",
         "spine3": "chest"}  # fmt: skip


@dataclass(frozen=True)
class Quantity:
    """Number as people read it, with its standard deviation where that is known.

    Attributes:
        value: NaN if not known.
        sigma: one standard deviation; NaN if not known.
        unit: written behind both.
        decimals: of both.
    """

    value: float
    sigma: float = math.nan
    unit: str = ""
    decimals: int = 0

    def __str__(self) -> str:
        if not math.isfinite(self.value):
            return UNKNOWN
        sigma = f" ± {self.sigma:.{self.decimals}f}" if math.isfinite(self.sigma) else ""
        space = "" if self.unit in ("", "°") else " "
        return f"{self.value:z.{self.decimals}f}{sigma}{space}{self.unit}"


Cell = str | Quantity
Row = Sequence[Cell]


@dataclass(frozen=True)
class Table:
    """Rows of cells, words in the first columns and numbers in the others.

    Attributes:
        head: names of the columns; empty where each row is a label and its fact.
        rows: as many cells each.
        title: what the rows are about.
        words: number of columns that hold words.
        is_detail: whether only few readers need it.
    """

    head: Sequence[str]
    rows: Sequence[Row]
    title: str = ""
    words: int = 1
    is_detail: bool = False


def facts(title: str, *rows: Row) -> Table:
    """Labels and their facts."""
    return Table((), rows, title, words=2)


def count(number: int, noun: str) -> str:
    """``1 sensor``, ``13 sensors``."""
    return f"{number} {noun if number == 1 else noun + 's'}"


def joint_words(name: str) -> str:
    """``left_knee`` → ``left knee``."""
    return name.replace("_", " ")


def bone_words(bone: str) -> str:
    """Everyday name of a bone: ``left_knee`` is the left shank."""
    side, _, joint = bone.rpartition("_")
    return f"{side} {BONES.get(joint, joint)}".strip()


def degrees(radians: float, sigma: float = math.nan) -> Quantity:
    """Angle with one decimal."""
    return Quantity(math.degrees(radians), math.degrees(sigma), "°", 1)
