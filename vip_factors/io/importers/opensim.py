"""OpenSim's tables of IMUs: OpenSense's quaternions (.sto), or one table for each quantity, side by side.

``walk_Accel.trc``, ``walk_Gyro.trc``, ``walk_Orientations.sto`` (as OpenSense's MATLAB scripts name them), or
``walk_linear_accelerations.sto``, ``walk_angular_velocity.sto``, ``walk_orientations.sto`` (as OpenSim's readers do);
the same sensors in all of them, m/s² with gravity and rad/s, quaternions from sensor to a world whose z is up.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.io.importers import table
from vip_factors.io.importers.column_map import QUANTITIES, ColumnMap, Columns, SensorColumns
from vip_factors.io.importers.packet_clock import SAME_RATE
from vip_factors.io.importers.shared import ImportedLog, LogFormat, candidates
from vip_factors.io.importers.text_table import COMPONENTS, TextTable, peek, read_text_table

SUFFIXES = (".trc", ".sto")
_ENDINGS = {
    "acceleration": r"(linear_?)?acc(el(erations?|erometer)?)?",
    "angular_rate": r"gyro?s?(scope)?|angular_?velocit(y|ies)",
    "quaternion": r"orientations?|quaternions?",
}
_TIMES = ("time", "Time")


def _matches_export(path: Path) -> bool:
    """Whether at least acceleration or angular rate stands in a file beside another quantity of the same name.

    A table of orientations that is named itself is no such export: it was asked for alone.
    """
    if path.is_file() and _split(path)[1] in ("", "quaternion"):
        return False
    return any(len(files) > 1 for files in _exports(path).values())


def _read_export(path: Path) -> ImportedLog:
    """The sensors of one export; a folder must hold one.

    Raises:
        FileFormatError: for several exports, or tables that are malformed.
        InputError: for a quantity that lacks one of the sensors.
    """
    tables = _tables(path)
    found = table.read(path, _columns(path, tables), {one.path: one for one in tables.values()})
    return ImportedLog(EXPORT.name, found.imus, found.default_sites, start_ns=found.start_ns, notes=found.notes)


def column_map(path: Path) -> ColumnMap:
    """What the columns of an export mean, in the words of a column map.

    Raises:
        FileFormatError: for several exports, or tables that are malformed.
    """
    return _columns(path, _tables(path))


def _tables(path: Path) -> dict[str, TextTable]:
    """By quantity, the table of the one export at a path."""
    exports = {prefix: files for prefix, files in _exports(path).items() if len(files) > 1}
    if len(exports) != 1:
        found = ", ".join(exports) or "none"
        raise FileFormatError(f"{path}: expected the tables of one recording, found {found}: name the one you mean")
    (files,) = exports.values()
    return {quantity: read_text_table(file) for quantity, file in files.items()}


def _columns(path: Path, tables: Mapping[str, TextTable]) -> ColumnMap:
    sensors: dict[str, dict[str, Columns]] = {}
    for quantity, one in tables.items():
        for name in dict.fromkeys(_sensor(column, quantity) for column in one.names):
            if name:
                columns = tuple(f"{name}_{letter}" for letter in COMPONENTS[QUANTITIES[quantity]])
                sensors.setdefault(name, {})[quantity] = Columns(columns, one.path.name)
    time = next((name for name in next(iter(tables.values())).names if name in _TIMES), "time")
    entries = {}
    for name, quantities in sensors.items():
        entries[name] = SensorColumns(time=time, **quantities)  # type: ignore[arg-type]
    return ColumnMap(str(path), sensors=entries)


def _sensor(column: str, quantity: str) -> str:
    """The sensor of a component's column; nothing of a column that is none."""
    found = re.fullmatch(rf"(.+)_[{COMPONENTS[QUANTITIES[quantity]]}]", column)
    return found.group(1) if found else ""


def _exports(path: Path) -> dict[str, dict[str, Path]]:
    """What the names begin with → quantity → file."""
    beside = path.with_name(_split(path)[0]) if path.is_file() else path
    exports: dict[str, dict[str, Path]] = {}
    for file in candidates(beside, SUFFIXES):
        prefix, quantity = _split(file)
        if quantity and (not path.is_file() or prefix == beside.name):
            exports.setdefault(prefix, {}).setdefault(quantity, file)
    return exports


def _split(file: Path) -> tuple[str, str]:
    """What a file's name begins with, and which quantity its ending names, if any."""
    for quantity, ending in _ENDINGS.items():
        if found := re.fullmatch(rf"(.*?)[-_ ]({ending})", file.stem, re.IGNORECASE):
            return found.group(1), quantity
    return file.stem, ""


def _quaternion_tables(path: Path) -> list[Path]:
    files = candidates(path, (".sto",))
    return [file for file in files if re.search(r"^DataType=Quaternion\s*$", peek(file)[:2000], re.MULTILINE)]


def _read_quaternions(path: Path) -> ImportedLog:
    """Read OpenSense's table of orientations, one column a sensor, cells ``w,x,y,z``; a folder must hold one.

    OpenSense's raw tables keep the sensors' own inertial frame, z up; a table that had
    ``sensor_to_opensim_rotations`` applied has y up instead. Orientation alone cannot tell which: z up is taken.

    Raises:
        FileFormatError: for other files, malformed cells, or a table without rows.
    """
    files = _quaternion_tables(path)
    if len(files) != 1:
        found = ", ".join(file.name for file in files) or "none"
        raise FileFormatError(f"{path}: expected one .sto table of quaternions, found {found}")
    path = files[0]
    one = read_text_table(path)
    notes = [
        f"{path.name}: taken to be in the sensors' own inertial frame, z up, as OpenSense writes raw tables; "
        "if OpenSim axes (y up) were applied already, convert the raw recording instead",
        f"{path.name}: orientation only, no acceleration: translation will be unobservable from the sensors",
    ]
    others = [file for file in _exports(path).get(_split(path)[0], {}).values() if file != path]
    if others and _split(path)[1]:
        notes.append(f"{path.name}: {others[0].name} stands beside it: name that one, and both are read together")
    columns = _columns(path, {"quaternion": one})
    blank = [name for name, entry in columns.sensors.items() if _is_blank(one, entry)]
    notes += [f"{path.name}: column '{name}' has no orientation at all: left out" for name in blank]
    sensors = {name: entry for name, entry in columns.sensors.items() if name not in blank}
    if not sensors:
        raise FileFormatError(f"{path}: expected the columns 'time' and one per sensor, tab-separated, of four numbers")
    log = table.read(path, ColumnMap(str(path), sensors=sensors), {path: one})
    stated, time = one.setting(r"^DataRate=\s*([\d.]+)"), next(iter(log.imus.values())).time
    rate = 1 / float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if stated and rate and abs(rate / (float(stated) or rate) - 1) > SAME_RATE:
        notes.append(
            f"{path.name}: DataRate says {float(stated):g} Hz, its times {rate:.2f} Hz; the times are believed"
        )
    return ImportedLog(OPENSENSE.name, log.imus, log.default_sites, notes=(*notes, *log.notes))


def _is_blank(one: TextTable, entry: SensorColumns) -> bool:
    assert entry.quaternion is not None
    return bool(np.all(np.isnan(one.numbers([one.index(name, "") for name in entry.quaternion.columns]))))


EXPORT = LogFormat("opensim_export", _matches_export, _read_export)
OPENSENSE = LogFormat("opensense_sto", lambda path: bool(_quaternion_tables(path)), _read_quaternions)
