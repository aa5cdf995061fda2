"""First guesses for somebody to correct: what a log's columns mean, and where its sensors sit."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from msgspec import structs

from vip_factors.atomic import atomic_open, check_target
from vip_factors.display import one_line
from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.convert import detect_format, read_log
from vip_factors.io.importers.column_guess import UNIT_KEYS, guess_columns
from vip_factors.io.importers.column_map import QUANTITIES, ColumnMap, Columns, SensorColumns
from vip_factors.io.importers.shared import candidates, likely_sites
from vip_factors.io.importers.text_table import SUFFIXES, TextTable, number, read_text_table, split
from vip_factors.io.typed_files import toml_text
from vip_factors.sensors.calibration import SITES, site_axes

MOST_SENSORS = 64  # of different words in a column that is to name sensors


class Templates(NamedTuple):
    """Paths of what was written.

    Attributes:
        placement: where the sensors sit.
        columns: what the columns mean; None for a log whose format is known.
    """

    placement: Path
    columns: Path | None = None


def write_templates(path: str | Path, name: Path, overwrite: bool = False) -> Templates:
    """Write ``NAME_placement.toml`` and, unless the log's format says it all, ``NAME_columns.toml``.

    Args:
        path: the log: a file, a folder, or how the names of its files begin.
        name: what the names of the files begin with; a suffix ``.toml`` is dropped.
        overwrite: whether existing files may be replaced.

    Raises:
        InputError: if nothing is at the path, it is a recording of ours, or a file exists.
        FileFormatError: if neither is its format known nor do the names of its columns tell anything.
    """
    path = Path(path)
    stem = name.with_suffix("") if name.suffix.lower() == ".toml" else name
    placement_file, columns_file = (stem.with_name(f"{stem.name}_{what}.toml") for what in ("placement", "columns"))
    for file in (placement_file, columns_file):
        check_target(file, overwrite)
    known_format = _format(path)
    if known_format == "recording":
        raise InputError(f"{path} is a recording of this package already: it needs neither columns nor places")
    if known_format:
        sensors, files = list(read_log(path, known_format).imus), Templates(placement_file)
    else:
        columns, reasons = guess(path)
        sensors, files = _names(path, columns), Templates(placement_file, columns_file)
        with atomic_open(columns_file, "w", overwrite) as stream:
            stream.write(columns_text(path, columns, reasons))
    with atomic_open(files.placement, "w", overwrite) as stream:
        stream.write(placement_text(path, sensors, files))
    return files


def _format(path: Path) -> str:
    """The log's format; empty if it is none of the known ones."""
    try:
        return detect_format(path)
    except FileFormatError:
        return ""


def guess(path: Path) -> tuple[ColumnMap, Mapping[str, list[str]]]:
    """A column map for the tables at a path, and by sensor what it was guessed from.

    Raises:
        FileFormatError: if the names of the columns tell nothing.
    """
    files = candidates(path, SUFFIXES)
    guessed: dict[Path, dict[str, tuple[SensorColumns, list[str]]]] = {}
    seen: list[str] = []
    refused = ""
    for file in files:
        try:
            table = read_text_table(file)
        except FileFormatError as error:
            refused = refused or str(error)
            continue
        seen = seen or [f"{file.name}: {', '.join(table.names[:12])}"]
        sensors_of_table = guess_columns(table)
        if "" in sensors_of_table and len(files) == 1 and (at := _sensor_column(table)) is not None:
            common, why = sensors_of_table[""]
            return ColumnMap(str(path), common, sensor_column=table.names[at]), {"": why}
        if sensors_of_table:
            guessed[file] = sensors_of_table
    if not guessed:
        raise FileFormatError(
            f"{path}: no column's name tells acceleration, angular rate or orientation ("
            f"{'; '.join(seen) or refused or 'no table of numbers there'}): expected names such as pelvis_acc_x, "
            "pelvis_gyr_x, pelvis_quat_w; write the column map by hand"
        )
    sensors, reasons = {}, {}
    shared = _shared_start([file.stem for file in guessed])
    for file, sensors_of_table in guessed.items():
        for sensor, (entry, why) in sensors_of_table.items():
            own = file.name if len(files) > 1 or not path.is_file() else None
            several = "_".join(part for part in (file.stem[shared:], sensor) if part)
            name = sensor if sensor and len(guessed) == 1 else several
            sensors[name], reasons[name] = structs.replace(entry, file=own), why
    return ColumnMap(str(path), sensors=sensors), reasons


def _shared_start(stems: list[str]) -> int:
    """How many letters of the files' names name the recording: those that all have, up to a separator."""
    ends = [found.end() for found in re.finditer(r"[-_ .]+", stems[0])] if len(stems) > 1 else []
    return max((end for end in ends if all(stem.startswith(stems[0][:end]) for stem in stems)), default=0)


def _sensor_column(table: TextTable) -> int | None:
    """The first column of a few different words, each in many rows."""
    cells = split(table.rows[0], table.separator)
    for at in range(len(table.names)):
        if number(cells[at]) is None:
            words = set(table.texts(at))
            return at if 1 < len(words) <= min(MOST_SENSORS, len(table) / 2) else None
    return None


def _names(path: Path, columns: ColumnMap) -> list[str]:
    if columns.sensor_column is None:
        return list(columns.sensors)
    table = read_text_table(candidates(path, SUFFIXES)[0])
    return sorted(set(table.texts(table.index(columns.sensor_column, "sensor_column"))))


def columns_text(path: Path, columns: ColumnMap, reasons: Mapping[str, list[str]]) -> str:
    """A column map as TOML, what all sensors share above them."""
    entries = dict(columns.sensors) or {"": columns.common}
    first = next(iter(entries.values()))
    one_clock = len({(entry.time, entry.time_unit) for entry in entries.values()}) == 1
    lines = [
        f"# What the columns of {one_line(str(path))} mean: a first guess from their names and numbers. Please check "
        "every line.",
        "",
        *(_time_lines(first) if one_clock else ()),
    ]
    for quantity, keys in UNIT_KEYS.items():
        if any(getattr(entry, quantity) is not None for entry in entries.values()):
            lines += [f"{key} = {toml_text(getattr(first, key))}  # {_CHOICES[key]}" for key in keys]
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


_CHOICES = {
    "acceleration_unit": "m/s2, g or mg; gravity included",
    "angular_rate_unit": "rad/s or deg/s",
    "quaternion_order": "wxyz or xyzw: of the columns as they are listed",
    "quaternion_sense": "sensor_to_world or world_to_sensor",
    "world_up": "z, y or -z: the axis of the quaternions' world that points up",
}


def _time_lines(entry: SensorColumns) -> list[str]:
    if entry.time is None:
        return ["# No column looks like the times of the samples. Name it, or say how many samples a second there are:",
                "# time = \"…\"", "# rate_hz = 100"]  # fmt: skip
    return [f"time = {toml_text(entry.time)}", f'time_unit = "{entry.time_unit}"  # s, ms, us or ns']


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
