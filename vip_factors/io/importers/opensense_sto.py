"""OpenSense quaternion tables (.sto): orientation of every sensor, one column each, cells ``w,x,y,z``."""

import re
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.opensim_export import others_beside
from vip_factors.io.importers.packet_clock import SAME_RATE
from vip_factors.io.importers.sensor_table import peek
from vip_factors.io.importers.shared import ImportedLog, candidates, default_sites, merge_notes
from vip_factors.io.importers.xsens_channels import rotations_or_nan
from vip_factors.sensors.imu_stream import ImuStream

FORMAT = "opensense_sto"


def matches(path: Path) -> bool:
    """Whether the file, or one in the folder, is a table of quaternions, by its header."""
    return any(_is_table(file) for file in candidates(path, (".sto",)))


def _is_table(path: Path) -> bool:
    return bool(re.search(r"^DataType=Quaternion\s*$", peek(path)[:2000], re.MULTILINE))


def read(path: Path) -> ImportedLog:
    """Read a table; a folder must hold one.

    OpenSense's raw tables keep the sensors' own inertial frame, z up; a table that had
    ``sensor_to_opensim_rotations`` applied has y up instead. Orientation alone cannot tell which: z up is taken.

    Raises:
        FileFormatError: for other files, malformed cells, or a table without rows.
    """
    files = [file for file in candidates(path, (".sto",)) if _is_table(file)]
    if len(files) != 1:
        found = ", ".join(file.name for file in files) or "none"
        raise FileFormatError(f"{path}: expected one .sto table of quaternions, found {found}")
    path = files[0]
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    at = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if at is None or at + 1 >= len(lines):
        raise FileFormatError(f"{path}: no 'endheader' line followed by column names")
    names = lines[at + 1].split("\t")
    if names[0].strip().lower() != "time" or len(names) < 2:
        raise FileFormatError(f"{path}, line {at + 2}: expected the columns 'time' and one per sensor, tab-separated")
    notes = [
        f"{path.name}: taken to be in the sensors' own inertial frame, z up, as OpenSense writes raw tables; "
        "if OpenSim axes (y up) were applied already, convert the raw recording instead",
        f"{path.name}: orientation only, no acceleration: translation will be unobservable from the sensors",
    ]
    if beside := others_beside(path):
        notes.append(f"{path.name}: {beside[0].name} stands beside it: name that one, and both are read together")
    time, quaternions = _cells(path, lines, at, len(names), notes)
    order = np.unique(time, return_index=True)[1]
    if len(order) < len(time):
        notes.append(f"{path.name}: {len(time) - len(order)} rows with a repeated time dropped")
    time, quaternions = time[order], quaternions[order]
    _compare_rate(path, lines[:at], time, notes)
    imus = {}
    for index, name in enumerate(names[1:]):
        sensor = name.strip()
        R = rotations_or_nan(quaternions[:, index], Order.WXYZ, f"{path}, sensor '{sensor}'", notes)
        if np.all(np.isnan(R)):
            notes.append(f"{path.name}: column '{sensor}' has no orientation at all: left out")
            continue
        imus[sensor] = ImuStream.from_samples(sensor, time - time[0], None, R)
    return ImportedLog(FORMAT, imus, default_sites(list(imus)), notes=merge_notes(notes))


def _cells(path: Path, lines: list[str], at: int, width: int, notes: list[str]) -> tuple[Array, Array]:
    """Times ``(N,)`` and quaternions ``(N, sensors, 4)``; blank or nan cells are NaN."""
    rows = [(at + 3 + i, line.split("\t")) for i, line in enumerate(lines[at + 2 :]) if line.strip()]
    if rows and not _whole(rows[-1][1], width):
        notes.append(f"{path.name}: the last line breaks off and was dropped")
        rows = rows[:-1]
    if not rows:
        raise FileFormatError(f"{path}: no rows below its header")
    time, quaternions = np.empty(len(rows)), np.full((len(rows), width - 1, 4), np.nan)
    for i, (number, cells) in enumerate(rows):
        if len(cells) < width:
            raise FileFormatError(f"{path}, line {number}: {len(cells)} cells: expected {width}")
        try:
            time[i] = float(cells[0])
            for sensor, cell in enumerate(cells[1:width]):
                if cell.strip():
                    quaternions[i, sensor] = [float(part) for part in cell.strip("()~[] ").split(",")]
        except ValueError:
            raise FileFormatError(f"{path}, line {number}: expected a time and cells of four numbers w,x,y,z") from None
    return time, quaternions


def _whole(cells: list[str], width: int) -> bool:
    return len(cells) >= width and cells[width - 1].count(",") in (0, 3) and not cells[width - 1].endswith(",")


def _compare_rate(path: Path, header: list[str], time: Array, notes: list[str]) -> None:
    text = next((line.partition("=")[2] for line in header if line.startswith("DataRate=")), "")
    try:
        stated = float(text)
    except ValueError:
        return
    if len(time) < 2 or stated <= 0:
        return
    measured = 1 / float(np.median(np.diff(time)))
    if abs(measured / stated - 1) > SAME_RATE:
        notes.append(f"{path.name}: DataRate says {stated:g} Hz, its times {measured:.2f} Hz; the times are believed")
