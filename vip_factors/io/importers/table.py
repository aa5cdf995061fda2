"""Sensor logs that are tables of any make, read as a column map says."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from msgspec import structs

from vip_factors.errors import FileFormatError, InputError, RecordingError, nearest
from vip_factors.geometry.quaternions import UNIT_TOLERANCE, continuous, interpolate_points
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.clocks import Clock, common_base, table_clock
from vip_factors.io.importers.column_map import (
    ACCELERATION_UNITS,
    ANGULAR_RATE_UNITS,
    GRAVITIES,
    QUANTITIES,
    UP_OR_DOWN,
    ColumnMap,
    Columns,
    SensorColumns,
)
from vip_factors.io.importers.shared import (
    GRAVITY,
    TILT_LIMIT_DEG,
    UP,
    ImportedLog,
    Sampled,
    candidates,
    default_sites,
    merge_notes,
    tilt_of_up,
    values_at,
    z_up,
)
from vip_factors.io.importers.text_table import SUFFIXES, TextTable, read_text_table
from vip_factors.io.importers.units import GRAVITY_RANGE, TURNED_OVER, best_reading, check_turning, upright_rotations
from vip_factors.sensors.imu_stream import RATE_LIMIT, ImuStream, force_spikes, rate_spikes, with_orientation

FORMAT = "table"
IMPOSSIBLE_TILT_DEG = 60.0  # of mean specific force from the vertical: mis-scaled and moving sensors stay within 5°
SINCE_1970_S = 1e8  # times above it are no seconds since a recording's start, but Unix time
SAME_TIME_S = 1e-4  # between times of one sample in two files: they are printed with four decimals and more


def read(path: Path, columns: ColumnMap, tables: dict[Path, TextTable] | None = None) -> ImportedLog:
    """Read the sensors that a column map names in the tables at ``path``: a file, a folder, or how their names begin.

    ``tables`` are those that have been read already, by path.

    Raises:
        FileFormatError: for tables that are malformed, or whose numbers cannot be what the map says.
        InputError: for files and columns that are missing, with the nearest name.
    """
    tables = {} if tables is None else dict(tables)
    notes: list[str] = []
    samples = read_samples(path, columns, tables, notes)
    streams = {
        name: _stream(f"{columns.source}: sensor '{name}'", name, entry, time, values, notes)
        for name, (entry, time, values) in samples.items()
    }
    check_turning(path, {name: entry for name, (entry, *_) in samples.items()}, streams, notes)
    notes = [note for table in tables.values() for note in table.notes] + notes
    start = float(min(stream.time[0] for stream in streams.values()))
    start_ns = round(start * 1e9) if start > SINCE_1970_S else 0
    imus = {name: replace(stream, time=stream.time - start) for name, stream in streams.items()}
    sites = default_sites(list(imus))
    return ImportedLog(FORMAT, imus, sites, start_ns=start_ns, clock_s=start, notes=merge_notes(notes))


Samples = tuple[SensorColumns, Array, dict[str, Array]]
"""Columns of a sensor, times ``(N,)`` in seconds, and rows ``(N, …)`` by quantity, in the units of the file."""


def read_samples(path: Path, columns: ColumnMap, tables: dict[Path, TextTable], notes: list[str]) -> dict[str, Samples]:
    """Read the samples of each sensor at their times, whatever their values are.

    Raises:
        FileFormatError, InputError: as :func:`read`.
    """
    log = _TableLog(path, columns, tables, notes)
    samples, periods = dict[str, Samples](), dict[str, float]()
    for name, entry, rows in log.sensors():
        samples[name], period_s = log.samples(name, entry, rows)
        if period_s is not None:
            periods[name] = period_s
    if periods:
        shifted = common_base([samples[name][1] for name in periods], max(periods.values()))
        if max(time[0] for time in shifted) > max(time[-1] - time[0] for time in shifted):
            notes.append("the sensors' packet counters were not set together: each sensor's times begin at 0")
            shifted = [time - time[0] for time in shifted]
        for name, time in zip(periods, shifted, strict=True):
            samples[name] = samples[name][0], time, samples[name][2]
    return samples


Rows = np.ndarray | None  # indices of the rows of one sensor, where all share a table


@dataclass
class _TableLog:
    """The tables at ``path``, each read once, and the clocks that sensors in the same rows share."""

    path: Path
    columns: ColumnMap
    tables: dict[Path, TextTable]
    notes: list[str]
    clocks: dict[tuple[object, ...], Clock] = field(default_factory=dict)

    def sensors(self) -> Iterator[tuple[str, SensorColumns, Rows]]:
        """Name, columns and rows of each sensor."""
        columns = self.columns
        if columns.sensor_column is not None:
            table = self.table(columns.common.file, columns.source)
            names = np.array(table.texts(table.index(columns.sensor_column, f"{columns.source}: sensor_column")))
            present = sorted(set(names))
            for name in columns.sensors or present:
                if name not in present:
                    raise InputError(
                        f"{columns.source}: no row of {table.path} is of sensor '{name}'{nearest(name, present)}"
                    )
                yield name, columns.sensors.get(name, columns.common), np.flatnonzero(names == name)
        elif columns.sensors:
            for name, entry in columns.sensors.items():
                yield name, entry, None
        else:
            files = candidates(self.path, SUFFIXES)
            if not files:
                raise FileFormatError(f"{self.path}: holds no table: expected files that end in {', '.join(SUFFIXES)}")
            for file in files:
                yield file.stem, structs.replace(columns.common, file=file.name), None

    def table(self, name: str | None, where: str) -> TextTable:
        """The table of a name in the log's folder, or the log itself without a name."""
        folder = self.path if self.path.is_dir() else self.path.parent
        if name is not None and not (folder / name).is_file():
            names = [file.name for file in candidates(folder, SUFFIXES)]
            raise InputError(f"{where}: file '{name}' is not in {folder}{nearest(name, names) if names else ''}")
        files = [self.path] if self.path.is_file() else candidates(self.path, SUFFIXES)
        if name is None and len(files) != 1:
            listing = ", ".join(file.name for file in files[:4]) or "none"
            raise InputError(
                f"{where}: file is missing, and {self.path} is not one table: expected its name; there are {listing}"
            )
        file = files[0] if name is None else folder / name
        if file not in self.tables:
            self.tables[file] = read_text_table(file, self.columns.dialect)
        return self.tables[file]

    def samples(self, name: str, entry: SensorColumns, rows: Rows) -> tuple[Samples, float | None]:
        """The samples of a sensor, and the period of the packet counter that timed them."""
        where = f"{self.columns.source}: sensor '{name}'"
        periods, sampled = list[float | None](), dict[str, Sampled]()
        for quantity in QUANTITIES:
            located: Columns | None = getattr(entry, quantity)
            if located is None:
                continue
            table = self.table(located.file or entry.file, where)
            indices = [table.index(column, f"{where}, {quantity}") for column in located.columns]
            key = table.path, entry.time, entry.time_unit, entry.counter, entry.rate_hz, None if rows is None else name
            if key not in self.clocks:
                self.clocks[key] = table_clock(table, entry, rows, where, self.notes)
            clock = self.clocks[key]
            periods.append(clock.period_s)
            sampled[quantity] = clock.time, table.numbers(indices)[clock.rows]
        return (entry, *_joined(where, sampled, self.notes)), periods[0]


def _joined(where: str, sampled: dict[str, Sampled], notes: list[str]) -> tuple[Array, dict[str, Array]]:
    """The quantities of a sensor at common times: the gyroscope's, where they have clocks of their own."""
    reference = "angular_rate" if "angular_rate" in sampled else next(iter(sampled))
    time, _ = sampled[reference]
    if all(len(t) == len(time) and np.allclose(t, time, rtol=0, atol=SAME_TIME_S) for t, _ in sampled.values()):
        return time, {quantity: values for quantity, (_, values) in sampled.items()}
    if (quaternion := sampled.get("quaternion")) is not None:
        sampled = {**sampled, "quaternion": (quaternion[0], continuous(quaternion[1]))}
    for quantity, (t, _) in sampled.items():
        if min(time[-1], t[-1]) - max(time[0], t[0]) < max(np.ptp(time), np.ptp(t)) / 2:
            raise FileFormatError(
                f"{where}: the times of {quantity}, {t[0]:g} to {t[-1]:g} s, are not those of the sensor's other file, "
                f"{time[0]:g} to {time[-1]:g} s: expected files of one recording"
            )
    interpolated = " and ".join(quantity for quantity in sampled if quantity != reference)
    notes.append(f"{where}: {interpolated} interpolated at the times of {reference}")
    return time, {quantity: values_at(pair, time, interpolate_points) for quantity, pair in sampled.items()}


def _stream(
    where: str, name: str, entry: SensorColumns, time: Array, values: Mapping[str, Array], notes: list[str]
) -> ImuStream:
    """The quantities in our units and frames, if they can be what the map says."""
    force, rate, quaternion = (values.get(key) for key in QUANTITIES)
    if force is not None:
        force = ACCELERATION_UNITS[entry.acceleration_unit] * force
    if rate is not None:
        rate = ANGULAR_RATE_UNITS[entry.angular_rate_unit] * rate
        fastest = float(np.nanmax(np.abs(rate[~rate_spikes(rate)]), initial=0.0))
        if fastest > RATE_LIMIT:
            raise FileFormatError(
                f"{where}: angular_rate reaches {fastest / ANGULAR_RATE_UNITS[entry.angular_rate_unit]:.3g} "
                f"{entry.angular_rate_unit}: expected at most {RATE_LIMIT:g} rad/s (4000 deg/s); check "
                "angular_rate_unit"
            )
    R = None
    if quaternion is not None:
        _check_length(where, quaternion)
        up = "z" if entry.world_up == UP_OR_DOWN else entry.world_up
        R = upright_rotations(quaternion, entry.quaternion_order, entry.quaternion_sense, up, where, notes)
        notes += [f"{where}: {TURNED_OVER}"] if up == "-z" and force is not None else []
    if force is not None and entry.gravity != GRAVITIES[0]:
        if R is None:
            raise FileFormatError(f"{where}: gravity is '{entry.gravity}': expected a quaternion, which restores it")
        force = force + np.einsum("nji,j->ni", R, GRAVITY * UP)
    if force is not None:
        calm = np.where(force_spikes(force)[:, None], np.nan, force)
        _check_force(where, entry, time, calm, rate, R, notes)
        if R is not None and entry.world_up == UP_OR_DOWN:
            R = z_up(name, R, force, notes)
        elif R is not None and quaternion is not None:
            _check_tilt(where, entry, quaternion, R, calm, notes)
    stream = ImuStream.from_samples(name, time, force, R, rate)
    if lost := len(time) - len(stream):
        notes.append(f"sensor '{name}': {lost} of {len(time)} samples with missing values, or impossible ones, dropped")
    return stream


def _check_force(
    where: str, entry: SensorColumns, time: Array, force: Array, rate: Array | None, R: Array | None, notes: list[str]
) -> None:
    """Specific force has to be gravity's at rest, or on average; else the unit is wrong, or gravity is left out.

    A sensor that is never at rest may measure anything: it is taken, with a note.
    """
    is_complete = np.all(np.isfinite(force), axis=1)
    if not np.any(is_complete):
        raise FileFormatError(f"{where}: acceleration holds no sample without a blank: expected numbers in its columns")
    at_rest = _force_at_rest(time[is_complete], force[is_complete])
    length = float(np.median(np.linalg.norm(force[is_complete], axis=1))) if at_rest is None else at_rest
    if _is_gravity(length) or (at_rest is None and _is_gravity(_mean_force(time, force, rate, R))):
        return
    raw, when = length / ACCELERATION_UNITS[entry.acceleration_unit], "on the median" if at_rest is None else "at rest"
    fits = [unit for unit, factor in ACCELERATION_UNITS.items() if _is_gravity(raw * factor)]
    size = f"acceleration is {raw:.3g} {entry.acceleration_unit} long {when}"
    if at_rest is None and not fits and length > GRAVITY_RANGE[0]:
        notes.append(f"{where}: {size}: it is never at rest, so nothing checks its unit")
        return
    hint = f"acceleration_unit '{fits[0]}' would fit" if fits else "is gravity left out, or is this no acceleration?"
    raise FileFormatError(
        f"{where}: {size}: expected about {GRAVITY / ACCELERATION_UNITS[entry.acceleration_unit]:.3g}, gravity "
        f"included; {hint}"
    )


def _force_at_rest(time: Array, force: Array) -> float | None:
    """Median length of specific forces ``(N, 3)`` in stretches at rest, in which they hardly vary; None without any."""
    rest_s, steady = 0.3, 0.05  # shorter ones are the turning points of a motion; a share of the length
    step = float(np.median(np.diff(time))) if len(time) > 1 else rest_s
    width = max(int(np.ceil(rest_s / step)), 3)
    if len(force) < width:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(force, width, axis=0)
    middle = windows.mean(axis=2)
    spread = np.linalg.norm(windows.std(axis=2), axis=1)
    length = np.linalg.norm(middle, axis=1)
    is_at_rest = spread < np.maximum(steady * length, 1e-3)
    return float(np.median(length[is_at_rest])) if np.any(is_at_rest) else None


def _is_gravity(size: float) -> bool:
    return GRAVITY_RANGE[0] <= size <= GRAVITY_RANGE[1]


def _mean_force(time: Array, force: Array, rate: Array | None, R: Array | None) -> float:
    """Length of the mean specific force in an inertial frame, where what jumps and throws add cancels out.

    By angular rates, where there are any: how quaternions are to be read is not settled yet. 0 if nothing tells.
    """
    try:
        stream = with_orientation(ImuStream.from_samples("", time, force, R if rate is None else None, rate))
    except RecordingError:
        return 0.0
    assert stream.R_inertial_sensor is not None
    assert stream.specific_force is not None
    return float(np.linalg.norm(np.einsum("nij,nj->i", stream.R_inertial_sensor, stream.specific_force)) / len(stream))


def _check_length(where: str, quaternion: Array) -> None:
    length = np.linalg.norm(quaternion[np.all(np.isfinite(quaternion), axis=1)], axis=1)
    if not len(length):
        raise FileFormatError(f"{where}: quaternion holds no sample without a blank: expected numbers in its columns")
    usual = float(np.median(length))
    if abs(usual - 1) > UNIT_TOLERANCE:
        raise FileFormatError(f"{where}: median length of the quaternion {usual:.3g}: expected 1; check its columns")


def _check_tilt(where: str, entry: SensorColumns, quaternion: Array, R: Array, force: Array, notes: list[str]) -> None:
    """Specific force has to point up in the quaternions' world on the whole."""
    tilt = tilt_of_up(R, force)
    if not tilt > TILT_LIMIT_DEG:
        return
    best, best_tilt = best_reading(quaternion, force)
    keys = ("quaternion_order", "quaternion_sense", "world_up")
    fits = ", ".join(f"{key} '{word}'" for key, word in zip(keys, best, strict=True) if word != getattr(entry, key))
    hint = f"with {fits} it would be {best_tilt:.0f}° off" if fits and best_tilt < tilt / 2 else "is its sign turned?"
    sentence = f"the mean acceleration is {tilt:.0f}° off the vertical of the quaternion's frame: {hint}"
    if tilt > IMPOSSIBLE_TILT_DEG:
        raise FileFormatError(f"{where}: {sentence}")
    notes.append(f"{where}: {sentence}")
