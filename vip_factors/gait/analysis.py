"""Gait of an estimate: strides, means and how sure they are, left against right, joint angles over the cycle."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vip_factors.body.joint_angles import is_measured, joint_angle_sigmas, joint_angles
from vip_factors.body.lengths import LENGTHS as BODY_LENGTHS
from vip_factors.body.lengths import lengths_of
from vip_factors.body.model_errors import shape_factor
from vip_factors.body.skeleton import SIDES
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.findings import Finding
from vip_factors.gait.events import EVENT_S, FootEvents, events_of_motion, events_of_sensor
from vip_factors.gait.results import CYCLE, Curve, Figure, Gait
from vip_factors.gait.strides import (
    LEAST_RATE_HZ,
    QUANTITIES,
    Quantity,
    Stride,
    Unsteady,
    stretch_by_shank,
    strides_of,
    travel_of_foot,
    without_starts_and_stops,
)
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import SensorSite
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.sensors.scene import Scene

if TYPE_CHECKING:
    pass

# What all strides of a recording are off by together, one standard deviation, as walks of six people with a reference
# showed: strikes and toe-offs by another sensor or another definition of contact, s (EVENT_S); lengths as shares of
# them, by legs alone, as muscles carry a thigh's sensor along with four fifths of what its bone swings, or with what
# the shanks' sensors make of it, or by feet whose blows are clipped; and what lies between the feet or below the toes,
# by headings, mountings and soles. Half of it differs between the sides.
LENGTH_BY_LEGS, LENGTH_BY_SHANKS, LENGTH_BY_SENSOR = 0.06, 0.035, 0.025
SHARED = {"width": 0.09, "clearance": 0.01, "strike_angle": 4.0}  # m, m, degrees
MOST_STRETCH = 3 * LENGTH_BY_LEGS  # more is no legs that swing too little, but a sensor that is wrong
LENGTHS = ("length", "speed", "step_length", "width")  # of which the sides do not differ in it
FEWEST = 3  # strides of a foot, for a curve
# The distance between the feet needs sensors on pelvis and shanks; the motion of a foot needs one on it.
LEGS = frozenset({"pelvis", "left_knee", "right_knee"})
OF_BOTH_LEGS, OF_A_FOOT = ("width", "step_length"), ("clearance", "strike_angle")


def gait_of(
    estimate: WearerEstimate,
    recording: Recording | None = None,
    name: str = "",
    with_camera: bool = False,
    *,
    count: Collection[Unsteady] = (),
    verdict: str = "",
) -> Gait:
    """The gait of a wearer; without what no sensor and no camera measured.

    Args:
        estimate: of the wearer.
        recording: that it was made from: the feet's own sensors tell events and lengths better than a motion does.
        name: of the wearer; the motion's if empty.
        with_camera: whether a camera saw the wearer: it measures what sensors do not.
        count: reasons for which no stride is left out of the means.
        verdict: of the estimate.
    """
    sensors = {side: site for side in SIDES if (site := foot_sensor(estimate, recording, side)) is not None}
    feet, travel = {side: events_of_motion(estimate.motion, side) for side in SIDES}, dict[str, dict[float, float]]()
    # A camera sees how far somebody came.
    stretch = None if with_camera else _stretch(estimate, recording, feet)
    for side in SIDES:
        events = events_of_sensor(*sensors[side]) if side in sensors else None
        if events is not None and sensors[side][0].rate < LEAST_RATE_HZ and shank_site(estimate, recording, side):
            events = None  # all sensors of the legs together tell better when it was than one between two samples
        if events is not None:
            time = estimate.motion.time
            inside = (events.off >= time[0]) & (events.rest <= time[-1])
            feet[side] = FootEvents(events.off[inside], events.strike[inside], events.rest[inside], True)
            travel[side] = _by_strike(feet[side], travel_of_foot(sensors[side][0], feet[side].rest))
    bones = bones_with_sensors(estimate, recording)
    measured = None if with_camera else bones
    strides = tuple(
        _with_length(stride, stretch, travel.get(stride.side, {}).get(stride.start, np.nan), measured)
        for stride in strides_of(estimate.motion, feet)
    )
    strides = tuple(
        replace(stride, left_out="") if stride.left_out in count else stride
        for stride in without_starts_and_stops(strides)
    )
    counted, name = [stride for stride in strides if not stride.left_out], name or estimate.motion.name
    legs = 0.0 if with_camera or recording is None else leg_length_sigma(recording.subject)
    by_legs = float(np.hypot(LENGTH_BY_LEGS, legs)) if stretch is None else LENGTH_BY_SHANKS
    curves = _curves(estimate, counted)
    guessed = dict.fromkeys(curve.angle for curve in curves if not is_measured(measured, curve.angle))
    return Gait(
        name,
        feet,
        strides,
        _figures(counted, by_legs),
        tuple(curve for curve in curves if curve.angle not in guessed),
        estimate.covariance is not None,
        bones,
        _findings(name, feet, guessed, measured),
        verdict,
    )


def gaits_of(estimate: Estimate, scene: Scene | None = None, count: Collection[Unsteady] = ()) -> tuple[Gait, ...]:
    """The gait of each wearer; ``scene`` is what the estimate was made from, ``count`` is as in :func:`gait_of`.

    Raises:
        InputError: if they do not hold the same number of wearers.
    """
    recordings = scene.wearers if scene is not None else (None,) * len(estimate.wearers)
    if len(recordings) != len(estimate.wearers):
        raise InputError(
            f"estimate of {len(estimate.wearers)} wearers beside a recording of {len(recordings)}: expected the same"
        )
    return tuple(
        gait_of(
            wearer,
            recording,
            "" if recording is None else recording.subject.name,
            estimate.camera is not None,
            count=count,
            verdict=str(estimate.verdict),
        )
        for wearer, recording in zip(estimate.wearers, recordings, strict=True)
    )


def leg_length_sigma(subject: Subject) -> float:
    """Standard deviation of the length of thigh and shank together, as a share of it; 0 if they are known."""
    if (variation := subject.variation()) is None:
        return 0.0
    leg = np.isin(BODY_LENGTHS, ("thigh", "shank"))
    return float(np.sqrt(leg @ variation.covariance @ leg) / (leg @ lengths_of(subject.body())))


def foot_sensor(estimate: WearerEstimate, recording: Recording | None, side: str) -> tuple[ImuStream, Array] | None:
    """The samples of the sensor on a foot, and its mounting; None without one."""
    site = _site(estimate, recording, (f"{side}_ankle", f"{side}_foot"))
    if site is None or recording is None:
        return None
    return recording.imus[site.sensor], estimate.calibration[site.sensor].R_bone_sensor


def shank_site(estimate: WearerEstimate, recording: Recording | None, side: str) -> SensorSite | None:
    """Estimated position of the sensor on a shank; None without one."""
    site = _site(estimate, recording, (f"{side}_knee",))
    positions = [
        place.posterior for place in estimate.sensor_positions if site is not None and place.sensor == site.sensor
    ]
    return site if site is None or not positions else replace(site, p_bone_sensor=positions[0])


def _site(estimate: WearerEstimate, recording: Recording | None, bones: Collection[str]) -> SensorSite | None:
    """The first on some bones of a sensor that was used."""
    sites = () if recording is None else recording.placement.sites
    sensors = recording.imus.keys() & estimate.calibration.keys() if recording is not None else set()
    return next((site for site in sites if site.bone in bones and site.sensor in sensors), None)


def _stretch(estimate: WearerEstimate, recording: Recording | None, feet: Mapping[str, FootEvents]) -> float | None:
    """By how much all strides are longer than the motion's, as the shanks' sensors tell; None if too few do.

    What makes legs swing too little is the same in all of them: one factor for both sides, the middle of all strides.

    Args:
        estimate, recording: of the wearer.
        feet: events by the legs, whether or not the feet have sensors: it is their motion that is stretched.
    """
    factors, counted = list[float](), [stride for stride in strides_of(estimate.motion, feet) if not stride.left_out]
    for side in SIDES:
        site = shank_site(estimate, recording, side)
        if site is None or recording is None:
            continue
        calibration, stream = estimate.calibration[site.sensor], recording.imus[site.sensor]
        stretch_factors = stretch_by_shank(estimate.motion, side, stream, calibration, site.p_bone_sensor, feet[side])
        factor_by_strike = _by_strike(feet[side], stretch_factors)
        factors += [
            factor_by_strike[stride.start]
            for stride in counted
            if stride.side == side and np.isfinite(factor_by_strike[stride.start])
        ]
    stretch = float(np.median(factors)) if len(factors) >= FEWEST else np.nan
    return stretch if abs(stretch - 1) < MOST_STRETCH else None


def _by_strike(feet: FootEvents, values: Array) -> dict[float, float]:
    """Index strides by the second at which they start."""
    return dict(zip(feet.strike[:-1].tolist(), values.tolist(), strict=True))


def _with_length(stride: Stride, stretch: float | None, by_foot: float, bones: Collection[str] | None) -> Stride:
    """The stride, its lengths by the motion as the shanks stretch it, or its foot's own sensor, or both by their ±;
    without values of what no sensor measured.
    """
    values, length = stride.values, (stretch or 1.0) * stride.values["length"]
    if np.isfinite(by_foot):
        share = 0.0 if stretch is None else LENGTH_BY_SENSOR**2 / (LENGTH_BY_SENSOR**2 + LENGTH_BY_SHANKS**2)
        length = (1 - share) * by_foot + share * length
    step = (stretch or 1.0) * values["step_length"]
    values = {**values, "length": length, "speed": length / values["time"], "step_length": step}
    measured = {name: value if _is_told(name, stride.side, bones) else np.nan for name, value in values.items()}
    return replace(stride, values=measured, by_sensor=bool(np.isfinite(by_foot)))


def bones_with_sensors(estimate: WearerEstimate, recording: Recording | None) -> frozenset[str] | None:
    """Names of the bones that sensors which were used sit on; None if neither estimate nor recording tells."""
    calibrated = {calibration.bone for calibration in estimate.calibration.values() if calibration.bone}
    bones = frozenset(calibrated | {place.bone for place in estimate.sensor_positions})
    if not bones and recording is not None:
        return frozenset(site.bone for site in recording.placement.sites if site.sensor in estimate.sensors)
    return bones or None


def _is_told(quantity: str, side: str, bones: Collection[str] | None) -> bool:
    """Whether sensors measured what a quantity of a side's strides is of; yes if nobody knows where they sat."""
    if bones is None or quantity not in (*OF_BOTH_LEGS, *OF_A_FOOT):
        return True
    if quantity in OF_A_FOOT:
        return any(f"{side}_{bone}" in bones for bone in ("ankle", "foot"))
    return frozenset(bones) >= LEGS


def _findings(
    name: str, feet: Mapping[str, FootEvents], angles: Collection[str], bones: Collection[str] | None
) -> tuple[Finding, ...]:
    """What nothing measured: events that the legs tell where feet do not, joint angles and quantities of strides."""
    by_legs = any(len(events) and not events.by_sensor for events in feet.values())
    is_guessed = by_legs and not _is_told(OF_BOTH_LEGS[0], "", bones)
    findings = [Finding("gait by unmeasured legs", name)] if is_guessed else []
    joints = dict.fromkeys(angle.removeprefix("left_").removeprefix("right_").partition("_")[0] for angle in angles)
    figures = [
        quantity.words for quantity in QUANTITIES if not all(_is_told(quantity.name, side, bones) for side in SIDES)
    ]
    if joints or figures:
        findings.append(Finding("gait not measured", name, words={"what": ", ".join([*joints, *figures])}))
    return tuple(findings)


def _figures(strides: Sequence[Stride], by_legs: float) -> tuple[Figure, ...]:
    figures = list[Figure]()
    for quantity in QUANTITIES:
        left, right = (
            _figure(quantity, side, [stride for stride in strides if stride.side == side], by_legs) for side in SIDES
        )
        figures += filter(None, (left, right, _figure(quantity, "both", strides, by_legs)))
        if left is not None and right is not None:
            random = [figure.variability / np.sqrt(figure.count) for figure in (left, right)]  # NaN of one stride
            shared_share = 0.0 if quantity.name in LENGTHS else _shared(quantity, strides, by_legs) / 2
            sigma = float(np.linalg.norm([*random, shared_share, shared_share]))
            strides_count = min(left.count, right.count)
            figures.append(Figure(quantity, "difference", strides_count, left.mean - right.mean, np.nan, sigma))
    return tuple(figures)


def _figure(quantity: Quantity, side: str, strides: Sequence[Stride], by_legs: float) -> Figure | None:
    values = np.array([stride.values[quantity.name] for stride in strides])
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else np.nan
    sigma = np.hypot(spread / np.sqrt(len(values)), _shared(quantity, strides, by_legs))
    return Figure(quantity, side, len(values), float(np.mean(values)), spread, float(sigma))


def _shared(quantity: Quantity, strides: Sequence[Stride], by_legs: float) -> float:
    """Standard deviation of the error that all strides share; cycles of a single kind of event have none."""
    name, values = quantity.name, [stride.values for stride in strides]
    if name.removesuffix("_percent") in ("step_time", "stance", "swing", "double_support"):
        return (
            EVENT_S
            if quantity.unit == "s"
            else 100 * EVENT_S / float(np.mean([values_of_stride["time"] for values_of_stride in values]))
        )
    if name in ("length", "speed", "step_length"):
        by_sensor = name != "step_length" and np.mean([stride.by_sensor for stride in strides]) > 0.5
        return float(
            np.nanmean([values_of_stride[name] for values_of_stride in values])
            * (LENGTH_BY_SENSOR if by_sensor else by_legs)
        )
    return SHARED.get(name, 0.0)


def _curves(estimate: WearerEstimate, strides: Sequence[Stride]) -> tuple[Curve, ...]:
    angles = joint_angles(estimate.motion)
    sigmas = np.zeros_like(angles.degrees)
    if estimate.covariance is not None:
        factors = np.array([shape_factor(definition.joint) for definition in angles.definitions])
        sigmas = np.nan_to_num(factors * joint_angle_sigmas(estimate.motion, estimate.covariance.joints))
    curves = []
    for side in SIDES:
        side_strides = [stride for stride in strides if stride.side == side]
        columns = [
            k for k, name in enumerate(angles.names) if not name.startswith("left_" if side == "right" else "right_")
        ]
        if len(side_strides) < FEWEST:
            continue
        instants = np.stack([stride.start + CYCLE / 100 * (stride.end - stride.start) for stride in side_strides])
        values, unsure = (
            interpolate_points(angles.time, values[:, columns], instants.ravel()).reshape(*instants.shape, -1)
            for values in (np.unwrap(angles.degrees, axis=0, period=360.0), sigmas)
        )
        turning = angles.names.index("pelvis_rotation")  # which way somebody walks is no part of it
        values[..., columns.index(turning)] -= values[..., columns.index(turning)].mean(axis=1, keepdims=True)
        spread = values.std(axis=0, ddof=1)
        sigma = np.hypot(spread / np.sqrt(len(side_strides)), unsure.mean(axis=0))
        curves += [
            Curve(angles.names[column], side, len(side_strides), values[..., k].mean(axis=0), spread[:, k], sigma[:, k])
            for k, column in enumerate(columns)
        ]
    return tuple(curves)
