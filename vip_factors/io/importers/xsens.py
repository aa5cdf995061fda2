"""Xsens tables, one for each sensor: MTw / MT Manager text exports, and (Movella) DOT's csv.

The name of an MTw's file ends in the device id; a DOT's has its tag and the time of recording. Samples are timed
by the sensors' clock where every file has it, else by packet counter and update rate (100 Hz where none is stated);
lost packets are gaps. ``Acc_*`` includes gravity; ``FreeAcc_*`` is global and gets gravity back. Matrices are read by
their columns' names. DOT exports degrees per second, MTw radians.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from functools import partial
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array, nearest_rotation, rotation_x, rotation_y, rotation_z, transpose
from vip_factors.io.importers.clocks import Packets, common_base, order_packets, restart_note, stated_rate
from vip_factors.io.importers.shared import (
    GRAVITY,
    SAME_RATE,
    UP,
    ImportedLog,
    LogFormat,
    candidates,
    default_sites,
    merge_notes,
    note_bad_rows,
    rotations_or_nan,
    z_up,
)
from vip_factors.io.importers.text_table import Dialect, TextTable, peek, read_text_table
from vip_factors.sensors.imu_stream import ImuStream

SUFFIXES = (".txt", ".csv")
HEADER_WORDS = ("PacketCounter", "SampleTimeFine", "Acc_X", "FreeAcc_X", "FreeAcc_E", "Mat[1][1]", "Quat_")
DOT_PREAMBLE = ("sep=", "DeviceTag", "FirmwareVersion", "OutputRate")
QUATERNIONS = (
    ("Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"),
    ("Quat_W", "Quat_X", "Quat_Y", "Quat_Z"),
    ("Quat_w", "Quat_x", "Quat_y", "Quat_z"),
)
MATRIX = tuple(f"Mat[{row}][{column}]" for row in (1, 2, 3) for column in (1, 2, 3))  # by name: any order in the file
EULER = (("Roll", "Pitch", "Yaw"), ("Euler_X", "Euler_Y", "Euler_Z"), ("Euler_x", "Euler_y", "Euler_z"))
ACCELERATION = ("Acc_X", "Acc_Y", "Acc_Z")
FREE_ACCELERATION = (("FreeAcc_X", "FreeAcc_Y", "FreeAcc_Z"), ("FreeAcc_E", "FreeAcc_N", "FreeAcc_U"))
ANGULAR_RATE = ("Gyr_X", "Gyr_Y", "Gyr_Z")

COUNTER_MODULUS = 2**16  # MTw and DOT packet counters
COUNTERS = ("PacketCounter", "Counter")  # the second of old MT Managers
CLOCK_MODULUS = 2**32  # SampleTimeFine
DEFAULT_RATE_HZ = 100.0  # of an MTw Awinda with up to nine sensors, and of every export seen without a rate
# North-east-down to east-north-up, for exports whose comment says NED.
R_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# A worn sensor's specific force averages to about 9.8 m/s² over a file; a mean this short had its gravity removed.
GRAVITY_FREE_MEAN = 3.0
# The same tolerance as for quaternions: a matrix further off is not a rounded rotation but a mistake.
MATRIX_TOLERANCE = 0.05


def _is_mtw(path: Path) -> bool:
    _, header, preamble = _header(path)
    if not preamble:  # a bare table: DOT's differ in how they call the quaternion, others have another clock
        is_ours = "PacketCounter" in header and any(word in header for word in HEADER_WORDS[2:])
        return is_ours and "Quat_W" not in header and not re.search(r"\btime", header, re.IGNORECASE)
    return bool(header) and all(line.startswith("//") for line in preamble)


def _is_dot(path: Path) -> bool:
    _, header, preamble = _header(path)
    if "PacketCounter" not in header:
        return False
    return any(line.startswith(DOT_PREAMBLE) for line in preamble) if preamble else "Quat_W" in header


def _header(path: Path) -> tuple[int, str, list[str]]:
    """Number and text of the line of column names, and the lines above it that are not blank; 0 if there is none."""
    lines = peek(path).splitlines()
    for number, line in enumerate(lines, start=1):
        if not line.startswith("//") and any(word in line for word in HEADER_WORDS):
            return number, line, [above for above in lines[: number - 1] if above.strip()]
    return 0, "", []


def _dot_name(stem: str) -> tuple[str, str]:
    """``RTibia_20210820_202113_825`` is sensor RTibia; files of one recording may differ in their seconds."""
    match = re.match(r"(?:xsens[ _]dot[ _])?(.+?)_\d{8}_\d{6}(?:_\d+)?$", stem, re.IGNORECASE)
    return "", match[1] if match else stem


def _matches(is_ours: Callable[[Path], bool], path: Path) -> bool:
    return any(is_ours(file) for file in candidates(path, SUFFIXES))


def _sensor_files(
    path: Path, is_ours: Callable[[Path], bool], split: Callable[[str], tuple[str, str]]
) -> dict[str, Path]:
    """Sensor name → file, for the files of the one recording at ``path``: a file, a folder, or how their names begin.

    ``split`` parts a file's stem into recording and sensor name.
    """
    others = candidates(path, SUFFIXES)
    files = [file for file in others if is_ours(file)]
    if not files:
        kind = " or ".join(SUFFIXES)
        reason = f"none of its {len(others)} {kind} files is of this format" if others else f"no {kind} file there"
        raise FileFormatError(f"{path}: {reason}")
    recordings: dict[str, dict[str, Path]] = {}
    for file in files:
        recording, sensor = split(file.stem)
        sensors = recordings.setdefault(recording, {})
        if sensor in sensors:
            raise FileFormatError(
                f"{path}: {sensors[sensor].name} and {file.name} are both of sensor '{sensor}': expected one file per "
                "sensor; keep each recording in a folder of its own"
            )
        sensors[sensor] = file
    if len(recordings) > 1:
        folder = path if path.is_dir() else path.parent
        raise FileFormatError(
            f"{path}: holds files of {len(recordings)} recordings ({', '.join(list(recordings)[:4])} …); "
            f"name the one you mean, such as {folder / next(iter(recordings))}"
        )
    return next(iter(recordings.values()))


def _read_mtw(path: Path, rate_hz: float | None = None) -> ImportedLog:
    """Read a recording: a file, a folder of one recording's files, or their common start (``folder/Walk-1-000``)."""
    files = _sensor_files(path, _is_mtw, lambda stem: stem.rpartition("_")[::2])
    return _import_tables(path, MTW.name, files, 1.0, rate_hz)


def _read_dot(path: Path, rate_hz: float | None = None) -> ImportedLog:
    """Read a recording: a file, a folder with one file per sensor, or their common start."""
    files = _sensor_files(path, _is_dot, _dot_name)
    log = _import_tables(path, DOT.name, files, float(np.deg2rad(1.0)), rate_hz)
    starts = [start for file in files.values() if (start := _start_ns(peek(file)))]
    unsynced = [file.name for file in files.values() if re.search(r"SyncStatus:\s*,\s*Un", peek(file), re.IGNORECASE)]
    notes = log.notes
    if unsynced and len(files) > 1:
        notes += (f"{unsynced[0]}: was recorded without synchronisation: times may be off between sensors",)
    return replace(log, start_ns=min(starts, default=0), notes=notes)


def _start_ns(text: str) -> int | None:
    """Absolute nanoseconds of ``StartTime: ,2021-08-20_20:21:13_839 GMT+8``."""
    match = re.search(r"StartTime:\s*,\s*(\d{4}-\d\d-\d\d)_(\d\d:\d\d:\d\d)_(\d{1,3})(?:\s*GMT([+-]\d{1,2}))?", text)
    if not match:
        return None
    date, clock, millisecond, offset = match.groups()
    try:
        start = datetime.fromisoformat(f"{date}T{clock}").replace(tzinfo=timezone(timedelta(hours=int(offset or 0))))
    except ValueError:
        return None
    return int(start.timestamp()) * 10**9 + int(millisecond) * 10**6


MTW = LogFormat("xsens_txt", partial(_matches, _is_mtw), _read_mtw, takes_rate=True)
DOT = LogFormat("xsens_dot", partial(_matches, _is_dot), _read_dot, takes_rate=True)


def _import_tables(
    path: Path, name: str, files: dict[str, Path], rate_unit: float, rate_hz: float | None
) -> ImportedLog:
    """Read one file per sensor and put all on one clock; ``rate_unit`` is the unit of angular rate in rad/s."""
    tables = dict[str, TextTable]()
    for sensor, file in files.items():
        number, header, _ = _header(file)
        separator = next((character for character in "\t;," if character in header), " ")
        tables[sensor] = read_text_table(file, Dialect(separator, header=(number,), same_digits=True))
    notes = [note for table in tables.values() for note in table.notes]
    packets = {sensor: _packets(table, notes) for sensor, table in tables.items()}
    times = _times(path, tables, packets, rate_hz, notes)
    imus = {}
    for sensor, table in tables.items():
        rows = packets[sensor].rows
        force, R, rate = (None if values is None else values[rows] for values in _channels(table, rate_unit, notes))
        imus[sensor] = ImuStream.from_samples(sensor, times[sensor], force, R, rate)
        if lost := len(rows) - len(imus[sensor]):
            notes.append(f"{table.path.name}: {lost} samples with missing values dropped")
    return ImportedLog(name, imus, default_sites(list(imus)), notes=merge_notes(notes))


def _packets(table: TextTable, notes: list[str]) -> Packets:
    name, rows = table.path.name, np.arange(len(table))
    label = next((label for label in COUNTERS if table.group([label]) is not None), None)
    if label is None:
        notes.append(f"{name}: no {COUNTERS[0]}, so lost packets cannot be seen")
        return Packets(rows, rows, COUNTER_MODULUS)
    try:
        return order_packets(table, table.names.index(label), rows, notes, COUNTER_MODULUS)
    except FileFormatError as restart:
        clock = _clock(table, Packets(rows, rows, COUNTER_MODULUS))
        if clock is None:
            raise
        notes.append(restart_note(table, restart, "SampleTimeFine"))
        count = (clock[0] - clock[0][0]) / np.median(np.diff(clock[0]))
        return Packets(rows, np.round(count).astype(np.int64), COUNTER_MODULUS)


def _clock(table: TextTable, packets: Packets) -> tuple[np.ndarray, float] | None:
    """SampleTimeFine of the packets, unwrapped, and the seconds of a tick; None if it is missing or no clock.

    MTw stations count tenths of milliseconds, DOTs microseconds; the ticks between packets tell which.
    """
    column, (rows, count, _) = table.group(["SampleTimeFine"]), packets
    if column is None or len(rows) < 2 or not np.all(np.isfinite(column[rows])):
        return None
    clock = np.unwrap(column[rows, 0].astype(np.int64), period=CLOCK_MODULUS)
    ticks = float(np.median(np.diff(clock) / np.diff(count)))
    if np.any(np.diff(clock) <= 0) or not 1.0 <= ticks < 250_000.0:
        return None
    return clock, 1e-4 if ticks < 900.0 else 1e-6


def _times(
    path: Path, tables: dict[str, TextTable], packets: dict[str, Packets], rate_hz: float | None, notes: list[str]
) -> dict[str, Array]:
    """Seconds from the earliest sample of any file, for each file's packets; a rate that the caller gives wins."""
    stated = {sensor: rate for sensor, table in tables.items() if (rate := stated_rate(table)) is not None}
    times = _clock_times(tables, packets, stated, notes) if rate_hz is None else None
    if times is not None:
        return times
    rate = rate_hz or max(stated.values(), default=DEFAULT_RATE_HZ)
    if rate_hz is None and not stated:
        notes.append(f"{path.name}: no file says its update rate; {rate:g} Hz assumed; say it with --rate-hz")
    elif rate_hz is None and rate > min(stated.values()) * (1 + SAME_RATE):
        slow, fast = (extreme(stated, key=stated.__getitem__) for extreme in (min, max))
        raise FileFormatError(
            f"{path}: {tables[slow].path.name} says {stated[slow]:g} Hz and {tables[fast].path.name} {stated[fast]:g} "
            "Hz: expected one rate for all files of a recording; import them apart, or give --rate-hz"
        )
    counts = common_base([p.counts for p in packets.values()], max(p.modulus for p in packets.values()))
    return {sensor: count / rate for sensor, count in zip(packets, counts, strict=True)}


def _clock_times(
    tables: dict[str, TextTable], packets: dict[str, Packets], stated: dict[str, float], notes: list[str]
) -> dict[str, Array] | None:
    """Times by SampleTimeFine, or None where a file lacks it or the clocks have nothing in common."""
    pairs = [_clock(table, packets[sensor]) for sensor, table in tables.items()]
    clocks = [pair for pair in pairs if pair is not None]
    if len(clocks) < len(tables) or len({tick for _, tick in clocks}) > 1:
        return None
    aligned, tick = common_base([ticks for ticks, _ in clocks], CLOCK_MODULUS), clocks[0][1]
    # A sensor that starts after the longest recording could have ended was never on the others' clock.
    if max(clock[0] for clock in aligned) > max(clock[-1] - clock[0] for clock in aligned):
        notes.append("the sensors' clocks (SampleTimeFine) were not set together; packet counters are used instead")
        return None
    for (sensor, table), clock in zip(tables.items(), aligned, strict=True):
        rate = 1 / (tick * float(np.median(np.diff(clock) / np.diff(packets[sensor].counts))))
        if sensor in stated and abs(rate / stated[sensor] - 1) > SAME_RATE:
            notes.append(
                f"{table.path.name}: says {stated[sensor]:g} Hz, but its SampleTimeFine runs at {rate:.2f} Hz; the "
                "clock is believed"
            )
    return {sensor: clock * tick for sensor, clock in zip(tables, aligned, strict=True)}


def _channels(table: TextTable, rate_unit: float, notes: list[str]) -> tuple[Array | None, Array | None, Array | None]:
    """Specific force, orientation and angular rate in our units and frames; NaN in lost rows."""
    R, name = _orientation(table, notes), table.path.name
    acceleration = table.group(ACCELERATION)
    free = _first_group(table, FREE_ACCELERATION)
    if (
        acceleration is not None
        and free is None
        and np.linalg.norm(np.nanmean(acceleration, axis=0)) < GRAVITY_FREE_MEAN
        and np.nanmedian(np.linalg.norm(acceleration, axis=1)) < GRAVITY / 2  # a tumbling sensor averages to little too
    ):
        notes.append(
            f"{name}: gravity had been removed from Acc_*: taken as free acceleration in the inertial frame; without "
            "gravity nothing in this converted file can tell whether its orientation has z up, so prefer the original"
        )
        acceleration, free = None, acceleration
    if acceleration is None and free is not None:
        if R is None:
            notes.append(f"{name}: acceleration without gravity needs an orientation to restore it: left out")
        else:
            acceleration = np.einsum("nji,nj->ni", R, free + GRAVITY * UP)
    elif acceleration is not None and R is not None:
        R = z_up(name, R, acceleration, notes)
    if R is None and acceleration is None:
        raise FileFormatError(
            f"{table.path}: neither orientation (Quat_*, Mat[*][*], Roll/Pitch/Yaw) nor acceleration (Acc_*) among its "
            f"columns {', '.join(table.names)}: export at least one of them"
        )
    rate = table.group(ANGULAR_RATE)
    return acceleration, R, None if rate is None else rate_unit * rate


def _first_group(table: TextTable, forms: tuple[tuple[str, ...], ...]) -> Array | None:
    return next((group for names in forms if (group := table.group(names)) is not None), None)


def _orientation(table: TextTable, notes: list[str]) -> Array | None:
    """R_inertial_sensor ``(N, 3, 3)`` with z up, NaN where lost, from quaternion, matrix or Euler angles."""
    quaternion, degrees = _first_group(table, QUATERNIONS), _first_group(table, EULER)
    if quaternion is not None:
        R = rotations_or_nan(quaternion, Order.WXYZ, str(table.path), notes)
    elif (cells := table.group(MATRIX)) is not None:
        R = _matrices_or_nan(cells.reshape(-1, 3, 3), str(table.path), notes)
    elif degrees is not None:
        roll, pitch, yaw = np.deg2rad(degrees).T
        R = rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)
    else:
        return None
    if any(re.search(r"coordinate system:\s*NED\b", line, re.IGNORECASE) for line in table.preamble):
        R = R_ENU_NED @ R
        notes.append(f"{table.path.name}: turned from north-east-down to east-north-up")
    return R


def _matrices_or_nan(matrices: Array, where: str, notes: list[str]) -> Array:
    is_finite = np.all(np.isfinite(matrices), axis=(1, 2))
    finite = np.where(is_finite[:, None, None], matrices, np.eye(3))
    error = np.abs(transpose(finite) @ finite - np.eye(3)).max(axis=(1, 2))
    is_rotation = is_finite & (error < MATRIX_TOLERANCE) & (np.linalg.det(finite) > 0)
    note_bad_rows(is_rotation, is_finite, where, "matrices are not rotations", notes)
    R = np.full(matrices.shape, np.nan)
    R[is_rotation] = nearest_rotation(matrices[is_rotation])
    return R
