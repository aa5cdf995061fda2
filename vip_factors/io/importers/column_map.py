"""Column map: a small TOML file with the quantity, sensor and unit of each column of a sensor log.

::

    time = "t"                             # or rate_hz = 100, or what the file states above its header
    time_unit = "ms"                       # s, ms, us, ns, 0.1ms, days; dates and times of day need none
    counter = "packet"                     # counts the packets: lost ones are gaps, at rate_hz or by the times
    acceleration_unit = "g"                # m/s2, g, mg
    gravity = "included"                   # or "left out" of the acceleration: the quaternion restores it
    angular_rate_unit = "deg/s"            # rad/s, deg/s
    quaternion_order = "wxyz"              # wxyz, xyzw: of the columns named
    quaternion_sense = "sensor_to_world"   # or world_to_sensor
    world_up = "z"                         # z, y, -z: of the quaternions' world

    [sensors.pelvis]
    acceleration = ["p_ax", "p_ay", "p_az"]
    angular_rate = ["p_gx", "p_gy", "p_gz"]
    quaternion = ["p_qw", "p_qx", "p_qy", "p_qz"]

    [sensors.left_thigh]
    file = "thigh.csv"                     # in the log's folder, if each sensor has a file
    acceleration = ["ax", "ay", "az"]
    angular_rate = { file = "thigh_gyro.csv", columns = [2, 3, 4] }   # names, or numbers from 1 on

What stands above the sensors holds for all of them, and a sensor may say otherwise. Without ``[sensors]`` each file
is one sensor, named as the file. With ``sensor_column`` the rows of all sensors stand in one table, and that column
names the sensor. ``separator``, ``comment`` and ``header`` (line numbers) are detected unless declared.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from msgspec import structs

from vip_factors.display import one_line
from vip_factors.errors import InputError, nearest
from vip_factors.geometry.quaternions import Order
from vip_factors.io.importers.shared import GRAVITY
from vip_factors.io.importers.text_table import SEPARATORS, Dialect
from vip_factors.io.typed_files import convert, read_toml, toml_text

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "0.1ms": 1e-4, "days": 86_400.0}  # likelier ones first
ACCELERATION_UNITS = {"m/s2": 1.0, "g": GRAVITY, "mg": GRAVITY / 1000}
ANGULAR_RATE_UNITS = {"rad/s": 1.0, "deg/s": 0.017453292519943295}
GRAVITIES = ("included", "left out")
SENSES = ("sensor_to_world", "world_to_sensor")
UPS = ("z", "y", "-z")
UP_OR_DOWN = "z or -z"  # as gravity tells: of makers whose exports differ; no column map says it
QUANTITIES = {"acceleration": 3, "angular_rate": 3, "quaternion": 4}
UNIT_KEYS = {
    "acceleration": ("acceleration_unit", "gravity"),
    "angular_rate": ("angular_rate_unit",),
    "quaternion": ("quaternion_order", "quaternion_sense", "world_up"),
}
CHOICES: dict[str, tuple[str, ...]] = {
    "time_unit": tuple(TIME_UNITS),
    "acceleration_unit": tuple(ACCELERATION_UNITS),
    "gravity": GRAVITIES,
    "angular_rate_unit": tuple(ANGULAR_RATE_UNITS),
    "quaternion_order": tuple(order.value for order in Order),
    "quaternion_sense": SENSES,
    "world_up": UPS,
}
PLAUSIBLE_RATES_HZ = (1.0, 20000.0)


class Columns(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Columns of a quantity, by names or by numbers from 1 on, and the file if it is not the sensor's."""

    columns: tuple[str | int, ...]
    file: str | None = None


class SensorColumns(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Columns, units and clock of one sensor, or of all; the fields are the keys of the file."""

    file: str | None = None
    time: str | int | None = None
    time_unit: str = "s"
    rate_hz: float | None = None
    counter: str | int | None = None
    acceleration: Columns | None = None
    acceleration_unit: str = "m/s2"
    gravity: str = "included"
    angular_rate: Columns | None = None
    angular_rate_unit: str = "rad/s"
    quaternion: Columns | None = None
    quaternion_order: str = "wxyz"
    quaternion_sense: str = "sensor_to_world"
    world_up: str = "z"


class _Layout(msgspec.Struct, frozen=True):
    """Keys of a column map beside those of a sensor."""

    sensors: dict[str, dict[str, object]] = {}
    sensor_column: str | int | None = None
    separator: str | None = None
    comment: str | None = None
    header: int | tuple[int, ...] | None = None


@dataclass(frozen=True)
class ColumnMap:
    """Content of a column map.

    Attributes:
        source: its name in messages.
        common: for sensors that have no entry.
        sensors: by name; none if each file is a sensor.
        sensor_column: the column that names the sensor of each row.
        dialect: layout of the files.
    """

    source: str
    common: SensorColumns = field(default_factory=SensorColumns)
    sensors: Mapping[str, SensorColumns] = field(default_factory=dict)
    sensor_column: str | int | None = None
    dialect: Dialect = field(default_factory=Dialect)


def read_column_map(path: str | Path, rate_hz: float | None = None) -> ColumnMap:
    """Read a column map; ``rate_hz`` replaces its columns of times and its rates.

    Raises:
        FileFormatError: if it cannot be read or parsed.
        InputError: for an unknown key or choice (the nearest is named), a value of the wrong kind, or a sensor with
            two clocks or without any quantity.
    """
    path = Path(path)
    content = read_toml(path, dict[str, object], "a column map (TOML with time, [sensors] …)")
    layout = convert(path, "", content, _Layout)
    common = {key: value for key, value in content.items() if key not in _Layout.__struct_fields__}
    columns = _sensor_columns(path, "", common)
    sensors = {
        name: _sensor_columns(path, f"sensors.{name}", {**common, **table}) for name, table in layout.sensors.items()
    }
    for name, entry in (sensors or {"": columns}).items():
        where = f"{path}: sensor '{name}'" if name else f"{path}: the sensors"
        if all(getattr(entry, quantity) is None for quantity in QUANTITIES):
            raise InputError(f"{where}: no columns named: expected at least one of {', '.join(QUANTITIES)}")
        if entry.time is not None and entry.rate_hz is not None:
            raise InputError(f"{where}: both time and rate_hz are given: expected the column of the times, or the rate")
    if rate_hz is not None:
        columns = structs.replace(columns, time=None, rate_hz=rate_hz)
        sensors = {name: structs.replace(entry, time=None, rate_hz=rate_hz) for name, entry in sensors.items()}
    by_character = {character or " ": name for name, character in SEPARATORS.items()}
    separator = by_character.get(layout.separator or "", layout.separator)
    if separator is not None and separator not in SEPARATORS:
        raise InputError(f"{path}: separator '{separator}'{nearest(separator, SEPARATORS)}")
    header = (layout.header,) if isinstance(layout.header, int) else layout.header
    if header is not None and (not header or min(header) < 1):
        raise InputError(f"{path}: header is {layout.header}: expected a line's number from 1 on, or a list")
    dialect = Dialect(separator, layout.comment or None, header)
    return ColumnMap(str(path), columns, sensors, layout.sensor_column, dialect)


def _sensor_columns(path: Path, where: str, table: Mapping[str, object]) -> SensorColumns:
    located = {  # the columns alone stand for a table without a file
        key: {"columns": value} if key in QUANTITIES and isinstance(value, list) else value
        for key, value in table.items()
    }
    entry = convert(path, where, located, SensorColumns)
    prefix = f"{path}: {where}." if where else f"{path}: "
    for quantity, count in QUANTITIES.items():
        columns: Columns | None = getattr(entry, quantity)
        if columns is not None and not len(columns.columns) == len(set(columns.columns)) == count:
            raise InputError(f"{prefix}{quantity}: expected a list of {count} columns, each named once")
    for key, choices in CHOICES.items():
        word: str = getattr(entry, key)
        if word not in choices:
            raise InputError(f"{prefix}{key} '{word}'{nearest(word, choices)}")
    low, high = PLAUSIBLE_RATES_HZ
    if entry.rate_hz is not None and not low <= entry.rate_hz <= high:
        raise InputError(f"{prefix}rate_hz is {entry.rate_hz:g}: expected {low:g} to {high:g} samples a second")
    return entry


def columns_text(path: Path, columns: ColumnMap, reasons: Mapping[str, list[str]]) -> str:
    """A column map as TOML, what all sensors share above them."""
    entries = dict(columns.sensors) or {"": columns.common}
    first = next(iter(entries.values()))
    has_one_clock = len({tuple(_time_lines(entry)) for entry in entries.values()}) == 1
    lines = [
        f"# Column map of {one_line(str(path))}, guessed from names and numbers. Check every line.",
        "",
        *(_time_lines(first) if has_one_clock else ()),
    ]
    for quantity, keys in UNIT_KEYS.items():
        if any(getattr(entry, quantity) is not None for entry in entries.values()):
            lines += [f"{key} = {toml_text(getattr(first, key))}  # {', '.join(CHOICES[key])}" for key in keys]
    if columns.sensor_column is not None:
        lines.append(f"sensor_column = {toml_text(columns.sensor_column)}  # names the sensor of each row")
    for name, entry in entries.items():
        lines += ["", *(f"# {one_line(reason)}" for reason in reasons.get(name, ()))]
        if name:
            lines.append(f"[sensors.{toml_text(name)}]")
        if entry.file is not None:
            lines.append(f"file = {toml_text(entry.file)}")
        lines += () if has_one_clock else _time_lines(entry)
        for quantity in QUANTITIES:
            located: Columns | None = getattr(entry, quantity)
            if located is not None:
                listed = toml_text(located.columns)
                table = f"{{ file = {toml_text(located.file)}, columns = {listed} }}" if located.file else listed
                lines.append(f"{quantity} = {table}")
    return "\n".join(lines) + "\n"


def _time_lines(entry: SensorColumns) -> list[str]:
    lines = []
    if entry.counter is not None:
        lines.append(f"counter = {toml_text(entry.counter)}  # packet counter; lost packets become gaps")
    if entry.time is not None:
        lines += [
            f"time = {toml_text(entry.time)}",
            f'time_unit = "{entry.time_unit}"  # ' + ", ".join(CHOICES["time_unit"]),
        ]
    elif entry.rate_hz is not None:
        lines.append(f"rate_hz = {entry.rate_hz:g}  # as stated")
    else:
        lines.append("# No time column was detected. Name it, or give the samples per second:")
        lines += ['# time = "…"', "# rate_hz = 100"]
    return lines
