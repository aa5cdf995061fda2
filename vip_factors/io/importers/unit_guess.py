"""First guesses of a table's clock and units, for a column map that its owner then corrects.

The clock is a column of times with its unit, a packet counter, and the stated rate. Units follow from gravity's length,
and from how fast the vertical turns against the gyroscope; acceleration and quaternion together give the quaternion's
order, sense and upward axis.
"""

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from msgspec import structs

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.io.importers.clocks import BODY_RATES_HZ, column_times, stated_rate
from vip_factors.io.importers.column_map import (
    ACCELERATION_UNITS,
    ANGULAR_RATE_UNITS,
    PLAUSIBLE_RATES_HZ,
    QUANTITIES,
    SENSES,
    TIME_UNITS,
    UPS,
    Columns,
    SensorColumns,
)
from vip_factors.io.importers.packet_counters import counter_column
from vip_factors.io.importers.table import GRAVITY_RANGE, TURNED_OVER, best_reading, upright_rotations
from vip_factors.io.importers.text_table import TextTable, number, split

_TIMES = ("time", "timestamp", "t", "seconds", "sec", "elapsed", "epoch", "clock", "datetime", "date", "ticks", "tick")
_TIME_UNIT_NAMES = {
    "s": r"s|sec\w*",
    "ms": r"ms|m ?sec\w*|milli\w*",
    "us": r"[uµμ]s|micro\w*",
    "ns": r"ns|nano\w*",
    "days": "days?",
}
GROWING = 0.1  # of the steps of times that fall somewhere, at least, and at most fall: of many sensors most repeat
USED_ROWS = 20000  # enough to tell units; a day's log need not be read twice
STATED_TOLERANCE = 0.2
PLEASE_DECLARE = "PLEASE DECLARE"  # what follows, in reasons for guesses
CONSISTENT = 1.6  # factor by which motion may disagree with a unit of time that it decides
DEGREES_SLOPE = 0.13  # between 1 and π/180, in the geometric middle
LEAST_SLOPE = 0.004  # a slope below it is that of a sensor that hardly moved
TURN_S = 0.25  # of a turn of the vertical: long against impacts, short against strides
GRAVITY_FREE_DEG = 45.0  # of acceleration from the vertical in the mean: with gravity it is less, at any motion
FASTEST_BODY = 20.0  # rad/s: feet and hands of people who walk stay below; larger numbers are degrees


def first_numbers(table: TextTable, names: tuple[str | int, ...]) -> Array | None:
    """Columns of the first :data:`USED_ROWS` rows ``(N, len(names))``; None if a cell is no number."""
    try:
        return _shortened(table).numbers([table.index(name, "guess") for name in names])
    except FileFormatError:
        return None


def _shortened(table: TextTable) -> TextTable:
    return replace(table, rows=table.rows[:USED_ROWS], lines=table.lines[:USED_ROWS])


def guess_clock(table: TextTable) -> tuple[SensorColumns, dict[str, float]]:
    """Guess the clock of a table, and the rates in Hz by unit that its times may have, the likeliest first.

    Raises:
        FileFormatError: if a column of times has a cell that is none; its line is named.
    """
    counter, stated = counter_column(table), stated_rate(table)
    clock = SensorColumns(counter=None if counter is None else table.names[counter])
    first = split(table.rows[0], table.separator)
    for name in sorted((name for name in table.names if _rank(name) <= len(_TIMES)), key=_rank):
        column = table.names.index(name)
        is_number = number(first[column].replace(",", ".")) is not None
        if table.names.count(name) > 1 or not (is_number or re.search(r":|\d\.\d\d\.\d", first[column])):
            continue
        time = column_times(_shortened(table), column, "s")
        steps = np.diff(time[np.isfinite(time)])
        falls = np.sum(steps < 0) / max(len(steps), 1)
        if falls > GROWING or np.sum(steps > 0) < (GROWING * len(steps) if falls else 1):
            continue
        rate = np.median(np.unique(time, return_counts=True)[1]) / np.median(steps[steps > 0])
        rates = {unit: float(rate) / factor for unit, factor in TIME_UNITS.items() if is_number or unit == "s"}
        words = _spaced(f"{name} {table.units[column] if table.units else ''}")
        return structs.replace(clock, time=name), _likely(words, rates, stated)
    return structs.replace(clock, rate_hz=stated), {}


def _likely(words: str, rates: dict[str, float], stated: float | None) -> dict[str, float]:
    """The rates that are near the stated one, or a body's; in the unit that words name, if any; else the nearest."""
    low, high = BODY_RATES_HZ
    if stated is not None:
        low, high = stated * (1 - STATED_TOLERANCE), stated * (1 + STATED_TOLERANCE)
    fits = {unit: rate for unit, rate in rates.items() if low <= rate <= high}
    low, high = PLAUSIBLE_RATES_HZ
    spelt = {unit for unit, names in _TIME_UNIT_NAMES.items() if re.search(rf"(?i)(?<![a-z])({names})(?![a-z])", words)}
    named = {unit: rate for unit, rate in rates.items() if low <= rate <= high and unit in spelt}
    both = {unit: rate for unit, rate in fits.items() if unit in named}
    nearest = min(rates, key=lambda unit: abs(np.log(rates[unit] / 100)))
    return both or {**named, **fits} or {nearest: rates[nearest]}


def _spaced(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", name)


def _rank(name: str) -> int:
    """Place in the order of the words for times; beyond them for words that begin or end in one."""
    words = re.split(r"[^a-z]+", _spaced(name).lower())
    is_composed = any(re.search(r"^time(?!r|out|zone)|time(stamp)?$|timefine$", word) for word in words)
    return min((_TIMES.index(word) for word in words if word in _TIMES), default=len(_TIMES) + (not is_composed))


def time_unit(
    rates: dict[str, float], rate_unit: str, time: Array | None, values: Mapping[str, Array | None]
) -> tuple[str, str]:
    """Choose the unit of times, with the reason: the motion, where rates do not decide.

    Args:
        rates: in Hz by unit, the likeliest first.
        rate_unit: unit of angular rates as the file names it, blank if it does not.
        time: ``(N,)`` in the file's unit.
        values: ``(N, …)`` by quantity, in the units of the file.
    """
    unit = next(iter(rates))
    force, rate = values.get("acceleration"), values.get("angular_rate")
    if len(rates) > 1:
        misfit = dict[str, float]()
        if force is not None and rate is not None and time is not None:
            slopes = [factor for name, factor in ANGULAR_RATE_UNITS.items() if rate_unit in (name, "")]
            for candidate in rates:
                slope = max(_turning(TIME_UNITS[candidate] * time, force, rate) or 0.0, 1e-9)
                misfit[candidate] = min(abs(np.log(slope / expected)) for expected in slopes)
        best = min(misfit, key=misfit.__getitem__, default=unit)
        if sum(value < 2 * np.log(CONSISTENT) for value in misfit.values()) == 1 and misfit[best] < np.log(CONSISTENT):
            return best, f"{rates[best]:.4g} samples a second as {best}, as gravity's direction turns"
        choices = " or ".join(f"{candidate} ({hertz:.4g} Hz)" for candidate, hertz in rates.items())
        return unit, f"{choices}: {PLEASE_DECLARE} time_unit"
    if BODY_RATES_HZ[0] <= rates[unit] <= BODY_RATES_HZ[1]:
        return unit, f"{rates[unit]:.4g} samples a second as {unit}"
    return (
        unit,
        f"{rates[unit]:.4g} SAMPLES A SECOND as {unit}: {PLEASE_DECLARE} time_unit, or rate_hz instead of time",
    )


def with_units(
    entry: SensorColumns, rate_unit: str, time: Array | None, values: Mapping[str, Array | None]
) -> tuple[SensorColumns, list[str]]:
    """Add the units that a sensor's numbers suggest to its columns, with a reason each.

    Args:
        entry: the sensor's columns.
        rate_unit: unit of angular rates as the file names it, blank if it does not.
        time: ``(N,)`` in seconds, if known.
        values: ``(N, …)`` by quantity, in the units of the file.
    """
    force, rate, quaternion = (values.get(quantity) for quantity in QUANTITIES)
    reasons = []
    if force is not None:
        length = _median_length(force)
        low, high = GRAVITY_RANGE
        unit = next((name for name, factor in ACCELERATION_UNITS.items() if low <= length * factor <= high), None)
        reason = f"acceleration: median length {length:.4g}"
        reasons.append(
            f"{reason}, so {unit}" if unit else f"{reason}: NEITHER m/s2, g NOR mg WITH GRAVITY, please look"
        )
        entry = structs.replace(entry, acceleration_unit=unit or "m/s2")
    if rate is not None:
        unit, reason = _rate_unit(rate_unit, time, force, rate)
        reasons.append(f"angular rate: {reason}, so {unit}")
        entry = structs.replace(entry, angular_rate_unit=unit)
    if quaternion is not None:
        reasons.append(f"quaternion: median length {_median_length(quaternion):.3g}")
    if quaternion is None or force is None:
        return entry, reasons
    (order, sense, up), tilt_deg = best_reading(quaternion, force)
    if tilt_deg > GRAVITY_FREE_DEG and time is not None and rate is not None:
        sense = _sense(quaternion, time, rate)
        reasons.append(
            f"acceleration is {tilt_deg:.0f}° off the vertical at best, SO GRAVITY IS LEFT OUT; the angular rates "
            f"show that the quaternion is {sense}; please check acceleration_unit"
        )
        return structs.replace(entry, acceleration_unit="m/s2", gravity="left out", quaternion_sense=sense), reasons
    reasons.append(f"with {order}, {sense} and {up} up, the acceleration is {tilt_deg:.0f}° off the vertical")
    reasons += [TURNED_OVER] if up == "-z" else []
    return structs.replace(entry, quaternion_order=order, quaternion_sense=sense, world_up=up), reasons


def _sense(quaternion: Array, time: Array, rate: Array) -> str:
    """The sense in which quaternions ``(N, 4)``, w first, turn as the angular rates ``(N, 3)`` have it."""
    R = upright_rotations(quaternion, Order.WXYZ.value, SENSES[0], UPS[0])
    agreement = []
    for R_world_sensor in (R, transpose(R)):
        turned = log(transpose(R_world_sensor[:-1]) @ R_world_sensor[1:]) / np.diff(time)[:, None]
        agreement.append(float(np.nansum(turned * (rate[1:] + rate[:-1]))))
    return SENSES[int(np.argmax(agreement))]


def _median_length(values: Array) -> float:
    return float(np.nan_to_num(np.nanmedian(np.linalg.norm(values, axis=1)))) if len(values) else 0.0


def name_of_rate_unit(table: TextTable, location: Columns | None) -> str:
    """Unit of angular rates that their columns' names, or a line of units below them, give; blank if neither does."""
    if location is None:
        return ""
    units = [table.units[table.index(name, "guess")] for name in location.columns] if table.units else []
    words = " ".join(map(str, (*location.columns, *units))).lower()
    return "deg/s" if re.search(r"deg|dps|°", words) else "rad/s" if "rad" in words else ""


def _rate_unit(named: str, time: Array | None, force: Array | None, rate: Array) -> tuple[str, str]:
    """The unit of angular rate, and the reason."""
    if named:
        return named, f"the names or units of its columns say {named}"
    slope = None if time is None or force is None else _turning(time, force, rate)
    if slope is not None and abs(slope) > LEAST_SLOPE:
        return ("deg/s" if abs(slope) < DEGREES_SLOPE else "rad/s"), (
            f"read as rad/s it turns {1 / abs(slope):.2g} times as fast as gravity's direction does"
        )
    fastest = float(np.nanquantile(np.abs(rate), 0.99))
    return ("deg/s" if fastest > FASTEST_BODY else "rad/s"), f"rarely above {fastest:.3g}"


def _turning(time: Array, force: Array, rate: Array) -> float | None:
    """Rate at which the direction of specific force turns over the angular rate: 1 if that is in radians per second.

    A vector that stands still in the world turns by −ω × u in the sensor; limbs' accelerations add noise to the left
    side of that regression only.
    """
    is_complete = np.all(np.isfinite(np.column_stack([time, force, rate])), axis=1)
    time, force, rate = time[is_complete], force[is_complete], rate[is_complete]
    if len(time) < 3:
        return None
    step = np.diff(time)
    direction = force / np.linalg.norm(force, axis=1, keepdims=True).clip(1e-9)
    turning = -np.cross((rate[1:] + rate[:-1]) / 2, (direction[1:] + direction[:-1]) / 2) * step[:, None]
    stride = max(1, round(TURN_S / max(float(np.median(step)), 1e-6)))
    predicted = np.diff(np.cumsum(turning, axis=0)[::stride], axis=0)
    measured = np.diff(direction[1::stride], axis=0)
    energy = float(np.sum(predicted**2))
    return float(np.sum(predicted * measured)) / energy if energy > 0 else None
