"""Sensors whose clocks are off their fellows', throughout or since they jumped.

How late one sensor is against its neighbour: the joint between their bones is accelerated once, not twice. The joint's
acceleration is told by either sensor: its own, and the turning of its bone times the arm from it to the joint (Seel,
Raisch & Schauer, Sensors 14, 2014). Where the joint lies from either sensor, how their headings differ and how late one
is are found together, so nothing of mountings, headings or the body is supposed. Rates of turn would need less, but in
walking thigh and shank do not turn in step. The fewest delays that explain what neighbours say are taken.

A clock jumps where samples were lost and a log has moved the later ones up: at the end of a recording they are as much
too early as was lost. All shifts within seconds are tried there, with the heading and arms that suit each best. Strides
repeat themselves, so a shift has to explain much more than none, of all joints that the sensor has a part in.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.geometry.rotations import Array, rotation_z, transpose
from vip_factors.initialise.sensor_tree import Link, joint_products
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.imu_stream import ImuStream

STEP = 1 / 30  # s: what is quicker are foot strikes, which ring straps and reach one sensor after the other
FINE = 4  # instants in a step at which accelerations are known; splines give them in between
ARM_SIGMA, MISFIT = 0.2, 1.5  # m from sensor to joint; m/s² by which bodies that are not rigid miss
# s between the instants that delays are found from. Between samples noise averages out: were all instants at one phase
# of the parent's samples, the child's would seem late or early by what puts them between its own.
APART = STEP * (1 + 1 / FINE)
STARTS = np.arange(-0.12, 0.121, 0.02)  # s, delays looked at: the misfit's valley is a quarter of a swing wide
REACH = float(STARTS[-1]) + STEP
HEADINGS = np.deg2rad(np.arange(0.0, 360.0, 30.0))
STRONG = 15.0  # m/s², from which on an acceleration counts less at the start
BLOCK = 1.0  # s: misfits within a swing belong together
LEAST_SHARED = 3.0  # s that two sensors have in common, to be told apart from others
# Of the joint's mean square acceleration, misfit that is left: knees and ankles leave 0.05–0.4, hips to 0.7; a loose
# sensor on a thigh 0.9 to its shank and 2.6 to its pelvis, and 85 ms where there were none.
POOR = 0.75
GRAVITY = np.array([0.0, 0.0, 9.81])
Signal = Callable[[Array], Array]
_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


@dataclass(frozen=True)
class JointSignal:
    """What a sensor says of the acceleration of points of its bone, over time.

    Attributes:
        time: ``(T,)`` seconds, :data:`FINE` instants a step.
        values: ``(T, 3, 4)``: the sensor's acceleration in its inertial frame in m/s², and what the arm ``(3,)`` in the
            sensor's frame is to be multiplied with to get that of a point.
        valid: ``(T,)`` whether all samples around are there.
    """

    time: Array
    values: Array
    valid: np.ndarray

    @cached_property
    def spline(self) -> "scipy.interpolate.BSpline":
        """Of the values."""
        return scipy.interpolate.make_interp_spline(self.time, self.values, k=3)

    def cut(self, start: float, end: float) -> "JointSignal | None":
        """What lies between two instants, if that is long enough to tell anything."""
        own = slice(*np.searchsorted(self.time, (start, end)))
        one = JointSignal(self.time[own], self.values[own], self.valid[own])
        return one if end - start >= LEAST_SHARED else None

    @cached_property
    def first(self) -> int:
        """Number of the first instant; ``FINE * n`` is that nearest to ``n`` steps from the recording's start."""
        return round(self.time[0] / STEP * FINE)

    def at(self, steps: np.ndarray) -> Array:
        """The values at some steps from the recording's start, to a :data:`FINE`-th of a step."""
        return self.values[steps * FINE - self.first]

    def complete(self, time: Array, reach: float) -> np.ndarray:
        """Whether nothing is missing within the reach of each of the times."""
        missing = np.r_[0, np.cumsum(~self.valid)]
        first, last = (np.searchsorted(self.time, time + sign * reach) for sign in (-1, 1))
        return missing[last] == missing[first]


def joint_signal(stream: ImuStream) -> JointSignal | None:
    """None of a stream without orientation or specific force, or one that is too short."""
    if stream.R_inertial_sensor is None or stream.specific_force is None:
        return None
    if stream.time[-1] - stream.time[0] < LEAST_SHARED:
        return None
    fine = resample_streams([stream], np.arange(stream.time[0], stream.time[-1], STEP / FINE))
    R, seen, whole = fine.R_inertial_sensor[:, 0], fine.orientation_valid[:, 0], fine.acceleration_valid[:, 0]
    count = len(fine) - 2 * FINE
    # As coarse frames from each instant on have it: differences over a step, and its triangle of narrower ones.
    before, now, after = (slice(shift, shift + count) for shift in (0, FINE, 2 * FINE))
    around = [slice(FINE + shift, FINE + shift + count) for shift in range(1 - FINE, FINE)]
    triangle = (FINE - np.abs(np.arange(1 - FINE, FINE))) / FINE**2
    valid = seen[before] & seen[now] & seen[after] & np.all([whole[one] for one in around], axis=0)
    values = np.empty((count, 3, 4))
    values[..., 0] = np.tensordot(triangle, [fine.specific_force_inertial[one, 0] for one in around], 1) - GRAVITY
    values[..., 1:] = (R[before] - 2 * R[now] + R[after]) / STEP**2
    return JointSignal(fine.time[now], np.where(valid[:, None, None], values, 0.0), valid)


def common_steps(one: JointSignal, other: JointSignal) -> np.ndarray:
    """Steps from the recording's start that two signals have, with one more on either side."""
    first, last = max(one.first, other.first), min(each.first + len(each.time) - 1 for each in (one, other))
    return np.arange(-(-first // FINE) + 1, last // FINE)


def link_delay(parent: JointSignal, child: JointSignal) -> tuple[float, float] | None:
    """How late the child's samples are against the parent's, and its standard deviation, in seconds.

    None where the two share too little time or hardly move, or no delay in reach makes them tell the same.
    """
    least_blocks, least_moving_s = 8, 2.0
    margin = REACH + 2 * STEP
    start, end = max(parent.time[0], child.time[0]) + margin, min(parent.time[-1], child.time[-1]) - margin
    time = np.arange(start, end, APART)
    time = time[parent.complete(time, STEP) & child.complete(time, margin)] if len(time) else time
    if len(time) * APART < least_blocks * BLOCK:
        return None
    above = parent.spline(time)
    if np.count_nonzero(_is_moving(above, child.spline(time))) * APART < least_moving_s:
        return None
    starts = [(*_start(above, child.spline(time + seconds)), seconds) for seconds in STARTS]
    _, heading, begin = min(starts)
    seconds, sigma, misfit = _fitted(above, child.spline, child.spline.derivative(), time, begin, heading)
    return None if misfit > POOR or abs(seconds) > REACH else (seconds, sigma)


def joint_misfit(one: JointSignal, other: JointSignal) -> tuple[float, float] | None:
    """Of a joint's acceleration the share (in squares) by which two sensors disagree, and seconds of motion.

    Heading and arms are those that fit best; clocks agree. None where the two share no time.
    """
    steps = common_steps(one, other)
    steps = steps[one.complete(steps * STEP, STEP) & other.complete(steps * STEP, STEP)]
    if len(steps) * STEP < LEAST_SHARED:
        return None
    above, below = one.at(steps), other.at(steps)
    moving = _is_moving(above, below)
    *_, share = _fitted(above, lambda _: below, None, np.zeros(len(steps)), 0.0, _start(above, below)[1])
    return share, np.count_nonzero(moving) * STEP


def _is_moving(above: Array, below: Array) -> np.ndarray:
    """Whether either sensor is accelerated ``(T,)``: at rest values are noise alone."""
    return np.asarray(np.sum(above[:, :, 0] ** 2 + below[:, :, 0] ** 2, axis=1) > MISFIT**2)


def _start(above: Array, below: Array) -> tuple[float, float]:
    """Least cost over headings, and that heading."""
    weight = 1 / (1 + np.sum(above[:, :, 0] ** 2 + below[:, :, 0] ** 2, axis=1) / STRONG**2)
    products = joint_products(*(one * np.sqrt(weight)[:, None, None] for one in (above, below)))
    cost, heading = least_over_headings(products[None])
    return float(cost[0]), float(heading[0])


def least_over_headings(products: Array) -> tuple[Array, Array]:
    """Least costs ``(L,)`` over headings, and these; of :func:`joint_products` ``(L, 5, 4, 4)``, arms eliminated."""
    turns = np.stack([np.cos(HEADINGS), np.sin(HEADINGS), np.ones(len(HEADINGS))], axis=1)
    gram = np.zeros((len(products), len(HEADINGS), 8, 8))
    gram[..., :4, :4], gram[..., 4:, 4:] = products[:, None, 0], products[:, None, 1]
    gram[..., :4, 4:] = -np.einsum("hc,lckm->lhkm", turns, products[:, 2:])
    gram[..., 4:, :4] = transpose(gram[..., :4, 4:])
    # The first column of either side is what both accelerations are; the rest are multiplied with the arms.
    fixed, arms = np.array([1.0, 0, 0, 0, 1.0, 0, 0, 0]), [1, 2, 3, 5, 6, 7]
    linear, square = (gram @ fixed)[..., arms], gram[..., arms, :][..., arms] + (MISFIT / ARM_SIGMA) ** 2 * np.eye(6)
    cost = fixed @ gram @ fixed - np.sum(linear * np.linalg.solve(square, linear[..., None])[..., 0], axis=-1)
    best = cost.argmin(axis=1)
    return cost[np.arange(len(cost)), best], HEADINGS[best]


def _fitted(
    above: Array, below: Signal, rate: Signal | None, time: Array, seconds: float, heading: float
) -> tuple[float, float, float]:
    """Gauss–Newton over heading, both arms and delay, Cauchy weights: the delay, its sigma, and the misfit's share.

    The sigma is from blocks as independent as swings. Without the ``rate`` of what is ``below`` the delay stays.
    """
    rounds = 12
    settled = 1e-6  # radians, metres and seconds
    arms, has_prior = np.zeros(6), np.r_[0.0, np.ones(6), np.zeros(int(rate is not None))]
    for _ in range(rounds):
        turned = rotation_z(heading) @ below(time + seconds)
        by_arms = np.concatenate([above[:, :, 1:], -turned[:, :, 1:]], axis=2)
        misfit = above[:, :, 0] - turned[:, :, 0] + by_arms @ arms
        at = np.concatenate([[1.0], arms[3:]])
        slopes = [(-(turned @ at) @ _TURN.T)[..., None], by_arms]
        if rate is not None:
            slopes.append(-(rotation_z(heading) @ rate(time + seconds) @ at)[..., None])
        slope = np.concatenate(slopes, axis=2)
        square = np.sum(misfit**2, axis=1)
        scale = max(float(np.median(square)) / 2.37, 0.05)  # 2.37: the median of chi square with three degrees
        weight = 1 / (1 + square / (4 * scale))
        prior = scale / ARM_SIGMA**2 * has_prior
        weighted = slope * weight[:, None, None]
        unknowns = slope.shape[2]
        hessian = weighted.reshape(-1, unknowns).T @ slope.reshape(-1, unknowns) + np.diag(prior + 1e-9)
        scores = np.einsum("tik,ti->tk", weighted, misfit)
        step = -np.linalg.solve(hessian, scores.sum(axis=0) + prior * np.r_[0.0, arms, np.zeros(unknowns - 7)])
        heading, arms = heading + float(step[0]), arms + step[1:7]
        seconds += float(np.clip(step[7:].sum(), -0.03, 0.03))
        if abs(seconds) > REACH or np.abs(step).max() < settled:
            break
    block = ((time - time[0]) / BLOCK).astype(int)
    sums = np.stack([np.bincount(block, column) for column in scores.T], axis=1)
    spread = np.linalg.solve(hessian, sums.T)[-1]
    joint = np.sum((above[:, :, 0] + above[:, :, 1:] @ arms[:3]) ** 2, axis=1)
    return seconds, float(np.linalg.norm(spread)), float(weight @ square / (weight @ joint))


LIMBS = ("knee", "ankle", "foot", "elbow", "wrist", "hand")  # what the lower bone of a link within a limb is called


CLOCK_SECONDS = 40.0  # of the recording, from its middle: some twenty strides
DELAY_DEVIATIONS = 4.0  # standard deviations by which a delay must differ from zero


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
    signals: Sequence[JointSignal | None], bones: Sequence[int], links: Sequence[Link]
) -> tuple[SensorDelay, ...]:
    """The sensors that are off; fewer than half of all, since most are taken to be right.

    Args:
        signals: of ``S`` sensors; None of those that tell nothing.
        bones: ``S`` numbers.
        links: of the sensor tree; those between sensors with a free limb in between say nothing.
    """
    ranges = [(one.time[0], one.time[-1]) for one in signals if one is not None]
    start, end = max((one for one, _ in ranges), default=0.0), min((one for _, one in ranges), default=0.0)
    spare = max(end - start - CLOCK_SECONDS, 0.0) / 2
    # What skin and muscle delay, s: sensors in step (MTw) seem up to 10 ms apart across knees, ankles and elbows, and
    # up to 23 ms across hips, shoulders and the spine.
    limb_sigma, trunk_sigma = 0.0055, 0.009
    signals = [None if one is None else one.cut(start + spare, end - spare) for one in signals]
    ends, delay, sigma = [], [], []
    for link in links:
        parent, child = signals[link.parent], signals[link.child]
        if link.p_parent is None or parent is None or child is None:
            continue
        found = link_delay(parent, child)
        if found is not None:
            ends.append((link.parent, link.child))
            delay.append(found[0])
            limb = JOINT_NAMES[bones[link.child]].endswith(LIMBS)
            sigma.append(np.hypot(found[1], limb_sigma if limb else trunk_sigma))
    return fewest_delays(len(signals), ends, np.array(delay), np.array(sigma))


def fewest_delays(sensors: int, ends: Sequence[tuple[int, int]], delay: Array, sigma: Array) -> tuple[SensorDelay, ...]:
    """One sensor after the other is let off, that which explains most, as long as it explains enough.

    Args:
        sensors: how many there are.
        ends: parent and child of ``L`` links.
        delay, sigma: ``(L,)`` seconds, of the child against the parent.
    """
    if not len(delay):
        return ()
    rows = np.zeros((len(ends), sensors))
    for row, (parent, child) in enumerate(ends):
        rows[row, [parent, child]] = -1, 1
    rows, wanted, enough = rows / sigma[:, None], delay / sigma, DELAY_DEVIATIONS**2
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
    return _significant_delays(late, rivals, rows, wanted)


def _significant_delays(
    late: Sequence[int], rivals: Mapping[int, int | None], rows: Array, wanted: Array
) -> tuple[SensorDelay, ...]:
    if not late:
        return ()
    information = rows[:, late].T @ rows[:, late]
    seconds = np.linalg.solve(information, rows[:, late].T @ wanted)
    sigma = np.sqrt(np.diag(np.linalg.inv(information)))
    found = (SensorDelay(s, float(a), float(b), rivals[s]) for s, a, b in zip(late, seconds, sigma, strict=True))
    # Sensors in step have seemed 0.024 s apart, for soft tissue follows the bone.
    return tuple(item for item in found if abs(item.seconds) > max(0.024, DELAY_DEVIATIONS * item.sigma))


def _cost(rows: Array, wanted: Array) -> float:
    if rows.shape[1] == 0:
        return float(wanted @ wanted)
    solution = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return float(np.sum((wanted - rows @ solution) ** 2))


LONGEST_S = 2.5  # that are looked for


def clock_step(signals: Sequence[JointSignal | None], links: Sequence[Link]) -> tuple[int, float] | None:
    """The sensor whose clock has surely jumped before a recording's end, and by how many seconds it is late there.

    Args:
        signals: of ``S`` sensors; None of those that tell nothing.
        links: of the sensor tree; those between sensors with a free limb in between say nothing.
    """
    sure = 10.0  # nats by which a shift explains more than none: 43 sound recordings and scenes have 7 at most
    near_s = 0.15  # smaller shifts are delays
    end_s = 15.0  # of a recording's end that are looked at, its last third if that is less
    ranges = [(one.time[0], one.time[-1]) for one in signals if one is not None]
    start, end = min((one for one, _ in ranges), default=0.0), max((one for _, one in ranges), default=0.0)
    looked_at = min(end_s, (end - start) / 3)
    steps = np.arange(*np.ceil((end - LONGEST_S - np.array([looked_at, 0.0])) / STEP).astype(int))
    gains = np.zeros((len(signals), len(SHIFTS)))
    for link in links:
        parent, child = signals[link.parent], signals[link.child]
        if link.p_parent is None or parent is None or child is None:
            continue
        share = shift_shares(parent, child, steps)
        if share is None:
            continue
        gain = looked_at * np.log(share[np.abs(SHIFTS) <= near_s].min() / share)
        gains[link.child] += gain
        gains[link.parent] += gain[::-1]
    sensor, shift = np.unravel_index(int(gains.argmax()), gains.shape)
    seconds, nats = float(SHIFTS[shift]), float(gains[sensor, shift])
    if nats < sure or abs(seconds) <= near_s or shift in (0, len(SHIFTS) - 1):
        return None
    return int(sensor), seconds


MOST = round(LONGEST_S / STEP)
SHIFTS = np.arange(-MOST, MOST + 1) * STEP


def shift_shares(parent: JointSignal, child: JointSignal, steps: np.ndarray) -> Array | None:
    """Of the parent's mean square acceleration the misfit that is left with the child late by each of :data:`SHIFTS`.

    None where they share too little at the ``steps`` ``(T,)``.
    """
    least_there = 0.6  # of the instants, with any shift: packets are lost
    steps = np.intersect1d(steps, common_steps(parent, child))
    steps = steps[(steps * STEP >= child.time[0] + LONGEST_S) & (steps * STEP <= child.time[-1] - LONGEST_S)]
    if len(steps) * STEP < LEAST_SHARED:
        return None
    reach = np.arange(steps[0] - MOST, steps[-1] + MOST + 1)
    above, below, known = parent.at(steps), child.at(reach), parent.complete(steps * STEP, STEP)
    there = child.complete(reach * STEP, STEP).astype(float)
    at_shift = sliding_window_view(there, len(steps))
    if (at_shift @ known).min() < least_there * len(steps):
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
