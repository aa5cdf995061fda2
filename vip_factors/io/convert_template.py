"""First guesses for somebody to correct: what a log's columns mean, and where its sensors sit.

Names of columns tell sensor, quantity and axis (``LF_acc_x``, ``Acc X [g]``, ``pelvis.gyro.z``, ``ax``, ``qw``).
Numbers tell the units: gravity's length, how fast the vertical turns against the gyroscope, how far apart the times
are; with both acceleration and quaternion also the quaternion's order, sense and upward axis.
"""

import os.path
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs

from vip_factors.atomic import atomic_open, check_target
from vip_factors.display import one_line
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.convert import detect_format, read_log
from vip_factors.io.convert_template_clock import USED_ROWS, decide_unit, guess_clock
from vip_factors.io.importers.column_map import (
    ACCELERATION_UNITS,
    ANGULAR_RATE_UNITS,
    QUANTITIES,
    TIME_UNITS,
    ColumnMap,
    Columns,
    SensorColumns,
)
from vip_factors.io.importers.shared import candidates, default_sites, likely_sites
from vip_factors.io.importers.table import GRAVITY_RANGE, TURNED_OVER, best_reading, read_samples
from vip_factors.io.importers.text_table import SUFFIXES, NoTableError, TextTable, number, read_text_table, split
from vip_factors.io.typed_files import toml_text
from vip_factors.sensors.calibration import SITES, site_axes

MOST_SENSORS = 64  # of different words in a column that is to name sensors
_WORDS = {
    "acceleration": r"acc|accel|acceleration|accelerometer|specificforce",
    "angular_rate": r"gyr|gyro|gyros|gyroscope|angvel|angularvelocity|angularrate|omega|turnrate",
    "quaternion": r"quat|quaternion|orientation|orient|ori|rot",
    "ignored": r"mag|magn|magnet|magnetometer|freeacc|linacc|euler|roll|pitch|yaw|temp|temperature|baro|pressure",
}
# What a map says of each quantity, and the choices there are.
UNIT_KEYS = {
    "acceleration": {"acceleration_unit": "m/s2, g or mg; gravity included"},
    "angular_rate": {"angular_rate_unit": "rad/s or deg/s"},
    "quaternion": {
        "quaternion_order": "wxyz or xyzw: of the columns as they are listed",
        "quaternion_sense": "sensor_to_world or world_to_sensor",
        "world_up": "z, y or -z: the axis of the quaternions' world that points up",
    },
}
_LETTERS = {"a": "acceleration", "g": "angular_rate", "w": "angular_rate", "q": "quaternion", "m": "ignored"}
_UNITS = {
    "g",
    "mg",
    "ms2",
    "mps2",
    "dps",
    "degs",
    "rads",
    "radps",
    "deg",
    "rad",
    "s",
    "ms",
    "us",
    "ut",
    "si",
    "raw",
    "cal",
}
_AXES = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}
DEGREES_SLOPE = 0.13  # between 1 and π/180, in the geometric middle
SLOWEST_TOLD = 0.004  # a slope below it is that of a sensor that hardly moved
TURN_S = 0.25  # of a turn of the vertical: long against impacts, short against strides
FASTEST_BODY = 20.0  # rad/s: feet and hands of people who walk stay below; larger numbers are degrees


class Templates(NamedTuple):
    """Paths of what was written.

    Attributes:
        placement: where the sensors sit.
        columns: what the columns mean; None for a log whose format is known.
    """

    placement: Path
    columns: Path | None = None


def write_templates(path: str | Path, name: Path, overwrite: bool = False, rate_hz: float | None = None) -> Templates:
    """Write ``NAME_placement.toml`` and, unless the log's format says it all, ``NAME_columns.toml``.

    Args:
        path: the log: a file, a folder, or how the names of its files begin.
        name: what the names of the files begin with; a suffix ``.toml`` is dropped.
        overwrite: whether existing files may be replaced.
        rate_hz: samples per second, if the log has no times, or wrong ones.

    Raises:
        InputError: if nothing is at the path, it is a recording of ours, or a file exists.
        FileFormatError: if neither is its format known nor do the names of its columns tell anything.
    """
    path = Path(path)
    stem = name.with_suffix("") if name.suffix.lower() == ".toml" else name
    placement_file, columns_file = (stem.with_name(f"{stem.name}_{what}.toml") for what in ("placement", "columns"))
    for file in (placement_file, columns_file):
        check_target(file, overwrite)
    try:
        known_format = detect_format(path)
    except FileFormatError:
        known_format = ""
    if known_format == "recording":
        raise InputError(f"{path} is a recording of this package already: it needs neither columns nor places")
    if known_format:
        sensors, files = list(read_log(path, known_format, rate_hz=rate_hz).imus), Templates(placement_file)
    else:
        columns, reasons, sensors = guess(path, rate_hz)
        files = Templates(placement_file, columns_file)
        with atomic_open(columns_file, "w", overwrite) as stream:
            stream.write(columns_text(path, columns, reasons))
    with atomic_open(files.placement, "w", overwrite) as stream:
        stream.write(placement_text(path, sensors, files))
    return files


def guess(path: Path, rate_hz: float | None = None) -> tuple[ColumnMap, Mapping[str, list[str]], list[str]]:
    """A column map for the tables at a path, by sensor what it was guessed from, and the sensors' names.

    Raises:
        FileFormatError: if the names of the columns tell nothing, or rows and times are not in order.
    """
    files = candidates(path, SUFFIXES)
    guessed: dict[Path, dict[str, tuple[SensorColumns, list[str]]]] = {}
    obstacles: list[str] = []
    tables: dict[Path, TextTable] = {}
    for file in files:
        try:
            table = read_text_table(file)
        except NoTableError as error:
            obstacles.append(str(error))
            continue
        obstacles.insert(0, f"{file.name}: {', '.join(table.names[:12])}")
        tables[file] = table
        sensors_of_table = guess_columns(table, rate_hz)
        if (
            "" in sensors_of_table
            and len(files) == 1
            and (at := _sensor_column(table, sensors_of_table[""][0].time)) is not None
        ):
            common, why = sensors_of_table[""]
            columns = ColumnMap(str(path), common, sensor_column=table.names[at])
            _check_rows(path, columns, tables)
            return columns, {"": why}, sorted(set(table.texts(at)))
        if sensors_of_table:
            guessed[file] = sensors_of_table
    if not guessed:
        raise FileFormatError(
            f"{path}: no column's name tells acceleration, angular rate or orientation "
            f"({(obstacles or ['no table of numbers there'])[0]}): expected names such as pelvis_acc_x, pelvis_gyr_x, "
            "pelvis_quat_w; write the column map by hand"
        )
    sensors, reasons = {}, {}
    # What the files' names have in common, up to a separator, is the recording's name.
    start = os.path.commonprefix([file.stem for file in guessed]) if len(guessed) > 1 else ""  # noqa: RUF071
    shared = len(re.sub(r"[^-_ .]*$", "", start))
    for file, sensors_of_table in guessed.items():
        for sensor, (entry, why) in sensors_of_table.items():
            file_name = file.name if len(files) > 1 or not path.is_file() else None
            several = "_".join(part for part in (file.stem[shared:], sensor) if part)
            name = sensor if sensor and len(guessed) == 1 else several
            if len(sensors_of_table) == 1 and not default_sites([name]) and default_sites([file.stem[shared:]]):
                name = file.stem[shared:]  # the sensor's own name is a device's
            sensors[name], reasons[name] = structs.replace(entry, file=file_name), why
    columns = ColumnMap(str(path), sensors=sensors)
    _check_rows(path, columns, tables)
    return columns, reasons, list(sensors)


def _check_rows(path: Path, columns: ColumnMap, tables: dict[Path, TextTable]) -> None:
    """Read all rows as a conversion does, for its sentences on rows and times; at any rate where none is known."""
    sensors = {
        name: structs.replace(entry, rate_hz=None if entry.time else entry.rate_hz or 100.0)
        for name, entry in (columns.sensors or {"": columns.common}).items()
    }
    checked = replace(columns, sensors=sensors if columns.sensors else {}, common=sensors.get("", columns.common))
    read_samples(path, checked, tables, [])


def _sensor_column(table: TextTable, time: str | int | None) -> int | None:
    """The first column of a few different words, each in many rows, that is not the one of times."""
    cells = split(table.rows[0], table.separator)
    for at in range(len(table.names)):
        is_text = number(cells[at]) is None and table.names[at] != time
        if is_text and 1 < len(set(table.texts(at))) <= min(MOST_SENSORS, len(table) / 2):
            return at
    return None


def columns_text(path: Path, columns: ColumnMap, reasons: Mapping[str, list[str]]) -> str:
    """A column map as TOML, what all sensors share above them."""
    entries = dict(columns.sensors) or {"": columns.common}
    first = next(iter(entries.values()))
    one_clock = len({tuple(_time_lines(entry)) for entry in entries.values()}) == 1
    lines = [
        f"# What the columns of {one_line(str(path))} mean: a first guess from their names and numbers. Please check "
        "every line.",
        "",
        *(_time_lines(first) if one_clock else ()),
    ]
    for quantity, keys in UNIT_KEYS.items():
        if any(getattr(entry, quantity) is not None for entry in entries.values()):
            lines += [f"{key} = {toml_text(getattr(first, key))}  # {choices}" for key, choices in keys.items()]
    if columns.sensor_column is not None:
        lines.append(f"sensor_column = {toml_text(columns.sensor_column)}  # names the sensor of each row")
    for name, entry in entries.items():
        lines += ["", *(f"# {one_line(reason)}" for reason in reasons.get(name, ()))]
        if name:
            lines.append(f"[sensors.{toml_text(name)}]")
        if entry.file is not None:
            lines.append(f"file = {toml_text(entry.file)}")
        lines += () if one_clock else _time_lines(entry)
        for quantity in QUANTITIES:
            at: Columns | None = getattr(entry, quantity)
            if at is not None:
                listed = toml_text(at.columns)
                where = listed if at.file is None else f"{{ file = {toml_text(at.file)}, columns = {listed} }}"
                lines.append(f"{quantity} = {where}")
    return "\n".join(lines) + "\n"


def _time_lines(entry: SensorColumns) -> list[str]:
    lines = (
        [] if entry.counter is None else [f"counter = {toml_text(entry.counter)}  # counts packets: lost ones are gaps"]
    )
    if entry.time is not None:
        return [
            *lines,
            f"time = {toml_text(entry.time)}",
            f'time_unit = "{entry.time_unit}"  # {", ".join(TIME_UNITS)}',
        ]
    if entry.rate_hz is not None:
        return [*lines, f"rate_hz = {entry.rate_hz:g}  # as stated"]
    return [*lines, "# No column looks like the times. Name it, or say how many samples a second there are:",
            "# time = \"…\"", "# rate_hz = 100"]  # fmt: skip


def placement_text(path: Path, sensors: list[str], files: Templates) -> str:
    """A placement file with the sites that the sensors' names suggest, and all sites explained."""
    command = f"vip-factors convert {one_line(str(path))} RECORDING.mcap"
    command += f" --columns {one_line(str(files.columns))}" if files.columns is not None else ""
    sites = likely_sites(sensors)
    width = max((len(toml_text(name)) for name in sensors), default=0)
    lines = [
        f"# Where the sensors of {one_line(str(path))} sat: a first guess from their names. Please check every line, "
        "then:",
        f"# {command} --placement {one_line(str(files.placement))}",
        "",
        "# Of the wearer; remove the # of what you know. Stature tells most of the body.",
        '# subject = "S01"',
        "# stature_m = 1.75",
        "# mass_kg = 70",
        '# sex = "female"',
        '# initial_pose = "n-pose"  # held at the first moment: n-pose (arms hanging) or t-pose (arms sideways)',
        "",
        "[sensors]",
    ]
    for name in sensors:
        key = toml_text(name).ljust(width)
        site = sites.get(name)
        lines.append(f"{key} = {toml_text(site)}  # {site_axes(site)}" if site else f'# {key} = "…"  # not told')
    lines += [
        "",
        "# A sensor's axes are taken as the site's, within 40° or so; quarter turns are found from the motion, and",
        "# standing still at first or a declared pose tells the rest. Left, right, up, down, front and back are the",
        "# wearer's in a T-pose (arms sideways, palms down). If you know the sensor's axes well, give the rotation:",
        '#   "…" = { site = "left_thigh", mounting_wxyz = [1, 0, 0, 0], sigma_deg = 15 }',
        "# Sites:",
        *(f"#   {name.ljust(max(map(len, SITES)))}  {site_axes(name)}" for name in SITES),
        "",
    ]
    return "\n".join(lines)


def guess_columns(table: TextTable, rate_hz: float | None = None) -> dict[str, tuple[SensorColumns, list[str]]]:
    """The sensors whose acceleration, angular rate or quaternion the names of the columns tell, by name.

    Each with the units that the numbers suggest, and what each guess was made from, a phrase each. The name is blank if
    the columns name no sensor.
    """
    named: dict[str, dict[str, dict[str, str]]] = {}
    for name in table.names:
        told = meaning(name)
        if told is not None and table.names.count(name) == 1:
            sensor, quantity, axis = told
            named.setdefault(sensor, {}).setdefault(quantity, {}).setdefault(axis, name)
    if not named and all(axis in table.names for axis in _AXES[4]):
        named = {"": {"quaternion": {axis: axis for axis in _AXES[4]}}}  # four columns w, x, y, z and no other words
    clock, rates = guess_clock(table)
    if rate_hz is not None:
        clock = structs.replace(clock, time=None, rate_hz=rate_hz)
    sensors, reasons = {}, {}
    for sensor, quantities in _joined(named).items():
        columns = {quantity: _complete(axes, QUANTITIES[quantity]) for quantity, axes in quantities.items()}
        whole: dict[str, Any] = {quantity: Columns(names) for quantity, names in columns.items() if names is not None}
        if whole:
            entry = structs.replace(clock, **whole)
            time_reasons = []
            if clock.time is not None:
                unit, reason = _time_unit(table, entry, rates)
                entry, time_reasons = structs.replace(entry, time_unit=unit), [f"time: {reason}"]
            sensors[sensor], reasons[sensor] = with_units(table, entry)
            reasons[sensor] += time_reasons
    return {name: (entry, reasons[name]) for name, entry in _agreeing(sensors).items()}


def _joined(named: Mapping[str, Mapping[str, Mapping[str, str]]]) -> dict[str, dict[str, Mapping[str, str]]]:
    """Sensors by name, acceleration alone joined with angular rate of fewer words: ``S1_LN_acc_x``, ``S1_gyr_x``."""
    joined = {name: dict(quantities) for name, quantities in named.items()}
    for name in sorted(joined, key=len):
        words = set(name.split("_"))
        fits = [each for each in joined if {*each.split("_")} - {""} < words and "angular_rate" in joined[each]]
        if set(joined[name]) == {"acceleration"} and len(fits) == 1:
            joined[fits[0]].setdefault("acceleration", joined.pop(name)["acceleration"])
    return joined


def _agreeing(sensors: Mapping[str, SensorColumns]) -> dict[str, SensorColumns]:
    """The sensors with the units of most of them: one logger writes one unit."""
    agreed: dict[str, Any] = {}
    for quantity, keys in UNIT_KEYS.items():
        entries = [entry for entry in sensors.values() if getattr(entry, quantity) is not None]
        votes = Counter(tuple(getattr(entry, key) for key in keys) for entry in entries)
        agreed |= dict(zip(keys, votes.most_common(1)[0][0], strict=True)) if votes else {}
    return {name: structs.replace(entry, **agreed) for name, entry in sensors.items()}


def meaning(name: str) -> tuple[str, str, str] | None:
    """Sensor, quantity and axis that the name of a column tells, None if it is none of ours."""
    bare = re.sub(r"[\[(]\s*([^\])]{2,}|g)\s*[\])]", " ", name)  # units in brackets
    bare = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", bare)
    bare = re.sub(r"(?i)\b(angular|specific|linear|free|turn)[ _.-]+(velocity|rate|force|acc\w*)\b", r"\1\2", bare)
    words = [word for word in re.split(r"[^A-Za-z0-9]+", bare) if word]
    quantity, axis, rest = "", "", []
    for word in words:
        kind, letter = _word(word)
        if kind and not quantity:
            quantity, axis = kind, letter or axis
        elif quantity and not axis and re.fullmatch(r"(?i)q?[wxyzs0-4]", word):
            axis = word[-1].lower()
        elif quantity == "quaternion" and kind == "quaternion" and letter:
            axis = letter
        elif not (word.lower() in _UNITS and (quantity or axis)):
            rest.append(word)
    if quantity not in QUANTITIES or not axis:
        return None
    return "_".join(rest), quantity, "w" if axis == "s" else axis


def _word(word: str) -> tuple[str, str]:
    """The quantity that a word names, and the axis if it ends in one: ``accX``, ``gz``, ``q0``."""
    lower = word.lower()
    for quantity, names in _WORDS.items():
        if match := re.fullmatch(rf"({names})s?([wxyz0-4]?)", lower):
            return quantity, match[2]
    match = re.fullmatch(r"([agwqm])([wxyz0-4])", lower)
    return (_LETTERS[match[1]], match[2]) if match else ("", "")


def _complete(axes: Mapping[str, str], count: int) -> tuple[str, ...] | None:
    """The columns of all axes in order, by letters, or by numbers from 0 or 1 on."""
    for keys in (_AXES[count], "0123"[:count], "1234"[:count]):
        if all(key in axes for key in keys):
            return tuple(axes[key] for key in keys)
    return None


def _numbers(table: TextTable, names: Sequence[str | int]) -> Array | None:
    short = replace(table, rows=table.rows[:USED_ROWS], lines=table.lines[:USED_ROWS])
    try:
        return short.numbers([short.index(name, "guess") for name in names])
    except FileFormatError:
        return None


def with_units(table: TextTable, entry: SensorColumns) -> tuple[SensorColumns, list[str]]:
    """The entry with the units that its numbers suggest, and what they were guessed from."""
    force, rate, quaternion = (
        None if at is None else _numbers(table, at.columns)
        for at in (entry.acceleration, entry.angular_rate, entry.quaternion)
    )
    reasons = []
    if force is not None:
        usual = _usual_length(force)
        low, high = GRAVITY_RANGE
        unit = next((name for name, factor in ACCELERATION_UNITS.items() if low <= usual * factor <= high), None)
        told = f"acceleration: {usual:.4g} long on the median"
        reasons.append(f"{told}, so {unit}" if unit else f"{told}: NEITHER m/s2, g NOR mg WITH GRAVITY, please look")
        entry = structs.replace(entry, acceleration_unit=unit or "m/s2")
    if rate is not None and entry.angular_rate is not None:
        unit, reason = _rate_unit(table, entry, force, rate)
        reasons.append(f"angular rate: {reason}, so {unit}")
        entry = structs.replace(entry, angular_rate_unit=unit)
    if quaternion is not None:
        reasons.append(f"quaternion: {_usual_length(quaternion):.3g} long on the median")
        if force is not None:
            (order, sense, up), off = best_reading(quaternion, force)
            reasons.append(f"as {order}, {sense}, {up} up the acceleration stands {off:.0f}° off the vertical")
            reasons += [TURNED_OVER] if up == "-z" else []
            entry = structs.replace(entry, quaternion_order=order, quaternion_sense=sense, world_up=up)
    return entry, reasons


def _usual_length(values: Array) -> float:
    return float(np.nan_to_num(np.nanmedian(np.linalg.norm(values, axis=1)))) if len(values) else 0.0


def _time_unit(table: TextTable, entry: SensorColumns, rates: dict[str, float]) -> tuple[str, str]:
    """The unit of times as the sensor's motion has it, and from what it was told."""
    force, rate = (
        None if at is None else _numbers(table, at.columns) for at in (entry.acceleration, entry.angular_rate)
    )
    time = _numbers(table, [entry.time or ""])
    if force is None or rate is None or time is None or entry.angular_rate is None:
        return decide_unit(rates, lambda unit: None, (1.0,))
    named = _named_rate_unit(table, entry.angular_rate)
    slopes = tuple(value for name, value in ANGULAR_RATE_UNITS.items() if named in (name, ""))
    return decide_unit(rates, lambda unit: _turning(time[:, 0], force, rate, unit), slopes)


def _named_rate_unit(table: TextTable, at: Columns) -> str:
    """The unit of angular rates that names, or a line of units below them, say; blank if they do not."""
    units = [table.units[table.index(name, "guess")] for name in at.columns] if table.units else []
    words = " ".join(map(str, (*at.columns, *units))).lower()
    return "deg/s" if re.search(r"deg|dps|°", words) else "rad/s" if "rad" in words else ""


def _rate_unit(table: TextTable, entry: SensorColumns, force: Array | None, rate: Array) -> tuple[str, str]:
    """The unit of angular rate, and from what it was told."""
    assert entry.angular_rate is not None
    if unit := _named_rate_unit(table, entry.angular_rate):
        return unit, f"the names or units of its columns say {unit}"
    time = None if entry.time is None else _numbers(table, [entry.time])
    slope = None if time is None or force is None else _turning(time[:, 0], force, rate, entry.time_unit)
    if slope is not None and abs(slope) > SLOWEST_TOLD:
        return ("deg/s" if abs(slope) < DEGREES_SLOPE else "rad/s"), (
            f"read as rad/s it turns {1 / abs(slope):.2g} times as fast as gravity's direction does"
        )
    fastest = float(np.nanquantile(np.abs(rate), 0.99))
    return ("deg/s" if fastest > FASTEST_BODY else "rad/s"), f"rarely above {fastest:.3g}"


def _turning(time: Array, force: Array, rate: Array, unit: str) -> float | None:
    """How fast the direction of specific force turns, by what the rates say: 1 if they are radians per second.

    A vector that stands still in the world turns by −ω × u in the sensor; limbs' accelerations add noise to the left
    side of that regression only.
    """
    known = np.all(np.isfinite(np.column_stack([time, force, rate])), axis=1)
    time, force, rate = TIME_UNITS[unit] * time[known], force[known], rate[known]
    if len(time) < 3:
        return None
    step = np.diff(time)
    direction = force / np.linalg.norm(force, axis=1, keepdims=True).clip(1e-9)
    turning = -np.cross((rate[1:] + rate[:-1]) / 2, (direction[1:] + direction[:-1]) / 2) * step[:, None]
    some = max(1, round(TURN_S / max(float(np.median(step)), 1e-6)))
    predicted = np.diff(np.cumsum(turning, axis=0)[::some], axis=0)
    turned = np.diff(direction[1::some], axis=0)
    energy = float(np.sum(predicted**2))
    return float(np.sum(predicted * turned)) / energy if energy > 0 else None
