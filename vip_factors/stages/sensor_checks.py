"""Sensors looked over before anything is estimated: accelerometers by themselves, clocks against one another."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.initialise.sensor_clocks import SensorDelay, clock_step, joint_signal, sensor_delays
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import FORCE_LIMIT, ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import LEAST_SAMPLES, RecordingSource
from vip_factors.settings import SensorClockSettings, Settings
from vip_factors.stages.acceleration_sign import is_sign_opposite, mirror_stream
from vip_factors.stages.pauses import between_pauses
from vip_factors.stages.sensor_assignment import placed_links

Corrections = Mapping[str, "SensorCorrection"]
"""Of one wearer's sensors, by name; those that are not named are right."""


def check_scene(scene: Scene, settings: Settings) -> tuple[Scene, tuple[Corrections, ...], tuple[Finding, ...]]:
    """The scene with all wearers' sensors put right, by what each wearer's were, and what was found."""
    checked = [sensor_corrections(recording, between_pauses(recording), settings) for recording in scene.wearers]
    wearers = tuple(_corrected(recording, right) for recording, (right, _) in zip(scene.wearers, checked, strict=True))
    return (
        replace(scene, wearers=wearers),
        tuple(right for right, _ in checked),
        tuple(finding for _, findings in checked for finding in findings),
    )


def checked(recording: Recording, settings: Settings) -> tuple[Recording, tuple[Finding, ...]]:
    """The recording with its placed sensors put right where that can be done, and what was found."""
    corrections, findings = sensor_corrections(recording, recording, settings)
    return _corrected(recording, corrections), findings


def corrected_elsewhere(
    recording: Recording, corrections: Corrections, settings: Settings
) -> tuple[Recording, tuple[Finding, ...]]:
    """A stretch put right by what another showed; in it accelerometers are looked over by themselves."""
    settled = {name: replace(correction, ends=()) for name, correction in corrections.items()}
    clocks = replace(settings.sensor_clocks, check=False)
    return checked(_corrected(recording, settled), replace(settings, sensor_clocks=clocks))


def _corrected(recording: Recording, corrections: Corrections) -> Recording:
    imus = {
        name: corrections[name].of(stream) if name in corrections else stream for name, stream in recording.imus.items()
    }
    return replace(recording, imus=imus)


@dataclass(frozen=True)
class SensorCorrection:
    """Correction of a sensor's samples.

    Attributes:
        ends: axes and values of specific force at the ends of its range: such samples measured none.
        scale: that its specific force has too much.
        reversed_axis: whose specific force has the wrong sign, if one has.
        has_force: whether its specific force can be used.
        is_mirrored: whether the force has the opposite sign, and the inertial frame lies upside down for it.
        late: seconds that its times are late.
    """

    ends: tuple[tuple[int, float], ...] = ()
    scale: float = 1.0
    reversed_axis: str = ""
    has_force: bool = True
    is_mirrored: bool = False
    late: float = 0.0

    def of(self, stream: ImuStream) -> ImuStream:
        """The stream with these errors taken out."""
        if not self.has_force and stream.R_inertial_sensor is not None:
            stream = replace(stream, specific_force=None, force_measured=None)
        if self.ends and stream.specific_force is not None:
            clipped = clipped_samples(stream, self.ends)
            stream = replace(stream, force_measured=stream.force_measured_mask & ~clipped)
        if self.reversed_axis and stream.specific_force is not None:
            signs = np.where(np.array(list("xyz")) == self.reversed_axis, -1.0, 1.0)
            stream = replace(stream, specific_force=stream.specific_force * signs)
        if self.scale != 1.0 and stream.specific_force is not None:
            stream = replace(stream, specific_force=stream.specific_force / self.scale)
        stream = mirror_stream(stream) if self.is_mirrored else stream
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
        """Return the corrected samples between two instants."""
        spare = max((abs(correction.late) for correction in self.corrections.values()), default=0.0)
        streams = {}
        for name, stream in self.source.between(start - spare, end + spare).items():
            right = self.corrections[name].of(stream) if name in self.corrections else stream
            if np.count_nonzero((right.time >= start) & (right.time <= end)) >= LEAST_SAMPLES:
                streams[name] = right.cut(start, end) if spare else right
        return streams


def sensor_corrections(
    recording: Recording, clocks: Recording, settings: Settings
) -> tuple[dict[str, SensorCorrection], tuple[Finding, ...]]:
    """Return corrections of the placed sensors by name, and the findings about them.

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
        _refuse_without_gravity(recording)
        for name in recording.placed:
            if (seconds := longest_repeat(recording.imus[name])) > stuck_s:
                findings.append(Finding("sensor stuck", wearer, subject=name, numbers={"seconds": seconds}))
            correction, accelerometer_findings = _accelerometer(wearer, recording.imus[name])
            if accelerometer_findings:
                corrections[name] = correction
            findings += accelerometer_findings
        right = {
            name: corrections[name].of(stream) if name in corrections else stream
            for name, stream in recording.imus.items()
        }
        if is_sign_opposite(replace(recording, imus=right), settings):
            for name in recording.placed:
                corrections[name] = replace(corrections.get(name, SensorCorrection()), is_mirrored=True)
            findings.append(Finding("acceleration turned round", wearer))
    if settings.sensor_clocks.check:
        right = {
            name: corrections[name].of(stream) if name in corrections else stream
            for name, stream in clocks.imus.items()
        }
        delays, step = _delays(replace(clocks, imus=right), settings)
        for delay in delays:
            name = clocks.placed[delay.sensor]
            if settings.sensor_clocks.correct and delay.rival is None:
                corrections[name] = replace(corrections.get(name, SensorCorrection()), late=delay.seconds)
        findings += _about_clocks(wearer, clocks.placed, delays, settings.sensor_clocks)
        if step is not None:
            sensor, late = step
            off = (
                f"is {abs(late):.1f} s (or a stride more or less) too {'late' if late > 0 else 'early'} towards the "
                "end, against the sensors beside it"
            )
            done = "some samples were lost before and the later ones moved up, or it jumped; it is left so"
            numbers = {"seconds": abs(late)}
            findings.append(_clock_finding("clock jumped", wearer, clocks.placed[sensor], off, done, numbers))
    return corrections, tuple(findings)


def _refuse_inverted(recording: Recording) -> None:
    """Refuse inverted accelerometers: one may be chance, half of them are the file's convention."""
    names = [name for name in recording.placed if force_in_wrong_axes(recording.imus[name]) == INVERTED]
    if len(names) > len(recording.placed) / 2:
        raise RecordingError(
            f"wearer '{recording.subject.name}': orientations of {len(names)} of {len(recording.placed)} sensors are "
            "inverted: gravity is upright if they turn the inertial frame into the sensor's; expected the sensor's "
            "into the inertial one; invert them (the conjugate of each quaternion) and convert again"
        )


def _accelerometer(wearer: str, stream: ImuStream) -> tuple[SensorCorrection, list[Finding]]:
    findings, problems, numbers = list[Finding](), list[str](), dict[str, float]()
    correction = SensorCorrection(range_ends(stream))
    if correction.ends:
        largest = max(abs(end) for _, end in correction.ends)
        numbers["clipped"] = float(np.count_nonzero(clipped_samples(stream, correction.ends)))
        problems.append(
            f"stands at the end of its range ({largest:.0f} m/s²) in {numbers['clipped']:.0f} samples: "
            "those are left out"
        )
    if stream.specific_force is not None and (spikes := np.count_nonzero(~stream.force_measured_mask)):
        numbers["spikes"] = float(spikes)
        problems.append(f"gives more than {FORCE_LIMIT:.0f} m/s² in {spikes} samples: those are left out")
    axis = force_in_wrong_axes(stream)
    if axis is not None and axis != INVERTED:
        findings.append(Finding("accelerometer axis", wearer, subject=stream.name, words={"axis": axis}))
        correction = replace(correction, reversed_axis=axis)
        stream = replace(correction, ends=()).of(stream)
    measured = accelerometer_scale(stream)
    if measured is not None and not _has_gravity(measured[0]):
        correction = SensorCorrection(has_force=False)
        numbers["gravity"] = 9.81 * measured[0]
        problems.append(f"measures gravity as {numbers['gravity']:.2f} m/s²: its accelerations are not used")
    elif measured is not None and is_scale_wrong(*measured):
        correction = replace(correction, scale=measured[0])
        numbers |= {"gravity": 9.81 * correction.scale, "percent": 100 * (correction.scale - 1)}
        advice = "was it given in g?" if abs(numbers["gravity"] - 1) < 0.1 else "calibrate it"
        problems.append(
            f"measures gravity as {numbers['gravity']:.2f} m/s², {numbers['percent']:+.0f} %: scaled to 9.81; {advice}"
        )
    if problems:
        words = {"what": ", and ".join(problems)}
        findings.append(Finding("accelerometer corrected", wearer, subject=stream.name, numbers=numbers, words=words))
    return correction, findings


def _has_gravity(scale: float) -> bool:
    """Whether accelerations hold any gravity to scale them by; ``scale`` is its share of what it is."""
    return abs(scale) >= 0.05


def _refuse_without_gravity(recording: Recording) -> None:
    """Raise if no sensor's accelerations hold gravity: of one sensor it is a fault, of all the file's convention."""
    scales = [scale for name in recording.placed if (scale := accelerometer_scale(recording.imus[name])) is not None]
    if scales and not any(_has_gravity(scale) for scale, _ in scales):
        raise RecordingError(
            f"wearer '{recording.subject.name}': accelerometers measure gravity as {9.81 * scales[0][0]:.2f} m/s²: "
            "expected 9.81; give accelerations with gravity in them (specific force), not what is left without it"
        )


def sampling_findings(recording: Recording, frames: ImuFrames) -> Iterator[Finding]:
    """Sensors that are copies of one another, or sampled too slowly to show a motion.

    Args:
        recording: of the wearer, with samples.
        frames: of its sensors.
    """
    slowest_hz = 10.0  # steps have two strikes a second, and each takes a tenth of one
    wearer = recording.subject.name
    for names in copied_sensors(frames):
        yield Finding("sensors copied", wearer, subject=", ".join(names))
    rates = {name: recording.imus[name].rate for name in frames.sensors if name in recording.imus}
    slow = {name: rate for name, rate in rates.items() if 0 < rate < slowest_hz}
    if slow:
        numbers = slow if len(slow) < len(rates) else {"all": max(slow.values())}
        yield Finding("low sampling rate", wearer, numbers=numbers)


def copied_sensors(frames: ImuFrames) -> list[tuple[str, ...]]:
    """Names of sensors that measure the same in every frame, in groups of two and more."""
    groups = list[list[int]]()
    for sensor in range(len(frames.sensors)):
        group = next((group for group in groups if _is_copy(frames, group[0], sensor)), None)
        if group is None:
            groups.append([sensor])
        else:
            group.append(sensor)
    return [tuple(frames.sensors[sensor] for sensor in group) for group in groups if len(group) > 1]


def _is_copy(frames: ImuFrames, original: int, copy: int) -> bool:
    are_valid = frames.orientation_valid[:, original] & frames.orientation_valid[:, copy]
    R, rounding = frames.R_inertial_sensor[are_valid], 1e-9
    moves = len(R) > 1 and np.ptp(R[:, original], axis=0).max() > rounding
    return bool(moves and np.abs(R[:, original] - R[:, copy]).max() < rounding)


def _delays(recording: Recording, settings: Settings) -> tuple[tuple[SensorDelay, ...], tuple[int, float] | None]:
    names = recording.placed
    if len(names) < 2:
        return (), None
    bones = [recording.placement.site(name).bone_index for name in names]
    links, signals = placed_links(recording, settings), [joint_signal(recording.imus[name]) for name in names]
    return sensor_delays(signals, bones, links), clock_step(signals, links)


def _about_clocks(
    wearer: str, names: Sequence[str], delays: Sequence[SensorDelay], settings: SensorClockSettings
) -> Iterator[Finding]:
    for delay in delays:
        numbers = {"off_ms": 1e3 * abs(delay.seconds), "sigma_ms": 1e3 * delay.sigma}
        late = "behind" if delay.seconds > 0 else "ahead of"
        off = f"seems {numbers['off_ms']:.0f} ± {numbers['sigma_ms']:.0f} ms {late}"
        if delay.rival is not None:
            kind, reference, done = "clocks disagree", f"that of '{names[delay.rival]}'", "it is unknown which is off"
        else:
            kind, reference = "clock corrected", "those of the other sensors"
            done = "its times are shifted by as much" if settings.correct else "it is left so"
        yield _clock_finding(kind, wearer, names[delay.sensor], f"{off} {reference}", done, numbers)


def _clock_finding(kind: str, wearer: str, sensor: str, off: str, done: str, numbers: Mapping[str, float]) -> Finding:
    words = {"off": off, "others": "", "done": done}
    return Finding(kind, wearer, subject=f"sensor '{sensor}'", numbers=numbers, words=words)


def accelerometer_scale(stream: ImuStream) -> tuple[float, float] | None:
    """Ratio of measured to true gravity, and its standard deviation.

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
    is_measured = stream.force_measured_mask
    R, force = stream.R_inertial_sensor[is_measured], stream.specific_force[is_measured]
    if _leaning(R, force) < LEANING:
        return None
    errors = {
        axis: _leaning(R, force * np.where(np.arange(3) == number, -1.0, 1.0)) for number, axis in enumerate("xyz")
    }
    errors[INVERTED] = _leaning(transpose(R), force)
    best_axes = min(errors, key=lambda axes: errors[axes])
    return best_axes if errors[best_axes] < UPRIGHT else None


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
        for first_row, last_row in _runs(stream.specific_force[:, number], end):
            clipped[first_row:last_row] = True
    return clipped


def _runs(axis: Array, end: float) -> list[tuple[int, int]]:
    """First sample and the one after the last of each run at an end of the range, of two samples or more."""
    same = 1e-3  # of the range: a clipped axis repeats one number; converting from its own unit rounds the last digit
    at_end = np.abs(axis - end) < same * abs(end)
    edges = np.flatnonzero(np.diff(np.r_[0, at_end.astype(int), 0]))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= 2]


def longest_repeat(stream: ImuStream) -> float:
    """Seconds of the longest stretch in which a stream gives the very same values."""
    measured = [
        signal
        for signal in (stream.R_inertial_sensor, stream.specific_force, stream.angular_rate)
        if signal is not None
    ]
    same = np.logical_and.reduce(
        [np.all(np.diff(signal.reshape(len(signal), -1), axis=0) == 0, axis=1) for signal in measured]
    )
    starts, ends = np.flatnonzero(np.diff(np.r_[False, same, False].astype(int))).reshape(-1, 2).T
    return float(np.max(stream.time[ends] - stream.time[starts], initial=0.0))
