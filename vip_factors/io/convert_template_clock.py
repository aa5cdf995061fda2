"""First guess of a table's clock: its column of times and their unit, its packet counter, its stated rate."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from msgspec import structs

from vip_factors.io.importers.clocks import BODY_RATES_HZ, column_times, stated_rate
from vip_factors.io.importers.column_map import PLAUSIBLE_RATES_HZ, TIME_UNITS, SensorColumns
from vip_factors.io.importers.packet_counters import counter_column
from vip_factors.io.importers.text_table import TextTable, number, split

_TIMES = ("time", "timestamp", "t", "seconds", "sec", "elapsed", "epoch", "clock", "datetime", "date", "ticks", "tick")
_NAMES = {
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


def guess_clock(table: TextTable) -> tuple[SensorColumns, dict[str, float]]:
    """The clock of a table, and the rates in Hz of the units that its times may have, the likeliest first.

    Raises:
        FileFormatError: if a column of times has a cell that is none; its line is named.
    """
    at = counter_column(table)
    clock, stated = SensorColumns(counter=None if at is None else table.names[at]), stated_rate(table)
    short = replace(table, rows=table.rows[:USED_ROWS], lines=table.lines[:USED_ROWS])
    first = split(table.rows[0], table.separator)
    for name in sorted(table.names, key=_rank):
        at = table.names.index(name)
        is_number = number(first[at].replace(",", ".")) is not None
        if (
            _rank(name) > len(_TIMES)
            or table.names.count(name) > 1
            or not (is_number or re.search(r":|\d\.\d\d\.\d", first[at]))
        ):
            continue
        time = column_times(short, at, "s")
        steps = np.diff(time[np.isfinite(time)])
        falls = np.sum(steps < 0) / max(len(steps), 1)
        if falls > GROWING or np.sum(steps > 0) < (GROWING * len(steps) if falls else 1):
            continue
        rate = np.median(np.unique(time, return_counts=True)[1]) / np.median(steps[steps > 0])
        rates = {unit: float(rate) / factor for unit, factor in TIME_UNITS.items() if is_number or unit == "s"}
        words = _spaced(f"{name} {table.units[at] if table.units else ''}")
        return structs.replace(clock, time=name), _likely(words, rates, stated)
    return structs.replace(clock, rate_hz=stated), {}


def _likely(words: str, rates: dict[str, float], stated: float | None) -> dict[str, float]:
    """The rates that are near the stated one, or a body's; in the unit that words name, if any; else the nearest."""
    low, high = BODY_RATES_HZ
    if stated is not None:
        low, high = stated * (1 - STATED_TOLERANCE), stated * (1 + STATED_TOLERANCE)
    fits = {unit: rate for unit, rate in rates.items() if low <= rate <= high}
    low, high = PLAUSIBLE_RATES_HZ
    spelt = {unit for unit, names in _NAMES.items() if re.search(rf"(?i)(?<![a-z])({names})(?![a-z])", words)}
    named = {unit: rates[unit] for unit in rates if low <= rates[unit] <= high and unit in spelt}
    both = {unit: rate for unit, rate in fits.items() if unit in named}
    nearest = min(rates, key=lambda unit: abs(np.log(rates[unit] / 100)))
    return both or {**named, **fits} or {nearest: rates[nearest]}


def decide_unit(
    rates: dict[str, float], turning: Callable[[str], float | None], slopes: tuple[float, ...]
) -> tuple[str, str]:
    """The unit of times, and the reason: the motion, where rates in Hz do not decide.

    Args:
        rates: by unit, the likeliest first.
        turning: how fast gravity's direction turns by what the angular rates say, with times in a unit.
        slopes: what that is in the right unit of times, for each unit that the angular rates may have.
    """
    unit = next(iter(rates))
    if len(rates) > 1:
        turned = {each: max(turning(each) or 0.0, 1e-9) for each in rates}
        off = {each: min(abs(np.log(value / slope)) for slope in slopes) for each, value in turned.items()}
        unit = min(off, key=off.__getitem__)
        if off[unit] < np.log(CONSISTENT) and sum(value < 2 * np.log(CONSISTENT) for value in off.values()) == 1:
            return unit, f"{rates[unit]:.4g} samples a second as {unit}, as gravity's direction turns"
        unit, choices = next(iter(rates)), " or ".join(f"{each} ({rate:.4g} Hz)" for each, rate in rates.items())
        return unit, f"{choices}: {PLEASE_DECLARE} time_unit"
    if not BODY_RATES_HZ[0] <= rates[unit] <= BODY_RATES_HZ[1]:
        return (
            unit,
            f"{rates[unit]:.4g} SAMPLES A SECOND as {unit}: {PLEASE_DECLARE} time_unit, or rate_hz instead of time",
        )
    return unit, f"{rates[unit]:.4g} samples a second as {unit}"


def _spaced(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", name)


def _rank(name: str) -> int:
    """Place in the order of the words for times; beyond them for words that begin or end in one."""
    words = re.split(r"[^a-z]+", _spaced(name).lower())
    is_composed = any(re.search(r"^time(?!r|out|zone)|time(stamp)?$|timefine$", word) for word in words)
    return min((_TIMES.index(word) for word in words if word in _TIMES), default=len(_TIMES) + (not is_composed))
