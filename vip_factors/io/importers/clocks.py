"""The clock of a table's samples: a column of times in any unit or as dates, a packet counter at a rate, a rate.

Packet counters show which packets were lost, came late or twice.
"""

import re
from typing import NamedTuple

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.column_map import PLAUSIBLE_RATES_HZ, TIME_UNITS, SensorColumns
from vip_factors.io.importers.text_table import TextTable
from vip_factors.sensors.imu_stream import rate_of

BODY_RATES_HZ = (16.0, 2000.0)  # of logs of people who move; what lies outside is likely another unit of time
STATED_FACTOR = 3.0  # by which times and a stated rate may disagree: sensors drop to half their rate, not to a tenth
SPREAD = 1.5  # usual steps between samples that share a stamp, at most; beyond it samples are lost
HOUR_S, DAY_S = 3600.0, 86_400.0
CLOCK_MODULI = np.array([2.0**16, 2.0**24, 2.0**32])  # of clocks that count ticks
DAYS_BEFORE_1970 = 25_569  # of spreadsheets
_STATED = re.compile(
    r"(?:(?:acquisition|sampl(?:e|ing)|update|output|data|logging|recording|measurement|capture)s?[ _-]*(?:data[ _-]*)?"
    r"(?:rate|freq\w*)|^\W*(?:rate|freq\w*|fs|odr)\b|samples[ _]per[ _]second)"
    r"\W*(?:hz|sps)?\W*(\d+(?:[.,]\d+)?)(?!\d|[.:-]\d)\s*,?\s*(k?)(?:hz|sps|samples|fps|\W|$)",
    re.IGNORECASE,
)
_OTHER_RATES = re.compile(r"mag|baro|video|camera|gps|gnss|temp|emg|heart|baud", re.IGNORECASE)
_TIME = re.compile(
    r"(?:(\d{1,4})[-/.](\d{1,2})[-/.](\d{1,4})[T ,_]+)?(?:(\d{1,2})(?(1)[:.]|:))?(\d{1,2})(?(1)[:.]|:)(\d{1,2})"
    r"(?:[.,:_](\d+))?"
    r"\s*([ap]m)?\s*(?:z|([+-]\d\d):?(\d\d))?",
    re.IGNORECASE,
)

COUNTER_MODULI = (2**8, 2**16, 2**32)
LATE_SAMPLES = 20  # places by which radio delivers late; a longer way back is a restart
WRAP_LOSS, ZERO_LOSS = 1000, 32  # packets lost over a wrap, at most, and if the count goes on at 0 or 1
REPEATED_COUNTS = 3  # that come twice with other samples; more are a restart
_COUNTER_NAME = re.compile(
    r"(packet|pkt|sample|frame|data|message|msg|seq\w*)[ _.-]*(counter|count|cnt|number|num|no|nr|id|index|#)\.?$"
    r"|(^|[ _.-])(counter|packet|pkt|seq|sequence)$",
    re.IGNORECASE,
)
# Names of counters only if they step by 1.
_ROW_NAME = re.compile(r"sample|frame|index|count|number|num|no\.?|nr\.?", re.IGNORECASE)


class Clock(NamedTuple):
    """Rows ``(N,)`` of a table in order, their times in seconds, and the period of a counter that timed them."""

    rows: np.ndarray
    time: Array
    period_s: float | None = None


def table_clock(table: TextTable, entry: SensorColumns, rows: np.ndarray | None, where: str, notes: list[str]) -> Clock:
    """The clock of a sensor's rows; all rows if None.

    Raises:
        FileFormatError: if times or counts begin again, or cannot be a body's log.
        InputError: if neither times nor a rate are known, or a column is not there.
    """
    rows = np.arange(len(table)) if rows is None else rows
    counter = counter_column(table) if entry.counter is None else table.index(entry.counter, f"{where}, counter")
    if entry.time is not None and entry.rate_hz is None:
        return _timed(table, entry, rows, counter, where, notes)
    rate = entry.rate_hz or stated_rate(table)
    if rate is None:
        raise InputError(
            f"{where}: neither time nor rate_hz is given, and {table.path.name} states no rate: expected the column of "
            "the times, or the samples a second (rate_hz in the map, or --rate-hz)"
        )
    if counter is None:
        return Clock(rows, np.arange(len(rows)) / rate)
    packets = order_packets(table, counter, rows, notes)
    return Clock(packets.rows, packets.counts / rate, packets.modulus / rate)


def stated_rate(table: TextTable) -> float | None:
    """Samples per second as stated above the table's header, or None."""
    for line in table.preamble:
        if (match := _STATED.search(line)) and not _OTHER_RATES.search(line[: match.end()]):
            rate = float(match[1].replace(",", ".")) * (1000 if match[2] else 1)
            if PLAUSIBLE_RATES_HZ[0] <= rate <= PLAUSIBLE_RATES_HZ[1]:
                return rate
    return None


def _timed(
    table: TextTable, entry: SensorColumns, rows: np.ndarray, counter: int | None, where: str, notes: list[str]
) -> Clock:
    """Rows and times by a column of times; by the packet counter in the same rows where the times begin again."""
    assert entry.time is not None
    column = table.index(entry.time, f"{where}, time")
    time = column_times(table, column, entry.time_unit)
    packets, counted = None, list[str]()
    try:
        packets = None if counter is None else order_packets(table, counter, rows, counted)
    except FileFormatError as error:
        counted = [restart_note(table, error, f"'{table.names[column]}'")]
    try:
        timed_rows, its_time = _ordered(table, column, rows, time[rows], notes)
    except FileFormatError as error:
        if packets is None or not np.any(np.diff(time[packets.rows]) > 0):
            raise
        notes.append(restart_note(table, error, f"'{table.names[counter or 0]}'"))
        step = np.diff(time[packets.rows]) / np.diff(packets.counts)
        timed_rows, its_time = packets.rows, float(np.median(step[step > 0])) * packets.counts
    notes += [note for note in counted if "twice" not in note]
    _check_step(table, entry, its_time, notes)
    return Clock(timed_rows, its_time)


def _check_step(table: TextTable, entry: SensorColumns, time: Array, notes: list[str]) -> None:
    """Refuse or note times whose rate in the declared unit cannot be a body's log, or is not the stated one."""
    rate, stated = rate_of(time), stated_rate(table)
    low, high = (stated / STATED_FACTOR, stated * STATED_FACTOR) if stated else BODY_RATES_HZ
    if len(time) < 2 or low <= rate <= high:
        return
    rates = {unit: rate * TIME_UNITS[entry.time_unit] / factor for unit, factor in TIME_UNITS.items()}
    fits = " or ".join(f"'{unit}' gives {hertz:.4g}" for unit, hertz in rates.items() if low <= hertz <= high)
    sentence = (
        f"in {entry.time_unit} the times '{entry.time}' give {rate:.4g} samples a second"
        f"{f', and {stated:g} are stated above the header' if stated else ''}: expected {low:.4g} to {high:.4g}; "
        f"declare time_unit ({fits or 'none fits'}), or rate_hz instead of time"
    )
    if stated or not PLAUSIBLE_RATES_HZ[0] <= rate <= PLAUSIBLE_RATES_HZ[1]:
        raise FileFormatError(f"{table.path}: {sentence}")
    notes.append(f"{table.path.name}: {sentence}")


def column_times(table: TextTable, column: int, unit: str) -> Array:
    """Times ``(N,)`` in seconds: numbers in the unit, dates since 1970, or times of day, over midnight too.

    Raises:
        FileFormatError: for a cell that is none of these; line and column are named.
    """
    try:
        time = TIME_UNITS[unit] * table.numbers([column])[:, 0]
    except FileFormatError:
        cells = [cell.strip('" ') for cell in table.texts(column)]
        if _TIME.fullmatch(cells[0]) is None:
            raise
        return _dated(table, column, cells)
    finite = time[np.isfinite(time)]
    if len(stamps := np.unique(finite)) < 2:
        return time
    step, fall, latest = np.median(np.diff(stamps)), np.max(-np.diff(finite)), np.max(finite)
    for modulus in TIME_UNITS[unit] * CLOCK_MODULI:
        if latest < modulus and fall > max(modulus / 2, modulus - LATE_SAMPLES * step):
            return _unwrapped(time, modulus)
    if unit == "days":
        return time - DAYS_BEFORE_1970 * DAY_S if latest > DAYS_BEFORE_1970 * DAY_S else _unwrapped(time, DAY_S)
    return time


def _dated(table: TextTable, column: int, cells: list[str]) -> Array:
    matches = [_TIME.fullmatch(cell) for cell in cells]
    for cell, match, line in zip(cells, matches, table.lines, strict=True):
        if cell and match is None:
            raise FileFormatError(
                f"{table.path}, line {line}: column '{table.names[column]}' is '{cell[:40]}': expected a time as in "
                f"'{cells[0]}'"
            )
    seconds = np.array([_second_of_day(match) for match in matches])
    dates = {match.group(1, 2, 3) for match in matches if match and match[1]}
    if not dates:  # minutes and seconds alone begin anew each hour
        return _unwrapped(seconds, DAY_S if any(match and match[4] for match in matches) else HOUR_S)
    first, second, _ = (set(numbers) for numbers in zip(*dates, strict=True))
    # Within a recording days change rather than months.
    is_day_first = "." in cells[0][:3] or max(map(int, first)) > 12 or len(first) > len(second)
    order = (0, 1, 2) if len(next(iter(first))) == 4 else (2, 1, 0) if is_day_first else (2, 0, 1)
    iso = {date: "-".join(f"{date[i]:0>2}" for i in order) for date in dates}
    try:
        days = {date: float(np.datetime64(f"20{day}"[-10:], "D").astype(int)) for date, day in iso.items()}
    except ValueError:
        raise FileFormatError(
            f"{table.path}: '{cells[0]}' is no date: expected such as 2023-05-04 10:11:12.5"
        ) from None
    zone = re.search(r"\(([+-]?\d\d):?(\d\d)\)", table.names[column])
    if zone and not any(match and match[9] for match in matches):
        seconds = seconds - 60.0 * _minutes_east(zone[1], zone[2])
    return seconds + DAY_S * np.array([days[match.group(1, 2, 3)] if match else np.nan for match in matches])


def _second_of_day(match: re.Match[str] | None) -> float:
    if match is None:
        return float("nan")
    hour, minute, second = (int(match[i] or 0) for i in (4, 5, 6))
    if match[8]:
        hour = hour % 12 + 12 * (match[8].lower() == "pm")
    east = _minutes_east(match[9], match[10]) if match[9] else 0
    return 3600.0 * hour + 60.0 * (minute - east) + second + float(f"0.{match[7] or 0}")


def _minutes_east(hours: str, minutes: str) -> int:
    return (-1 if hours.startswith("-") else 1) * (60 * abs(int(hours)) + int(minutes))


def _unwrapped(time: Array, turn: float) -> Array:
    is_finite = np.isfinite(time)
    time[is_finite] = np.unwrap(time[is_finite], period=turn)
    return time


def _ordered(
    table: TextTable, column: int, rows: np.ndarray, time: Array, notes: list[str]
) -> tuple[np.ndarray, Array]:
    """Rows in the order of their times, which increase strictly: stamps that several share are spread."""
    name, label = table.path.name, table.names[column]
    is_finite = np.isfinite(time)
    rows, time = rows[is_finite], time[is_finite]
    if not len(rows) or (len(rows) > 1 and np.ptp(time) == 0):
        raise FileFormatError(
            f"{table.path}: column '{label}' holds {'the same time in all rows' if len(rows) else 'no time'}: expected "
            "a number or a date for each sample; give rate_hz (or --rate-hz) instead of time"
        )
    late = np.maximum.accumulate(time) - time
    is_restart = late > LATE_SAMPLES * np.median(np.diff(np.unique(time))) if np.any(late) else late > 0
    if np.any(is_restart):
        restart = int(np.argmax(is_restart))
        raise FileFormatError(
            f"{table.path}, line {table.lines[rows[restart]]}: time '{label}' falls from {time[restart - 1]:g} s to "
            f"{time[restart]:g} s: expected it to grow; split the file there, or name another column"
        )
    if np.any(late):
        notes.append(f"{name}: {np.sum(np.diff(time) < 0)} samples came late and were sorted by '{label}'")
        order = np.argsort(time, kind="stable")
        rows, time = rows[order], time[order]
    copies = [i for i in np.flatnonzero(np.diff(time) == 0) + 1 if table.rows[rows[i]] == table.rows[rows[i - 1]]]
    if copies:
        notes.append(f"{name}: {len(copies)} rows that repeat the one before dropped")
        rows, time = np.delete(rows, copies), np.delete(time, copies)
    if shared := int(np.sum(np.diff(time) == 0)):
        notes.append(
            f"{name}: {shared} of {len(time)} samples share the time in '{label}' with the one before: spread evenly "
            "up to the next time"
        )
    return rows, _spread(time)


def _spread(time: Array) -> Array:
    """Times of which samples that share a stamp lie evenly up to the next stamp, where none are lost before it."""
    stamps, starts, sizes = np.unique(time, return_index=True, return_counts=True)
    if len(stamps) == len(time):
        return time
    step = np.diff(stamps) / sizes[:-1]
    usual = float(np.median(np.repeat(step, sizes[:-1])))
    step = np.append(np.where(step > SPREAD * usual, usual, step), usual)
    if sizes[0] < np.median(sizes):  # the log begins within a packet
        step[0], stamps[0] = usual, stamps[1] - sizes[0] * usual
    position = np.arange(len(time)) - np.repeat(starts, sizes)
    return np.asarray(np.repeat(stamps, sizes) + position * np.repeat(step, sizes))


class Packets(NamedTuple):
    """Indices ``(M,)`` of rows in order, their unwrapped counts, which increase strictly, and where these wrap."""

    rows: np.ndarray
    counts: np.ndarray
    modulus: int


def counter_column(table: TextTable) -> int | None:
    """The first column whose name and numbers are a packet counter's, or None."""
    for column, name in enumerate(table.names):
        is_row_name = _ROW_NAME.fullmatch(name.strip()) is not None
        if not (is_row_name or _COUNTER_NAME.search(name.strip())) or table.names.count(name) > 1:
            continue
        try:
            values = table.numbers([column])
        except FileFormatError:
            continue
        values = values[np.isfinite(values)]
        step = np.diff(values) % _modulus(values)
        is_counting = np.all(values % 1 == 0) and np.any(step > 0) and np.mean(step <= LATE_SAMPLES) > 0.5
        if is_counting and (np.median(step) == 1 or not is_row_name):
            return column
    return None


def _modulus(counter: Array) -> int:
    return next((modulus for modulus in COUNTER_MODULI if np.max(counter, initial=0) < modulus), COUNTER_MODULI[-1])


def order_packets(table: TextTable, column: int, rows: np.ndarray, notes: list[str], least_modulus: int = 0) -> Packets:
    """Unwrap, sort and de-duplicate the packet counter of some rows; those without a count are left out.

    Raises:
        FileFormatError: if the counter begins again, or no row has a count.
    """
    name, label = table.path.name, table.names[column]
    values = table.numbers([column])[:, 0]
    counted = rows[np.isfinite(values[rows])]
    if not len(counted):
        raise FileFormatError(f"{table.path}: column '{label}' holds no packet counter: expected whole numbers")
    counter = values[counted].astype(np.int64)
    modulus = max(_modulus(counter), least_modulus)
    count, is_restart = _counts_over_wraps(counter, modulus)
    starts = np.flatnonzero(np.diff(count, prepend=count[0] - 1))
    sizes = np.diff(starts, append=len(count))
    if (size := int(np.median(sizes))) > 1:  # several samples in a packet
        position = np.arange(len(count)) - np.repeat(starts, sizes)
        count, modulus = count * size + np.minimum(position, size - 1), modulus * size
    counts, first_rows, inverse = np.unique(count, return_index=True, return_inverse=True)
    twice = np.flatnonzero(first_rows[inverse] != np.arange(len(count)))
    changed = [i for i in twice if table.rows[counted[i]] != table.rows[counted[first_rows[inverse[i]]]]]
    restarts = [*np.flatnonzero(is_restart), *(changed[:1] if len(changed) > REPEATED_COUNTS else [])]
    if restarts:
        restart = int(min(restarts))
        raise FileFormatError(
            f"{table.path}, line {table.lines[counted[restart]]}: the packet counter '{label}' falls from "
            f"{counter[restart - 1]} to {counter[restart]}: expected it to grow, or a column of times that goes on; "
            "split the file where the sensor was restarted"
        )
    if len(twice):
        notes.append(f"{name}: {len(twice)} packets came twice; the first was kept")
    if np.any(np.diff(first_rows) < 0):
        notes.append(f"{name}: packets came out of order and were sorted")
    if blank := len(rows) - len(counted):
        notes.append(f"{name}: {blank} rows without a packet counter dropped")
    if lost := int(counts[-1] - counts[0] + 1 - len(counts)):
        notes.append(f"{name}: {lost} of {int(counts[-1] - counts[0] + 1)} packets lost")
    return Packets(counted[first_rows], counts, modulus)


def _counts_over_wraps(counter: np.ndarray, modulus: int) -> tuple[np.ndarray, np.ndarray]:
    """Counts that go on over wraps, and whether the counter begins again at each."""
    step = np.diff(counter, prepend=counter[:1])
    forward = step % modulus
    is_late = modulus - forward <= LATE_SAMPLES
    loss = np.where(counter <= 1, ZERO_LOSS, min(modulus // 2, WRAP_LOSS))
    is_restart = (step < 0) & ~is_late & (forward > loss)
    return counter[0] + np.cumsum(np.where(is_late, forward - modulus, forward)), is_restart


def restart_note(table: TextTable, error: FileFormatError, clock: str) -> str:
    """A note that one clock begins again, as an error says, and that the other goes on and decides."""
    what = str(error).replace(str(table.path), table.path.name, 1).partition(": expected")[0]
    return f"{what}; {clock} goes on and decides"


def common_base(counts: list[np.ndarray], modulus: float) -> list[np.ndarray]:
    """Counts, or times, of several files shifted by whole turns so that their starts lie together, the first at 0."""
    reference = counts[0][0]
    shifted = [count + ((reference - count[0] + modulus / 2) // modulus) * modulus for count in counts]
    earliest = min(count[0] for count in shifted)
    return [count - earliest for count in shifted]
