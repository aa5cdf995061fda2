"""Sensors whose clock has jumped: samples were lost, and a log has moved the later ones up by as much.

At the end of a recording such a sensor is as much too early as was lost. As for small delays
(:mod:`~vip_factors.initialise.sensor_faults`), the joint between two bones is accelerated once; here all shifts within
seconds are tried, with the heading and arms that suit each best. Strides repeat themselves, so a shift has to explain
much more than none, of all joints that the sensor has a part in.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.initialise.sensor_faults import (
    ARM_SIGMA,
    HEADINGS,
    LEAST_SHARED,
    MISFIT,
    STEP,
    STRONG,
    JointSignal,
    complete,
    joint_signal,
)
from vip_factors.initialise.sensor_tree import Link
from vip_factors.sensors.imu_stream import ImuStream

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


def clock_step(streams: Sequence[ImuStream], links: Sequence[Link]) -> ClockStep | None:
    """The sensor whose clock has surely jumped before the end of a recording, if there is one.

    Args:
        streams: of ``S`` sensors.
        links: of the sensor tree; those between sensors with a free limb in between say nothing.
    """
    start, end = min(one.time[0] for one in streams), max(one.time[-1] for one in streams)
    looked_at = min(END_S, (end - start) / 3)
    signals = [_last(one, end - looked_at - 2 * LONGEST_S - LEAST_SHARED) for one in streams]
    time = np.arange(end - LONGEST_S - looked_at, end - LONGEST_S, STEP)
    gains = np.zeros((len(signals), len(SHIFTS)))
    for link in links:
        parent, child = signals[link.parent], signals[link.child]
        if link.p_parent is None or parent is None or child is None:
            continue
        share = shift_shares(parent, child, time)
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


def _last(stream: ImuStream, start: float) -> JointSignal | None:
    return joint_signal(stream.cut(start, np.inf)) if stream.time[-1] - start > LEAST_SHARED else None


SHIFTS = np.arange(-round(LONGEST_S / STEP), round(LONGEST_S / STEP) + 1) * STEP


def shift_shares(parent: JointSignal, child: JointSignal, time: Array) -> Array | None:
    """Of the parent's mean square acceleration the misfit that is left with the child late by each of :data:`SHIFTS`.

    None where they share too little at ``time`` ``(T,)``, every :data:`STEP`.
    """
    time = time[(time >= child.time[0] + LONGEST_S) & (time <= child.time[-1] - LONGEST_S)]
    if len(time) * STEP < LEAST_SHARED:
        return None
    above, several = parent.spline(time), np.arange(len(SHIFTS)) - len(SHIFTS) // 2
    reach = np.concatenate([time[0] + several * STEP, time[1:] + several[-1] * STEP])
    rows = np.arange(len(time)) + np.arange(len(SHIFTS))[:, None]
    below, there = child.spline(reach)[rows], complete(child, reach, STEP)[rows] & complete(parent, time, STEP)
    if there.mean(axis=1).min() < LEAST_THERE:
        return None
    weight = there / (1 + np.sum(above[:, :, 0] ** 2, axis=1) / STRONG**2)
    own = np.einsum("tik,lt,tim->lkm", above, weight, above, optimize=True)
    others = np.einsum("ltik,lt,ltim->lkm", below, weight, below, optimize=True)
    cross = np.einsum("tik,lt,ltjm->lijkm", above, weight, below, optimize=True)
    shared = np.einsum("hij,lijkm->lhkm", rotation_z(HEADINGS), cross)
    gram = np.zeros((*shared.shape[:2], 8, 8))
    gram[..., :4, :4], gram[..., 4:, 4:] = own[:, None], others[:, None]
    gram[..., :4, 4:], gram[..., 4:, :4] = -shared, -np.swapaxes(shared, -1, -2)
    # The first column of either side is what both accelerations are; the rest are multiplied with the arms.
    fixed, arms = np.array([1.0, 0, 0, 0, 1.0, 0, 0, 0]), [1, 2, 3, 5, 6, 7]
    linear = (gram @ fixed)[..., arms]
    square = gram[..., arms, :][..., arms] + (MISFIT / ARM_SIGMA) ** 2 * np.eye(6)
    found = np.linalg.solve(square, linear[..., None])[..., 0]
    cost = fixed @ gram @ fixed - np.sum(linear * found, axis=-1)
    floor = MISFIT**2 * weight.sum(axis=1)  # what bodies that are not rigid leave says nothing
    return np.asarray((cost.min(axis=1) + floor) / (own[:, 0, 0] + floor))
