"""First guess of what the columns of tables mean: from the names of files and columns, and from numbers."""

import os.path
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import structs

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array
from vip_factors.io.column_names import AXES, IGNORED, complete, meaning, meaning_of_file
from vip_factors.io.convert_template_clock import USED_ROWS, guess_clock
from vip_factors.io.convert_template_units import UNIT_KEYS, name_of_rate_unit, time_unit, with_units
from vip_factors.io.importers.column_map import QUANTITIES, TIME_UNITS, ColumnMap, Columns, SensorColumns
from vip_factors.io.importers.shared import candidates, default_sites
from vip_factors.io.importers.table import Samples, read_samples
from vip_factors.io.importers.text_table import SUFFIXES, NoTableError, TextTable, number, read_text_table, split

MOST_SENSORS = 64  # of different words in a column that is to name sensors


class Guess(NamedTuple):
    """Columns of a sensor, and what they were guessed from, a phrase each."""

    entry: SensorColumns
    reasons: list[str]


def guess(path: Path, rate_hz: float | None = None) -> tuple[ColumnMap, Mapping[str, list[str]], list[str]]:
    """A column map for the tables at a path, by sensor what it was guessed from, and the sensors' names.

    A folder may hold a folder for each sensor, and a sensor a file for each quantity.

    Raises:
        FileFormatError: if columns' names tell nothing, a table holds one sample, or rows and times are not in order.
    """
    files = candidates(path, SUFFIXES)
    if not files and path.is_dir():
        files = [file for folder in sorted(path.iterdir()) if folder.is_dir() for file in candidates(folder, SUFFIXES)]
    guessed: dict[Path, dict[str, Guess]] = {}
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
        if sensors_of_table and len(table) == 1:
            raise FileFormatError(f"{file}: one sample: expected at least two")
        if (
            "" in sensors_of_table
            and len(files) == 1
            and (at := _sensor_column(table, sensors_of_table[""].entry.time)) is not None
        ):
            common, why = sensors_of_table[""]
            columns = ColumnMap(str(path), common, sensor_column=table.names[at])
            _read_rows(path, columns, tables)
            return columns, {"": why}, sorted(set(table.texts(at)))
        if sensors_of_table:
            guessed[file] = sensors_of_table
    if not guessed:
        raise FileFormatError(
            f"{path}: no column's name tells acceleration, angular rate or orientation "
            f"({(obstacles or ['no table of numbers there'])[0]}): expected names such as pelvis_acc_x, pelvis_gyr_x, "
            "pelvis_quat_w; write the column map by hand"
        )
    of_files, sensors = _sensors(path, guessed, named=len(files) > 1 or not path.is_file())
    columns = ColumnMap(str(path), sensors={name: each.entry for name, each in sensors.items()})
    samples = _read_rows(path, columns, tables)
    for name, files_of_sensor in of_files.items():
        sensors[name] = _with_joined_units(sensors[name], [tables[file] for file in files_of_sensor], samples[name])
    entries = {**columns.sensors, **_agreeing({name: sensors[name].entry for name in of_files})}
    return replace(columns, sensors=entries), {name: each.reasons for name, each in sensors.items()}, list(sensors)


def _sensors(
    path: Path, guessed: Mapping[Path, Mapping[str, Guess]], named: bool
) -> tuple[dict[str, list[Path]], dict[str, Guess]]:
    """The files of the sensors that have several, and the guesses of all sensors, by the sensors' names.

    Files belong together if their names differ in words for quantities only, and hold a quantity each.
    """
    root = path if path.is_dir() else path.parent
    groups: dict[tuple[Path, str, str], dict[Path, Guess]] = {}
    for file, sensors_of_table in guessed.items():
        for sensor, each in sensors_of_table.items():
            groups.setdefault((file.parent, meaning_of_file(file.stem)[1], sensor), {})[file] = each
    labelled: list[tuple[str, str, list[Path], Guess]] = []
    for (folder, words, sensor), members in groups.items():
        parts = [folder.name] if folder != root else []
        together = _of_files(members, root) if len(members) > 1 else None
        if together is not None:
            label = "_".join([*parts, *([words] if words else [])]) or folder.name
            labelled.append((label, sensor, list(members), together))
            continue
        for file, (entry, why) in members.items():
            file_name = file.relative_to(root).as_posix() if named else None
            alone = Guess(structs.replace(entry, file=file_name), why)
            labelled.append(("_".join([*parts, file.stem]), sensor, [file], alone))
    labels = _shortened([label for label, *_ in labelled])
    of_files, sensors = {}, {}
    for label, (_, sensor, files, each) in zip(labels, labelled, strict=True):
        name = sensor if sensor and len(guessed) == 1 else "_".join(part for part in (label, sensor) if part)
        if sum(other == label for other in labels) == 1 and not default_sites([name]) and default_sites([label]):
            name = label  # the sensor's own name is a device's
        sensors[name] = each
        if len(files) > 1:
            of_files[name] = files
    return of_files, sensors


def _of_files(members: Mapping[Path, Guess], root: Path) -> Guess | None:
    """One sensor of files with a quantity each; of two accelerations the total one. None if they do not fit."""
    times = {each.entry.time for each in members.values()}
    located: dict[str, Any] = {}
    for file, (entry, _) in sorted(members.items(), key=lambda item: "total" in item[0].stem.lower()):
        for quantity in QUANTITIES:
            at: Columns | None = getattr(entry, quantity)
            if at is None:
                continue
            if quantity in located and not (quantity == "acceleration" and "total" in file.stem.lower()):
                return None
            located[quantity] = structs.replace(at, file=file.relative_to(root).as_posix())
    first = next(iter(members.values()))
    return Guess(structs.replace(first.entry, **located), first.reasons) if len(times) == 1 else None


def _shortened(labels: list[str]) -> list[str]:
    """Labels without addresses and what all begin with, the recording's name; but with the sides of a body."""
    plain = [re.sub(r"_(?=[A-F]*\d)[0-9A-F]{12}\b", "", label) for label in labels]
    labels = plain if len(set(plain)) == len(set(labels)) else labels
    start = os.path.commonprefix(labels) if len(set(labels)) > 1 else ""  # noqa: RUF071
    bare = [label[len(re.sub(r"[^-_ .]*$", "", start)) :] for label in labels]
    return bare if len(default_sites(bare)) >= len(default_sites(labels)) else labels


def _with_joined_units(each: Guess, tables: Sequence[TextTable], samples: Samples) -> Guess:
    """The guess with units as the quantities of several files suggest together."""
    entry, (_, time, values) = each.entry, samples
    at = entry.angular_rate
    named = next((name_of_rate_unit(table, at) for table in tables if at and at.file and table.path.match(at.file)), "")
    entry, reasons = with_units(entry, named, time, values)
    return Guess(entry, [*reasons, *(reason for reason in each.reasons if reason.startswith("time: "))])


def _read_rows(path: Path, columns: ColumnMap, tables: dict[Path, TextTable]) -> dict[str, Samples]:
    """Read all rows as a conversion does, for its sentences on rows and times; at any rate where none is known."""
    sensors = {
        name: structs.replace(entry, rate_hz=None if entry.time else entry.rate_hz or 100.0)
        for name, entry in (columns.sensors or {"": columns.common}).items()
    }
    checked = replace(columns, sensors=sensors if columns.sensors else {}, common=sensors.get("", columns.common))
    return read_samples(path, checked, tables, [])


def _sensor_column(table: TextTable, time: str | int | None) -> int | None:
    """The first column of a few different words, each in many rows, that is not the one of times."""
    cells = split(table.rows[0], table.separator)
    for at in range(len(table.names)):
        is_text = number(cells[at]) is None and table.names[at] != time
        if is_text and 1 < len(set(table.texts(at))) <= min(MOST_SENSORS, len(table) / 2):
            return at
    return None


def guess_columns(table: TextTable, rate_hz: float | None = None) -> dict[str, Guess]:
    """The sensors whose acceleration, angular rate or quaternion the names of the columns tell, by name.

    Each with the units that the numbers suggest. The name is blank if the columns name no sensor.
    """
    named: dict[str, dict[str, dict[str, str]]] = {}
    of_file, _ = meaning_of_file(table.path.stem)
    for name, unit in zip(table.names, table.units or [""] * len(table.names), strict=True):
        told = meaning(name, unit, of_file)
        if told is not None and table.names.count(name) == 1:
            sensor, quantity, axis = told
            named.setdefault(sensor, {}).setdefault(quantity, {}).setdefault(axis, name)
    if not named and all(axis in table.names for axis in AXES[4]) and of_file != IGNORED:
        named = {"": {"quaternion": {axis: axis for axis in AXES[4]}}}  # four columns w, x, y, z and no other words
    clock, rates = guess_clock(table)
    if rate_hz is not None:
        clock = structs.replace(clock, time=None, rate_hz=rate_hz)
    numbers = None if clock.time is None else _numbers(table, [clock.time])
    sensors, reasons = {}, {}
    for sensor, quantities in _joined(named).items():
        columns = {quantity: complete(axes, QUANTITIES[quantity]) for quantity, axes in quantities.items()}
        whole: dict[str, Any] = {quantity: Columns(names) for quantity, names in columns.items() if names is not None}
        if whole:
            entry, time, time_reasons = structs.replace(clock, **whole), None, []
            values = {quantity: _numbers(table, at.columns) for quantity, at in whole.items()}
            rate_unit = name_of_rate_unit(table, entry.angular_rate)
            if clock.time is not None:
                unit, reason = time_unit(rates, rate_unit, None if numbers is None else numbers[:, 0], values)
                entry, time_reasons = structs.replace(entry, time_unit=unit), [f"time: {reason}"]
                time = None if numbers is None else TIME_UNITS[unit] * numbers[:, 0]
            sensors[sensor], reasons[sensor] = with_units(entry, rate_unit, time, values)
            reasons[sensor] += time_reasons
    return {name: Guess(entry, reasons[name]) for name, entry in _agreeing(sensors).items()}


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


def _numbers(table: TextTable, names: Sequence[str | int]) -> Array | None:
    short = replace(table, rows=table.rows[:USED_ROWS], lines=table.lines[:USED_ROWS])
    try:
        return short.numbers([short.index(name, "guess") for name in names])
    except FileFormatError:
        return None
