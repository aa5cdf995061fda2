"""Tables of facts: labels, words, and numbers with their standard deviations and units; as Markdown and as JSON."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

UNKNOWN = "\u2013"  # a dash
MM = 1e3
BONES = {
    "hip": "thigh",
    "knee": "shank",
    "ankle": "foot",
    "shoulder": "upper arm",
    "elbow": "forearm",
    "wrist": "hand",
    "foot": "toes",
    "hand": "fingers",
    "collar": "collar bone",
    "spine1": "lower back",
    "spine2": "middle back",
    "spine3": "chest",
}


@dataclass(frozen=True)
class Quantity:
    """Number as people read it, with its standard deviation where that is known.

    Attributes:
        value: NaN if not known.
        sigma: one standard deviation; NaN if not known.
        unit: written behind both.
        decimals: of both; one more where the standard deviation would round to zero.
    """

    value: float
    sigma: float = math.nan
    unit: str = ""
    decimals: int = 0

    def __str__(self) -> str:
        if not math.isfinite(self.value):
            return UNKNOWN
        decimals, sigma = self.decimals, ""
        if math.isfinite(self.sigma) and self.sigma > 0:
            decimals += self.sigma < 0.5 / 10**decimals  # ± 0 is no uncertainty
            sigma = f" ± {self.sigma:.{decimals}f}"
        space = "" if self.unit in ("", "°") else " "
        return f"{self.value:z.{decimals}f}{sigma}{space}{self.unit}"


Cell = str | Quantity
Row = Sequence[Cell]


@dataclass(frozen=True)
class Table:
    """Rows of cells, words in the first columns and numbers in the others.

    Attributes:
        head: names of the columns; empty where each row is a label and its fact.
        rows: as many cells each.
        title: of the table.
        words: number of columns that hold words.
        is_detail: whether only few readers need it.
    """

    head: Sequence[str]
    rows: Sequence[Row]
    title: str = ""
    words: int = 1
    is_detail: bool = False


def facts(title: str, *rows: Row) -> Table:
    """Make a table of labels and their facts."""
    return Table((), rows, title, words=2)


def count(number: int, noun: str) -> str:
    """Format a number with its noun: ``1 sensor``, ``13 sensors``."""
    return f"{number} {noun if number == 1 else noun + 's'}"


def joint_words(name: str) -> str:
    """Format a joint's name in words: ``left_knee`` → ``left knee``."""
    return name.replace("_", " ")


def bone_words(bone: str) -> str:
    """Everyday name of a bone: ``left_knee`` is the left shank."""
    side, _, joint = bone.rpartition("_")
    return f"{side} {BONES.get(joint, joint)}".strip()


def degrees(radians: float, sigma: float = math.nan) -> Quantity:
    """Make a quantity in degrees, with one decimal, from radians."""
    return Quantity(math.degrees(radians), math.degrees(sigma), "°", 1)


def plain(text: str) -> str:
    """Escape text as one line of Markdown."""
    return re.sub(r"([\\`*\[\]<>|])", r"\\\1", " ".join(text.split()))


def markdown(table: Table) -> list[str]:
    """Lines of a table, or of a list of labels and their facts, with an empty one at the end; none without rows."""
    if not table.rows:
        return []
    rows = [[plain(str(cell)) for cell in row] for row in table.rows]
    title = [f"## {plain(table.title)}", ""] if table.title else []
    if not table.head:
        remarks = (f" ({'; '.join(row[2:])})" if row[2:] else "" for row in rows)
        return [*title, *(f"- **{row[0]}**: {row[1]}{remark}" for row, remark in zip(rows, remarks, strict=True)), ""]
    rule = ["---"] * table.words + ["---:"] * (len(table.head) - table.words)
    lines = [" | ".join(cells) for cells in ([plain(name) for name in table.head], rule, *rows)]
    return [*title, *(f"| {line} |" for line in lines), ""]


def json_text(value: object, decimals: int | None = None) -> str:
    """Format a value as JSON: a number that is not finite is null, and None or an empty mapping is left out.

    Args:
        value: mappings, sequences and arrays of numbers and text.
        decimals: to which numbers are rounded; all that they have if None.
    """
    return json.dumps(_json_value(value, decimals), indent=2, allow_nan=False) + "\n"


def _json_value(value: object, decimals: int | None) -> object:
    if isinstance(value, Mapping):
        empty = {key for key, inner in value.items() if inner is None or (isinstance(inner, Mapping) and not inner)}
        return {key: _json_value(inner, decimals) for key, inner in value.items() if key not in empty}
    if isinstance(value, list | tuple | np.ndarray):
        return [_json_value(inner, decimals) for inner in value]
    if isinstance(value, float | np.floating):
        return None if not np.isfinite(value) else float(value) if decimals is None else round(float(value), decimals)
    return value
