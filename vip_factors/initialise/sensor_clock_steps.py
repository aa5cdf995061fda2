"""Sensors whose clock has jumped: samples were lost, and a log has moved the later ones up by as much.

At the end of a recording such a sensor is as much too early as was lost. As for small delays
(:mod:`~vip_factors.initialise.sensor_faults`), the joint between two bones is accelerated once; here all shifts within
seconds are tried, with the heading and arms that suit each best. Strides repeat themselves, so a shift has to explain
much more than none, of all joints that the sensor has a part in.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from vip_factors.geometry.rotations import Array
from vip_factors.initialise.sensor_faults import (
    LEAST_SHARED,
    MISFIT,
    STEP,
    STRONG,
    JointSignal,
    common_steps,
    least_over_headings,
)
from vip_factors.initialise.sensor_tree import Link

LONGEST_S = 2.5  # that are looked for
END_S = 15.0  # of a recording's end that are looked at, its last third if that is less
LEAST_THERE = 0.6  # of the instants, with any shift: packets are lost
NEAR_S = 0.15  # smaller shifts are delays
SURE = 10.0  # nats by which a shift explains more than none: 43 sound recordings and scenes have 7 at most


@dataclass(frozen=True)
class ClockStep:
    """A sensor, by its number, whose later samples are so many seconds late (early if below nought)."""

    sensor: int
    seconds: float
    nats: float


def clock_step(signals: Sequence[JointSignal | None], links: Sequence[Link]) -> ClockStep | None:
    """The sensor whose clock has surely jumped before the end of a recording, if there is one.

    Args:
        signals: of ``S`` sensors; None of those that tell nothing.
        links: of the sensor tree; those between sensors with a free limb in between say nothing.
    """
    ranges = [(one.time[0], one.time[-1]) for one in signals if one is not None]
    start, end = min((one for one, _ in ranges), default=0.0), max((one for _, one in ranges), default=0.0)
    looked_at = min(END_S, (end - start) / 3)
    steps = np.arange(*np.ceil((end - LONGEST_S - np.array([looked_at, 0.0])) / STEP).astype(int))
    gains = np.zeros((len(signals), len(SHIFTS)))
    for link in links:
        parent, child = signals[link.parent], signals[link.child]
        if link.p_parent is None or parent is None or child is None:
            continue
        share = shift_shares(parent, child, steps)
        if share is None:
            continue
        gain = looked_at * np.log(share[np.abs(SHIFTS) <= NEAR_S].min() / share)
        gains[link.child] += gain
        gains[link.parent] += gain[::-1]
    sensor, shift = np.unravel_index(int(gains.argmax()), gains.shape)
    seconds, nats = float(SHIFTS[shift]), float(gains[sensor, shift])
    if nats < SURE or abs(seconds) <= NEAR_S or shift in (0, len(SHIFTS) - 1):
        return None
    return ClockStep(int(sensor), seconds, nats)


MOST = round(LONGEST_S / STEP)
SHIFTS = np.arange(-MOST, MOST + 1) * STEP


def shift_shares(parent: JointSignal, child: JointSignal, steps: np.ndarray) -> Array | None:
    """Of the parent's mean square acceleration the misfit that is left with the child late by each of :data:`SHIFTS`.

    None where they share too little at the ``steps`` ``(T,)``.
    """
    steps = np.intersect1d(steps, common_steps(parent, child))
    steps = steps[(steps * STEP >= child.time[0] + LONGEST_S) & (steps * STEP <= child.time[-1] - LONGEST_S)]
    if len(steps) * STEP < LEAST_SHARED:
        return None
    reach = np.arange(steps[0] - MOST, steps[-1] + MOST + 1)
    above, below, known = parent.at(steps), child.at(reach), parent.complete(steps * STEP, STEP)
    there = child.complete(reach * STEP, STEP).astype(float)
    at_shift = sliding_window_view(there, len(steps))
    if (at_shift @ known).min() < LEAST_THERE * len(steps):
        return None
    weight = known / (1 + np.sum(above[:, :, 0] ** 2, axis=1) / STRONG**2)
    products = _shifted_products(above, weight, below, there)
    floor = MISFIT**2 * (at_shift @ weight)  # what bodies that are not rigid leave says nothing
    cost, _ = least_over_headings(products)
    return np.asarray((cost + floor) / (products[:, 0, 0, 0] + floor))


def _shifted_products(above: Array, weight: Array, below: Array, there: Array) -> Array:
    """:func:`joint_products` ``(N - T + 1, 5, 4, 4)`` of ``(T, 3, 4)`` and as many of ``(N, 3, 4)``, from each on.

    Products count by their ``weight`` ``(T,)`` and by what is ``there`` ``(N,)``.
    """
    size = 1 << (len(below) - 1).bit_length()

    def spectrum(values: Array) -> np.ndarray:
        return np.fft.rfft(values, size, axis=0)

    weighted, left = above * weight[:, None, None], below * there[:, None, None]
    one, other = spectrum(weighted).conj()[..., None], spectrum(left)[:, :, None]
    own = spectrum(np.swapaxes(weighted, 1, 2) @ above).conj() * spectrum(there)[:, None, None]
    others = spectrum(weight).conj()[:, None, None] * spectrum(np.swapaxes(left, 1, 2) @ below)
    across = one[:, 1] * other[:, 0] - one[:, 0] * other[:, 1]
    found = [own, others, one[:, 0] * other[:, 0] + one[:, 1] * other[:, 1], across, one[:, 2] * other[:, 2]]
    return np.fft.irfft(np.stack(found, axis=1), size, axis=0)[: len(below) - len(above) + 1]
