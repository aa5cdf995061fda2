"""What is worth saying about the streams of a log before anybody relies on them: gaps, early ends, unequal rates."""

from collections.abc import Mapping

import numpy as np

from vip_factors.errors import InputError
from vip_factors.sensors.imu_stream import ImuStream

LEAP_S = 86_400.0  # nobody pauses for a day within one recording: a clock was set, or a row is no sample
LONG_GAP_S = 1.0  # shorter ones are bridged by the neighbours; over longer ones a limb can have done anything
MISSING_END_S = 1.0  # sensors are switched off within a second of each other
UNEQUAL_RATE = 0.02


def coverage_notes(imus: Mapping[str, ImuStream]) -> list[str]:
    """Sentences on sensors that start late, stop early, lack seconds in between, or run at another rate."""
    if not imus:
        return []
    notes = []
    first, last = min(s.time[0] for s in imus.values()), max(s.time[-1] for s in imus.values())
    for name, stream in imus.items():
        start, end = float(stream.time[0]), float(stream.time[-1])
        if start - first > MISSING_END_S:
            notes.append(f"sensor '{name}' starts {start - first:.1f} s after the first one")
        if last - end > MISSING_END_S:
            notes.append(f"sensor '{name}' stops at {end:.1f} s, {last - end:.1f} s before the last one")
        gaps = stream.gaps
        long = gaps[gaps[:, 1] - gaps[:, 0] > LONG_GAP_S]
        if len(long):
            longest = float(np.max(long[:, 1] - long[:, 0]))
            notes.append(
                f"sensor '{name}' has {len(long)} gaps longer than {LONG_GAP_S:g} s, the longest of {longest:.1f} s, "
                f"the first at {long[0, 0]:.1f} s"
            )
    rates = {name: _usual_rate(stream) for name, stream in imus.items() if len(stream) > 1}
    if rates:
        slow, fast = min(rates, key=rates.__getitem__), max(rates, key=rates.__getitem__)
        if rates[fast] > rates[slow] * (1 + UNEQUAL_RATE):
            notes.append(
                f"sensors run at different rates: '{slow}' at {rates[slow]:.1f} Hz, '{fast}' at {rates[fast]:.1f} Hz"
            )
    return notes


def check_leaps(imus: Mapping[str, ImuStream]) -> None:
    """Times that leap, as where a pose held before stands at 0 s in a log of Unix time.

    Raises:
        InputError: if all sensors say nothing for a day.
    """
    if not imus:
        return
    time = np.unique(np.concatenate([stream.time for stream in imus.values()]))
    leaps = np.flatnonzero(np.diff(time) > LEAP_S)
    if len(leaps):
        before, after = time[leaps[0]], time[leaps[0] + 1]
        rows = max(int(np.sum(stream.time <= before)) for stream in imus.values())
        raise InputError(
            f"all sensors' times leap from {before:.2f} to {after:.2f} s after row {rows} of a sensor: no recording "
            f"pauses for days; leave out what is before with --start-s {np.floor(100 * after) / 100:.2f}, or, if it is "
            "a pose that was held before, say --initial-pose n-pose (or t-pose) and --pose-from LOG:1"
        )


def _usual_rate(stream: ImuStream) -> float:
    """Samples per second where none are lost: a low percentile of the steps, which losses do not lengthen."""
    return float(1 / np.percentile(np.diff(stream.time), 10))
