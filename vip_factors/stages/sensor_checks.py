"""Sensors looked over before anything is estimated: accelerometers by themselves, clocks against one another."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.findings import Finding
from vip_factors.initialise.sensor_clock_steps import ClockStep, clock_step
from vip_factors.initialise.sensor_faults import (
    INVERTED,
    SensorClockSettings,
    SensorDelay,
    accelerometer_scale,
    clipped_samples,
    force_in_wrong_axes,
    is_scale_wrong,
    joint_signal,
    longest_repeat,
    range_ends,
    sensor_delays,
)
from vip_factors.sensors.imu_stream import FORCE_LIMIT, ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import LEAST_SAMPLES, RecordingSource
from vip_factors.settings import Settings
from vip_factors.stages.sensor_assignment import placed_links

Corrections = Mapping[str, "SensorCorrection"]
"""Of one wearer's sensors, by name; those that are not named are right."""


def checked_scene(scene: Scene, settings: Settings) -> tuple[Scene, tuple[Corrections, ...], tuple[Finding, ...]]:
    """The scene with all wearers' sensors put right, by what each wearer's were, and what was found."""
    found = [sensor_corrections(one, one, settings) for one in scene.wearers]
    wearers = tuple(_corrected(one, right) for one, (right, _) in zip(scene.wearers, found, strict=True))
    return (
        replace(scene, wearers=wearers),
        tuple(right for right, _ in found),
        tuple(finding for _, own in found for finding in own),
    )


def checked(recording: Recording, settings: Settings) -> tuple[Recording, tuple[Finding, ...]]:
    """The recording with its placed sensors put right where that can be done, and what was found."""
    corrections, findings = sensor_corrections(recording, recording, settings)
    return _corrected(recording, corrections), findings


def corrected_elsewhere(
    recording: Recording, corrections: Corrections, settings: Settings
) -> tuple[Recording, tuple[Finding, ...]]:
    """A stretch put right by what another showed; in it accelerometers are looked over by themselves."""
    known = {name: replace(one, ends=()) for name, one in corrections.items()}
    clocks = replace(settings.sensor_clocks, check=False)
    return checked(_corrected(recording, known), replace(settings, sensor_clocks=clocks))


def _corrected(recording: Recording, corrections: Corrections) -> Recording:
    imus = {name: corrections[name].of(one) if name in corrections else one for name, one in recording.imus.items()}
    return replace(recording, imus=imus)


@dataclass(frozen=True)
class SensorCorrection:
    """What puts a sensor's samples right.

    Attributes:
        ends: axes and values of specific force at the ends of its range: such samples measured none.
        scale: that its specific force has too much.
        reversed_axis: whose specific force has the wrong sign, if one has.
        late: seconds that its times are late.
    """

    ends: tuple[tuple[int, float], ...] = ()
    scale: float = 1.0
    reversed_axis: str = ""
    late: float = 0.0

    def of(self, stream: ImuStream) -> ImuStream:
        """The stream with these errors taken out."""
        if self.ends:
            clipped = clipped_samples(stream, self.ends)
            stream = replace(stream, force_measured=stream.force_measured_mask & ~clipped)
        if self.reversed_axis and stream.specific_force is not None:
            signs = np.where(np.array(list("xyz")) == self.reversed_axis, -1.0, 1.0)
            stream = replace(stream, specific_force=stream.specific_force * signs)
        if self.scale != 1.0 and stream.specific_force is not None:
            stream = replace(stream, specific_force=stream.specific_force / self.scale)
        return replace(stream, time=stream.time - self.late) if self.late else stream


@dataclass(frozen=True)
class CorrectedSamples:
    """A recording that gives its samples put right; see :class:`~vip_factors.sensors.sources.RecordingSource`."""

    source: RecordingSource
    corrections: Mapping[str, SensorCorrection]

    @property
    def head(self) -> Recording:
        """The recording without what was measured."""
        return self.source.head

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the placed sensors that have samples."""
        return self.source.sensors

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of their first and last sample; as it was before clocks were put right."""
        return self.source.interval

    def between(self, start: float = -np.inf, end: float = np.inf) -> Mapping[str, ImuStream]:
        """What was measured from one instant to another."""
        spare = max((abs(one.late) for one in self.corrections.values()), default=0.0)
        found = {}
        for name, stream in self.source.between(start - spare, end + spare).items():
            right = self.corrections[name].of(stream) if name in self.corrections else stream
            if np.count_nonzero((right.time >= start) & (right.time <= end)) >= LEAST_SAMPLES:
                found[name] = right.cut(start, end) if spare else right
        return found


def sensor_corrections(
    recording: Recording, clocks: Recording, settings: Settings
) -> tuple[dict[str, SensorCorrection], tuple[Finding, ...]]:
    """What puts the placed sensors right that are not, by name, and what was found.

    Args:
        recording: that accelerometers are looked over in; its times need not be those of the samples.
        clocks: that clocks are compared in.
        settings: of both.
    """
    # Of the very same values; 58 recordings have 1.0 at most, a still pose that was written in front of some
    stuck_s = 2.0
    wearer = recording.subject.name
    corrections: dict[str, SensorCorrection] = {}
    findings: list[Finding] = []
    if settings.accelerometers.check:
        _refuse_inverted(recording)
        for name in recording.placed:
            if (seconds := longest_repeat(recording.imus[name])) > stuck_s:
                findings.append(Finding("sensor stuck", wearer, subject=name, numbers={"seconds": seconds}))
            correction, found = _accelerometer(wearer, recording.imus[name])
            if found:
                corrections[name] = correction
            findings += found
    if settings.sensor_clocks.check:
        right = {name: corrections[name].of(one) if name in corrections else one for name, one in clocks.imus.items()}
        delays, step = _delays(replace(clocks, imus=right), settings)
        for one in delays:
            name = clocks.placed[one.sensor]
            if settings.sensor_clocks.correct and one.rival is None:
                corrections[name] = replace(corrections.get(name, SensorCorrection()), late=one.seconds)
        findings += _about_clocks(wearer, clocks.placed, delays, settings.sensor_clocks)
        if step is not None:
            findings.append(_clock_jumped(wearer, clocks.placed[step.sensor], step.seconds))
    return corrections, tuple(findings)


def _refuse_inverted(recording: Recording) -> None:
    """Of one sensor it may be chance, of half of them it is the file's convention."""
    names = [name for name in recording.placed if force_in_wrong_axes(recording.imus[name]) == INVERTED]
    if len(names) > len(recording.placed) / 2:
        raise RecordingError(
            f"wearer '{recording.subject.name}': orientations of {len(names)} of {len(recording.placed)} sensors are "
            "inverted: gravity is upright if they turn the inertial frame into the sensor's; expected the sensor's "
            "into the inertial one; invert them (the conjugate of each quaternion) and convert again"
        )


def _accelerometer(wearer: str, stream: ImuStream) -> tuple[SensorCorrection, list[Finding]]:
    least_gravity = 0.05  # of what it is: with less there is none in the samples, and nothing to scale them by
    findings, correction = list[Finding](), SensorCorrection(range_ends(stream))
    if correction.ends:
        largest = max(abs(end) for _, end in correction.ends)
        count = np.count_nonzero(clipped_samples(stream, correction.ends))
        numbers = {"largest": largest, "samples": float(count)}
        findings.append(Finding("accelerometer range", wearer, subject=stream.name, numbers=numbers))
    if stream.specific_force is not None and (spikes := np.count_nonzero(~stream.force_measured_mask)):
        numbers = {"limit": FORCE_LIMIT, "samples": float(spikes)}
        findings.append(Finding("impossible acceleration", wearer, subject=stream.name, numbers=numbers))
    axis = force_in_wrong_axes(stream)
    if axis is not None and axis != INVERTED:
        findings.append(Finding("accelerometer axis", wearer, subject=stream.name, words={"axis": axis}))
        correction = replace(correction, reversed_axis=axis)
        stream = replace(correction, ends=()).of(stream)
    measured = accelerometer_scale(stream)
    if measured is None or not is_scale_wrong(*measured):
        return correction, findings
    scale, _ = measured
    gravity = 9.81 * scale
    if abs(scale) < least_gravity:
        raise RecordingError(
            f"wearer '{wearer}': the accelerometer of '{stream.name}' measures gravity as {gravity:.2f} m/s²: expected "
            "9.81; give accelerations with gravity in them (specific force), not what is "
            "left without it"
        )
    numbers = {"gravity": gravity, "percent": 100 * (scale - 1)}
    words = {"advice": "was it given in g?" if abs(gravity - 1) < 0.1 else "calibrate it"}
    findings.append(Finding("accelerometer scale", wearer, subject=stream.name, numbers=numbers, words=words))
    return replace(correction, scale=scale), findings


def _delays(recording: Recording, settings: Settings) -> tuple[tuple[SensorDelay, ...], ClockStep | None]:
    names = recording.placed
    if len(names) < 2:
        return (), None
    bones = [recording.placement.site(name).bone_index for name in names]
    links, signals = placed_links(recording, settings), [joint_signal(recording.imus[name]) for name in names]
    return sensor_delays(signals, bones, links), clock_step(signals, links)


def _clock_jumped(wearer: str, name: str, late: float) -> Finding:
    numbers, words = {"seconds": abs(late)}, {"late": "late" if late > 0 else "early"}
    return Finding("sensor clock jumped", wearer, subject=name, numbers=numbers, words=words)


def _about_clocks(
    wearer: str, names: Sequence[str], delays: Sequence[SensorDelay], settings: SensorClockSettings
) -> Iterator[Finding]:
    for one in delays:
        name, words = names[one.sensor], {"late": "behind" if one.seconds > 0 else "ahead of"}
        numbers = {"off_ms": 1e3 * abs(one.seconds), "sigma_ms": 1e3 * one.sigma}
        if one.rival is not None:
            words["rival"] = names[one.rival]
            yield Finding("sensor clocks disagree", wearer, subject=name, numbers=numbers, words=words)
            continue
        words["done"] = "its times are shifted by as much" if settings.correct else "it is left so"
        yield Finding("sensor clock", wearer, subject=name, numbers=numbers, words=words)
