"""Sensors looked over before anything is estimated: accelerometers by themselves, clocks against one another."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vip_factors.findings import Finding
from vip_factors.initialise.sensor_clocks import SensorDelay, clock_step, joint_signal, sensor_delays
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import LEAST_SAMPLES, RecordingSource
from vip_factors.settings import SensorClockSettings, Settings
from vip_factors.stages.accelerometers import (
    Corrections,
    SensorCorrection,
    accelerometer_corrections,
    apply_corrections,
)
from vip_factors.stages.calibration_start import sensor_links
from vip_factors.stages.pauses import between_pauses


def check_scene(scene: Scene, settings: Settings) -> tuple[Scene, tuple[Corrections, ...], tuple[Finding, ...]]:
    """The scene with all wearers' sensors put right, by what each wearer's were, and what was found."""
    checked = [sensor_corrections(recording, recording, settings) for recording in scene.wearers]
    wearers = tuple(
        apply_corrections(recording, right) for recording, (right, _) in zip(scene.wearers, checked, strict=True)
    )
    return (
        replace(scene, wearers=wearers),
        tuple(right for right, _ in checked),
        tuple(finding for _, findings in checked for finding in findings),
    )


def checked(recording: Recording, settings: Settings) -> tuple[Recording, tuple[Finding, ...]]:
    """The recording with its placed sensors put right where that can be done, and what was found."""
    corrections, findings = sensor_corrections(recording, recording, settings)
    return apply_corrections(recording, corrections), findings


def corrected_elsewhere(
    recording: Recording, corrections: Corrections, settings: Settings
) -> tuple[Recording, tuple[Finding, ...]]:
    """A stretch put right by what another showed; in it accelerometers are looked over by themselves."""
    settled = {name: replace(correction, ends=()) for name, correction in corrections.items()}
    clocks = replace(settings.sensor_clocks, check=False)
    return checked(apply_corrections(recording, settled), replace(settings, sensor_clocks=clocks))


@dataclass(frozen=True)
class PreparedRecording:
    """A recording with its sensors in their places and their samples put right.

    See :class:`~vip_factors.sensors.sources.RecordingSource`.

    Attributes:
        source: the recording as it was given.
        placement: another placement; None keeps that of the recording.
        corrections: of its sensors.
    """

    source: RecordingSource
    placement: Placement | None = None
    corrections: Corrections = field(default_factory=dict)

    @cached_property
    def head(self) -> Recording:
        """The recording without what was measured."""
        head = self.source.head
        return head if self.placement is None else replace(head, placement=self.placement)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the placed sensors that have samples."""
        measured = self.source.sensors
        return tuple(site.sensor for site in self.head.placement.sites if site.sensor in measured)

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
    wearer = recording.subject.name
    corrections, findings = dict[str, SensorCorrection](), list[Finding]()
    if settings.accelerometers.check:
        corrections, findings = accelerometer_corrections(recording, settings)
    if settings.sensor_clocks.check:
        delays, step = _delays(apply_corrections(clocks, corrections))
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


def _delays(recording: Recording) -> tuple[tuple[SensorDelay, ...], tuple[int, float] | None]:
    names = recording.placed
    if len(names) < 2:
        return (), None
    bones = [recording.placement.site(name).bone_index for name in names]
    links, signals = sensor_links(recording, names), [joint_signal(recording.imus[name]) for name in names]
    restarts = [(pause.start + pause.end) / 2 for pause in recording.pauses]
    delays = sensor_delays(signals, bones, links, restarts)
    if restarts:
        compared = between_pauses(recording)
        signals = [joint_signal(compared.imus[name]) if name in compared.imus else None for name in names]
    return delays, clock_step(signals, links)


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
