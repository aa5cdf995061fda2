"""One text table of one sensor: comment lines, a header of column names, then numbers; any usual separator."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array

HEADER_WORDS = ("PacketCounter", "SampleTimeFine", "Acc_X", "FreeAcc_X", "FreeAcc_E", "Mat[1][1]", "Quat_")
PEEK_BYTES = 16384  # the longest preamble seen is 1.5 kB; this holds it and the first rows


@dataclass(frozen=True)
class SensorTable:
    """Numeric columns ``(N,)`` by name; a column without a single number is left out, single blanks are NaN."""

    path: Path
    preamble: tuple[str, ...]
    columns: Mapping[str, Array]
    header: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def group(self, names: tuple[str, ...]) -> Array | None:
        """The columns side by side ``(N, len(names))``, or None if any is missing or blank throughout."""
        if any(name not in self.columns for name in names):
            return None
        return np.stack([self.columns[name] for name in names], axis=1)

    def setting(self, pattern: str) -> str | None:
        """First group of a regular expression searched in the preamble, or None."""
        for line in self.preamble:
            if found := re.search(pattern, line, re.IGNORECASE):
                return found.group(1).strip()
        return None


def peek(path: Path) -> str:
    """The beginning of a file as text; empty if it is binary or cannot be opened as a file."""
    try:
        with path.open("rb") as file:
            start = file.read(PEEK_BYTES)
    except OSError:
        return ""
    return "" if b"\0" in start else start.decode("utf-8-sig", errors="replace")


def find_header(lines: list[str]) -> int | None:
    """Index of the line of column names, or None."""
    for index, line in enumerate(lines):
        if not line.startswith("//") and any(word in line for word in HEADER_WORDS):
            return index
    return None


def read_table(path: Path) -> SensorTable:
    """Read one file, whatever its separator: tab, semicolon, comma or single spaces (empty cells kept).

    Raises:
        FileFormatError: if there is no header, no row, a row of the wrong width, or a cell that is not a number.
    """
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror})") from error
    lines = text.splitlines()
    at = find_header(lines)
    if at is None:
        raise FileFormatError(f"{path}: no header line: expected column names such as PacketCounter, Acc_X, Quat_q0")
    separator = next((one for one in "\t;," if one in lines[at]), " ")
    header = tuple(cell.strip() for cell in lines[at].rstrip().split(separator))
    rows = [
        (at + 2 + i, line.split(separator)) for i, line in enumerate(lines[at + 1 :]) if line.strip(f" {separator}")
    ]
    rows, notes = _without_truncated_end(rows, len(header), text.endswith(("\n", "\r")), path)
    if not rows:
        raise FileFormatError(f"{path}: no samples below the header in line {at + 1}")
    for number, cells in rows:
        if len(cells) < len(header):
            raise FileFormatError(
                f"{path}, line {number}: {len(cells)} cells where the header names {len(header)} columns; "
                "repair or delete the line"
            )
    columns = {}
    for index, name in enumerate(header):
        values = _numbers(path, name, index, rows, decimal_comma=separator != ",")
        if values is not None:
            columns[name] = values
    return SensorTable(path, tuple(lines[:at]), columns, header, notes)


Rows = list[tuple[int, list[str]]]


def _without_truncated_end(rows: Rows, width: int, complete: bool, path: Path) -> tuple[Rows, tuple[str, ...]]:
    """Without a last line that a broken-off export left short of cells, or of digits in its last cell."""
    if len(rows) < 2:
        return (rows, ()) if not rows or len(rows[0][1]) >= width else ([], ())
    last, before = rows[-1][1], rows[-2][1]
    short_cells = len(last) < width <= len(before)
    digits = [len(cells[-1].strip().partition(".")[2]) for cells in (last, before)]
    if short_cells or (not complete and digits[0] < digits[1]):
        return rows[:-1], (f"{path.name}: the last line {rows[-1][0]} breaks off and was dropped",)
    return rows, ()


def _numbers(path: Path, name: str, index: int, rows: Rows, decimal_comma: bool) -> Array | None:
    cells = [cells[index].strip() for _, cells in rows]
    if not any(cells):
        return None
    try:
        values = np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        values = np.array(
            [_number(path, name, number, cell, decimal_comma) for (number, _), cell in zip(rows, cells, strict=True)]
        )
    return values if np.any(np.isfinite(values)) else None


def _number(path: Path, name: str, line: int, cell: str, decimal_comma: bool) -> float:
    if not cell:
        return np.nan
    try:
        return float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        raise FileFormatError(f"{path}, line {line}: {name} is '{cell}': expected a number") from None
