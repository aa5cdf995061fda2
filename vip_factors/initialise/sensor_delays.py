"""Which sensors' clocks are off their fellows': the fewest that explain what neighbours say of one another."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.link_delay import joint_signal, link_delay
from vip_factors.initialise.sensor_tree import Link
from vip_factors.ranges import NotNegative
from vip_factors.sensors.imu_stream import ImuStream

LIMBS = ("knee", "ankle", "foot", "elbow", "wrist", "hand")  # what the lower bone of a link within a limb is called


@dataclass(frozen=True)
class SensorClockSettings:
    """How sensors whose clocks are off their fellows' are looked for, and what is done about them."""

    check: bool = True  # off: clocks agree, whatever the motion says
    correct: bool = True  # off: delays are told, and left
    least: float = 0.024  # s: as much as sensors in step have seemed apart, for soft tissue follows the bone
    deviations: NotNegative = 4.0  # standard deviations that a delay is off nought by
    # s, of what skin and muscle delay: sensors in step (MTw) seem up to 10 ms apart across knees, ankles and elbows …
    limb_sigma: float = 0.0055
    trunk_sigma: float = 0.009  # … and up to 23 ms across hips, shoulders and the spine.
    seconds: float = 40.0  # looked at, from the middle: some twenty strides


@dataclass(frozen=True)
class SensorDelay:
    """A sensor whose samples are late (early if below nought).

    Attributes:
        sensor: its number.
        seconds, sigma: how late.
        rival: another one that may be the one off instead, by as much the other way; None if there is none.
    """

    sensor: int
    seconds: float
    sigma: float
    rival: int | None = None


def sensor_delays(
    streams: Sequence[ImuStream], bones: Sequence[int], links: Sequence[Link], settings: SensorClockSettings
) -> tuple[SensorDelay, ...]:
    """The sensors that are off; fewer than half of all, since most are taken to be right.

    Args:
        streams: of ``S`` sensors.
        bones: ``S`` numbers.
        links: of the sensor tree; those between sensors with a free limb in between say nothing.
        settings: of the search.
    """
    start, end = max(one.time[0] for one in streams), min(one.time[-1] for one in streams)
    spare = max(end - start - settings.seconds, 0.0) / 2
    signals = [joint_signal(one.cut(start + spare, end - spare)) if end > start else None for one in streams]
    ends, delay, sigma = [], [], []
    for link in links:
        parent, child = signals[link.parent], signals[link.child]
        if link.p_parent is None or parent is None or child is None:
            continue
        found = link_delay(parent, child)
        if found is not None:
            ends.append((link.parent, link.child))
            delay.append(found.seconds)
            limb = JOINT_NAMES[bones[link.child]].endswith(LIMBS)
            sigma.append(np.hypot(found.sigma, settings.limb_sigma if limb else settings.trunk_sigma))
    return fewest_delays(len(streams), ends, np.array(delay), np.array(sigma), settings)


def fewest_delays(
    sensors: int, ends: Sequence[tuple[int, int]], delay: Array, sigma: Array, settings: SensorClockSettings
) -> tuple[SensorDelay, ...]:
    """One sensor after the other is let off, that which explains most, as long as it explains enough.

    Args:
        sensors: how many there are.
        ends: parent and child of ``L`` links.
        delay, sigma: ``(L,)`` seconds, of the child against the parent.
        settings: of the search.
    """
    if not len(delay):
        return ()
    rows = np.zeros((len(ends), sensors))
    for row, (parent, child) in enumerate(ends):
        rows[row, [parent, child]] = -1, 1
    rows, wanted, enough = rows / sigma[:, None], delay / sigma, settings.deviations**2
    late: list[int] = []
    rivals: dict[int, int | None] = {}
    while len(late) + 1 < sensors / 2 or (sensors == 2 and not late):
        cost = {s: _cost(rows[:, [*late, s]], wanted) for s in range(sensors) if s not in late and np.any(rows[:, s])}
        if not cost:
            break
        best, *others = sorted(cost, key=lambda s: cost[s])
        if _cost(rows[:, late], wanted) - cost[best] < enough:
            break
        late.append(best)
        rivals[best] = next((s for s in others[:1] if cost[s] - cost[best] < enough / 4), None)
    return _told(late, rivals, rows, wanted, settings)


def _told(
    late: Sequence[int], rivals: Mapping[int, int | None], rows: Array, wanted: Array, settings: SensorClockSettings
) -> tuple[SensorDelay, ...]:
    if not late:
        return ()
    information = rows[:, late].T @ rows[:, late]
    seconds = np.linalg.solve(information, rows[:, late].T @ wanted)
    sigma = np.sqrt(np.diag(np.linalg.inv(information)))
    found = (SensorDelay(s, float(a), float(b), rivals[s]) for s, a, b in zip(late, seconds, sigma, strict=True))
    return tuple(
        one for one in found if abs(one.seconds) > max(settings.least, settings.deviations * one.sigma)
    )  # fmt: skip


def _cost(rows: Array, wanted: Array) -> float:
    if rows.shape[1] == 0:
        return float(wanted @ wanted)
    solution = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return float(np.sum((wanted - rows @ solution) ** 2))
