"""Which times samples may have."""

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array

LATEST_S = 4e9  # 127 years: seconds since 1970 are less, and together with such a start they fit into nanoseconds


def usable_times(time: Array) -> np.ndarray:
    """Which of some times, in seconds from a recording's start or since 1970, a clock can have shown."""
    return np.asarray(np.abs(time) <= LATEST_S)  # NaN is not


def check_times(time: Array, whose: str) -> None:
    """Times ``(N,)`` in seconds, one after the other.

    Raises:
        RecordingError: if one is not finite or beyond :data:`LATEST_S`, or if they do not increase strictly.
    """
    usable = usable_times(time)
    if not np.all(usable):
        row = int(np.argmin(usable))
        raise RecordingError(
            f"{whose}: sample {row} has a time of {time[row]:.4g} s: expected seconds from the recording's start"
        )
    backwards = np.flatnonzero(np.diff(time) <= 0)
    if len(backwards):
        row = int(backwards[0]) + 1
        raise RecordingError(
            f"{whose}: time goes from {time[row - 1]:.4f} s to {time[row]:.4f} s at sample {row}: expected strictly "
            "increasing times; sort the samples and drop duplicates"
        )
