"""Units that a sensor's numbers suggest: gravity's length, how fast the vertical turns against the gyroscope.

With both acceleration and quaternion also the quaternion's order, sense and upward axis.
"""

import re
from collections.abc import Mapping

import numpy as np
from msgspec import structs

from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.io.convert_template_clock import decide_unit
from vip_factors.io.importers.column_map import (
    ACCELERATION_UNITS,
    ANGULAR_RATE_UNITS,
    QUANTITIES,
    SENSES,
    TIME_UNITS,
    UPS,
    Columns,
    SensorColumns,
)
from vip_factors.io.importers.table import GRAVITY_RANGE, TURNED_OVER, best_reading, upright_rotations
from vip_factors.io.importers.text_table import TextTable

# What a map says of each quantity, and the choices there are.
UNIT_KEYS = {
    "acceleration": {
        "acceleration_unit": "m/s2, g or mg",
        "gravity": "included or left out: at rest acceleration is 9.81 m/s2 upward, or nothing",
    },
    "angular_rate": {"angular_rate_unit": "rad/s or deg/s"},
    "quaternion": {
        "quaternion_order": "wxyz or xyzw: of the columns as they are listed",
        "quaternion_sense": "sensor_to_world or world_to_sensor",
        "world_up": "z, y or -z: the axis of the quaternions' world that points up",
    },
}
DEGREES_SLOPE = 0.13  # between 1 and π/180, in the geometric middle
SLOWEST_TOLD = 0.004  # a slope below it is that of a sensor that hardly moved
TURN_S = 0.25  # of a turn of the vertical: long against impacts, short against strides
GRAVITY_FREE_DEG = 45.0  # of acceleration from the vertical in the mean: with gravity it is less, at any motion
FASTEST_BODY = 20.0  # rad/s: feet and hands of people who walk stay below; larger numbers are degrees


def with_units(
    entry: SensorColumns, named_rate_unit: str, time: Array | None, values: Mapping[str, Array | None]
) -> tuple[SensorColumns, list[str]]:
    """The entry with the units that its numbers suggest, and what they were guessed from.

    Args:
        entry: of the sensor.
        named_rate_unit: unit of the angular rate that its columns tell, blank if they do not.
        time: ``(N,)`` in seconds, if known.
        values: ``(N, …)`` by quantity, in the units of the file.
    """
    force, rate, quaternion = (values.get(quantity) for quantity in QUANTITIES)
    reasons = []
    if force is not None:
        usual = _usual_length(force)
        low, high = GRAVITY_RANGE
        unit = next((name for name, factor in ACCELERATION_UNITS.items() if low <= usual * factor <= high), None)
        told = f"acceleration: {usual:.4g} long on the median"
        reasons.append(f"{told}, so {unit}" if unit else f"{told}: NEITHER m/s2, g NOR mg WITH GRAVITY, please look")
        entry = structs.replace(entry, acceleration_unit=unit or "m/s2")
    if rate is not None:
        unit, reason = _rate_unit(named_rate_unit, time, force, rate)
        reasons.append(f"angular rate: {reason}, so {unit}")
        entry = structs.replace(entry, angular_rate_unit=unit)
    if quaternion is not None:
        reasons.append(f"quaternion: {_usual_length(quaternion):.3g} long on the median")
        if force is not None:
            (order, sense, up), off = best_reading(quaternion, force)
            if off > GRAVITY_FREE_DEG and time is not None and rate is not None:
                sense = _sense(quaternion, time, rate)
                reasons.append(
                    f"acceleration stands {off:.0f}° off the vertical at best, SO GRAVITY IS LEFT OUT; as the angular "
                    f"rates have it the quaternion is {sense}; please look at acceleration_unit"
                )
                return structs.replace(
                    entry, acceleration_unit="m/s2", gravity="left out", quaternion_sense=sense
                ), reasons
            reasons.append(f"as {order}, {sense}, {up} up the acceleration stands {off:.0f}° off the vertical")
            reasons += [TURNED_OVER] if up == "-z" else []
            entry = structs.replace(entry, quaternion_order=order, quaternion_sense=sense, world_up=up)
    return entry, reasons


def _sense(quaternion: Array, time: Array, rate: Array) -> str:
    """The sense in which quaternions ``(N, 4)``, w first, turn as the angular rates ``(N, 3)`` have it."""
    R = upright_rotations(quaternion, Order.WXYZ.value, SENSES[0], UPS[0])
    pace = np.diff(time)[:, None]
    agreement = []
    for R_world_sensor in (R, transpose(R)):
        turned = log(transpose(R_world_sensor[:-1]) @ R_world_sensor[1:]) / pace
        agreement.append(float(np.nansum(turned * (rate[1:] + rate[:-1]))))
    return SENSES[int(np.argmax(agreement))]


def _usual_length(values: Array) -> float:
    return float(np.nan_to_num(np.nanmedian(np.linalg.norm(values, axis=1)))) if len(values) else 0.0


def time_unit(
    rates: dict[str, float], named_rate_unit: str, time: Array | None, values: Mapping[str, Array | None]
) -> tuple[str, str]:
    """The unit of times ``(N,)`` as the sensor's motion has it, and from what it was told."""
    force, rate = values.get("acceleration"), values.get("angular_rate")
    if force is None or rate is None or time is None:
        return decide_unit(rates, lambda unit: None, (1.0,))
    slopes = tuple(value for name, value in ANGULAR_RATE_UNITS.items() if named_rate_unit in (name, ""))
    return decide_unit(rates, lambda unit: _turning(TIME_UNITS[unit] * time, force, rate), slopes)


def name_of_rate_unit(table: TextTable, at: Columns | None) -> str:
    """The unit of angular rates that names, or a line of units below them, say; blank if they do not."""
    if at is None:
        return ""
    units = [table.units[table.index(name, "guess")] for name in at.columns] if table.units else []
    words = " ".join(map(str, (*at.columns, *units))).lower()
    return "deg/s" if re.search(r"deg|dps|°", words) else "rad/s" if "rad" in words else ""


def _rate_unit(named: str, time: Array | None, force: Array | None, rate: Array) -> tuple[str, str]:
    """The unit of angular rate, and from what it was told."""
    if named:
        return named, f"the names or units of its columns say {named}"
    slope = None if time is None or force is None else _turning(time, force, rate)
    if slope is not None and abs(slope) > SLOWEST_TOLD:
        return ("deg/s" if abs(slope) < DEGREES_SLOPE else "rad/s"), (
            f"read as rad/s it turns {1 / abs(slope):.2g} times as fast as gravity's direction does"
        )
    fastest = float(np.nanquantile(np.abs(rate), 0.99))
    return ("deg/s" if fastest > FASTEST_BODY else "rad/s"), f"rarely above {fastest:.3g}"


def _turning(time: Array, force: Array, rate: Array) -> float | None:
    """How fast the direction of specific force turns, by what the rates say: 1 if they are radians per second.

    A vector that stands still in the world turns by −ω × u in the sensor; limbs' accelerations add noise to the left
    side of that regression only.
    """
    known = np.all(np.isfinite(np.column_stack([time, force, rate])), axis=1)
    time, force, rate = time[known], force[known], rate[known]
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
