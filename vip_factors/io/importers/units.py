"""Units and clocks that the numbers of a table suggest: guessed for a column map, and checked in a conversion.

Units follow from gravity's length, and from how fast the vertical turns against the gyroscope; acceleration and
quaternion together give the quaternion's order, sense and upward axis.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from msgspec import structs

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array, angle_between, log, transpose
from vip_factors.io.importers.clocks import BODY_RATES_HZ, column_times, counter_column, stated_rate
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
from vip_factors.io.importers.shared import rotations_or_nan
from vip_factors.io.importers.text_table import TextTable, number, split
from vip_factors.sensors.imu_stream import ImuStream

# A worn sensor's specific force is 9.8 m/s² on the median, within the worst scale errors seen (22 %) and brisk motion.
GRAVITY_RANGE = (5.0, 20.0)
R_UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-z": np.diag([1.0, -1.0, -1.0]),
}  # from the quaternions' world to one whose z is up
TURNED_OVER = (
    "the quaternions' world is turned over (world_up '-z'); if their z axis points up in truth, the acceleration has "
    "the opposite sign: change the sign in the log, and use world_up 'z'"
)
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
    table = replace(table, rows=table.rows[:USED_ROWS], lines=table.lines[:USED_ROWS])
    try:
        return table.numbers([table.index(name, "guess") for name in names])
    except FileFormatError:
        return None


def guess_clock(table: TextTable) -> tuple[SensorColumns, dict[str, float]]:
    """Guess the clock of a table, and the rates in Hz by unit that its times may have, the likeliest first.

    Raises:
        FileFormatError: if a column of times has a cell that is none; its line is named.
    """
    counter, stated = counter_column(table), stated_rate(table)
    table = replace(table, rows=table.rows[:USED_ROWS], lines=table.lines[:USED_ROWS])
    clock = SensorColumns(counter=None if counter is None else table.names[counter])
    first = split(table.rows[0], table.separator)
    for name in sorted((name for name in table.names if _rank(name) <= len(_TIMES)), key=_rank):
        column = table.names.index(name)
        is_number = number(first[column].replace(",", ".")) is not None
        if table.names.count(name) > 1 or not (is_number or re.search(r":|\d\.\d\d\.\d", first[column])):
            continue
        time = column_times(table, column, "s")
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
    hertz = f"{rates[unit]:.4g}"
    if BODY_RATES_HZ[0] <= rates[unit] <= BODY_RATES_HZ[1]:
        return unit, f"{hertz} samples a second as {unit}"
    return unit, f"{hertz} SAMPLES A SECOND as {unit}: {PLEASE_DECLARE} time_unit, or rate_hz instead of time"


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
        verdict = f", so {unit}" if unit else ": NEITHER m/s2, g NOR mg WITH GRAVITY, please look"
        reasons.append(f"acceleration: median length {length:.4g}{verdict}")
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
    slope = 0.0 if time is None or force is None else abs(_turning(time, force, rate) or 0.0)
    if slope > LEAST_SLOPE:
        reason = f"read as rad/s it turns {1 / slope:.2g} times as fast as gravity's direction does"
        return "deg/s" if slope < DEGREES_SLOPE else "rad/s", reason
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


def upright_rotations(
    quaternion: Array, order: str, sense: str, up: str, where: str = "", notes: list[str] | None = None
) -> Array:
    """Orientations ``(N, 3, 3)`` in a world whose z is up, of quaternions ``(N, 4)``; NaN where a row is missing.

    Raises:
        FileFormatError: if most rows are not of unit length.
    """
    R = rotations_or_nan(quaternion, Order(order), where, [] if notes is None else notes)
    return R_UP[up] @ (R if sense == SENSES[0] else transpose(R))


def best_reading(quaternion: Array, force: Array) -> tuple[tuple[str, str, str], float]:
    """Order, sense and upward axis under which specific force points up most steadily, and its mean tilt in degrees.

    Args:
        quaternion: ``(N, 4)``; rows with NaN do not count.
        force: ``(N, 3)`` specific force, in any unit.
    """
    is_complete = np.all(np.isfinite(quaternion), axis=1) & np.all(np.isfinite(force), axis=1)
    quaternion, force = quaternion[is_complete], force[is_complete]
    direction = force / np.linalg.norm(force, axis=1, keepdims=True).clip(1e-9)
    tilts: dict[tuple[str, str, str], float] = {}
    for reading in product((order.value for order in Order), SENSES, UPS):
        upward = np.einsum("nij,nj->ni", upright_rotations(quaternion, *reading), direction)[:, 2]
        tilts[reading] = float(np.rad2deg(np.mean(np.arccos(np.clip(upward, -1, 1)))))
    best = min(tilts, key=tilts.__getitem__)
    return best, tilts[best]


def check_turning(
    path: Path, entries: Mapping[str, SensorColumns], streams: Mapping[str, ImuStream], notes: list[str]
) -> None:
    """Refuse angular rates that do not turn as far as orientations; note those at frequencies of no body."""
    tolerated, near = 2.0, 1.1  # factors: of filters that lag and wrong axes; of units that explain it
    fastest_hz = 12.0  # half of what gyroscopes measured of walks, jumps and gestures was below 0.4 to 6 Hz
    halves = [hz for stream in streams.values() if (hz := turning_hz(stream)) is not None]
    if halves and (half := float(np.median(halves))) > fastest_hz:
        notes.append(f"{path.name}: gyroscopes turn at {half:.3g} Hz, people's are below 6 Hz: check time_unit")
    scales = {name: scale for name, stream in streams.items() if (scale := turning_scale(stream)) is not None}
    scale = float(np.median(list(scales.values()))) if scales else 1.0
    if 1 / tolerated < scale < tolerated:
        return
    entry, rate, factors = entries[name := next(iter(scales))], streams[name].rate / scale, dict[str, float]()
    is_timed = entry.time is not None and entry.rate_hz is None
    for key, units in (("angular_rate_unit", ANGULAR_RATE_UNITS), *[("time_unit", TIME_UNITS)] * is_timed):
        factors |= {f"{key} '{unit}'": factor / units[getattr(entry, key)] for unit, factor in units.items()}
    factors |= {"ticks of 1/32768 s": 1 / 32_768 / TIME_UNITS[entry.time_unit]} if is_timed else {}
    fits = [words for words, factor in factors.items() if 1 / near < factor / scale < near]
    fits += [f"rate_hz {rate:.4g}{' instead of time' * is_timed}"] * (BODY_RATES_HZ[0] <= rate <= BODY_RATES_HZ[1])
    raise FileFormatError(
        f"{path}: orientations turn {scale:.3g} times as far as angular rates say, at {rate * scale:.4g} samples a "
        f"second: expected as far; {' or '.join(fits) or 'no known unit'} would fit"
    )


def turning_hz(stream: ImuStream) -> float | None:
    """Frequency below which half of the power of the angular rate lies; None for a sensor that hardly turns."""
    from scipy.signal import periodogram  # late: it takes long to import

    least = 0.2  # rad/s, standard deviation: less may be noise, which has no frequency
    if stream.angular_rate is None or np.linalg.norm(np.std(stream.angular_rate, axis=0)) < least:
        return None
    hertz, power = periodogram(stream.angular_rate, stream.rate, axis=0)
    below = np.cumsum(power.sum(axis=1))
    return float(hertz[np.searchsorted(below, below[-1] / 2)])


def turning_scale(stream: ImuStream) -> float | None:
    """Ratio of the turns by orientations and by angular rates, the median over the steps that turn most, or None."""
    span, fewest, least = 4, 20, 0.02  # samples, as some makers repeat orientations; steps; rad, more than noise
    R, rate = stream.R_inertial_sensor, stream.angular_rate
    if R is None or rate is None or len(stream) <= span + 1:
        return None
    swept = np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(stream.time)[:, None], axis=0)
    by_rate, turned = np.linalg.norm(swept[span:] - swept[:-span], axis=1), angle_between(R[1:-span], R[1 + span :])
    is_turning = turned >= max(least, float(np.quantile(turned, 0.75, method="lower")))
    if np.sum(is_turning) < fewest:
        return None
    return float(np.median(turned[is_turning] / np.maximum(by_rate[is_turning], 1e-9)))
