"""A small TOML file that says what the columns of a sensor log mean: which quantity, of which sensor, in which unit.

::

    time = "t"                             # or rate_hz = 100
    time_unit = "ms"                       # s, ms, us, ns
    acceleration_unit = "g"                # m/s2, g, mg; gravity included
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
names the sensor. ``separator``, ``comment`` and ``header`` (line numbers) are found unless told.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order
from vip_factors.io.importers.shared import GRAVITY
from vip_factors.io.importers.text_table import SEPARATORS, Dialect
from vip_factors.io.toml_values import known_keys, nearest, number_at, read_toml, table_at, text_at

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ACCELERATION_UNITS = {"m/s2": 1.0, "g": GRAVITY, "mg": GRAVITY / 1000}
ANGULAR_RATE_UNITS = {"rad/s": 1.0, "deg/s": 0.017453292519943295}
SENSES = ("sensor_to_world", "world_to_sensor")
UPS = ("z", "y", "-z")
UP_OR_DOWN = "z or -z"  # as gravity tells: of makers whose exports differ; no column map says it
QUANTITIES = {"acceleration": 3, "angular_rate": 3, "quaternion": 4}
_CHOICES: dict[str, tuple[str, ...]] = {
    "time_unit": tuple(TIME_UNITS),
    "acceleration_unit": tuple(ACCELERATION_UNITS),
    "angular_rate_unit": tuple(ANGULAR_RATE_UNITS),
    "quaternion_order": tuple(order.value for order in Order),
    "quaternion_sense": SENSES,
    "world_up": UPS,
}
PLAUSIBLE_RATES_HZ = (1.0, 20000.0)


@dataclass(frozen=True)
class Columns:
    """Where a quantity stands: names, or numbers from 1 on, and the file if it is not the sensor's."""

    columns: tuple[str | int, ...]
    file: str | None = None


@dataclass(frozen=True)
class SensorColumns:
    """What is known of one sensor, or of all of them; the fields are the keys of the file."""

    file: str | None = None
    time: str | int | None = None
    time_unit: str = "s"
    rate_hz: float | None = None
    acceleration: Columns | None = None
    acceleration_unit: str = "m/s2"
    angular_rate: Columns | None = None
    angular_rate_unit: str = "rad/s"
    quaternion: Columns | None = None
    quaternion_order: str = "wxyz"
    quaternion_sense: str = "sensor_to_world"
    world_up: str = "z"


@dataclass(frozen=True)
class ColumnMap:
    """Content of a column map.

    Attributes:
        source: what to call it in complaints.
        common: what holds for sensors that have no entry.
        sensors: by name; none if each file is a sensor.
        sensor_column: which column names the sensor of each row.
        dialect: of the files.
    """

    source: str
    common: SensorColumns = SensorColumns()
    sensors: Mapping[str, SensorColumns] = field(default_factory=dict)
    sensor_column: str | int | None = None
    dialect: Dialect = field(default_factory=Dialect)


def read_column_map(path: str | Path) -> ColumnMap:
    """Read a column map.

    Raises:
        FileFormatError: if it cannot be read or parsed.
        InputError: for an unknown key or choice (the nearest is named), a value of the wrong kind, or a sensor without
            time or without any quantity.
    """
    path = Path(path)
    content = dict(read_toml(path, "a column map (TOML with time, [sensors] …)"))
    keys = [one.name for one in fields(SensorColumns)]
    known_keys(path, "", content, [*keys, "sensors", "sensor_column", "separator", "comment", "header"])
    dialect = _dialect(path, content)
    sensor_column = _column(path, "sensor_column", content["sensor_column"]) if "sensor_column" in content else None
    common = {key: content[key] for key in keys if key in content}
    tables = table_at(path, "sensors", content.get("sensors", {}))
    sensors = {}
    for name, entry in tables.items():
        table = table_at(path, f"sensors.{name}", entry)
        known_keys(path, f"sensors.{name}", table, keys)
        sensors[name] = _sensor(path, f"sensors.{name}.", {**common, **table}, set(table))
    columns = _sensor(path, "", common, set(common), complete=not sensors)
    return ColumnMap(str(path), columns, sensors, sensor_column, dialect)


def _dialect(path: Path, content: Mapping[str, Any]) -> Dialect:
    separator = text_at(path, "separator", content["separator"]) if "separator" in content else None
    by_character = {character or " ": name for name, character in SEPARATORS.items()}
    separator = by_character.get(separator or "", separator)
    if separator is not None and separator not in SEPARATORS:
        raise InputError(f"{path}: separator '{separator}'{nearest(separator, SEPARATORS)}")
    comment = text_at(path, "comment", content["comment"]) if "comment" in content else None
    header = content.get("header")
    if header is not None:
        header = header if isinstance(header, list) else [header]
        if not header or any(isinstance(one, bool) or not isinstance(one, int) or one < 1 for one in header):
            raise InputError(f"{path}: header is {content['header']!r}: expected a line's number from 1 on, or a list")
    return Dialect(separator, comment or None, tuple(header) if header else None)


def _sensor(path: Path, where: str, table: Mapping[str, Any], own: set[str], complete: bool = True) -> SensorColumns:
    """One sensor's entry; ``where`` its keys stand, ``own`` those that it says itself."""
    values: dict[str, Any] = {}
    for key, value in table.items():
        place = f"{where}{key}" if key in own else key
        if key in QUANTITIES:
            values[key] = _columns(path, place, value, QUANTITIES[key])
        elif key in _CHOICES:
            values[key] = _choice(path, place, value)
        elif key == "time":
            values[key] = _column(path, place, value)
        elif key == "rate_hz":
            values[key] = number_at(path, place, value)
            low, high = PLAUSIBLE_RATES_HZ
            if not low <= values[key] <= high:
                raise InputError(f"{path}: {place} is {values[key]:g}: expected {low:g} to {high:g} samples a second")
        else:
            values[key] = text_at(path, place, value)
    sensor = where.removeprefix("sensors.").rstrip(".")
    of = f"sensor '{sensor}'" if sensor else "the sensors"
    if complete and not any(key in values for key in QUANTITIES):
        raise InputError(f"{path}: {of}: no columns named: expected at least one of {', '.join(QUANTITIES)}")
    if complete and ("time" in values) == ("rate_hz" in values):
        found = "both time and rate_hz are" if "time" in values else "neither time nor rate_hz is"
        raise InputError(f"{path}: {of}: {found} given: expected the column of the times, or the samples a second")
    return SensorColumns(**values)


def _choice(path: Path, where: str, value: Any) -> str:
    word, choices = text_at(path, where, value), _CHOICES[where.rpartition(".")[2]]
    if word not in choices:
        raise InputError(f"{path}: {where} '{word}'{nearest(word, choices)}")
    return word


def _column(path: Path, where: str, value: Any) -> str | int:
    if isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    raise InputError(f"{path}: {where} is {value!r}: expected the name of a column, or its number from 1 on")


def _columns(path: Path, where: str, value: Any, count: int) -> Columns:
    file = None
    if isinstance(value, Mapping):
        known_keys(path, where, value, ("file", "columns"))
        file = text_at(path, f"{where}.file", value["file"]) if "file" in value else None
        value = value.get("columns")
    if not isinstance(value, list) or len(value) != count:
        raise InputError(f"{path}: {where} is {value!r}: expected a list of {count} columns, by name or number")
    columns = tuple(_column(path, where, one) for one in value)
    if len(set(columns)) < count:
        raise InputError(f"{path}: {where} is {value!r}: expected {count} columns, each named once")
    return Columns(columns, file)
