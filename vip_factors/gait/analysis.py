"""Gait of an estimate: strides, means and how sure they are, left against right, joint angles over the cycle.

How far a foot came between two moments at rest, by its own sensor: specific force integrated twice.

Orientation tells which way is up; at rest the foot does not move, so what the first integral is off by at the end was
picked up on the way. It is taken back in proportion to the square of the acceleration, as if an accelerometer erred by
a share of what it measures: most of it comes in at the landing, whose blows are clipped and fall between samples.
"""

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.joint_angles import is_measured, joint_angle_sigmas, joint_angles
from vip_factors.body.model_errors import shape_factor
from vip_factors.errors import InputError, RecordingError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.findings import Finding
from vip_factors.gait.events import SIDES, FootEvents, events_of_motion, events_of_sensor
from vip_factors.gait.strides import QUANTITIES, Quantity, Stride, strides_of
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.imu_stream import ImuStream, with_orientation
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene

LEAST_RATE_HZ = 60.0  # of samples: at 30 to 47 Hz lengths were off by decimetres, and toe-offs by 20 to 40 ms
LONGEST_S = 3.0  # between two rests: errors grow with the square of it
WIDEST_GAP_S = 0.05  # of lost samples in between
GRAVITY = np.array([0.0, 0.0, 9.81])
CYCLE = np.arange(101.0)  # per cent
# What all strides of a recording are off by together, one standard deviation, as walks of six people with a reference
# showed: strikes and toe-offs by another sensor or another definition of contact, s; lengths as shares of them, by legs
# whose hips swing less in the estimate than they do, or by sensors whose blows are clipped; and what lies between the
# feet or below the toes, by headings, mountings and soles. Half of it differs between the sides.
EVENT_S, LENGTH_BY_LEGS, LENGTH_BY_SENSOR = 0.02, 0.06, 0.015
SHARED = {"width": 0.09, "clearance": 0.01, "strike_angle": 4.0}  # m, m, degrees
LENGTHS = ("length", "speed", "step_length", "width")  # of which the sides do not differ in it
FEWEST = 3  # strides of a foot, for a mean
# How the feet stand to each other is told by sensors on pelvis and shanks; what a foot does by one on it.
LEGS = frozenset({"pelvis", "left_knee", "right_knee"})
OF_BOTH_LEGS, OF_A_FOOT = ("width", "step_length"), ("clearance", "strike_angle")


@dataclass(frozen=True)
class Figure:
    """A number of all strides that count.

    Attributes:
        quantity: what it is of.
        side: ``left``, ``right``, ``both``, or ``difference``: left less right.
        count: of strides.
        mean: of them.
        variability: standard deviation from stride to stride; NaN of a difference.
        sigma: standard deviation of the mean: of the strides, and of what all of them share.
    """

    quantity: Quantity
    side: str
    count: int
    mean: float
    variability: float
    sigma: float


@dataclass(frozen=True)
class Curve:
    """A joint angle over the cycle, from strike to strike of one side.

    Attributes:
        angle: name of the joint angle, such as ``left_knee_flexion``.
        side: whose cycle it is.
        count: of strides.
        mean, variability: ``(101,)`` degrees, and their standard deviation from stride to stride.
        sigma: ``(101,)`` of the mean: of the strides, and of the estimate's own covariance where it has one.
    """

    angle: str
    side: str
    count: int
    mean: Array
    variability: Array
    sigma: Array


@dataclass(frozen=True)
class Gait:
    """How somebody walked.

    Attributes:
        name: whose gait.
        feet: events by side.
        strides: all, in the order of time; those with a reason in ``left_out`` are in no mean.
        figures: of each quantity: left, right, both, difference.
        curves: of joint angles that something measured, each over the cycle of its own side; of the trunk over both.
        with_covariance: whether the bands of the curves hold what the estimate itself is unsure of.
        bones: that sensors sat on; None if nobody knows.
        findings: what is left out, as nothing measured it.
    """

    name: str
    feet: dict[str, FootEvents]
    strides: tuple[Stride, ...]
    figures: tuple[Figure, ...]
    curves: tuple[Curve, ...]
    with_covariance: bool
    bones: frozenset[str] | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def counted(self) -> tuple[Stride, ...]:
        """Those that means are of."""
        return tuple(one for one in self.strides if not one.left_out)

    def figure(self, quantity: str, side: str = "both") -> Figure | None:
        """One of the figures; None if too few strides tell it."""
        return next((one for one in self.figures if (one.quantity.name, one.side) == (quantity, side)), None)


def gait_of(
    estimate: WearerEstimate, recording: Recording | None = None, name: str = "", with_camera: bool = False
) -> Gait:
    """The gait of a wearer; without what no sensor and no camera measured.

    Args:
        estimate: of the wearer.
        recording: that it was made from: the feet's own sensors tell events and lengths better than a motion does.
        name: of the wearer; the motion's if empty.
        with_camera: whether a camera saw the wearer: it measures what sensors do not.
    """
    sensors = {side: found for side in SIDES if (found := foot_sensor(estimate, recording, side)) is not None}
    feet, travel = dict[str, FootEvents](), dict[str, tuple[Array, Array]]()
    for side in SIDES:
        events = events_of_sensor(*sensors[side]) if side in sensors else None
        if events is not None and sensors[side][0].rate < LEAST_RATE_HZ and _has_shank(recording, side):
            events = None  # all sensors of the legs together tell better when it was than one between two samples
        feet[side] = events_of_motion(estimate.motion, side) if events is None else _during(events, estimate)
        if events is not None:
            travel[side] = travel_of_sensor(sensors[side][0], feet[side].rest)
    bones = bones_with_sensors(estimate, recording)
    measured = None if with_camera else bones
    strides = tuple(_measured_values(one, measured) for one in strides_of(estimate.motion, feet, travel))
    counted, name = [one for one in strides if not one.left_out], name or estimate.motion.name
    curves = _curves(estimate, counted)
    guessed = dict.fromkeys(one.angle for one in curves if not is_measured(measured, one.angle))
    return Gait(
        name, feet, strides, _figures(counted), tuple(one for one in curves if one.angle not in guessed),
        estimate.covariance is not None, bones,
        (*_guessed_events(name, feet, measured), *_left_out(name, list(guessed), measured)),
    )  # fmt: skip


def gaits_of(estimate: Estimate, scene: Scene | None = None) -> tuple[Gait, ...]:
    """The gait of each wearer; ``scene`` is what the estimate was made from.

    Raises:
        InputError: if they do not hold the same number of wearers.
    """
    recordings = scene.wearers if scene is not None else (None,) * len(estimate.wearers)
    if len(recordings) != len(estimate.wearers):
        raise InputError(
            f"estimate of {len(estimate.wearers)} wearers beside a recording of {len(recordings)}: expected the same"
        )
    return tuple(
        gait_of(one, recording, "" if recording is None else recording.subject.name, estimate.camera is not None)
        for one, recording in zip(estimate.wearers, recordings, strict=True)
    )


def _during(events: FootEvents, estimate: WearerEstimate) -> FootEvents:
    """Those of which the motion tells everything."""
    time = estimate.motion.time
    inside = (events.off >= time[0]) & (events.rest <= time[-1])
    return FootEvents(events.off[inside], events.strike[inside], events.rest[inside], events.by_sensor)


def foot_sensor(estimate: WearerEstimate, recording: Recording | None, side: str) -> tuple[ImuStream, Array] | None:
    """The samples of the sensor on a foot, and its mounting; None without one."""
    if recording is None:
        return None
    bones = (f"{side}_ankle", f"{side}_foot")
    for site in recording.placement.sites:
        if site.bone in bones and site.sensor in recording.imus and site.sensor in estimate.calibration:
            return recording.imus[site.sensor], estimate.calibration[site.sensor].R_bone_sensor
    return None


def bones_with_sensors(estimate: WearerEstimate, recording: Recording | None) -> frozenset[str] | None:
    """Names of the bones that sensors which were used sit on; None if neither estimate nor recording tells."""
    calibrated = {one.bone for one in estimate.calibration.values() if one.bone}
    known = frozenset(calibrated | {one.bone for one in estimate.sensor_places})
    if not known and recording is not None:
        return frozenset(one.bone for one in recording.placement.sites if one.sensor in estimate.sensors)
    return known or None


def _is_told(quantity: str, side: str, bones: Collection[str] | None) -> bool:
    """Whether sensors measured what a quantity of a side's strides is of; yes if nobody knows where they sat."""
    if bones is None or quantity not in (*OF_BOTH_LEGS, *OF_A_FOOT):
        return True
    if quantity in OF_A_FOOT:
        return any(f"{side}_{one}" in bones for one in ("ankle", "foot"))
    return frozenset(bones) >= LEGS


def _measured_values(stride: Stride, bones: Collection[str] | None) -> Stride:
    """The stride, without values of what no sensor measured."""
    values = {name: one if _is_told(name, stride.side, bones) else np.nan for name, one in stride.values.items()}
    return replace(stride, values=values)


def _guessed_events(name: str, feet: Mapping[str, FootEvents], bones: Collection[str] | None) -> tuple[Finding, ...]:
    """Legs tell events where feet do not: those that nothing measured say little."""
    by_legs = any(len(one) and not one.by_sensor for one in feet.values())
    return (Finding("gait by unmeasured legs", name),) if by_legs and not _is_told(OF_BOTH_LEGS[0], "", bones) else ()


def _left_out(name: str, angles: Sequence[str], bones: Collection[str] | None) -> tuple[Finding, ...]:
    """What is told of nobody, in one finding."""
    joints = dict.fromkeys(one.removeprefix("left_").removeprefix("right_").partition("_")[0] for one in angles)
    figures = [one.words for one in QUANTITIES if not all(_is_told(one.name, side, bones) for side in SIDES)]
    if not joints and not figures:
        return ()
    return (Finding("gait not measured", name, words={"what": ", ".join([*joints, *figures])}),)


def _has_shank(recording: Recording | None, side: str) -> bool:
    if recording is None:
        return False
    return any(one.bone == f"{side}_knee" and one.sensor in recording.imus for one in recording.placement.sites)


def _figures(strides: Sequence[Stride]) -> tuple[Figure, ...]:
    found = []
    for quantity in QUANTITIES:
        sides = {side: _figure(quantity, side, [one for one in strides if one.side == side]) for side in SIDES}
        both = _figure(quantity, "both", strides)
        known = {side: one for side, one in sides.items() if one is not None}
        found += [*known.values(), *([both] if both is not None else [])]
        if len(known) == len(SIDES):
            left, right = (known[side] for side in SIDES)
            random = [one.variability / np.sqrt(one.count) for one in (left, right)]
            own = 0.0 if quantity.name in LENGTHS else _shared(quantity, strides) / 2
            sigma = float(np.linalg.norm([*random, own, own]))
            found.append(
                Figure(quantity, "difference", min(left.count, right.count), left.mean - right.mean, np.nan, sigma)
            )
    return tuple(found)


def _figure(quantity: Quantity, side: str, strides: Sequence[Stride]) -> Figure | None:
    values = np.array([one.values[quantity.name] for one in strides])
    values = values[np.isfinite(values)]
    if len(values) < FEWEST:
        return None
    spread = float(np.std(values, ddof=1))
    sigma = np.hypot(spread / np.sqrt(len(values)), _shared(quantity, strides))
    return Figure(quantity, side, len(values), float(np.mean(values)), spread, float(sigma))


def _shared(quantity: Quantity, strides: Sequence[Stride]) -> float:
    """What all strides are off by together, one standard deviation; cycles of one kind of event have none of it."""
    name, values = quantity.name, [one.values for one in strides]
    if name.removesuffix("_percent") in ("step_time", "stance", "swing", "double_support"):
        return EVENT_S if quantity.unit == "s" else 100 * EVENT_S / float(np.mean([one["time"] for one in values]))
    if name in ("length", "speed", "step_length"):
        by_sensor = name != "step_length" and np.mean([one.by_sensor for one in strides]) > 0.5
        return float(np.nanmean([one[name] for one in values]) * (LENGTH_BY_SENSOR if by_sensor else LENGTH_BY_LEGS))
    return SHARED.get(name, 0.0)


def _curves(estimate: WearerEstimate, strides: Sequence[Stride]) -> tuple[Curve, ...]:
    angles = joint_angles(estimate.motion)
    sigmas = np.zeros_like(angles.degrees)
    if estimate.covariance is not None:
        factors = np.array([shape_factor(one.joint) for one in angles.definitions])
        sigmas = np.nan_to_num(factors * joint_angle_sigmas(estimate.motion, estimate.covariance.joints))
    curves = []
    for side in SIDES:
        own = [one for one in strides if one.side == side]
        columns = [
            k for k, name in enumerate(angles.names) if not name.startswith("left_" if side == "right" else "right_")
        ]
        if len(own) < FEWEST:
            continue
        at = np.stack([one.start + CYCLE / 100 * (one.end - one.start) for one in own])
        values, unsure = (
            interpolate_points(angles.time, one[:, columns], at.ravel()).reshape(*at.shape, -1)
            for one in (_unwrapped(angles.degrees), sigmas)
        )
        turning = angles.names.index("pelvis_rotation")  # which way somebody walks is no part of it
        values[..., columns.index(turning)] -= values[..., columns.index(turning)].mean(axis=1, keepdims=True)
        spread = values.std(axis=0, ddof=1)
        sigma = np.hypot(spread / np.sqrt(len(own)), unsure.mean(axis=0))
        curves += [
            Curve(angles.names[column], side, len(own), values[..., k].mean(axis=0), spread[:, k], sigma[:, k])
            for k, column in enumerate(columns)
        ]
    return tuple(curves)


def _unwrapped(degrees: Array) -> Array:
    return np.unwrap(degrees, axis=0, period=360.0)


def travel_of_sensor(stream: ImuStream, rest: Array) -> tuple[Array, Array]:
    """Between each rest and the next, along the floor, of rests at ``(N,)`` seconds.

    Returns:
        Lengths ``(N-1,)`` in metres and their standard deviations; NaN where the samples do not tell.
    """
    lengths = np.full((2, max(len(rest) - 1, 0)), np.nan)
    if stream.specific_force is None or stream.rate < LEAST_RATE_HZ or not lengths.size:
        return lengths[0], lengths[1]
    try:
        stream = with_orientation(stream)
    except RecordingError:  # its samples do not allow an orientation
        return lengths[0], lengths[1]
    assert stream.R_inertial_sensor is not None
    assert stream.specific_force is not None
    acceleration = (stream.R_inertial_sensor @ stream.specific_force[..., None])[..., 0] - GRAVITY
    at = np.clip(np.searchsorted(stream.time, rest), 0, len(stream) - 1)
    left_over = np.full(len(rest) - 1, np.nan)
    for k, (first, last) in enumerate(itertools.pairwise(at)):
        time = stream.time[first : last + 1]
        if len(time) < 3 or time[-1] - time[0] > LONGEST_S or np.max(np.diff(time)) > WIDEST_GAP_S:
            continue
        lengths[0, k], left_over[k], lengths[1, k] = _travelled(time, acceleration[first : last + 1])
    # One stride's remainder says little about how large such remainders are: all of them say it.
    known = left_over[np.isfinite(left_over)]
    return lengths[0], lengths[1] * (np.sqrt(np.mean(known**2)) if len(known) else np.nan)


def _travelled(time: Array, acceleration: Array) -> tuple[float, float, float]:
    """Length, m; what of the velocity was left over at the end, m/s an axis; and by how much of it the length errs, s.

    Errors of velocity that pile up like a random walk in a time ``u`` from 0 to 1, and are tied to zero at both ends,
    have a covariance of ``min(u, u') − u u'``; its double integral is the variance of the length.
    """
    from scipy.integrate import cumulative_trapezoid  # late: it takes long to import

    velocity = cumulative_trapezoid(acceleration, time, axis=0, initial=0)
    u = np.asarray(cumulative_trapezoid(np.asarray(np.sum(acceleration**2, axis=1)), time, initial=0))
    u /= max(float(u[-1]), 1e-9)
    length = float(np.linalg.norm(np.trapezoid(velocity - u[:, None] * velocity[-1], time, axis=0)[:2]))
    variance = 2 * np.trapezoid(u * (time[-1] - time), time) - np.trapezoid(u, time) ** 2
    return length, float(np.linalg.norm(velocity[-1, :2]) / np.sqrt(2)), float(np.sqrt(max(variance, 0.0)))
