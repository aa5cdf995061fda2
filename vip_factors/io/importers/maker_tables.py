"""Makers' tables that a column map describes: OpenSim's and OpenSense's, and APDM's.

OpenSense writes quaternions (.sto); OpenSim's export is a table for each quantity, side by side: ``walk_Accel.trc``,
``walk_Gyro.trc``, ``walk_Orientations.sto`` (as OpenSense's MATLAB scripts name them), or
``walk_linear_accelerations.sto``, ``walk_angular_velocity.sto``, ``walk_orientations.sto`` (as OpenSim's readers do);
the same sensors in all of them, m/s² with gravity and rad/s, quaternions from sensor to a world whose z is up.

APDM's (Opal's) csv has all sensors side by side in one file, in either of the two layouts that Motion Studio writes.
Acceleration is specific force. Opals turn samples into a frame with x to magnetic north and z up; where the data say
that z is down, the frame is turned over.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from msgspec import structs

from vip_factors.errors import FileFormatError
from vip_factors.io.importers.column_map import QUANTITIES, UP_OR_DOWN, ColumnMap, Columns, SensorColumns
from vip_factors.io.importers.shared import ImportedLog, LogFormat, candidates, only_file
from vip_factors.io.importers.table import read as read_streams
from vip_factors.io.importers.text_table import (
    COMPONENTS,
    SEPARATORS,
    TextTable,
    peek,
    read_lines,
    read_text_table,
    split,
    table_of_rows,
)

SUFFIXES = (".trc", ".sto")
_ENDINGS = {
    "acceleration": r"(linear_?)?acc(el(erations?|erometer)?)?",
    "angular_rate": r"gyro?s?(scope)?|angular_?velocit(y|ies)",
    "quaternion": r"orientations?|quaternions?",
}


def _matches_export(path: Path) -> bool:
    """Whether at least acceleration or angular rate stands in a file beside another quantity of the same name.

    A table of orientations that is named itself is no such export: it was asked for alone.
    """
    if path.is_file() and _split(path)[1] in ("", "quaternion"):
        return False
    return any(len(files) > 1 for files in _exports(path).values())


def _read_export(path: Path) -> ImportedLog:
    """Read the sensors of an export; a folder must hold one."""
    exports = {prefix: files for prefix, files in _exports(path).items() if len(files) > 1}
    if len(exports) != 1:
        names = ", ".join(exports) or "none"
        raise FileFormatError(f"{path}: expected the tables of one recording, found {names}: name the one you mean")
    (files,) = exports.values()
    tables = {quantity: read_text_table(file) for quantity, file in files.items()}
    log = read_streams(path, _columns(path, tables), {table.path: table for table in tables.values()})
    return replace(log, format=EXPORT.name, clock_s=None)


def _columns(path: Path, tables: Mapping[str, TextTable]) -> ColumnMap:
    time = next((name for name in next(iter(tables.values())).names if name in ("time", "Time")), "time")
    sensors: dict[str, SensorColumns] = {}
    for quantity, table in tables.items():
        letters = COMPONENTS[QUANTITIES[quantity]]
        matches = (re.fullmatch(rf"(.+)_[{letters}]", column) for column in table.names)
        for name in dict.fromkeys(match[1] for match in matches if match):
            columns = Columns(tuple(f"{name}_{letter}" for letter in letters), table.path.name)
            sensors[name] = structs.replace(sensors.get(name, SensorColumns(time=time)), **{quantity: columns})
    return ColumnMap(str(path), sensors=sensors)


def _exports(path: Path) -> dict[str, dict[str, Path]]:
    """The files of each export, by the beginning of their names and by quantity."""
    start = path.with_name(_split(path)[0]) if path.is_file() else path
    exports: dict[str, dict[str, Path]] = {}
    for file in candidates(start, SUFFIXES):
        prefix, quantity = _split(file)
        if quantity and (not path.is_file() or prefix == start.name):
            exports.setdefault(prefix, {}).setdefault(quantity, file)
    return exports


def _split(file: Path) -> tuple[str, str]:
    """Beginning of a file's name, and the quantity that its ending names, blank if none."""
    for quantity, ending in _ENDINGS.items():
        if match := re.fullmatch(rf"(.*?)[-_ ]({ending})", file.stem, re.IGNORECASE):
            return match[1], quantity
    return file.stem, ""


def _quaternion_tables(path: Path) -> list[Path]:
    files = candidates(path, (".sto",))
    return [file for file in files if re.search(r"^DataType=Quaternion\s*$", peek(file)[:2000], re.MULTILINE)]


def _read_quaternions(path: Path) -> ImportedLog:
    """Read OpenSense's table of orientations, one column a sensor, cells ``w,x,y,z``; a folder must hold one.

    OpenSense's raw tables keep the sensors' own inertial frame, z up; a table that had
    ``sensor_to_opensim_rotations`` applied has y up instead. Orientation alone cannot tell which: z up is taken.
    """
    path = only_file(path, _quaternion_tables(path), "one .sto table of quaternions")
    table = read_text_table(path)
    notes = [
        f"{path.name}: taken to be in the sensors' own inertial frame, z up, as OpenSense writes raw tables; "
        "if OpenSim axes (y up) were applied already, convert the raw recording instead",
        f"{path.name}: orientation only, no acceleration: translation will be unobservable from the sensors",
    ]
    siblings = [file for file in _exports(path).get(_split(path)[0], {}).values() if file != path]
    if siblings and _split(path)[1]:
        notes.append(f"{path.name}: {siblings[0].name} stands beside it: name that one, and both are read together")
    columns = _columns(path, {"quaternion": table})
    blank = [
        name
        for name, entry in columns.sensors.items()
        if entry.quaternion and table.group(list(map(str, entry.quaternion.columns))) is None
    ]
    notes += [f"{path.name}: column '{name}' has no orientation at all: left out" for name in blank]
    sensors = {name: entry for name, entry in columns.sensors.items() if name not in blank}
    if not sensors:
        raise FileFormatError(f"{path}: expected the columns 'time' and one per sensor, tab-separated, of four numbers")
    log = read_streams(path, ColumnMap(str(path), sensors=sensors), {path: table})
    return ImportedLog(OPENSENSE.name, log.imus, log.default_sites, notes=(*notes, *log.notes))


APDM_QUANTITIES = {
    "Acceleration": "acceleration",
    "Accelerometer": "acceleration",
    "Angular Velocity": "angular_rate",
    "Gyroscope": "angular_rate",
    "Orientation": "quaternion",
}
APDM_AXES = {"acceleration": "XYZ", "angular_rate": "XYZ", "quaternion": "SXYZ"}
APDM_UNITS = {"g": "g", "deg/s": "deg/s", "°/s": "deg/s"}  # others are SI already
PEEKED_LINES = 12  # that hold the header of either layout
EPOCH_MICROSECONDS = 1e12  # a time above this is microseconds since 1970 (1e12 µs is January 1970), not seconds


def _apdm_files(path: Path) -> list[Path]:
    files = []
    for file in candidates(path, (".csv",)):
        lines = peek(file).splitlines()[:4]
        is_format7 = len(lines) > 1 and lines[0].startswith("Format=") and "Accelerometer" in lines[1]
        if is_format7 or any(line.startswith("Time,") and "/Acceleration/X" in line for line in lines):
            files.append(file)
    return files


def _read_apdm(path: Path) -> ImportedLog:
    """Read a file with all sensors; a folder must hold one such file."""
    path, comma = only_file(path, _apdm_files(path), "one APDM csv file with all sensors"), SEPARATORS["comma"]
    numbered = [(i + 1, line) for i, line in enumerate(read_lines(path)[0]) if line.strip(", ")]
    head = [[cell.strip() for cell in split(line, comma)] for _, line in numbered[:PEEKED_LINES]]
    names, first_row, units = (_format7 if head[0][0].startswith("Format=") else _slash_names)(head, path)
    if len(numbered) <= first_row:
        raise FileFormatError(f"{path}: no samples below its header")
    table = table_of_rows(path, ("Time", *names[1:]), numbered[first_row:], comma)
    start = float(table.numbers([0])[0, 0])
    since_1970 = start > EPOCH_MICROSECONDS
    common = SensorColumns(time=1, time_unit="us" if since_1970 else "s", world_up=UP_OR_DOWN)
    sensors: dict[str, SensorColumns] = {}
    for sensor in dict.fromkeys(name.rsplit("/", 2)[0] for name in names if "/" in name):
        for quantity, axes in APDM_AXES.items():
            columns = tuple(f"{sensor}/{quantity}/{axis}" for axis in axes)
            if table.group(columns) is not None:
                unit = APDM_UNITS.get(units.get(columns[0], ""))
                unit_key = {} if unit is None else {f"{quantity}_unit": unit}
                entry = sensors.get(sensor, common)
                sensors[sensor] = structs.replace(entry, **{quantity: Columns(columns)}, **unit_key)
    if not sensors:
        raise FileFormatError(f"{path}: no sensor with all axes of Acceleration, Angular Velocity or Orientation")
    log = read_streams(path, ColumnMap(str(path), sensors=sensors), {path: table})
    return replace(log, format=APDM.name, start_ns=int(start) * 1000 if since_1970 else 0, clock_s=None)


Header = tuple[list[str], int, dict[str, str]]  # names of all columns, the first row below them, units by name


def _column_name(number: int, sensor: str, quantity: str, axis: str) -> str:
    """``Sensor/acceleration/X``, or the column's number where it is none of ours."""
    key = APDM_QUANTITIES.get(quantity)
    return f"{sensor}/{key}/{'S' if axis == 'Scalar' else axis}" if key else str(number)


def _format7(head: list[list[str]], path: Path) -> Header:
    """Three header lines: device ids with their labels further right, quantities, axes."""
    if len(head) < 3:
        raise FileFormatError(f"{path}: ends within its three header lines")
    ids, quantities, axes = head[:3]
    starts = [i for i, cell in enumerate(ids) if i and cell.isdigit()]
    if not starts:
        raise FileFormatError(f"{path}, line 1: no device id after '{ids[0]}': expected one per sensor")
    if starts[-1] >= min(len(quantities), len(axes)):
        raise FileFormatError(f"{path}, lines 2 and 3 end before the columns of the device in column {starts[-1] + 1}")
    names = [str(column + 1) for column in range(len(quantities))]
    for start, end in zip(starts, [*starts[1:], len(quantities)], strict=True):
        label = next((cell for cell in ids[start + 1 : end] if cell), ids[start])
        quantity = ""
        for column in range(start, min(end, len(axes))):
            quantity = quantities[column] or quantity
            names[column] = _column_name(column + 1, label, quantity, axes[column])
    return names, 3, {}


def _slash_names(head: list[list[str]], path: Path) -> Header:
    """Settings, then one line of ``Sensor/Quantity/Axis`` and one of units."""
    row = next((i for i, row in enumerate(head) if row[0] == "Time"), None)
    if row is None:
        raise FileFormatError(f"{path}: no line whose first cell is 'Time': expected the names of the columns there")
    labels = [cell.split("/") for cell in head[row]]
    names = [_column_name(i, *words) if len(words) == 3 else str(i) for i, words in enumerate(labels, start=1)]
    if not any("/" in name for name in names):
        raise FileFormatError(f"{path}, line {row + 1}: no column of the form Sensor/Acceleration/X")
    units = head[row + 1] if row + 1 < len(head) else []
    if not units or units[0] not in ("s", "us", "ms"):
        return names, row + 1, {}
    return names, row + 2, dict(zip(names, units, strict=False))


EXPORT = LogFormat("opensim_export", _matches_export, _read_export)
APDM = LogFormat("apdm", lambda path: bool(_apdm_files(path)), _read_apdm)
OPENSENSE = LogFormat("opensense_sto", lambda path: bool(_quaternion_tables(path)), _read_quaternions)
