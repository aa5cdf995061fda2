"""First guess of a column map: from the names of files and columns, ``LF_acc_x``, ``Acc X [g]``, ``qw``, and numbers.

A column may name its axis alone, ``x-axis (g)``: then its unit gives the quantity, or the name of its file does.
"""

import os.path
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import structs

from vip_factors.errors import FileFormatError
from vip_factors.io.importers.column_map import QUANTITIES, TIME_UNITS, UNIT_KEYS, ColumnMap, Columns, SensorColumns
from vip_factors.io.importers.shared import candidates, default_sites
from vip_factors.io.importers.table import Samples, read_samples
from vip_factors.io.importers.text_table import (
    COMPONENTS,
    SUFFIXES,
    NoTableError,
    TextTable,
    number,
    read_text_table,
    split,
)
from vip_factors.io.importers.units import (
    first_numbers,
    guess_clock,
    name_of_rate_unit,
    time_unit,
    with_units,
)

MOST_SENSORS = 64  # of different words in a column that is to name sensors
IGNORED = "ignored"  # quantity of what is measured, but not read
_WORDS = {
    "acceleration": r"(?:total)?(?:acc|accel|acceleration|accelerometer)|specificforce",
    "angular_rate": r"gyr|gyro|gyros|gyroscope|angvel|angularvelocity|angularrate|rotationrate|omega|turnrate",
    "quaternion": r"quat|quaternion|orientation|orient|ori|rot",
    IGNORED: r"mag|magn|magnet|magnetometer|(?:free|lin|linear|user|earth|highg)acc\w*|grav|gravity|uncal|uncalibrated|"
    r"euler|roll|pitch|yaw|temp|temperature|baro|pressure",
}
_LETTERS = {"a": "acceleration", "g": "angular_rate", "w": "angular_rate", "q": "quaternion", "m": IGNORED}
_UNITS = re.compile(r"axis|m?g|ms2|mps2|dps|degs?|rads?|radps|[mu]?s|ut|si|raw|cal", re.IGNORECASE)
_UNITS_OF = {
    "acceleration": r"m?g|m */ *s(\^?2|²|\*\*2|/s)|m *s\^?-2",
    "angular_rate": r"(deg|degrees?|°|rad|radians?) */ *s(ec)?|dps|rps|rad *s\^?-1",
    IGNORED: r"[munµμ]?t(esla)?|m?gauss|pa|hpa|lx|°?c|deg",
}
_COMPOUNDS = re.compile(
    r"\b(angular|specific|linear|free|user|earth|total|high g|turn|rotation) +(velocity|rate|force|acc\w*)\b",
    re.IGNORECASE,
)
# In files' names: content in other words, when, at which rate, and of which version of a program.
_PLAIN = re.compile(r"inertial|imu|motion|sensors?|data", re.IGNORECASE)
_EDITION = re.compile(
    r"(?<![A-Za-z0-9])(\d{4}-?\d\d-?\d\d[T_ -]?\d\d[.:_-]?\d\d([.:_-]?\d\d)?([.:_-]\d+)?|\d+(\.\d+)?hz|v?\d+(\.\d+)+)"
    r"(?![A-Za-z0-9])",
    re.IGNORECASE,
)
_BRACKETS = r"[\[(]\s*([^\])]{2,}|g)\s*[\])]"


def meaning(name: str, unit: str = "", of_file: str = "") -> tuple[str, str, str] | None:
    """Parse a column's name into sensor, quantity and axis; None if it is none of ours.

    Args:
        name: the column's, with its unit in brackets or without.
        unit: as a line below the names has it.
        of_file: quantity that the file's name gives, for columns that name an axis alone.
    """
    words = _words(re.sub(_BRACKETS, " ", name))
    axes = [word for word in words if word.lower() != "axis"]
    if len(axes) == 1 and re.fullmatch(r"(?i)[wxyz]", axes[0]):
        unit = next(iter(re.findall(_BRACKETS, name)), unit).strip()
        of_unit = (key for key, units in _UNITS_OF.items() if re.fullmatch(units, unit, re.IGNORECASE))
        quantity = of_file if of_file == IGNORED else next(of_unit, of_file)
        return None if quantity in ("", IGNORED) else ("", quantity, axes[0].lower())
    quantity, axis, sensor = "", "", []
    for word in words:
        kind, letter = _word(word)
        if kind and not quantity:
            quantity, axis = kind, letter or axis
        elif quantity and not axis and re.fullmatch(r"(?i)q?[wxyzs0-4]", word):
            axis = word[-1].lower()
        elif quantity == "quaternion" and kind == "quaternion" and letter:
            axis = letter
        elif not (_UNITS.fullmatch(word) and (quantity or axis)):
            sensor.append(word)
    if quantity in ("", IGNORED) or not axis:
        return None
    return "_".join(sensor), quantity, "w" if axis == "s" else axis


def meaning_of_file(stem: str) -> tuple[str, str]:
    """Parse a file's name into its quantity, blank if none, and the words for its sensor and recording."""
    words = _words(_EDITION.sub(" ", stem))
    kinds = {word: kind for word in words if (kind := _word(word)[0]) and not _word(word)[1]}
    quantity = IGNORED if IGNORED in kinds.values() else next(iter(kinds.values()), "")
    return quantity, "_".join(word for word in words if word not in kinds and not _PLAIN.fullmatch(word))


def _complete(axes: Mapping[str, str], count: int) -> tuple[str, ...] | None:
    """The columns of all axes in order, by letters, or by numbers from 0 or 1 on."""
    for keys in (COMPONENTS[count], "0123"[:count], "1234"[:count]):
        if all(key in axes for key in keys):
            return tuple(axes[key] for key in keys)
    return None


def _words(name: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    spaced = re.sub(r"[^A-Za-z0-9]+", " ", spaced)
    return _COMPOUNDS.sub(lambda match: match[0].replace(" ", ""), spaced).split()


def _word(word: str) -> tuple[str, str]:
    """The quantity that a word names, and the axis if it ends in one: ``accX``, ``gz``, ``q0``."""
    lower = word.lower()
    for quantity, names in _WORDS.items():
        if match := re.fullmatch(rf"(?:{names})s?([wxyz0-4]?)", lower):
            return quantity, match[1]
    match = re.fullmatch(r"([agwqm])([wxyz0-4])", lower)
    return (_LETTERS[match[1]], match[2]) if match else ("", "")


class Guess(NamedTuple):
    """Columns of a sensor, and the reasons for them, a phrase each."""

    entry: SensorColumns
    reasons: list[str]


def guess(path: Path, rate_hz: float | None = None) -> tuple[ColumnMap, Mapping[str, list[str]], list[str]]:
    """Guess a column map for the tables at a path, with reasons by sensor, and the sensors' names.

    A folder may hold a folder for each sensor, and a sensor a file for each quantity.

    Raises:
        FileFormatError: if no column's name gives a quantity, a table holds one sample, or rows and times are not in
            order.
    """
    files = candidates(path, SUFFIXES)
    if not files and path.is_dir():
        files = [file for folder in sorted(path.iterdir()) if folder.is_dir() for file in candidates(folder, SUFFIXES)]
    guesses: dict[Path, dict[str, Guess]] = {}
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
        if sensors := guess_columns(table, rate_hz):
            guesses[file] = sensors
            if len(table) == 1:
                raise FileFormatError(f"{file}: one sample: expected at least two")
    if not guesses:
        raise FileFormatError(
            f"{path}: no column's name tells acceleration, angular rate or orientation "
            f"({(obstacles or ['no table of numbers there'])[0]}): expected names such as pelvis_acc_x, pelvis_gyr_x, "
            "pelvis_quat_w; write the column map by hand"
        )
    if len(files) == 1 and "" in guesses[files[0]]:
        table, (common, reasons) = tables[files[0]], guesses[files[0]][""]
        column = _sensor_column(table, common.time)
        if column is not None:
            columns = ColumnMap(str(path), common, sensor_column=table.names[column])
            _read_rows(path, columns, tables)
            return columns, {"": reasons}, sorted(set(table.texts(column)))
    files_of, sensors = _sensors(path, guesses, is_named=len(files) > 1 or not path.is_file())
    columns = ColumnMap(str(path), sensors={name: sensor.entry for name, sensor in sensors.items()})
    samples = _read_rows(path, columns, tables)
    for name, files in files_of.items():  # units as the quantities of several files suggest together
        (entry, reasons), (_, time, values) = sensors[name], samples[name]
        rate = entry.angular_rate
        of_rate = (tables[file] for file in files if rate and rate.file and file.match(rate.file))
        unit = next((name_of_rate_unit(table, rate) for table in of_rate), "")
        entry, unit_reasons = with_units(entry, unit, time, values)
        sensors[name] = Guess(entry, [*unit_reasons, *(reason for reason in reasons if reason.startswith("time: "))])
    entries = {**columns.sensors, **_agreeing({name: sensors[name].entry for name in files_of})}
    return replace(columns, sensors=entries), {name: s.reasons for name, s in sensors.items()}, list(sensors)


def _sensors(
    path: Path, guesses: Mapping[Path, Mapping[str, Guess]], is_named: bool
) -> tuple[dict[str, list[Path]], dict[str, Guess]]:
    """The files of the sensors that have several, and the guesses for all sensors, by the sensors' names.

    Files belong together if their names differ in words for quantities only, and hold a quantity each.
    """
    root = path if path.is_dir() else path.parent
    groups: dict[tuple[Path, str, str], dict[Path, Guess]] = {}
    for file, sensors_of_table in guesses.items():
        for sensor, columns in sensors_of_table.items():
            groups.setdefault((file.parent, meaning_of_file(file.stem)[1], sensor), {})[file] = columns
    labelled: list[tuple[str, str, list[Path], Guess]] = []
    for (folder, words, sensor), members in groups.items():
        parts = [folder.name] if folder != root else []
        if len(members) > 1 and (joined := _joined_files(members, root)) is not None:
            label = "_".join([*parts, *([words] if words else [])]) or folder.name
            labelled.append((label, sensor, list(members), joined))
            continue
        for file, (entry, reasons) in members.items():
            file_name = file.relative_to(root).as_posix() if is_named else None
            labelled.append(
                ("_".join([*parts, file.stem]), sensor, [file], Guess(structs.replace(entry, file=file_name), reasons))
            )
    labels = _shortened([label for label, *_ in labelled])
    files_of, sensors = {}, {}
    for label, (_, sensor, files, columns) in zip(labels, labelled, strict=True):
        name = sensor if sensor and len(guesses) == 1 else "_".join(part for part in (label, sensor) if part)
        if labels.count(label) == 1 and not default_sites([name]) and default_sites([label]):
            name = label  # the sensor's own name is a device's
        sensors[name] = columns
        if len(files) > 1:
            files_of[name] = files
    return files_of, sensors


def _joined_files(members: Mapping[Path, Guess], root: Path) -> Guess | None:
    """One sensor of files with a quantity each; of two accelerations the total one. None if they do not fit."""
    located: dict[str, Any] = {}
    for file, (entry, _) in sorted(members.items(), key=lambda item: "total" in item[0].stem.lower()):
        for quantity in QUANTITIES:
            columns: Columns | None = getattr(entry, quantity)
            if columns is None:
                continue
            if quantity in located and not (quantity == "acceleration" and "total" in file.stem.lower()):
                return None
            located[quantity] = structs.replace(columns, file=file.relative_to(root).as_posix())
    entry, reasons = next(iter(members.values()))
    has_one_clock = len({member.entry.time for member in members.values()}) == 1
    return Guess(structs.replace(entry, **located), reasons) if has_one_clock else None


def _shortened(labels: list[str]) -> list[str]:
    """Labels without addresses and what all begin with, the recording's name; but with the sides of a body."""
    plain = [re.sub(r"_(?=[A-F]*\d)[0-9A-F]{12}\b", "", label) for label in labels]
    labels = plain if len(set(plain)) == len(set(labels)) else labels
    start = os.path.commonprefix(labels) if len(set(labels)) > 1 else ""  # noqa: RUF071
    bare = [label[len(re.sub(r"[^-_ .]*$", "", start)) :] for label in labels]
    return bare if len(default_sites(bare)) >= len(default_sites(labels)) else labels


def _read_rows(path: Path, columns: ColumnMap, tables: dict[Path, TextTable]) -> dict[str, Samples]:
    """Read all rows as a conversion does, for its sentences on rows and times; at any rate where none is known."""

    def timed(entry: SensorColumns) -> SensorColumns:
        return structs.replace(entry, rate_hz=None if entry.time else entry.rate_hz or 100.0)

    sensors = {name: timed(entry) for name, entry in columns.sensors.items()}
    return read_samples(path, replace(columns, sensors=sensors, common=timed(columns.common)), tables, [])


def _sensor_column(table: TextTable, time: str | int | None) -> int | None:
    """The first column of a few different words, each in many rows, that is not the one of times."""
    for column, cell in enumerate(split(table.rows[0], table.separator)[: len(table.names)]):
        is_text = number(cell) is None and table.names[column] != time
        if is_text and 1 < len(set(table.texts(column))) <= min(MOST_SENSORS, len(table) / 2):
            return column
    return None


def guess_columns(table: TextTable, rate_hz: float | None = None) -> dict[str, Guess]:
    """Guess the sensors by name, whose acceleration, angular rate or quaternion the names of the columns give.

    Each has the units that the numbers suggest. The name is blank if the columns name no sensor.
    """
    named: dict[str, dict[str, dict[str, str]]] = {}
    of_file, _ = meaning_of_file(table.path.stem)
    for name, unit in zip(table.names, table.units or [""] * len(table.names), strict=True):
        parsed = meaning(name, unit, of_file)
        if parsed is not None and table.names.count(name) == 1:
            sensor, quantity, axis = parsed
            named.setdefault(sensor, {}).setdefault(quantity, {}).setdefault(axis, name)
    if not named and all(axis in table.names for axis in COMPONENTS[4]) and of_file != IGNORED:
        # Four columns w, x, y, z and no other words.
        named = {"": {"quaternion": {axis: axis for axis in COMPONENTS[4]}}}
    clock, rates = guess_clock(table)
    if rate_hz is not None:
        clock = structs.replace(clock, time=None, rate_hz=rate_hz)
    stamps = None if clock.time is None else first_numbers(table, (clock.time,))
    stamps = None if stamps is None else stamps[:, 0]
    sensors, reasons = {}, {}
    for sensor, quantities in _joined(named).items():
        columns = {quantity: _complete(axes, QUANTITIES[quantity]) for quantity, axes in quantities.items()}
        located: dict[str, Any] = {quantity: Columns(names) for quantity, names in columns.items() if names is not None}
        if not located:
            continue
        entry, time, time_reasons = structs.replace(clock, **located), None, []
        values = {quantity: first_numbers(table, place.columns) for quantity, place in located.items()}
        rate_unit = name_of_rate_unit(table, entry.angular_rate)
        if clock.time is not None:
            unit, reason = time_unit(rates, rate_unit, stamps, values)
            entry, time_reasons = structs.replace(entry, time_unit=unit), [f"time: {reason}"]
            time = None if stamps is None else TIME_UNITS[unit] * stamps
        sensors[sensor], unit_reasons = with_units(entry, rate_unit, time, values)
        reasons[sensor] = unit_reasons + time_reasons
    return {name: Guess(entry, reasons[name]) for name, entry in _agreeing(sensors).items()}


def _joined(named: Mapping[str, Mapping[str, Mapping[str, str]]]) -> dict[str, dict[str, Mapping[str, str]]]:
    """Sensors by name, acceleration alone joined with angular rate of fewer words: ``S1_LN_acc_x``, ``S1_gyr_x``."""
    joined = {name: dict(quantities) for name, quantities in named.items()}
    for name in sorted(joined, key=len):
        words = set(name.split("_"))
        fits = [other for other in joined if {*other.split("_")} - {""} < words and "angular_rate" in joined[other]]
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
