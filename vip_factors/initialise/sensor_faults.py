"""Sensors whose clocks are off their fellows', and accelerometers of wrong scale or exceeded range.

How late one sensor is against its neighbour: the joint between their bones is accelerated once, not twice. The joint's
acceleration is told by either sensor: its own, and the turning of its bone times the arm from it to the joint (Seel,
Raisch & Schauer, Sensors 14, 2014). Where the joint lies from either sensor, how their headings differ and how late one
is are found together, so nothing of mountings, headings or the body is supposed. Rates of turn would need less, but in
walking thigh and shank do not turn in step. The fewest delays that explain what neighbours say are taken.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.compiled import Kernels, kernels
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
ROUNDS = 12
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


def common_steps(one: JointSignal, other: JointSignal, margin: int = 1) -> np.ndarray:
    """Steps from the recording's start that two signals have, and as many as the margin on either side."""
    first, last = max(one.first, other.first), min(each.first + len(each.time) - 1 for each in (one, other))
    return np.arange(-(-first // FINE) + margin, last // FINE + 1 - margin)


def link_delay(parent: JointSignal, child: JointSignal) -> tuple[float, float] | None:
    """How late the child's samples are against the parent's, and its standard deviation, in seconds.

    None where the two share too little time, or no delay in reach makes them tell the same.
    """
    least_blocks = 8
    margin = REACH + 2 * STEP
    time = np.arange(
        max(parent.time[0], child.time[0]) + margin, min(parent.time[-1], child.time[-1]) - margin, APART
    )  # fmt: skip
    time = time[parent.complete(time, STEP) & child.complete(time, margin)] if len(time) else time
    if len(time) * APART < least_blocks * BLOCK:
        return None
    above = parent.spline(time)
    starts = [(*_start(above, child.spline(time + seconds)), seconds) for seconds in STARTS]
    _, heading, begin = min(starts)
    seconds, sigma, misfit = joint_delay(above, child, time, begin, heading)
    return None if misfit > POOR or abs(seconds) > REACH else (seconds, sigma)


def joint_delay(
    above: Array, child: JointSignal, time: Array, seconds: float, heading: float, kernels: Kernels = kernels
) -> tuple[float, float, float]:
    """The delay of a child against the parent's values ``(T, 3, 4)``, its sigma, and :func:`joint_share`.

    From a delay and a heading on; ``time`` ``(T,)`` is well within the child's.
    """
    if kernels is None:
        return _refined(above, child.spline, child.spline.derivative(), time, seconds, heading)
    found, step, blocks = np.empty(3), STEP / FINE, ((time - time[0]) / BLOCK).astype(np.int64)
    place = (time - child.time[0]) / step
    kernels.joint_delay(above, child.spline.c, place, blocks, step, REACH, seconds, heading, found)
    return float(found[0]), float(found[1]), float(found[2])


def joint_misfit(one: JointSignal, other: JointSignal) -> tuple[float, float] | None:
    """Of a joint's acceleration the share (in squares) by which two sensors disagree, and seconds of motion.

    Heading and arms are those that fit best; clocks agree. None where the two share no time.
    """
    steps = common_steps(one, other)
    steps = steps[one.complete(steps * STEP, STEP) & other.complete(steps * STEP, STEP)]
    if len(steps) * STEP < LEAST_SHARED:
        return None
    above, below = one.at(steps), other.at(steps)
    moving = np.sum(above[:, :, 0] ** 2 + below[:, :, 0] ** 2, axis=1) > MISFIT**2  # rest tells of noise alone
    return joint_share(above, below), np.count_nonzero(moving) * STEP


def joint_share(above: Array, below: Array, kernels: Kernels = kernels) -> float:
    """The share (in squares) by which two sensors' values ``(T, 3, 4)`` disagree about a joint's acceleration."""
    if kernels is not None:
        return float(kernels.joint_share(above, below))
    still = np.zeros_like(below)
    return _refined(above, lambda _: below, lambda _: still, np.zeros(len(above)), 0.0, _start(above, below)[1])[2]


def _start(above: Array, below: Array) -> tuple[float, float]:
    """Least cost over headings, and that heading."""
    weight = 1 / (1 + np.sum(above[:, :, 0] ** 2 + below[:, :, 0] ** 2, axis=1) / STRONG**2)
    products = joint_products(*(one * np.sqrt(weight)[:, None, None] for one in (above, below)))
    cost, heading = least_over_headings(products[None])
    return float(cost[0]), float(heading[0])


def least_over_headings(products: Array, kernels: Kernels = kernels) -> tuple[Array, Array]:
    """Least costs ``(L,)`` over headings, and these; of :func:`joint_products` ``(L, 5, 4, 4)``, arms eliminated."""
    if kernels is not None:
        found = np.empty(len(products)), np.empty(len(products))
        kernels.least_over_headings(np.ascontiguousarray(products), *found)
        return found
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


def _refined(
    above: Array, below: Signal, rate: Signal, time: Array, seconds: float, heading: float
) -> tuple[float, float, float]:
    """Gauss–Newton over delay, heading and both arms, Cauchy weights: the delay, its sigma, and the misfit's share.

    The sigma is from blocks as independent as swings. Where the ``rate`` of what is ``below`` is nought, none is found.
    """
    arms = np.zeros(6)
    for _ in range(ROUNDS):
        there, moved = below(time + seconds), rate(time + seconds)
        turned = rotation_z(heading) @ there
        by_arms = np.concatenate([above[:, :, 1:], -turned[:, :, 1:]], axis=2)
        misfit = above[:, :, 0] - turned[:, :, 0] + by_arms @ arms
        at = np.concatenate([[1.0], arms[3:]])
        by_seconds, by_heading = -(rotation_z(heading) @ moved) @ at, -(turned @ at) @ _TURN.T
        slopes = np.concatenate([by_seconds[..., None], by_heading[..., None], by_arms], axis=2)
        square = np.sum(misfit**2, axis=1)
        scale = max(float(np.median(square)) / 2.37, 0.05)  # 2.37: the median of chi square with three degrees
        weight = 1 / (1 + square / (4 * scale))
        prior = np.r_[0, 0, np.full(6, scale / ARM_SIGMA**2)]
        weighted = slopes * weight[:, None, None]
        hessian = np.tensordot(weighted, slopes, ((0, 1), (0, 1))) + np.diag(prior + 1e-9)
        scores = np.einsum("tik,ti->tk", weighted, misfit)
        step = -np.linalg.solve(hessian, scores.sum(axis=0) + prior * np.r_[0, 0, arms])
        seconds += float(np.clip(step[0], -0.03, 0.03))
        heading, arms = heading + float(step[1]), arms + step[2:]
        if abs(seconds) > REACH:
            break
    block = ((time - time[0]) / BLOCK).astype(int)
    sums = np.stack([np.bincount(block, column) for column in scores.T], axis=1)
    spread = np.linalg.solve(hessian, sums.T)[0]
    joint = np.sum((above[:, :, 0] + above[:, :, 1:] @ arms[:3]) ** 2, axis=1)
    return seconds, float(np.linalg.norm(spread)), float(weight @ square / (weight @ joint))


LIMBS = ("knee", "ankle", "foot", "elbow", "wrist", "hand")  # what the lower bone of a link within a limb is called


CLOCK_SECONDS = 40.0  # of the recording, from its middle: some twenty strides
DELAY_DEVIATIONS = 4.0  # standard deviations by which a delay must differ from zero


@dataclass(frozen=True)
class SensorClockSettings:
    """How sensors whose clocks are off their fellows' are looked for, and what is done about them."""

    check: bool = True  # off: clocks agree, whatever the motion says
    correct: bool = True  # off: delays are told, and left


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


SAME = 1e-3  # of the range: a clipped axis repeats one number; converting from its own unit rounds the last digit


@dataclass(frozen=True)
class AccelerometerSettings:
    """What accelerometers are looked over for, and what is done."""

    check: bool = True  # off: they are taken as they are


def accelerometer_scale(stream: ImuStream) -> tuple[float, float] | None:
    """What gravity measures, of what it is, and the standard deviation of that.

    From the mean specific force along the vertical: over a long time nobody accelerates.

    Up and down cancel out, so no rest is needed: on a treadmill there may be none. None without orientation.
    """
    standard_gravity = 9.81
    if stream.specific_force is None or stream.R_inertial_sensor is None or len(stream) < 2:
        return None
    vertical = np.einsum("nj,nj->n", stream.R_inertial_sensor[:, 2], stream.specific_force)
    step = np.diff(stream.time)
    measured = step < 2 / stream.rate  # lost samples say nothing
    seconds = float(step[measured].sum())
    if seconds <= 0:
        return None
    mean = float(np.sum((step * (vertical[1:] + vertical[:-1]) / 2)[measured]) / seconds)
    speed_change = 2.0  # m/s by which a sensor's vertical speed may differ between start and end
    zero_offset = 0.005  # of gravity: zero offsets are as much, and no scale
    sigma = np.hypot(speed_change / (seconds * standard_gravity), zero_offset)
    return mean / standard_gravity, float(sigma)


def is_scale_wrong(scale: float, sigma: float) -> bool:
    """Whether a scale is off one: sound ones are by up to 1.5 %, some by 3 % where nobody calibrated."""
    return abs(scale - 1) > max(0.04, 4.0 * sigma)


# Of the mean force to the vertical: what is wrong, and what is right. Fifteen sound recordings have up to 2.8°.
LEANING, UPRIGHT = np.deg2rad(10.0), np.deg2rad(4.0)
INVERTED = "inverted"


def force_in_wrong_axes(stream: ImuStream) -> str | None:
    """The axis, ``"x"``, ``"y"`` or ``"z"``, whose specific force has the wrong sign; :data:`INVERTED` where
    orientations turn the inertial frame into the sensor's.

    The mean force is upright in the inertial frame, over a long time. None where it is, and where none of this makes
    it so.
    """
    if stream.specific_force is None or stream.R_inertial_sensor is None or len(stream) < 2:
        return None
    known = stream.force_measured_mask
    R, force = stream.R_inertial_sensor[known], stream.specific_force[known]
    if _leaning(R, force) < LEANING:
        return None
    found = {
        axis: _leaning(R, force * np.where(np.arange(3) == number, -1.0, 1.0)) for number, axis in enumerate("xyz")
    }
    found[INVERTED] = _leaning(transpose(R), force)
    best = min(found, key=lambda one: found[one])
    return best if found[best] < UPRIGHT else None


def _leaning(R: Array, force: Array) -> float:
    """Angle of the mean force to the vertical."""
    mean = np.einsum("nij,nj->i", R, force)
    return float(np.arctan2(np.hypot(mean[0], mean[1]), mean[2]))


def range_ends(stream: ImuStream) -> tuple[tuple[int, float], ...]:
    """Axes and values at which an accelerometer's range ends: extremes that repeat themselves, time and again."""
    least_range = 15.0  # m/s²: accelerometers of bodies measure 2 g at least, and what rests at 1 g is constant too
    if stream.specific_force is None:
        return ()
    largest = float(np.max(np.abs(stream.specific_force)))
    return tuple(
        (number, end)
        for number, axis in enumerate(stream.specific_force.T)
        for end in sorted({float(axis.max()), float(axis.min())})
        if abs(end) > least_range and abs(end) > 0.9 * largest and len(_runs(axis, end)) >= 2  # once may be chance
    )


def clipped_samples(stream: ImuStream, ends: Sequence[tuple[int, float]]) -> np.ndarray:
    """Which samples ``(N,)`` stand at one of the ends of the range for as long as no motion does by itself."""
    clipped = np.zeros(len(stream), bool)
    if stream.specific_force is None:
        return clipped
    for number, end in ends:
        for first, last in _runs(stream.specific_force[:, number], end):
            clipped[first:last] = True
    return clipped


def _runs(axis: Array, end: float) -> list[tuple[int, int]]:
    """First sample and the one after the last of each run at an end of the range, of two samples or more."""
    at_end = np.abs(axis - end) < SAME * abs(end)
    edges = np.flatnonzero(np.diff(np.r_[0, at_end.astype(int), 0]))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= 2]


def longest_repeat(stream: ImuStream) -> float:
    """Seconds of the longest stretch in which a stream gives the very same values."""
    measured = [
        one for one in (stream.R_inertial_sensor, stream.specific_force, stream.angular_rate) if one is not None
    ]
    same = np.logical_and.reduce([np.all(np.diff(one.reshape(len(one), -1), axis=0) == 0, axis=1) for one in measured])
    starts, ends = np.flatnonzero(np.diff(np.r_[False, same, False].astype(int))).reshape(-1, 2).T
    return float(np.max(stream.time[ends] - stream.time[starts], initial=0.0))
