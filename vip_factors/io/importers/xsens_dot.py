"""Xsens (Movella) DOT csv exports: one file per sensor, named by its tag and the time of recording."""

import re
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np

from vip_factors.io.importers.sensor_table import find_header, peek
from vip_factors.io.importers.shared import ImportedLog, candidates, sensor_files
from vip_factors.io.importers.xsens_recording import import_tables

FORMAT = "xsens_dot"
SUFFIXES = (".csv", ".txt")
DEGREE = float(np.deg2rad(1.0))  # DOT exports angular velocity in degrees per second, MTw in radians
_PREAMBLE = ("sep=", "DeviceTag", "FirmwareVersion", "OutputRate")


def matches(path: Path) -> bool:
    """Whether the path is, or as folder or prefix leads to, such an export."""
    return any(_is_export(file) for file in candidates(path, SUFFIXES))


def _is_export(path: Path) -> bool:
    lines = peek(path).splitlines()
    at = find_header(lines)
    if at is None or "PacketCounter" not in lines[at]:
        return False
    preamble = [line for line in lines[:at] if line.strip()]
    if not preamble:
        return "Quat_W" in lines[at]
    return any(line.startswith(_PREAMBLE) for line in preamble)


def read(path: Path) -> ImportedLog:
    """Read a recording: a file, a folder with one file per sensor, or their common start.

    Samples are timed by ``SampleTimeFine`` (µs, wraps at 2³²), which synchronised sensors share. ``FreeAcc_*`` is
    global and without gravity, which is added again.

    Raises:
        FileFormatError: for files that are not such exports, or hold nothing usable.
    """
    files = sensor_files(path, SUFFIXES, _is_export, _recording_and_sensor)
    log = import_tables(path, FORMAT, files, gyr_unit=DEGREE)
    starts = [start for file in files.values() if (start := _start_ns(peek(file)))]
    unsynced = [file.name for file in files.values() if re.search(r"SyncStatus:\s*,\s*Un", peek(file), re.IGNORECASE)]
    notes = log.notes
    if unsynced and len(files) > 1:
        notes += (f"{unsynced[0]}: was recorded without synchronisation: times may be off between sensors",)
    return replace(log, start_ns=min(starts, default=0), notes=notes)


def _recording_and_sensor(stem: str) -> tuple[str, str]:
    """``RTibia_20210820_202113_825`` is sensor RTibia; files of one recording may differ in their seconds."""
    found = re.match(r"(?:xsens[ _]dot[ _])?(.+?)_\d{8}_\d{6}(?:_\d+)?$", stem, re.IGNORECASE)
    return ("", found.group(1)) if found else ("", stem)


def _start_ns(text: str) -> int | None:
    """Absolute nanoseconds of ``StartTime: ,2021-08-20_20:21:13_839 GMT+8``."""
    found = re.search(r"StartTime:\s*,\s*(\d{4}-\d\d-\d\d)_(\d\d:\d\d:\d\d)_(\d{1,3})(?:\s*GMT([+-]\d{1,2}))?", text)
    if not found:
        return None
    date, clock, millisecond, offset = found.groups()
    try:
        start = datetime.fromisoformat(f"{date}T{clock}").replace(tzinfo=timezone(timedelta(hours=int(offset or 0))))
    except ValueError:
        return None
    return int(start.timestamp()) * 10**9 + int(millisecond) * 10**6
