"""Estimation of sensor clocks that are delayed relative to the others, throughout or after a jump.

Two neighbouring sensors measure the acceleration of their common joint: their own plus that of the arm to the joint
(Seel, Raisch & Schauer, Sensors 14, 2014). Arms, relative heading and delay are estimated together, independent of
mountings, headings and body. The smallest set of delays that explains all pairs is chosen.

A clock jumps if samples are lost and a log shifts the later ones: at the end of a recording they are too early. All
shifts of up to some seconds are tried there. Strides repeat, so a shift has to explain much more than no shift, summed
over all joints of the sensor.
"""

from collections.abc import Callable, Iterator, Sequence
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

STEP = 1 / 30  # s: longer than foot strikes, which shake straps
FINE = 4  # samples per step; splines interpolate between them
ARM_SIGMA, MISFIT = 0.2, 1.5  # m, arm from sensor to joint; m/s², misfit of non-rigid bodies
SPACING = STEP * (1 + 1 / FINE)  # s between evaluated instants: all phases of the samples, which avoids a bias
STARTS = np.arange(-0.12, 0.121, 0.02)  # s, initial delays: the cost's valley is a quarter of a swing wide
REACH = float(STARTS[-1]) + STEP
HEADINGS = np.deg2rad(np.arange(0.0, 360.0, 30.0))
STRONG = 15.0  # m/s², scale above which accelerations have less initial weight
BLOCK = 1.0  # s: misfits within a swing are correlated
LEAST_SHARED = 3.0  # s, common time of two sensors
# Misfit over the joint's mean square acceleration: 0.05–0.4 for knees and ankles, up to 0.7 for hips, more for a loose
# sensor, whose delay would be wrong.
LARGEST_MISFIT = 0.75
GRAVITY = np.array([0.0, 0.0, 9.81])
Signal = Callable[[Array], Array]
_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


@dataclass(frozen=True)
class JointSignal:
    """Acceleration of points on a sensor's bone as a linear function of the arm to the point.

    Attributes:
        time: ``(T,)`` seconds, :data:`FINE` instants per step.
        values: ``(T, 3, 4)``: the sensor's acceleration in its inertial frame in m/s², and the matrix that multiplies
            the arm ``(3,)`` in the sensor's frame.
        valid: ``(T,)`` mask of instants without missing samples.
    """

    time: Array
    values: Array
    valid: np.ndarray

    @cached_property
    def spline(self) -> "scipy.interpolate.BSpline":
        """Cubic spline of the values."""
        return scipy.interpolate.make_interp_spline(self.time, self.values, k=3)

    def cut(self, start: float, end: float) -> "JointSignal | None":
        """Cut the signal to an interval; None if it is shorter than :data:`LEAST_SHARED`."""
        rows = slice(*np.searchsorted(self.time, (start, end)))
        signal = JointSignal(self.time[rows], self.values[rows], self.valid[rows])
        return signal if end - start >= LEAST_SHARED else None

    @cached_property
    def first(self) -> int:
        """Number of the first instant; ``FINE * n`` is ``n`` steps from the recording's start."""
        return round(self.time[0] / STEP * FINE)

    def at(self, steps: np.ndarray) -> Array:
        """Values at steps from the recording's start, to a :data:`FINE`-th of a step."""
        return self.values[steps * FINE - self.first]

    def complete(self, time: Array, reach: float) -> np.ndarray:
        """Test at which times no sample is missing within ``reach``."""
        missing = np.r_[0, np.cumsum(~self.valid)]
        start, end = (np.searchsorted(self.time, time + sign * reach) for sign in (-1, 1))
        return missing[end] == missing[start]


def joint_signal(stream: ImuStream) -> JointSignal | None:
    """Compute the signal of a stream; None without orientation or specific force, or if it is too short."""
    if stream.R_inertial_sensor is None or stream.specific_force is None:
        return None
    if stream.time[-1] - stream.time[0] < LEAST_SHARED:
        return None
    fine = resample_streams([stream], np.arange(stream.time[0], stream.time[-1], STEP / FINE))
    R, orientation_valid = fine.R_inertial_sensor[:, 0], fine.orientation_valid[:, 0]
    force_valid = fine.acceleration_valid[:, 0]
    count = len(fine) - 2 * FINE
    # differences over a step, and its triangular window as a sum of narrower ones
    previous_steps, steps, next_steps = (slice(shift, shift + count) for shift in (0, FINE, 2 * FINE))
    around = [slice(FINE + shift, FINE + shift + count) for shift in range(1 - FINE, FINE)]
    triangle = (FINE - np.abs(np.arange(1 - FINE, FINE))) / FINE**2
    valid = (
        orientation_valid[previous_steps]
        & orientation_valid[steps]
        & orientation_valid[next_steps]
        & np.all([force_valid[window] for window in around], axis=0)
    )
    values = np.empty((count, 3, 4))
    values[..., 0] = np.tensordot(triangle, [fine.specific_force_inertial[window, 0] for window in around], 1) - GRAVITY
    values[..., 1:] = (R[previous_steps] - 2 * R[steps] + R[next_steps]) / STEP**2
    return JointSignal(fine.time[steps], np.where(valid[:, None, None], values, 0.0), valid)


def common_steps(signal_a: JointSignal, signal_b: JointSignal) -> np.ndarray:
    """Steps from the recording's start that two signals have in common, with a margin of one."""
    start, end = max(signal_a.first, signal_b.first), min(s.first + len(s.time) - 1 for s in (signal_a, signal_b))
    return np.arange(-(-start // FINE) + 1, end // FINE)


def link_delay(parent: JointSignal, child: JointSignal, restarts: Sequence[float] = ()) -> tuple[float, float] | None:
    """Delay of the child's samples relative to the parent's and its standard deviation, seconds.

    The relative heading is another one after each of the ``restarts`` (seconds). None if they have too little common
    time or motion, or if no delay within reach makes them agree.
    """
    least_blocks, least_moving_s = 8, 2.0
    margin = REACH + 2 * STEP
    start, end = max(parent.time[0], child.time[0]) + margin, min(parent.time[-1], child.time[-1]) - margin
    time = np.arange(start, end, SPACING)
    time = time[parent.complete(time, STEP) & child.complete(time, margin)] if len(time) else time
    if len(time) * SPACING < least_blocks * BLOCK:
        return None
    above = parent.spline(time)
    if np.count_nonzero(_is_moving(above, child.spline(time))) * SPACING < least_moving_s:
        return None
    _, stretch = np.unique(np.searchsorted(restarts, time), return_inverse=True)
    starts = [(*_start(above, child.spline(time + seconds), stretch), seconds) for seconds in STARTS]
    _, headings, begin = min(starts, key=lambda start: start[0])
    seconds, sigma, misfit = _fit_delay(above, child.spline, child.spline.derivative(), time, begin, headings, stretch)
    return None if misfit > LARGEST_MISFIT or abs(seconds) > REACH else (seconds, sigma)


def joint_misfit(signal_a: JointSignal, signal_b: JointSignal) -> tuple[float, float] | None:
    """Mean square misfit of two sensors over the joint's acceleration, with best heading and arms; seconds of motion.

    Clocks are assumed to agree. None without common time.
    """
    steps = common_steps(signal_a, signal_b)
    steps = steps[signal_a.complete(steps * STEP, STEP) & signal_b.complete(steps * STEP, STEP)]
    if len(steps) * STEP < LEAST_SHARED:
        return None
    above, below = signal_a.at(steps), signal_b.at(steps)
    moving = _is_moving(above, below)
    time, stretch = np.zeros(len(steps)), np.zeros(len(steps), int)
    *_, share = _fit_delay(above, lambda _: below, None, time, 0.0, _start(above, below, stretch)[1], stretch)
    return share, np.count_nonzero(moving) * STEP


def _is_moving(above: Array, below: Array) -> np.ndarray:
    """Mask ``(T,)`` of instants at which either sensor is accelerated; at rest there is only noise."""
    return np.asarray(np.sum(above[:, :, 0] ** 2 + below[:, :, 0] ** 2, axis=1) > MISFIT**2)


def _start(above: Array, below: Array, stretch: np.ndarray) -> tuple[float, Array]:
    """Least cost over headings and the headings ``(P,)`` of the stretches, whose numbers are ``stretch`` ``(T,)``."""
    weight = np.sqrt(1 / (1 + np.sum(above[:, :, 0] ** 2 + below[:, :, 0] ** 2, axis=1) / STRONG**2))
    sides = [side * weight[:, None, None] for side in (above, below)]
    of_stretches = (stretch == number for number in range(stretch.max() + 1))
    products = np.stack([joint_products(*(side[rows] for side in sides)) for rows in of_stretches])
    costs, headings = least_over_headings(products)
    return float(costs.sum()), headings


def least_over_headings(products: Array) -> tuple[Array, Array]:
    """Least costs ``(L,)`` over headings and these headings, with arms eliminated.

    ``products`` ``(L, 5, 4, 4)`` are those of :func:`joint_products`.
    """
    turns = np.stack([np.cos(HEADINGS), np.sin(HEADINGS), np.ones(len(HEADINGS))], axis=1)
    gram = np.zeros((len(products), len(HEADINGS), 8, 8))
    gram[..., :4, :4], gram[..., 4:, 4:] = products[:, None, 0], products[:, None, 1]
    gram[..., :4, 4:] = -np.einsum("hc,lckm->lhkm", turns, products[:, 2:])
    gram[..., 4:, :4] = transpose(gram[..., :4, 4:])
    # the first column of either side has coefficient 1, the others are multiplied by the arms
    fixed, arms = np.array([1.0, 0, 0, 0, 1.0, 0, 0, 0]), [1, 2, 3, 5, 6, 7]
    linear, square = (gram @ fixed)[..., arms], gram[..., arms, :][..., arms] + (MISFIT / ARM_SIGMA) ** 2 * np.eye(6)
    cost = fixed @ gram @ fixed - np.sum(linear * np.linalg.solve(square, linear[..., None])[..., 0], axis=-1)
    index = cost.argmin(axis=1)
    return cost[np.arange(len(cost)), index], HEADINGS[index]


def _fit_delay(
    above: Array,
    below: Signal,
    rate: Signal | None,
    time: Array,
    seconds: float,
    headings: Array,
    stretch: np.ndarray,
) -> tuple[float, float, float]:
    """Gauss–Newton over headings, both arms and delay with Cauchy weights; returns delay, sigma and relative misfit.

    The sigma is computed from independent blocks. Without the ``rate`` of ``below`` the delay is constant. ``headings``
    are those of the stretches, whose numbers are ``stretch`` ``(T,)``.
    """
    rounds = 12
    tolerance = 1e-6  # radians, metres and seconds
    P, arms = len(headings), np.zeros(6)
    has_prior = np.r_[np.zeros(P), np.ones(6), np.zeros(int(rate is not None))]
    for _ in range(rounds):
        turn = rotation_z(headings)[stretch]
        turned = turn @ below(time + seconds)
        by_arms = np.concatenate([above[:, :, 1:], -turned[:, :, 1:]], axis=2)
        misfit = above[:, :, 0] - turned[:, :, 0] + by_arms @ arms
        coefficients = np.concatenate([[1.0], arms[3:]])
        by_headings = np.zeros((len(above), 3, P))
        by_headings[np.arange(len(above)), :, stretch] = -(turned @ coefficients) @ _TURN.T
        slopes = [by_headings, by_arms]
        if rate is not None:
            slopes.append(-(turn @ rate(time + seconds) @ coefficients)[..., None])
        slope = np.concatenate(slopes, axis=2)
        square = np.sum(misfit**2, axis=1)
        scale = max(float(np.median(square)) / 2.37, 0.05)  # 2.37: the median of chi square with three degrees
        weight = 1 / (1 + square / (4 * scale))
        prior = scale / ARM_SIGMA**2 * has_prior
        weighted = slope * weight[:, None, None]
        unknowns = slope.shape[2]
        hessian = weighted.reshape(-1, unknowns).T @ slope.reshape(-1, unknowns) + np.diag(prior + 1e-9)
        scores = np.einsum("tik,ti->tk", weighted, misfit)
        values = np.r_[np.zeros(P), arms, np.zeros(unknowns - P - 6)]
        step = -np.linalg.solve(hessian, scores.sum(axis=0) + prior * values)
        headings, arms = headings + step[:P], arms + step[P : P + 6]
        seconds += float(np.clip(step[P + 6 :].sum(), -0.03, 0.03))
        if abs(seconds) > REACH or np.abs(step).max() < tolerance:
            break
    block = ((time - time[0]) / BLOCK).astype(int)
    sums = np.stack([np.bincount(block, column) for column in scores.T], axis=1)
    spread = np.linalg.solve(hessian, sums.T)[-1]
    joint = np.sum((above[:, :, 0] + above[:, :, 1:] @ arms[:3]) ** 2, axis=1)
    return seconds, float(np.linalg.norm(spread)), float(weight @ square / (weight @ joint))


LIMBS = ("knee", "ankle", "foot", "elbow", "wrist", "hand")  # lower bones of links within a limb


CLOCK_SECONDS = 40.0  # of the recording, from its middle: some twenty strides
DELAY_DEVIATIONS = 4.0  # standard deviations by which a delay must differ from zero


@dataclass(frozen=True)
class SensorDelay:
    """Delay of a sensor's samples.

    Attributes:
        sensor: number of the sensor.
        seconds, sigma: delay (negative: early) and its standard deviation.
        rival: sensor that may have the opposite delay instead, or None.
    """

    sensor: int
    seconds: float
    sigma: float
    rival: int | None = None


def _joined(
    signals: Sequence[JointSignal | None], links: Sequence[Link]
) -> Iterator[tuple[Link, JointSignal, JointSignal]]:
    """Links across one joint, with the signals of parent and child."""
    for link in links:
        parent, child = signals[link.parent], signals[link.child]
        if link.p_parent is not None and parent is not None and child is not None:
            yield link, parent, child


def sensor_delays(
    signals: Sequence[JointSignal | None], bones: Sequence[int], links: Sequence[Link], restarts: Sequence[float] = ()
) -> tuple[SensorDelay, ...]:
    """Find delayed sensors, fewer than half of all, from ``signals`` (None for unusable sensors) and their bones.

    Headings may be others after each of the ``restarts`` (seconds); without any the middle of a long recording is
    used. Links of the sensor tree with a free limb in between are not used.
    """
    ranges = [(signal.time[0], signal.time[-1]) for signal in signals if signal is not None]
    start, end = max((t for t, _ in ranges), default=0.0), min((t for _, t in ranges), default=0.0)
    spare = 0.0 if len(restarts) else max(end - start - CLOCK_SECONDS, 0.0) / 2
    # s, delays by soft tissue: up to 10 ms across knees, ankles and elbows, 23 ms across hips, shoulders and the spine
    limb_sigma, trunk_sigma = 0.0055, 0.009
    signals = [None if signal is None else signal.cut(start + spare, end - spare) for signal in signals]
    ends, delay, sigma = [], [], []
    for link, parent, child in _joined(signals, links):
        estimate = link_delay(parent, child, restarts)
        if estimate is not None:
            ends.append((link.parent, link.child))
            delay.append(estimate[0])
            limb = JOINT_NAMES[bones[link.child]].endswith(LIMBS)
            sigma.append(np.hypot(estimate[1], limb_sigma if limb else trunk_sigma))
    return fewest_delays(len(signals), ends, np.array(delay), np.array(sigma))


def fewest_delays(sensors: int, ends: Sequence[tuple[int, int]], delay: Array, sigma: Array) -> tuple[SensorDelay, ...]:
    """Choose delayed sensors greedily by the decrease of the cost.

    ``ends`` are parent and child of ``L`` links, ``delay`` and ``sigma`` ``(L,)`` seconds of the child relative to the
    parent.
    """
    if not len(delay):
        return ()
    rows = np.zeros((len(ends), sensors))
    for row, (parent, child) in enumerate(ends):
        rows[row, [parent, child]] = -1, 1
    rows, wanted, threshold = rows / sigma[:, None], delay / sigma, DELAY_DEVIATIONS**2
    late: list[int] = []
    rivals: dict[int, int | None] = {}
    while len(late) + 1 < sensors / 2 or (sensors == 2 and not late):
        cost = {s: _cost(rows[:, [*late, s]], wanted) for s in range(sensors) if s not in late and np.any(rows[:, s])}
        if not cost:
            break
        sensor, *other_sensors = sorted(cost, key=lambda s: cost[s])
        if _cost(rows[:, late], wanted) - cost[sensor] < threshold:
            break
        late.append(sensor)
        rivals[sensor] = next((s for s in other_sensors[:1] if cost[s] - cost[sensor] < threshold / 4), None)
    if not late:
        return ()
    information = rows[:, late].T @ rows[:, late]
    seconds = np.linalg.solve(information, rows[:, late].T @ wanted)
    sigma = np.sqrt(np.diag(np.linalg.inv(information)))
    delays = (SensorDelay(s, float(a), float(b), rivals[s]) for s, a, b in zip(late, seconds, sigma, strict=True))
    # soft tissue causes up to 0.024 s
    return tuple(delay for delay in delays if abs(delay.seconds) > max(0.024, DELAY_DEVIATIONS * delay.sigma))


def _cost(rows: Array, wanted: Array) -> float:
    solution = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return float(np.sum((wanted - rows @ solution) ** 2))


LONGEST_S = 2.5  # largest jump


def clock_step(signals: Sequence[JointSignal | None], links: Sequence[Link]) -> tuple[int, float] | None:
    """Find a sensor whose clock has jumped before a recording's end; returns it and its delay there in seconds.

    Arguments are those of :func:`sensor_delays`.
    """
    sure = 10.0  # nats, least gain of a shift; recordings without a jump have at most 7
    near_s = 0.15  # smaller shifts are delays
    end_s = 15.0  # of the recording's end that are used, at most its last third
    ranges = [(signal.time[0], signal.time[-1]) for signal in signals if signal is not None]
    start, end = min((t for t, _ in ranges), default=0.0), max((t for _, t in ranges), default=0.0)
    looked_at = min(end_s, (end - start) / 3)
    steps = np.arange(*np.ceil((end - LONGEST_S - np.array([looked_at, 0.0])) / STEP).astype(int))
    gains = np.zeros((len(signals), len(SHIFTS)))
    for link, parent, child in _joined(signals, links):
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
    """Misfit over the parent's mean square acceleration for each of the :data:`SHIFTS` of the child.

    None if they have too little in common at the ``steps`` ``(T,)``.
    """
    least_present = 0.6  # of the instants, with any shift: packets are lost
    steps = np.intersect1d(steps, common_steps(parent, child))
    steps = steps[(steps * STEP >= child.time[0] + LONGEST_S) & (steps * STEP <= child.time[-1] - LONGEST_S)]
    if len(steps) * STEP < LEAST_SHARED:
        return None
    reach = np.arange(steps[0] - MOST, steps[-1] + MOST + 1)
    above, below, is_complete = parent.at(steps), child.at(reach), parent.complete(steps * STEP, STEP)
    is_present = child.complete(reach * STEP, STEP).astype(float)
    at_shift = sliding_window_view(is_present, len(steps))
    if (at_shift @ is_complete).min() < least_present * len(steps):
        return None
    weight = is_complete / (1 + np.sum(above[:, :, 0] ** 2, axis=1) / STRONG**2)
    products = _shifted_products(above, weight, below, is_present)
    floor = MISFIT**2 * (at_shift @ weight)  # misfit of non-rigid bodies
    cost, _ = least_over_headings(products)
    return np.asarray((cost + floor) / (products[:, 0, 0, 0] + floor))


def _shifted_products(above: Array, weight: Array, below: Array, is_present: Array) -> Array:
    """Compute :func:`joint_products` ``(N - T + 1, 5, 4, 4)`` of ``(T, 3, 4)`` and shifted ``(N, 3, 4)``.

    Products have the ``weight`` ``(T,)`` times ``is_present`` ``(N,)``.
    """
    size = 1 << (len(below) - 1).bit_length()

    def spectrum(values: Array) -> np.ndarray:
        return np.fft.rfft(values, size, axis=0)

    weighted, masked = above * weight[:, None, None], below * is_present[:, None, None]
    A, B = spectrum(weighted).conj()[..., None], spectrum(masked)[:, :, None]
    above_products = spectrum(np.swapaxes(weighted, 1, 2) @ above).conj() * spectrum(is_present)[:, None, None]
    below_products = spectrum(weight).conj()[:, None, None] * spectrum(np.swapaxes(masked, 1, 2) @ below)
    across = A[:, 1] * B[:, 0] - A[:, 0] * B[:, 1]
    products = [above_products, below_products, A[:, 0] * B[:, 0] + A[:, 1] * B[:, 1], across, A[:, 2] * B[:, 2]]
    return np.fft.irfft(np.stack(products, axis=1), size, axis=0)[: len(below) - len(above) + 1]
