"""OpenSim's export of IMUs: tables side by side, one for each quantity, told by how their names end.

``walk_Accel.trc``, ``walk_Gyro.trc``, ``walk_Orientations.sto`` (as OpenSense's MATLAB scripts name them), or
``walk_linear_accelerations.sto``, ``walk_angular_velocity.sto``, ``walk_orientations.sto`` (as OpenSim's readers do);
the same sensors in all of them, m/s² with gravity and rad/s, quaternions from sensor to a world whose z is up.
"""

import re
from collections.abc import Mapping
from pathlib import Path

from vip_factors.errors import FileFormatError
from vip_factors.io.importers import table
from vip_factors.io.importers.column_map import QUANTITIES, ColumnMap, Columns, SensorColumns
from vip_factors.io.importers.shared import ImportedLog, candidates
from vip_factors.io.importers.text_table import COMPONENTS, TextTable, read_text_table

FORMAT = "opensim_export"
SUFFIXES = (".trc", ".sto")
_ENDINGS = {
    "acceleration": r"(linear_?)?acc(el(erations?|erometer)?)?",
    "angular_rate": r"gyro?s?(scope)?|angular_?velocit(y|ies)",
    "quaternion": r"orientations?|quaternions?",
}
_TIMES = ("time", "Time")


def matches(path: Path) -> bool:
    """Whether at least acceleration or angular rate stands in a file beside another quantity of the same name.

    A table of orientations that is named itself is no such export: it was asked for alone.
    """
    if path.is_file() and _split(path)[1] in ("", "quaternion"):
        return False
    return any(len(files) > 1 for files in _exports(path).values())


def read(path: Path) -> ImportedLog:
    """The sensors of one export; a folder must hold one.

    Raises:
        FileFormatError: for several exports, or tables that are malformed.
        InputError: for a quantity that lacks one of the sensors.
    """
    tables = _tables(path)
    found = table.read(path, _columns(path, tables), {one.path: one for one in tables.values()})
    return ImportedLog(FORMAT, found.imus, found.default_sites, start_ns=found.start_ns, notes=found.notes)


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


def others_beside(path: Path) -> list[Path]:
    """The tables of other quantities in the export that a table is one of."""
    files = _exports(path).get(_split(path)[0], {})
    return [file for file in files.values() if file != path] if path in files.values() else []


def _split(file: Path) -> tuple[str, str]:
    """What a file's name begins with, and which quantity its ending names, if any."""
    for quantity, ending in _ENDINGS.items():
        if found := re.fullmatch(rf"(.*?)[-_ ]({ending})", file.stem, re.IGNORECASE):
            return found.group(1), quantity
    return file.stem, ""
