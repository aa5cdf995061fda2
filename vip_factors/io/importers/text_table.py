"""A table of numbers as text, of any usual dialect: CSV, TSV, OpenSim's TRC and STO; named columns, numbers on demand.

Separator, comment lines and header lines are declared or detected. A TRC marker ``knee`` is the columns ``knee_x``,
``knee_y``, ``knee_z``; an STO column ``knee`` with cells ``w,x,y,z`` is ``knee_w``, ``knee_x``, ``knee_y``, ``knee_z``.

Libraries that sniff dialects know no preambles, lines of units and decimal commas: of 58 loggers' and OpenSim's files
``csv.Sniffer`` finds the separator of 32, ``clevercsv`` of 47.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError, InputError, nearest
from vip_factors.geometry.rotations import Array

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".trc", ".sto", ".mot", ".raw", ".log")
SEPARATORS = {"tab": "\t", "semicolon": ";", "comma": ",", "bar": "|", "space": ""}  # the last: any number of spaces
COMMENTS = ("#", "//", "%")
MISSING = ("", "nan", "na", "n/a", "null", "none", "-")
LOOKED_AT = 200  # lines, to tell the dialect: preambles of loggers are shorter
RUN = 3  # rows of numbers in a row: a line of settings may look like one
HEADER_LINES = 4  # device, names or axes, how they are calibrated, and units in lines of their own
COMPONENTS = {3: "xyz", 4: "wxyz"}
LARGEST = 1e30  # in any unit: nanoseconds since 1970 are 1.8e18
LONGEST_LINE = 200_000  # characters: of some 10,000 columns
PEEK_BYTES = 16384  # the longest preamble seen is 1.5 kB; this holds it and the first rows


class NoTableError(FileFormatError):
    """Error for a file without rows of numbers."""


@dataclass(frozen=True)
class Dialect:
    """Declared layout of a file; None is detected.

    Attributes:
        separator: one of :data:`SEPARATORS`, or a character itself; single spaces have blank cells between them.
        comment: beginning of the lines to skip.
        header: numbers of the lines with the names of the columns, the first line being 1; names are joined by ``_``.
        same_digits: whether all cells of a column have as many decimals: a last cell with fewer breaks off.
    """

    separator: str | None = None
    comment: str | None = None
    header: tuple[int, ...] | None = None
    same_digits: bool = False


@dataclass(frozen=True)
class TextTable:
    """Rows of text below named columns.

    Attributes:
        path: the file.
        names: one per column; the numbers from 1 on where the file names none.
        rows: a line each, without those to be skipped.
        lines: numbers of those lines in the file.
        separator: between their cells.
        notes: a sentence on each loss.
        preamble: the lines above the first row.
        units: one per column, where a line below their names gives them.
    """

    path: Path
    names: tuple[str, ...]
    rows: list[str]
    lines: Sequence[int]
    separator: str
    notes: tuple[str, ...] = ()
    preamble: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.rows)

    def index(self, column: str | int, where: str) -> int:
        """Index of a column, given its name or its number from 1 on; errors begin with ``where``.

        A name may be written with other capitals, if only one column fits: TRC has ``Time``, STO has ``time``.

        Raises:
            InputError: if there is none, or several have the name.
        """
        if isinstance(column, int):
            if not 1 <= column <= len(self.names):
                raise InputError(f"{where}: {self.path} has no column {column}: expected 1 to {len(self.names)}")
            return column - 1
        alike = [name for name in self.names if name.lower() == column.lower()]
        if column not in self.names and len(alike) == 1:
            column = alike[0]
        places = [i for i, name in enumerate(self.names) if name == column]
        if not places:
            raise InputError(f"{where}: {self.path} has no column '{column}'{nearest(column, self.names)}")
        if len(places) > 1:
            choices = ", ".join(str(i + 1) for i in places)
            raise InputError(
                f"{where}: {self.path} has several columns '{column}': give the number of one of {choices}"
            )
        return places[0]

    def numbers(self, columns: Sequence[int]) -> Array:
        """The columns of these indices ``(N, len(columns))``; blank cells and impossible numbers are NaN.

        Raises:
            FileFormatError: for a cell that is not a number; line and column are named.
        """
        rows = self.rows
        if self.separator != "," and any("," in row for row in rows[:LOOKED_AT]):
            rows = [row.replace(",", ".") for row in rows]  # a decimal comma
        try:
            values = np.loadtxt(
                rows, delimiter=self.separator or None, usecols=columns, comments=None, quotechar='"', ndmin=2
            )
        except ValueError:
            values = np.empty((len(rows), len(columns)))
            for index, row in enumerate(rows):
                cells = split(row, self.separator)
                for place, column in enumerate(columns):
                    value = number(cells[column])
                    if value is None:
                        raise FileFormatError(
                            f"{self.path}, line {self.lines[index]}: column '{self.names[column]}' is "
                            f"'{cells[column].strip()[:40]}': expected a number"
                        ) from None
                    values[index, place] = value
        return np.where(np.abs(values) < LARGEST, values, np.nan)

    def group(self, names: Sequence[str]) -> Array | None:
        """The columns of these names ``(N, len(names))``; None if one is missing or holds no number at all."""
        if any(name not in self.names for name in names):
            return None
        values = self.numbers([self.names.index(name) for name in names])
        return values if np.all(np.any(np.isfinite(values), axis=0)) else None

    def texts(self, column: int) -> list[str]:
        """The cells of a column as text."""
        return [split(row, self.separator)[column].strip() for row in self.rows]


def number(cell: str) -> float | None:
    """The number in a cell; NaN for a blank or a word for a missing value, None for anything else."""
    cell = cell.strip().strip('"')
    if cell.lower() in MISSING:
        return float("nan")
    try:
        return float(cell)
    except ValueError:
        return None


def split(row: str, separator: str) -> list[str]:
    """Split a line into cells, with quotes."""
    if not separator:
        return row.split()
    return next(csv.reader([row], delimiter=separator), []) if '"' in row else row.split(separator)


def read_text_table(path: Path, dialect: Dialect | None = None) -> TextTable:
    """Read a table, OpenSim's by its form, others by the dialect.

    Raises:
        FileFormatError: if it cannot be read, is no text, holds no rows of numbers, or a row has too few cells.
        InputError: for a header line that the file does not have.
    """
    lines, is_complete = read_lines(path)
    if (lines[:1] and lines[0].startswith("PathFileType")) or path.suffix.lower() in (".sto", ".mot"):
        return _read_opensim(path, lines)
    return _read_plain(path, lines, dialect or Dialect(), is_complete)


def peek(path: Path) -> str:
    """The beginning of a file as text; empty if it is binary or cannot be opened as a file."""
    try:
        with path.open("rb") as file:
            start = file.read(PEEK_BYTES)
    except OSError:
        return ""
    text = _decoded(start)
    return "" if "\0" in text else text


def read_lines(path: Path) -> tuple[list[str], bool]:
    """Read the lines of a text, UTF-8 or UTF-16, other bytes replaced, and whether the last one ends.

    Raises:
        FileFormatError: if it cannot be read, is no text, or a line is longer than a table's ever is; the cells of a
            few such lines fill the memory.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror}): expected a table of numbers") from error
    text = _decoded(content)
    if "\0" in text[:4096]:
        raise NoTableError(f"{path}: is not text: expected a table of numbers")
    lines = text.splitlines()
    for line, row in enumerate(lines, start=1):
        if len(row) > LONGEST_LINE:
            raise FileFormatError(
                f"{path}, line {line} has {len(row)} characters: expected at most {LONGEST_LINE} in a table of sensors"
            )
    return lines, text.endswith(("\n", "\r"))


def _decoded(content: bytes) -> str:
    """Decode UTF-16 by its mark, or by the zeros in every second byte; else UTF-8."""
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    if len(content) > 3 and (content[0] == 0) != (content[1] == 0) and (content[2] == 0) != (content[3] == 0):
        encoding = "utf-16-be" if content[0] == 0 else "utf-16-le"
    return content.decode(encoding, errors="replace")


def _read_plain(path: Path, lines: list[str], dialect: Dialect, is_complete: bool) -> TextTable:
    """A table whose header stands right above its first row of numbers, or where the dialect declares it."""
    comments = (dialect.comment,) if dialect.comment else COMMENTS
    numbered = [(i + 1, line) for i, line in enumerate(lines) if line.strip() and not line.startswith(comments)]
    if dialect.header is not None:
        wrong = next((line for line in dialect.header if not 1 <= line <= len(lines)), None)
        if wrong is not None:
            raise InputError(f"{path} has no header line {wrong}: expected 1 to {len(lines)}")
        numbered = [(line, row) for line, row in numbered if line > max(dialect.header)]
        if not numbered:
            raise FileFormatError(f"{path}: no samples below the header in line {max(dialect.header)}")
    declared = SEPARATORS.get(dialect.separator, dialect.separator) if dialect.separator else None
    separator, width = _separator(path, [row for _, row in numbered[:LOOKED_AT]], declared)
    data = [_is_data(row, separator, width) for _, row in numbered[: LOOKED_AT + RUN]]
    run = 1 if dialect.header else RUN
    start = next((i for i in range(len(data)) if all(data[i : i + run])), None)
    if start is None:
        raise NoTableError(f"{path}: holds no row of numbers: expected a table with a line of column names above it")
    if dialect.header is not None:
        header = [split(lines[line - 1], separator) for line in dialect.header]
    else:
        header = _header_above(numbered[: start + 1], separator, width)
        above = next((line for line in reversed(lines[: numbered[start][0] - 1]) if line.strip()), "")
        names = split(above.lstrip("#/% "), separator)
        if not header and above.startswith(COMMENTS) and len(names) == width:
            header = [names]
    preamble = lines[: numbered[start][0] - 1 if dialect.header is None else min(dialect.header) - 1]
    units = _units(header)
    header = header[:-1] if units else header
    repeat = next((line for line, row in numbered[start:] if header and split(row, separator) == header[-1]), None)
    if repeat is not None:
        raise FileFormatError(
            f"{path}, line {repeat}: the header stands there again, as where two recordings follow each other: split "
            "the file there, or delete the line"
        )
    numbered = numbered[start:]
    if dialect.same_digits and not is_complete and len(numbered) > 1:
        digits = [len(split(row, separator)[-1].strip().partition(".")[2]) for _, row in numbered[-2:]]
        numbered = [*numbered[:-1], (numbered[-1][0], "")] if digits[1] < digits[0] else numbered
    return replace(table_of_rows(path, _joined(header, width), numbered, separator, preamble), units=units)


def _separator(path: Path, rows: list[str], declared: str | None) -> tuple[str, int]:
    """The separator that makes the widest rows, and their usual width."""
    choice = ("", 0)
    for separator in SEPARATORS.values() if declared is None else (declared,):
        widths = [
            width for row in rows if (width := len(split(row, separator))) > 1 and _is_data(row, separator, width)
        ]
        if not widths:
            continue
        usual = max(set(widths), key=widths.count)
        if usual > choice[1] and widths.count(usual) >= len(widths) / 2:
            choice = (separator, usual)
    if not choice[1]:
        how = "that separator" if declared is not None else "tab, semicolon, comma, bar or spaces"
        raise NoTableError(f"{path}: holds no row of two numbers or more between {how}: expected a table of numbers")
    return choice


def _is_data(row: str, separator: str, width: int) -> bool:
    """Whether a row has the width and holds numbers, at least one and half of its cells."""
    cells = [cell.replace(",", ".") if separator != "," else cell for cell in split(row, separator)]
    values = [number(cell) for cell in cells]
    numbers = sum(value is not None and value == value for value in values)
    return len(cells) == width and numbers > 0 and sum(value is not None for value in values) >= len(values) / 2


def _header_above(numbered: list[tuple[int, str]], separator: str, width: int) -> list[list[str]]:
    """The lines right above the last one that have as many cells."""
    header: list[list[str]] = []
    for (line, row), (below, _) in zip(numbered[-2::-1][:HEADER_LINES], numbered[:0:-1], strict=False):
        cells = split(row, separator)
        if len(cells) != width or (header and (below != line + 1 or _is_data(row, separator, width))):
            break
        header.insert(0, cells)
    return header


_UNIT = (
    r"[munkcµμ]?(s|secs?|seconds?|m|meters?|g|rad|radians?|deg|degs|degrees?|hz|t|tesla|gauss|v|volts?|pa|bar)|h|min|dps"
    r"|rps|°|°?[cf]|%|au|a\.?u\.?|counts?|ticks?|lsb|flux|local|cal|raw|none|no ?units?|unitless|[ymdhs/:. 0]{8,}"
)


def _units(header: list[list[str]]) -> tuple[str, ...]:
    """The cells of the last line of a header, if it holds units below names."""
    atoms = rf"(?:{_UNIT})(?:\^?-?[12²])?"
    unit = re.compile(rf"\W{{0,2}}(?:{atoms}(?:[/*· ]*\(?{atoms}\)?)*)?\W{{0,2}}", re.IGNORECASE)
    cells = tuple(cell.strip() for cell in header[-1]) if len(header) > 1 else ()
    return cells if any(cells) and all(unit.fullmatch(cell) for cell in cells) else ()


def _joined(header: list[list[str]], width: int) -> tuple[str, ...]:
    """One name for each column, its number without a header; a blank in an upper line is as the cell to its left."""
    lines = [[cell.strip().strip('"') for cell in cells] for cells in header]
    for cells in lines[:-1]:
        for i in range(1, len(cells)):
            cells[i] = cells[i] or cells[i - 1]
    columns = zip_longest(*lines, [""] * width, fillvalue="")
    names = ["_".join(filter(None, column)) for column in columns]
    return tuple(name or str(i) for i, name in enumerate(names[:width], start=1))


def table_of_rows(
    path: Path, names: tuple[str, ...], numbered: list[tuple[int, str]], separator: str, preamble: Sequence[str] = ()
) -> TextTable:
    """Build a table of numbered lines; a last line that breaks off is dropped.

    Raises:
        FileFormatError: for any other line that is too short.
    """
    lines, rows = [line for line, _ in numbered], [row for _, row in numbered]
    widths = [len(split(row, separator)) if not separator or '"' in row else row.count(separator) + 1 for row in rows]
    notes = []
    if len(rows) > 1 and widths[-1] < len(names):
        notes.append(f"{path.name}: the last line {lines[-1]} breaks off and was dropped")
        rows, lines, widths = rows[:-1], lines[:-1], widths[:-1]
    short = next((i for i, width in enumerate(widths) if width < len(names)), None)
    if short is not None:
        raise FileFormatError(
            f"{path}, line {lines[short]}: {widths[short]} cells where the header has {len(names)} columns; repair or "
            "delete the line"
        )
    return TextTable(path, names, rows, lines, separator, tuple(notes), tuple(preamble))


def _read_opensim(path: Path, lines: list[str]) -> TextTable:
    """Read OpenSim's tables, whose lines may end in blank cells.

    TRC has triples below five lines of header, the fourth with the names. STO has a header up to ``endheader``, a line
    of names, and cells of one number or of several.
    """
    is_trc, head = lines[:1] and lines[0].startswith("PathFileType"), lines[:LOOKED_AT]
    mark = "frame#" if is_trc else "endheader"
    header_row = next((i for i, line in enumerate(head) if line.strip().lower().partition("\t")[0] == mark), None)
    if is_trc and header_row is None:
        raise FileFormatError(f"{path}: no line 'Frame#  Time  name …': expected OpenSim's TRC")
    if header_row is None or header_row + 1 >= len(lines):
        raise FileFormatError(f"{path}: no 'endheader' line followed by column names: expected OpenSim's STO")
    numbered = [(i + 1, line) for i, line in enumerate(lines) if i > header_row + 1 and line.strip()]
    if not numbered:
        raise FileFormatError(f"{path}: no rows below its header")
    labels = [cell.strip() for cell in lines[header_row if is_trc else header_row + 1].split("\t")]
    if is_trc:
        labels = [label for label in labels if label]
        names = [*labels[:2], *(f"{name}_{axis}" for name in labels[2:] for axis in "xyz")]
        counts = [1] * len(names)
    else:
        looked_at = [line.split("\t") for _, line in numbered[:LOOKED_AT]]
        counts = [max(row[i].count(",") + 1 if i < len(row) else 1 for row in looked_at) for i in range(len(labels))]
        names = []
        for label, count in zip(labels, counts, strict=True):
            letters = COMPONENTS.get(count, [str(i) for i in range(count)])
            names += [label] if count == 1 else [f"{label}_{letter}" for letter in letters]

    def as_cells(line: str) -> str:
        if line.count("\t") == len(names) - 1 and "\t\t" not in line and "," not in line:
            return line
        cells: list[str] = []
        for cell, count in zip(line.split("\t"), counts, strict=False):
            parts = [cell.strip()] if count == 1 else cell.strip("()~[] ").split(",")
            cells += ["nan"] * count if cell.strip().lower() in MISSING else parts
        return "\t".join(part.strip() or "nan" for part in cells[: len(names)])

    rows = [(line, as_cells(row)) for line, row in numbered]
    return table_of_rows(path, tuple(names), rows, "\t", lines[:header_row])
