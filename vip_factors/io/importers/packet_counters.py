"""Columns that count packets: which were lost, came late or twice, and when each was taken."""

import re
from typing import NamedTuple

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array
from vip_factors.io.importers.text_table import TextTable

COUNTER_MODULI = (2**8, 2**16, 2**32)
LATE_SAMPLES = 20  # places by which radio delivers late; a longer way back is a restart
WRAP_LOSS, ZERO_LOSS = 1000, 32  # packets lost over a wrap, at most, and if the count goes on at 0 or 1
REPEATED_COUNTS = 3  # that come twice with other samples; more are a restart
_NAME = re.compile(
    r"(packet|pkt|sample|frame|data|message|msg|seq\w*)[ _.-]*(counter|count|cnt|number|num|no|nr|id|index|#)\.?$"
    r"|(^|[ _.-])(counter|packet|pkt|seq|sequence)$",
    re.IGNORECASE,
)
_ROW_NAME = re.compile(r"sample|frame|index|count|number|num|no\.?|nr\.?", re.IGNORECASE)  # counters if they step by 1


class Packets(NamedTuple):
    """Indices ``(M,)`` of rows in order, their unwrapped counts, which increase strictly, and where these wrap."""

    rows: np.ndarray
    counts: np.ndarray
    modulus: int


def counter_column(table: TextTable) -> int | None:
    """The first column whose name and numbers are a packet counter's, or None."""
    for column, name in enumerate(table.names):
        is_row_name = _ROW_NAME.fullmatch(name.strip()) is not None
        if not (is_row_name or _NAME.search(name.strip())) or table.names.count(name) > 1:
            continue
        try:
            values = table.group([name])
        except FileFormatError:
            continue
        if values is None:
            continue
        values = values[np.isfinite(values)]
        step = np.diff(values) % _modulus(values)
        is_counting = np.all(values % 1 == 0) and np.any(step > 0) and np.mean(step <= LATE_SAMPLES) > 0.5
        if is_counting and (np.median(step) == 1 or not is_row_name):
            return column
    return None


def _modulus(counter: Array) -> int:
    return next((modulus for modulus in COUNTER_MODULI if np.max(counter) < modulus), COUNTER_MODULI[-1])


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
    count, is_restart = _unwrapped(counter, modulus)
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


def _unwrapped(counter: np.ndarray, modulus: int) -> tuple[np.ndarray, np.ndarray]:
    """Counts that go on over wraps, and whether the counter begins again at each."""
    step = np.diff(counter, prepend=counter[:1])
    forward = step % modulus
    is_late = modulus - forward <= LATE_SAMPLES
    loss = np.where(counter <= 1, ZERO_LOSS, min(modulus // 2, WRAP_LOSS))
    return counter[0] + np.cumsum(np.where(is_late, forward - modulus, forward)), (step < 0) & ~is_late & (
        forward > loss
    )


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
