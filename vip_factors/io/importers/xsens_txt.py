"""Xsens MTw / MT Manager text exports: one file per sensor, told apart by the device id that ends the file's name."""

from pathlib import Path

from vip_factors.io.importers.sensor_table import find_header, peek
from vip_factors.io.importers.shared import ImportedLog, candidates, sensor_files
from vip_factors.io.importers.xsens_recording import import_tables

FORMAT = "xsens_txt"
SUFFIXES = (".txt", ".csv")


def matches(path: Path) -> bool:
    """Whether the path is, or as folder or prefix leads to, such an export."""
    return any(_is_export(file) for file in candidates(path, SUFFIXES))


def _is_export(path: Path) -> bool:
    lines = peek(path).splitlines()
    at = find_header(lines)
    if at is None:
        return False
    preamble = [line for line in lines[:at] if line.strip()]
    if not preamble:  # a bare table: DOT's differ in how they call the quaternion
        return "PacketCounter" in lines[at] and "Quat_W" not in lines[at]
    return all(line.startswith("//") for line in preamble)


def read(path: Path) -> ImportedLog:
    """Read a recording: a file, a folder of one recording's files, or their common start (``folder/Walk-1-000``).

    Samples are timed by the sensors' clock where every file has it, else by packet counter and update rate (100 Hz
    where none is stated); lost packets are gaps. ``Acc_*`` includes gravity; ``FreeAcc_*`` is global and gets gravity
    back. Matrices are read by their columns' names.

    Raises:
        FileFormatError: for files that are not such exports, that disagree on the rate, or hold nothing usable.
    """
    files = sensor_files(path, SUFFIXES, _is_export, _recording_and_sensor)
    return import_tables(path, FORMAT, files, gyr_unit=1.0)


def _recording_and_sensor(stem: str) -> tuple[str, str]:
    recording, _, sensor = stem.rpartition("_")
    return recording, sensor
