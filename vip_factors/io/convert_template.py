"""Two files of first guesses for somebody to correct: what a log's columns mean, and where its sensors sit."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from vip_factors.atomic import atomic_open, check_target
from vip_factors.display import one_line
from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.convert import detect_format, read_log
from vip_factors.io.importers.column_guess import guess
from vip_factors.io.importers.column_map import CHOICES, QUANTITIES, UNIT_KEYS, ColumnMap, Columns, SensorColumns
from vip_factors.io.importers.shared import likely_sites, unpacked
from vip_factors.io.importers.unit_guess import PLEASE_DECLARE
from vip_factors.io.typed_files import toml_text
from vip_factors.sensors.calibration import SITES, site_axes


class Templates(NamedTuple):
    """Paths of the files that were written.

    Attributes:
        placement: where the sensors sit.
        columns: what the columns mean; None for a log whose format is known.
        undeclared: a sentence on each thing that the log does not say and only its owner knows.
    """

    placement: Path
    columns: Path | None = None
    undeclared: tuple[str, ...] = ()


def write_templates(path: str | Path, name: Path, overwrite: bool = False, rate_hz: float | None = None) -> Templates:
    """Write ``NAME_placement.toml`` and, unless the log's format says it all, ``NAME_columns.toml``.

    Args:
        path: the log: a file, a folder, or how the names of its files begin.
        name: what the names of the files begin with; a suffix ``.toml`` is dropped.
        overwrite: whether existing files may be replaced.
        rate_hz: samples per second, if the log has no times, or wrong ones.

    Raises:
        InputError: if nothing is at the path, it is a recording of ours, or a file exists.
        FileFormatError: if its format is unknown and no column's name gives a quantity.
    """
    path = Path(path)
    stem = name.with_suffix("") if name.suffix.lower() == ".toml" else name
    placement_file, columns_file = (stem.with_name(f"{stem.name}_{kind}.toml") for kind in ("placement", "columns"))
    for file in (placement_file, columns_file):
        check_target(file, overwrite)
    try:
        format_name = detect_format(path)
    except FileFormatError:
        format_name = ""
    if format_name == "recording":
        raise InputError(f"{path} is a recording of this package already: it needs neither columns nor places")
    if format_name:
        sensors, files = list(read_log(path, format_name, rate_hz=rate_hz).imus), Templates(placement_file)
    else:
        with unpacked(path) as log:
            columns, reasons, sensors = guess(log, rate_hz)
        questions = [reason for phrases in reasons.values() for reason in phrases if PLEASE_DECLARE in reason]
        files = Templates(placement_file, columns_file, tuple(dict.fromkeys(questions)))
        with atomic_open(columns_file, "w", overwrite) as stream:
            stream.write(columns_text(path, columns, reasons))
    with atomic_open(files.placement, "w", overwrite) as stream:
        stream.write(placement_text(path, sensors, files))
    sites = likely_sites(sensors)
    placed, others = [name for name in sensors if name in sites], [name for name in sensors if name not in sites]
    mounted = f"no mounting is declared: {', '.join(placed)} have the default axes of their sites"
    nowhere = f"no site is declared for {', '.join(others)}"
    return files._replace(undeclared=(*files.undeclared, *[mounted] * bool(placed), *[nowhere] * bool(others)))


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


PLACEMENT_HEAD = """\
# Placement of the sensors of {log}, guessed from their names. Check every line, then run:
# {command} --placement {placement}

# The wearer. Remove the # where you know a value; stature matters most.
# subject = "S01"
# stature_m = 1.75
# mass_kg = 70
# sex = "female"
# initial_pose = "n-pose"  # pose at the start: n-pose (arms hanging) or t-pose (arms sideways)

[sensors]
"""
PLACEMENT_END = """\

# The axes of a sensor are expected within 40° of those of its site. Other rotations are estimated from the
# motion; a declared pose, or standing still at the start, helps. Left, right, up, down, front and back are the
# wearer's in a T-pose (arms sideways, palms down). If the axes are known, give the rotation:
#   "…" = { site = "left_thigh", mounting_wxyz = [1, 0, 0, 0], sigma_deg = 15 }
# Sites:
"""


def placement_text(path: Path, sensors: list[str], files: Templates) -> str:
    """A placement file with the sites that the sensors' names suggest, and all sites explained."""
    log, placement = one_line(str(path)), one_line(str(files.placement))
    command = f"vip-factors convert {log} RECORDING.mcap"
    command += f" --columns {one_line(str(files.columns))}" if files.columns is not None else ""
    sites = likely_sites(sensors)
    lines = []
    for name in sensors:
        key, site = toml_text(name).ljust(max(len(toml_text(sensor)) for sensor in sensors)), sites.get(name)
        lines.append(f"{key} = {toml_text(site)}  # {site_axes(site)}\n" if site else f'# {key} = "…"  # not told\n')
    width = max(map(len, SITES))
    lines += [PLACEMENT_END, *(f"#   {name.ljust(width)}  {site_axes(name)}\n" for name in SITES)]
    return PLACEMENT_HEAD.format(log=log, command=command, placement=placement) + "".join(lines)
