"""APDM (Opal) csv exports: all sensors side by side in one file, in either of the two layouts Motion Studio writes."""

import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.sensor_table import peek
from vip_factors.io.importers.shared import GRAVITY, ImportedLog, candidates, default_sites, merge_notes, z_up
from vip_factors.io.importers.xsens_channels import rotations_or_nan
from vip_factors.sensors.imu_stream import ImuStream

FORMAT = "apdm"
_QUANTITIES = {
    "Acceleration": "acc", "Accelerometer": "acc", "Angular Velocity": "gyr", "Gyroscope": "gyr",
    "Orientation": "quat",
}  # fmt: skip
_AXES = {"acc": ("X", "Y", "Z"), "gyr": ("X", "Y", "Z"), "quat": ("S", "X", "Y", "Z")}
_UNITS = {"g": GRAVITY, "deg/s": np.deg2rad(1.0), "°/s": np.deg2rad(1.0)}  # everything else is in SI already
EPOCH_MICROSECONDS = 1e12  # a time above this is microseconds since 1970 (1e12 µs is January 1970), not seconds
LATEST = 9.2e15  # microseconds: what nanoseconds in 64 bits can tell


@dataclass
class _Layout:
    """Where things stand: sensor → quantity → axis → column, first data row, and factors to SI by column."""

    first_row: int
    width: int
    columns: dict[str, dict[str, dict[str, int]]] = field(default_factory=dict)
    units: dict[int, float] = field(default_factory=dict)

    def add(self, sensor: str, quantity: str, axis: str, column: int) -> None:
        if kind := _QUANTITIES.get(quantity):
            axis = "S" if axis == "Scalar" else axis
            self.columns.setdefault(sensor, {}).setdefault(kind, {})[axis] = column


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

    Acceleration is specific force. Opals turn samples into a frame with x to magnetic north and z up; where the data
    say that z is down, the frame is turned over.

    Raises:
        FileFormatError: for other files, without samples, or with cells that are not numbers.
    """
    files = [file for file in candidates(path, (".csv",)) if _is_export(file)]
    if len(files) != 1:
        found = ", ".join(file.name for file in files) or "none"
        raise FileFormatError(f"{path}: expected one APDM csv file with all sensors, found {found}")
    path = files[0]
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows = [row for row in csv.reader(file) if any(row)]
    layout = _format7(rows, path) if rows[0][0].startswith("Format=") else _slash_names(rows, path)
    values, notes = _values(rows, layout, path)
    scale, start_ns = 1.0, 0
    if values[0, 0] > EPOCH_MICROSECONDS:
        scale, start_ns = 1e-6, int(values[0, 0]) * 1000
    time = scale * (values[:, 0] - values[0, 0])
    imus = {
        sensor: _stream(sensor, time, values, columns, str(path), notes) for sensor, columns in layout.columns.items()
    }
    return ImportedLog(FORMAT, imus, default_sites(list(imus)), start_ns=start_ns, notes=merge_notes(notes))


def _format7(rows: list[list[str]], path: Path) -> _Layout:
    """Three header lines: device ids with their labels further right, quantities, axes."""
    if len(rows) < 3:
        raise FileFormatError(f"{path}: ends within its three header lines")
    layout = _Layout(3, len(rows[1]))
    starts = [i for i, cell in enumerate(rows[0]) if i and cell.strip().isdigit()]
    if not starts:
        raise FileFormatError(f"{path}, line 1: no device id after '{rows[0][0]}': expected one per sensor")
    if starts[-1] >= min(len(rows[1]), len(rows[2])):
        raise FileFormatError(f"{path}, lines 2 and 3 end before the columns of the device in column {starts[-1] + 1}")
    for start, end in zip(starts, [*starts[1:], len(rows[1])], strict=True):
        label = next((cell.strip() for cell in rows[0][start + 1 : end] if cell.strip()), rows[0][start].strip())
        quantity = ""
        for column in range(start, min(end, len(rows[2]))):
            quantity = rows[1][column].strip() or quantity
            layout.add(label, quantity, rows[2][column].strip(), column)
    return layout


def _slash_names(rows: list[list[str]], path: Path) -> _Layout:
    """Settings, then one line of ``Sensor/Quantity/Axis`` and one of units."""
    at = next((i for i, row in enumerate(rows) if row[0].strip() == "Time"), None)
    if at is None:
        raise FileFormatError(f"{path}: no line whose first cell is 'Time': expected the names of the columns there")
    layout = _Layout(at + 1, len(rows[at]))
    for column, name in enumerate(rows[at]):
        parts = name.strip().split("/")
        if len(parts) == 3:
            layout.add(parts[0], parts[1], parts[2], column)
    if at + 1 < len(rows) and rows[at + 1][0].strip() in ("s", "us", "ms"):
        layout.first_row += 1
        layout.units = {i: _UNITS.get(cell.strip(), 1.0) for i, cell in enumerate(rows[at + 1]) if 0 < i < layout.width}
    if not layout.columns:
        raise FileFormatError(f"{path}, line {at + 1}: no column of the form Sensor/Acceleration/X")
    return layout


def _values(rows: list[list[str]], layout: _Layout, path: Path) -> tuple[Array, list[str]]:
    """All numbers ``(N, columns)`` in SI, blanks as NaN; rows with a repeated time are dropped."""
    data, notes = rows[layout.first_row :], []
    if data and len(data[-1]) < layout.width:
        data = data[:-1]
        notes.append(f"{path.name}: the last line breaks off and was dropped")
    if not data:
        raise FileFormatError(f"{path}: no samples below its header")
    table = np.full((len(data), layout.width), np.nan)
    for i, row in enumerate(data):
        if len(row) < layout.width:
            raise FileFormatError(f"{path}, sample {i + 1}: {len(row)} cells: expected {layout.width}")
        try:
            table[i] = [float(cell) if cell.strip() else np.nan for cell in row[: layout.width]]
        except ValueError as error:
            raise FileFormatError(f"{path}, sample {i + 1}: {error}") from error
    for column, factor in layout.units.items():
        table[:, column] *= factor
    if not np.all(np.abs(table[:, 0]) < LATEST):
        at = int(np.argmin(np.abs(table[:, 0]) < LATEST))
        raise FileFormatError(f"{path}, sample {at + 1}: time {data[at][0]!r}: expected a number")
    _, first = np.unique(table[:, 0], return_index=True)
    if len(first) < len(table):
        notes.append(f"{path.name}: {len(table) - len(first)} samples with a repeated time stamp dropped")
    return table[first], notes


def _stream(
    sensor: str, time: Array, values: Array, columns: dict[str, dict[str, int]], where: str, notes: list[str]
) -> ImuStream:
    def group(kind: str) -> Array | None:
        at = columns.get(kind, {})
        if any(axis not in at for axis in _AXES[kind]):
            return None
        found = values[:, [at[axis] for axis in _AXES[kind]]]
        return found if np.any(np.isfinite(found)) else None

    force, rate, quaternion = group("acc"), group("gyr"), group("quat")
    R = None
    if quaternion is not None:
        R = rotations_or_nan(quaternion, Order.WXYZ, f"{where}, sensor '{sensor}'", notes)
        if force is not None:
            R, turned = z_up(sensor, R, force)
            notes += turned
    return ImuStream.from_samples(sensor, time, force, R, rate)
