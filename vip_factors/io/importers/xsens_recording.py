"""Several Xsens tables, one per sensor, on one time base: what the MTw and DOT readers share."""

from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.packet_clock import (
    CLOCK_MODULUS,
    COUNTER_MODULUS,
    PLAUSIBLE_RATE_HZ,
    SAME_RATE,
    Packets,
    clock_tick,
    common_base,
    order_packets,
    unwrap,
)
from vip_factors.io.importers.sensor_table import SensorTable, read_table
from vip_factors.io.importers.shared import ImportedLog, default_sites, merge_notes
from vip_factors.io.importers.xsens_channels import channels
from vip_factors.sensors.imu_stream import ImuStream

DEFAULT_RATE_HZ = 100.0  # of an MTw Awinda with up to nine sensors, and of every export seen without a rate


def import_tables(path: Path, format_name: str, files: dict[str, Path], gyr_unit: float) -> ImportedLog:
    """Read one file per sensor and put all on one clock; ``gyr_unit`` is the angular rate's unit in rad/s.

    Raises:
        FileFormatError: where a file is malformed or empty, or the files state different rates.
    """
    tables = {sensor: read_table(file) for sensor, file in files.items()}
    packets = {sensor: _packets(table) for sensor, table in tables.items()}
    notes = [note for table in tables.values() for note in table.notes]
    notes += [note for one in packets.values() for note in one.notes]
    times = _times(path, tables, packets, notes)
    imus = {}
    for sensor, table in tables.items():
        found = channels(table, gyr_unit)
        notes += found.notes
        rows = packets[sensor].rows
        force, R, rate = (
            None if values is None else values[rows]
            for values in (found.specific_force, found.R_inertial_sensor, found.angular_rate)
        )
        imus[sensor] = ImuStream.from_samples(sensor, times[sensor], force, R, rate)
        if lost := len(rows) - len(imus[sensor]):
            notes.append(f"{table.path.name}: {lost} samples with missing values dropped")
    return ImportedLog(format_name, imus, default_sites(list(imus)), notes=merge_notes(notes))


def _packets(table: SensorTable) -> Packets:
    counter, name = table.columns.get("PacketCounter"), table.path.name
    if counter is None:
        rows = np.arange(len(table))
        return Packets(rows, rows, (f"{name}: no PacketCounter, so lost packets cannot be seen",))
    wide = np.nanmax(counter) >= COUNTER_MODULUS
    return order_packets(counter, name, CLOCK_MODULUS if wide else COUNTER_MODULUS)


def _times(
    path: Path, tables: dict[str, SensorTable], packets: dict[str, Packets], notes: list[str]
) -> dict[str, Array]:
    """Seconds from the earliest sample of any file, for each file's kept rows."""
    stated = {sensor: rate for sensor, table in tables.items() if (rate := _stated_rate(table)) is not None}
    by_clock = _clock_times(tables, packets, stated, notes)
    if by_clock is not None:
        return by_clock
    slow, fast = (pick(stated, key=stated.__getitem__, default=None) for pick in (min, max))
    if slow and fast and stated[fast] > stated[slow] * (1 + SAME_RATE):
        raise FileFormatError(
            f"{path}: {tables[slow].path.name} says {stated[slow]:g} Hz and {tables[fast].path.name} {stated[fast]:g} "
            "Hz: expected one rate for all files of a recording; import them apart"
        )
    rate = stated[fast] if fast else DEFAULT_RATE_HZ
    if not fast:
        notes.append(f"{path.name}: no file says its update rate; {rate:g} Hz assumed")
    counts = common_base([one.count for one in packets.values()], COUNTER_MODULUS)
    return {sensor: count / rate for sensor, count in zip(packets, counts, strict=True)}


def _stated_rate(table: SensorTable) -> float | None:
    text = table.setting(r"(?:update|output|sample)\s*rate\s*:?\s*,?\s*(\d+(?:\.\d+)?)\s*hz")
    rate = float(text) if text else 0.0
    return rate if PLAUSIBLE_RATE_HZ[0] <= rate <= PLAUSIBLE_RATE_HZ[1] else None


def _clock_times(
    tables: dict[str, SensorTable], packets: dict[str, Packets], stated: dict[str, float], notes: list[str]
) -> dict[str, Array] | None:
    """Times by SampleTimeFine, or None where a file lacks it or the clocks have nothing in common."""
    clocks, ticks, said = [], set(), []
    for sensor, table in tables.items():
        column, rows = table.columns.get("SampleTimeFine"), packets[sensor].rows
        if column is None or not np.all(np.isfinite(column[rows])):
            return None
        found = clock_tick(column[rows], packets[sensor].count)
        clock = unwrap(column[rows], CLOCK_MODULUS)
        if found is None or np.any(np.diff(clock) <= 0):
            return None
        clocks.append(clock)
        ticks.add(found[0])
        if sensor in stated and abs(found[1] / stated[sensor] - 1) > SAME_RATE:
            said.append(
                f"{table.path.name}: says {stated[sensor]:g} Hz, but its SampleTimeFine runs at {found[1]:.2f} Hz; "
                "the clock is believed"
            )
    if len(ticks) > 1:
        return None
    tick = ticks.pop()
    aligned = common_base(clocks, CLOCK_MODULUS)
    # A sensor that starts after the longest recording could have ended was never on the others' clock.
    if max(clock[0] for clock in aligned) > max(clock[-1] - clock[0] for clock in aligned):
        notes.append("the sensors' clocks (SampleTimeFine) were not set together; packet counters are used instead")
        return None
    notes += said
    return {sensor: clock * tick for sensor, clock in zip(tables, aligned, strict=True)}
