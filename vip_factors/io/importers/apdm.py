"""APDM (Opal) csv exports: all sensors side by side in one file, in either of the two layouts Motion Studio writes.

Acceleration is specific force. Opals turn samples into a frame with x to magnetic north and z up; where the data say
that z is down, the frame is turned over.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.io.importers import table
from vip_factors.io.importers.column_map import UP_OR_DOWN, ColumnMap, Columns, SensorColumns
from vip_factors.io.importers.shared import ImportedLog, candidates
from vip_factors.io.importers.text_table import SEPARATORS, TextTable, peek, read_text, split, table_of_rows

FORMAT = "apdm"
QUANTITIES = {
    "Acceleration": "acceleration", "Accelerometer": "acceleration", "Angular Velocity": "angular_rate",
    "Gyroscope": "angular_rate", "Orientation": "quaternion",
}  # fmt: skip
AXES = {"acceleration": "XYZ", "angular_rate": "XYZ", "quaternion": "SXYZ"}
UNITS = {
    "g": {"acceleration_unit": "g"}, "deg/s": {"angular_rate_unit": "deg/s"}, "°/s": {"angular_rate_unit": "deg/s"},
}  # fmt: skip
PEEKED_LINES = 12  # that hold the header of either layout
EPOCH_MICROSECONDS = 1e12  # a time above this is microseconds since 1970 (1e12 µs is January 1970), not seconds

Layout = dict[str, dict[str, dict[str, int]]]
"""Sensor → quantity → axis → column, from 1 on."""


def matches(path: Path) -> bool:
    """Whether the file is an APDM csv, by its first lines."""
    return any(_is_export(file) for file in candidates(path, (".csv",)))


def _is_export(path: Path) -> bool:
    lines = peek(path).splitlines()[:4]
    if not lines:
        return False
    return (lines[0].startswith("Format=") and len(lines) > 1 and "Accelerometer" in lines[1]) or any(
        line.startswith("Time,") and "/Acceleration/X" in line for line in lines
    )


def read(path: Path) -> ImportedLog:
    """Read a recording; a folder must hold one such file.

    Raises:
        FileFormatError: for other files, without samples, or with cells that are not numbers.
    """
    files = [file for file in candidates(path, (".csv",)) if _is_export(file)]
    if len(files) != 1:
        found = ", ".join(file.name for file in files) or "none"
        raise FileFormatError(f"{path}: expected one APDM csv file with all sensors, found {found}")
    path, comma = files[0], SEPARATORS["comma"]
    kept = [(i + 1, line) for i, line in enumerate(read_text(path).splitlines()) if line.strip(", ")]
    head = [[cell.strip() for cell in split(line, comma)] for _, line in kept[:PEEKED_LINES]]
    first, width, layout, units = _format7(head, path) if head[0][0].startswith("Format=") else _slash_names(head, path)
    if len(kept) <= first:
        raise FileFormatError(f"{path}: no samples below its header")
    names = ["Time"] + [str(column) for column in range(2, width + 1)]
    for sensor, quantities in layout.items():
        for quantity, axes in quantities.items():
            for axis, column in axes.items():
                names[column - 1] = f"{sensor}/{quantity}/{axis}"
    one = table_of_rows(path, tuple(names), kept[first:], comma)
    start = float(one.numbers([0])[0, 0])
    since_1970 = start > EPOCH_MICROSECONDS
    common = SensorColumns(time=1, time_unit="us" if since_1970 else "s", world_up=UP_OR_DOWN)
    sensors = {sensor: _sensor(one, common, quantities, units) for sensor, quantities in layout.items()}
    sensors = {name: entry for name, entry in sensors.items() if entry != common}
    if not sensors:
        raise FileFormatError(f"{path}: no sensor with all axes of Acceleration, Angular Velocity or Orientation")
    log = table.read(path, ColumnMap(str(path), sensors=sensors), {path: one})
    return replace(log, format=FORMAT, start_ns=int(start) * 1000 if since_1970 else 0, clock_s=None)


def _sensor(
    one: TextTable, common: SensorColumns, quantities: dict[str, dict[str, int]], units: Sequence[str]
) -> SensorColumns:
    """The columns of the quantities of which there are all axes and any numbers, in the units that stand above them."""
    entry = common
    for quantity, axes in quantities.items():
        columns = tuple(axes[axis] for axis in AXES[quantity] if axis in axes)
        if len(columns) == len(AXES[quantity]) and np.any(np.isfinite(one.numbers([at - 1 for at in columns]))):
            entry = replace(entry, **{quantity: Columns(columns)})
            entry = replace(entry, **UNITS.get(units[columns[0] - 1] if units else "", {}))  # others are SI already
    return entry


def _add(layout: Layout, sensor: str, quantity: str, axis: str, column: int) -> None:
    if quantity in QUANTITIES:
        axes = layout.setdefault(sensor, {}).setdefault(QUANTITIES[quantity], {})
        axes["S" if axis == "Scalar" else axis] = column + 1


def _format7(head: list[list[str]], path: Path) -> tuple[int, int, Layout, Sequence[str]]:
    """Three header lines: device ids with their labels further right, quantities, axes."""
    if len(head) < 3:
        raise FileFormatError(f"{path}: ends within its three header lines")
    starts = [i for i, cell in enumerate(head[0]) if i and cell.isdigit()]
    if not starts:
        raise FileFormatError(f"{path}, line 1: no device id after '{head[0][0]}': expected one per sensor")
    if starts[-1] >= min(len(head[1]), len(head[2])):
        raise FileFormatError(f"{path}, lines 2 and 3 end before the columns of the device in column {starts[-1] + 1}")
    layout: Layout = {}
    for start, end in zip(starts, [*starts[1:], len(head[1])], strict=True):
        label = next((cell for cell in head[0][start + 1 : end] if cell), head[0][start])
        quantity = ""
        for column in range(start, min(end, len(head[2]))):
            quantity = head[1][column] or quantity
            _add(layout, label, quantity, head[2][column], column)
    return 3, len(head[1]), layout, ()


def _slash_names(head: list[list[str]], path: Path) -> tuple[int, int, Layout, Sequence[str]]:
    """Settings, then one line of ``Sensor/Quantity/Axis`` and one of units."""
    at = next((i for i, row in enumerate(head) if row[0] == "Time"), None)
    if at is None:
        raise FileFormatError(f"{path}: no line whose first cell is 'Time': expected the names of the columns there")
    layout: Layout = {}
    for column, name in enumerate(head[at]):
        parts = name.split("/")
        if len(parts) == 3:
            _add(layout, parts[0], parts[1], parts[2], column)
    if not layout:
        raise FileFormatError(f"{path}, line {at + 1}: no column of the form Sensor/Acceleration/X")
    width, units = len(head[at]), head[at + 1] if at + 1 < len(head) else []
    if not units or units[0] not in ("s", "us", "ms"):
        return at + 1, width, layout, ()
    return at + 2, width, layout, [*units, *[""] * width]
