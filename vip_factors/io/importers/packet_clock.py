"""Sample times from packet counters and sensor clocks that wrap, on one time base for all files of a recording."""

from typing import NamedTuple

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array

COUNTER_MODULUS = 2**16  # MTw and DOT packet counters
CLOCK_MODULUS = 2**32  # SampleTimeFine
# Radio delivers packets a few places late at most; a longer way back is a restarted sensor.
OUT_OF_ORDER_PACKETS = 1000
PLAUSIBLE_RATE_HZ = (4.0, 2000.0)
SAME_RATE = 0.02  # two statements of one rate agree within 2 %: clocks are better than 0.01 %, exports round


class Packets(NamedTuple):
    """Which rows of a file to keep, in order, and their unwrapped counts.

    Attributes:
        rows: ``(M,)`` indices of the rows kept.
        count: ``(M,)`` strictly increasing integers.
        notes: what was dropped or sorted.
    """

    rows: np.ndarray
    count: np.ndarray
    notes: tuple[str, ...] = ()


def unwrap(values: Array, modulus: int) -> np.ndarray:
    """Integers ``(N,)`` that stepped over ``modulus`` made continuous; a step of over half the range is one back."""
    whole = np.asarray(values).astype(np.int64)
    half = modulus // 2
    step = (np.diff(whole) + half) % modulus - half
    return whole[0] + np.concatenate([[0], np.cumsum(step)])


def order_packets(counter: Array, name: str, modulus: int = COUNTER_MODULUS) -> Packets:
    """Unwrap, sort and de-duplicate the packet counter of one file; rows without a counter are left out.

    Raises:
        FileFormatError: if the counter goes back by more than radio can explain, or no row has one.
    """
    known = np.flatnonzero(np.isfinite(counter))
    if not len(known):
        raise FileFormatError(f"{name}: no row has a packet counter")
    count = unwrap(counter[known], modulus)
    late = np.maximum.accumulate(count) - count
    if late.max() > OUT_OF_ORDER_PACKETS:
        row = int(np.argmax(late > OUT_OF_ORDER_PACKETS))
        raise FileFormatError(
            f"{name}: at sample {known[row]} the packet counter falls from {counter[known[row - 1]]:g} to "
            f"{counter[known[row]]:g}: expected it to grow; split the file where the sensor was restarted"
        )
    kept, first = np.unique(count, return_index=True)
    notes = []
    if twice := len(count) - len(kept):
        notes.append(f"{name}: {twice} packets came twice; the first was kept")
    if np.any(np.diff(first) < 0):
        notes.append(f"{name}: packets came out of order and were sorted")
    if blank := len(counter) - len(known):
        notes.append(f"{name}: {blank} rows without a packet counter dropped")
    if lost := int(kept[-1] - kept[0] + 1 - len(kept)):
        notes.append(f"{name}: {lost} of {int(kept[-1] - kept[0] + 1)} packets lost")
    return Packets(known[first], kept, tuple(notes))


def common_base(counts: list[np.ndarray], modulus: int) -> list[np.ndarray]:
    """Counts of several files shifted by whole turns so that their starts lie together, the earliest at zero."""
    half = modulus // 2
    reference = counts[0][0]
    shifted = [count + ((reference - count[0] + half) // modulus) * modulus for count in counts]
    earliest = min(count[0] for count in shifted)
    return [count - earliest for count in shifted]


def clock_tick(clock: Array, count: np.ndarray) -> tuple[float, float] | None:
    """Seconds per tick of SampleTimeFine and samples per second it implies, or None if neither unit is plausible.

    MTw stations count tenths of milliseconds, DOTs microseconds; the ticks between packets tell which.
    """
    if len(count) < 2:
        return None
    ticks = float(np.median(np.diff(unwrap(clock, CLOCK_MODULUS)) / np.diff(count)))
    for tick, low, high in ((1e-4, 1.0, 900.0), (1e-6, 900.0, 250000.0)):
        if low <= ticks < high:
            return tick, 1 / (tick * ticks)
    return None
