"""A first guess of what the columns of an unknown table mean: from their names, then from the numbers below them.

Names tell sensor, quantity and axis (``LF_acc_x``, ``Acc X [g]``, ``pelvis.gyro.z``, ``ax``, ``qw``). Numbers tell the
units: gravity's length, how fast the vertical turns against the gyroscope, how far apart the times are; with both
acceleration and quaternion also the quaternion's order, sense and upward axis.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from msgspec import structs

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.column_map import ACCELERATION_UNITS, QUANTITIES, TIME_UNITS, Columns, SensorColumns
from vip_factors.io.importers.table import GRAVITY_RANGE, best_reading
from vip_factors.io.importers.text_table import TextTable

_WORDS = {
    "acceleration": r"acc|accel|acceleration|accelerometer|specificforce",
    "angular_rate": r"gyr|gyro|gyros|gyroscope|angvel|angularvelocity|angularrate|omega|turnrate",
    "quaternion": r"quat|quaternion|orientation|orient|ori|rot",
    "ignored": r"mag|magn|magnet|magnetometer|freeacc|linacc|euler|roll|pitch|yaw|temp|temperature|baro|pressure",
}
UNIT_KEYS = {
    "acceleration": ("acceleration_unit",),
    "angular_rate": ("angular_rate_unit",),
    "quaternion": ("quaternion_order", "quaternion_sense", "world_up"),
}
_LETTERS = {"a": "acceleration", "g": "angular_rate", "w": "angular_rate", "q": "quaternion", "m": "ignored"}
_UNITS = {"g", "mg", "ms2", "mps2", "dps", "degs", "rads", "radps", "deg", "rad", "s", "ms", "us", "ut", "si", "raw"}
_TIMES = ("time", "timestamp", "t", "seconds", "sec", "elapsed", "sampletimefine", "epoch", "unixtime", "clock")
_AXES = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}
_STEPS = {"s": (5e-4, 0.25), "ms": (0.5, 250.0), "us": (500.0, 2.5e5), "ns": (5e5, 2.5e8)}  # 4 to 2000 Hz
GROWING = 0.1  # of the steps of time, at least: where rows of many sensors take turns, most have the one before
USED_ROWS = 20000  # enough to tell units; a day's log need not be read twice
DEGREES_SLOPE = 0.13  # between 1 and π/180, in the geometric middle
SLOWEST_TOLD = 0.004  # a slope below it is that of a sensor that hardly moved
TURN_S = 0.25  # of a turn of the vertical: long against impacts, short against strides
FASTEST_BODY = 20.0  # rad/s: feet and hands of people who walk stay below; larger numbers are degrees


def guess_columns(table: TextTable) -> dict[str, tuple[SensorColumns, list[str]]]:
    """The sensors whose acceleration, angular rate or quaternion the names of the columns tell, by name.

    Each with the units that the numbers suggest, and what each guess was made from, a phrase each. The name is blank if
    the columns name no sensor.
    """
    found: dict[str, dict[str, dict[str, str]]] = {}
    for name in table.names:
        told = meaning(name)
        if told is not None and table.names.count(name) == 1:
            sensor, quantity, axis = told
            found.setdefault(sensor, {}).setdefault(quantity, {}).setdefault(axis, name)
    if not found and all(axis in table.names for axis in _AXES[4]):
        found = {"": {"quaternion": {axis: axis for axis in _AXES[4]}}}  # four columns w, x, y, z and no other words
    time, unit = _time(table)
    sensors, reasons = {}, {}
    for sensor, quantities in found.items():
        columns = {quantity: _complete(axes, QUANTITIES[quantity]) for quantity, axes in quantities.items()}
        whole = {quantity: Columns(names) for quantity, names in columns.items() if names is not None}
        if whole:
            entry = SensorColumns(time=time, time_unit=unit, **whole)  # type: ignore[arg-type]
            sensors[sensor], reasons[sensor] = with_units(table, entry)
    return {name: (entry, reasons[name]) for name, entry in _agreeing(sensors).items()}


def _agreeing(sensors: Mapping[str, SensorColumns]) -> dict[str, SensorColumns]:
    """The sensors with the units of most of them: one logger writes one unit."""
    agreed: dict[str, Any] = {}
    for quantity, keys in UNIT_KEYS.items():
        having = [one for one in sensors.values() if getattr(one, quantity) is not None]
        votes = Counter(tuple(getattr(one, key) for key in keys) for one in having)
        agreed |= dict(zip(keys, votes.most_common(1)[0][0], strict=True)) if votes else {}
    return {name: structs.replace(one, **agreed) for name, one in sensors.items()}


def meaning(name: str) -> tuple[str, str, str] | None:
    """Sensor, quantity and axis that the name of a column tells, None if it is none of ours."""
    bare = re.sub(r"[\[(]\s*([^\])]{2,}|g)\s*[\])]", " ", name)  # units in brackets
    bare = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", bare)
    bare = re.sub(r"(?i)\b(angular|specific|linear|free|turn)[ _.-]+(velocity|rate|force|acc\w*)\b", r"\1\2", bare)
    words = [word for word in re.split(r"[^A-Za-z0-9]+", bare) if word]
    quantity, axis, rest = "", "", []
    for word in words:
        kind, letter = _word(word)
        if kind and not quantity:
            quantity, axis = kind, letter or axis
        elif quantity and not axis and re.fullmatch(r"(?i)q?[wxyzs0-4]", word):
            axis = word[-1].lower()
        elif quantity == "quaternion" and kind == "quaternion" and letter:
            axis = letter
        elif not (word.lower() in _UNITS and (quantity or axis)):
            rest.append(word)
    if quantity not in QUANTITIES or not axis:
        return None
    return "_".join(rest), quantity, "w" if axis == "s" else axis


def _word(word: str) -> tuple[str, str]:
    """The quantity that a word names, and the axis if it ends in one: ``accX``, ``gz``, ``q0``."""
    lower = word.lower()
    for quantity, names in _WORDS.items():
        if found := re.fullmatch(rf"({names})s?([wxyz0-4]?)", lower):
            return quantity, found.group(2)
    found = re.fullmatch(r"([agwqm])([wxyz0-4])", lower)
    return (_LETTERS[found.group(1)], found.group(2)) if found else ("", "")


def _complete(axes: Mapping[str, str], count: int) -> tuple[str, ...] | None:
    """The columns of all axes in order, by letters, or by numbers from 0 or 1 on."""
    for first in ("letters", 0, 1):
        keys = _AXES[count] if first == "letters" else tuple(str(int(first) + i) for i in range(count))
        if all(key in axes for key in keys):
            return tuple(axes[key] for key in keys)
    return None


def _time(table: TextTable) -> tuple[str | None, str]:
    """The column of times, and the unit in which samples come 4 to 2000 times a second."""
    for name in sorted(table.names, key=lambda one: _time_rank(one)):
        if _time_rank(name) == len(_TIMES) or table.names.count(name) > 1:
            continue
        values = _numbers(table, [name])
        if values is None:
            continue
        steps = np.diff(values[np.isfinite(values[:, 0]), 0])
        growing = steps[steps > 0]
        if len(growing) < max(1, GROWING * len(steps)) or np.any(steps < 0):
            continue
        usual = float(np.median(growing))
        for unit, (low, high) in _STEPS.items():
            if low <= usual < high:
                return name, unit
    return None, "s"


def _time_rank(name: str) -> int:
    words = re.split(r"[^a-z]+", name.lower())
    return min((_TIMES.index(word) for word in words if word in _TIMES), default=len(_TIMES))


def _numbers(table: TextTable, names: Sequence[str | int]) -> Array | None:
    short = replace(table, rows=table.rows[:USED_ROWS], lines=table.lines[:USED_ROWS])
    try:
        return short.numbers([short.index(name, "guess") for name in names])
    except FileFormatError:
        return None


def with_units(table: TextTable, entry: SensorColumns) -> tuple[SensorColumns, list[str]]:
    """The entry with the units that its numbers suggest, and what they were guessed from."""
    force, rate, quaternion = (
        None if at is None else _numbers(table, at.columns)
        for at in (entry.acceleration, entry.angular_rate, entry.quaternion)
    )
    reasons = []
    if force is not None:
        usual = _usual_length(force)
        unit = next(
            (one for one, by in ACCELERATION_UNITS.items() if GRAVITY_RANGE[0] <= usual * by <= GRAVITY_RANGE[1]), None
        )
        told = f"acceleration: {usual:.4g} long on the median"
        reasons.append(f"{told}, so {unit}" if unit else f"{told}: NEITHER m/s2, g NOR mg WITH GRAVITY, please look")
        entry = structs.replace(entry, acceleration_unit=unit or "m/s2")
    if rate is not None and entry.angular_rate is not None:
        unit, reason = _rate_unit(table, entry, force, rate)
        reasons.append(f"angular rate: {reason}, so {unit}")
        entry = structs.replace(entry, angular_rate_unit=unit)
    if quaternion is not None:
        reasons.append(f"quaternion: {_usual_length(quaternion):.3g} long on the median")
        if force is not None:
            (order, sense, up), off = best_reading(quaternion, force)
            reasons.append(f"as {order}, {sense}, {up} up the acceleration stands {off:.0f}° off the vertical")
            entry = structs.replace(entry, quaternion_order=order, quaternion_sense=sense, world_up=up)
    return entry, reasons


def _usual_length(values: Array) -> float:
    return float(np.nan_to_num(np.nanmedian(np.linalg.norm(values, axis=1)))) if len(values) else 0.0


def _rate_unit(table: TextTable, entry: SensorColumns, force: Array | None, rate: Array) -> tuple[str, str]:
    """The unit of angular rate, and from what it was told."""
    assert entry.angular_rate is not None
    names = " ".join(str(one) for one in entry.angular_rate.columns).lower()
    if re.search(r"deg|dps|°", names):
        return "deg/s", "the columns' names say degrees"
    if "rad" in names:
        return "rad/s", "the columns' names say radians"
    time = None if entry.time is None else _numbers(table, [entry.time])
    slope = None if time is None or force is None else _turning(time[:, 0], force, rate, entry.time_unit)
    if slope is not None and abs(slope) > SLOWEST_TOLD:
        return ("deg/s" if abs(slope) < DEGREES_SLOPE else "rad/s"), (
            f"read as rad/s it turns {1 / abs(slope):.2g} times as fast as gravity's direction does"
        )
    fastest = float(np.nanquantile(np.abs(rate), 0.99))
    return ("deg/s" if fastest > FASTEST_BODY else "rad/s"), f"rarely above {fastest:.3g}"


def _turning(time: Array, force: Array, rate: Array, unit: str) -> float | None:
    """How fast the direction of specific force turns, by what the rates say: 1 if they are radians per second.

    A vector that stands still in the world turns by −ω × u in the sensor; limbs' accelerations add noise to the left
    side of that regression only.
    """
    known = np.all(np.isfinite(np.column_stack([time, force, rate])), axis=1)
    time, force, rate = TIME_UNITS[unit] * time[known], force[known], rate[known]
    if len(time) < 3:
        return None
    step = np.diff(time)
    direction = force / np.linalg.norm(force, axis=1, keepdims=True).clip(1e-9)
    turning = -np.cross((rate[1:] + rate[:-1]) / 2, (direction[1:] + direction[:-1]) / 2) * step[:, None]
    some = max(1, round(TURN_S / max(float(np.median(step)), 1e-6)))
    predicted = np.diff(np.cumsum(turning, axis=0)[::some], axis=0)
    turned = np.diff(direction[1::some], axis=0)
    energy = float(np.sum(predicted**2))
    return float(np.sum(predicted * turned)) / energy if energy > 0 else None
