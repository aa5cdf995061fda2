"""How late one sensor is against its neighbour: the joint between their bones is accelerated once, not twice.

The joint's acceleration is told by either sensor: its own, and the turning of its bone times the arm from it to the
joint (Seel, Raisch & Schauer, Sensors 14, 2014). Where the joint lies from either sensor, how their headings differ and
how late one is are found together, so nothing of mountings, headings or the body is supposed. Rates of turn would need
less, but in walking thigh and shank do not turn in step.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.sensors.frames import coarser, resample_streams
from vip_factors.sensors.imu_stream import ImuStream

STEP = 1 / 30  # s: what is quicker are foot strikes, which ring straps and reach one sensor after the other
FINE = 4  # instants in a step at which accelerations are known; splines give them in between
ARM_SIGMA, MISFIT = 0.2, 1.5  # m from sensor to joint; m/s² by which bodies that are not rigid miss
STARTS = np.arange(-0.12, 0.121, 0.02)  # s, delays looked at: the misfit's valley is a quarter of a swing wide
HEADINGS = np.deg2rad(np.arange(0.0, 360.0, 30.0))
STRONG = 15.0  # m/s², from which on an acceleration counts less at the start
ROUNDS = 12
BLOCK = 1.0  # s: misfits within a swing belong together
LEAST_BLOCKS = 8
# Of the joint's mean square acceleration, misfit that is left: knees and ankles leave 0.05–0.4, hips to 0.7; a loose
# sensor on a thigh 0.9 to its shank and 2.6 to its pelvis, and 85 ms where there were none.
POOR = 0.75
GRAVITY = np.array([0.0, 0.0, 9.81])
_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


@dataclass(frozen=True)
class LinkDelay:
    """How late the child's samples are against the parent's, and its standard deviation, in seconds."""

    seconds: float
    sigma: float


@dataclass(frozen=True)
class JointSignal:
    """What a sensor says of the acceleration of points of its bone, over time.

    Attributes:
        time: ``(T,)`` seconds.
        known: ``(T,)`` whether all samples around are there.
        spline: of ``(3, 4)``: the sensor's acceleration in its inertial frame in m/s², and what the arm ``(3,)`` in the
            sensor's frame is to be multiplied with to get that of a point.
    """

    time: Array
    known: np.ndarray
    spline: BSpline


def joint_signal(stream: ImuStream) -> JointSignal | None:
    """None of a stream without orientation or specific force, or one that is too short."""
    if stream.R_inertial_sensor is None or stream.specific_force is None:
        return None
    if stream.time[-1] - stream.time[0] < LEAST_BLOCKS * BLOCK:
        return None
    # Coarse frames, FINE times, each a part of a step later than before.
    time = np.arange(stream.time[0], stream.time[-1], STEP / FINE)
    phases = [coarser(resample_streams([stream], time[phase:]), FINE) for phase in range(FINE)]
    count = min(len(one) for one in phases) - 2
    values, known = np.zeros((count, FINE, 3, 4)), np.zeros((count, FINE), bool)
    for phase, frames in enumerate(phases):
        R, seen = frames.R_inertial_sensor[: count + 2, 0], frames.orientation_valid[: count + 2, 0]
        values[:, phase, :, 0] = frames.specific_force_inertial[1 : count + 1, 0] - GRAVITY
        values[:, phase, :, 1:] = (R[:-2] - 2 * R[1:-1] + R[2:]) / STEP**2
        known[:, phase] = seen[:-2] & seen[1:-1] & seen[2:] & frames.acceleration_valid[1 : count + 1, 0]
    flat = known.ravel()
    filled = np.where(flat[:, None, None], values.reshape(-1, 3, 4), 0.0)
    time = time[FINE : FINE + count * FINE]
    return JointSignal(time, flat, make_interp_spline(time, filled, k=3))


def link_delay(parent: JointSignal, child: JointSignal) -> LinkDelay | None:
    """None where the two share too little time, or no delay in reach makes them tell the same."""
    margin = float(STARTS[-1]) + 2 * STEP
    time = np.arange(
        max(parent.time[0], child.time[0]) + margin, min(parent.time[-1], child.time[-1]) - margin, STEP
    )  # fmt: skip
    time = time[_known(parent, time, STEP) & _known(child, time, margin)] if len(time) else time
    if len(time) * STEP < LEAST_BLOCKS * BLOCK:
        return None
    above = parent.spline(time)
    start = min((_start(above, child.spline(time + seconds), seconds) for seconds in STARTS), key=lambda one: one[0])
    return _refined(above, child.spline, time, start[1], start[2])


def _known(signal: JointSignal, time: Array, reach: float) -> np.ndarray:
    """Whether nothing is missing within the reach of each of the times."""
    missing = np.r_[0, np.cumsum(~signal.known)]
    first, last = (np.searchsorted(signal.time, time + sign * reach) for sign in (-1, 1))
    return missing[last] == missing[first]


def _start(above: Array, below: Array, seconds: float) -> tuple[float, float, float]:
    """Least cost over headings, the delay, and that heading; arms are eliminated."""
    strength = np.sum(above[:, :, 0] ** 2 + below[:, :, 0] ** 2, axis=1)
    weight = 1 / (1 + strength / STRONG**2)
    own = [np.einsum("tik,t,til->kl", one, weight, one) for one in (above, below)]
    cross = np.einsum("tik,t,tjl->ijkl", above, weight, below)
    best = (np.inf, seconds, 0.0)
    for heading in HEADINGS:
        shared = np.einsum("ij,ijkl->kl", rotation_z(heading), cross)
        gram = np.block([[own[0], -shared], [-shared.T, own[1]]])
        # The first column of either side is what both accelerations are; the rest are multiplied with the arms.
        fixed, arms = np.array([1.0, 0, 0, 0, 1.0, 0, 0, 0]), [1, 2, 3, 5, 6, 7]
        linear, square = gram[arms] @ fixed, gram[np.ix_(arms, arms)] + (MISFIT / ARM_SIGMA) ** 2 * np.eye(6)
        cost = float(fixed @ gram @ fixed - linear @ np.linalg.solve(square, linear))
        best = min(best, (cost, seconds, float(heading)))
    return best


def _refined(above: Array, below: BSpline, time: Array, seconds: float, heading: float) -> LinkDelay | None:
    """Gauss–Newton over delay, heading and both arms, Cauchy weights; a sigma from blocks as independent as swings."""
    arms, rate = np.zeros(6), below.derivative()
    for _ in range(ROUNDS):
        turned = rotation_z(heading) @ below(time + seconds)
        by_arms = np.concatenate([above[:, :, 1:], -turned[:, :, 1:]], axis=2)
        misfit = above[:, :, 0] - turned[:, :, 0] + by_arms @ arms
        at = np.concatenate([[1.0], arms[3:]])
        by_seconds, by_heading = -(rotation_z(heading) @ rate(time + seconds)) @ at, -(turned @ at) @ _TURN.T
        slopes = np.concatenate([by_seconds[..., None], by_heading[..., None], by_arms], axis=2)
        square = np.sum(misfit**2, axis=1)
        scale = max(float(np.median(square)) / 2.37, 0.05)  # 2.37: the median of chi square with three degrees
        weight = 1 / (1 + square / (4 * scale))
        prior = np.r_[0, 0, np.full(6, scale / ARM_SIGMA**2)]
        hessian = np.einsum("tik,t,til->kl", slopes, weight, slopes) + np.diag(prior + 1e-9)
        scores = np.einsum("tik,t,ti->tk", slopes, weight, misfit)
        step = -np.linalg.solve(hessian, scores.sum(axis=0) + prior * np.r_[0, 0, arms])
        seconds += float(np.clip(step[0], -0.03, 0.03))
        heading, arms = heading + float(step[1]), arms + step[2:]
        if abs(seconds) > STARTS[-1] + STEP:
            return None
    block = ((time - time[0]) / BLOCK).astype(int)
    sums = np.stack([np.bincount(block, column) for column in scores.T], axis=1)
    spread = np.linalg.solve(hessian, sums.T)[0]
    joint = np.sum((above[:, :, 0] + above[:, :, 1:] @ arms[:3]) ** 2, axis=1)
    if weight @ square > POOR * (weight @ joint):
        return None
    return LinkDelay(seconds, float(np.linalg.norm(spread)))
