"""Checks of accelerometers: range, scale, axes, and the sign of their acceleration.

With the opposite sign accelerometers measure gravity at rest instead of specific force. The estimated vertical is then
upside down and the motion mirrored. Accelerations still agree with rotations, but the body does not fit: left and right
are exchanged and knees bend backwards. The likelihood of the best start (headings and mountings) for the given and for
the mirrored recording therefore decides.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import FORCE_LIMIT, ImuStream, runs
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.sources import frames_of
from vip_factors.settings import CommonSettings
from vip_factors.stages.calibration_start import UPRIGHT
from vip_factors.stages.inertial import find_start

RATE = 15.0  # Hz
R_TURNED_OVER = np.diag([1.0, -1.0, -1.0])
# Of the mean force to the vertical: what is wrong, and what is right. Fifteen sound recordings have up to 2.8°.
LEANING, LEVEL = np.deg2rad(10.0), np.deg2rad(4.0)
INVERTED = "inverted"


Corrections = Mapping[str, "SensorCorrection"]
"""Corrections of one wearer's sensors by name; sensors without one are right."""


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


def apply_corrections(recording: Recording, corrections: Corrections) -> Recording:
    """Apply corrections to the streams of a recording."""
    imus = {
        name: corrections[name].of(stream) if name in corrections else stream for name, stream in recording.imus.items()
    }
    return replace(recording, imus=imus)


def accelerometer_corrections(
    recording: Recording, settings: CommonSettings
) -> tuple[dict[str, SensorCorrection], list[Finding]]:
    """Check the accelerometers of a wearer's placed sensors; return corrections by name, and findings.

    Raises:
        RecordingError: if most orientations are inverted, or no accelerometer measures gravity.
    """
    # Of the very same values; 58 recordings have 1.0 at most, a still pose that was written in front of some
    stuck_s = 2.0
    wearer, corrections, findings = recording.subject.name, dict[str, SensorCorrection](), list[Finding]()
    _refuse_inverted(recording)
    _refuse_without_gravity(recording)
    for name in recording.placed:
        if (seconds := longest_repeat(recording.imus[name])) > stuck_s:
            findings.append(Finding("sensor stuck", wearer, subject=name, numbers={"seconds": seconds}))
        correction, accelerometer_findings = _correction(wearer, recording.imus[name])
        if accelerometer_findings:
            corrections[name] = correction
        findings += accelerometer_findings
    if is_sign_opposite(apply_corrections(recording, corrections), settings):
        for name in recording.placed:
            corrections[name] = replace(corrections.get(name, SensorCorrection()), is_mirrored=True)
        findings.append(Finding("acceleration turned round", wearer))
    return corrections, findings


def mirror_stream(stream: ImuStream) -> ImuStream:
    """Negate the specific force and turn the inertial frame over, so that it is upright again."""
    force, R = stream.specific_force, stream.R_inertial_sensor
    return replace(
        stream,
        specific_force=None if force is None else -force,
        R_inertial_sensor=None if R is None else R_TURNED_OVER @ R,
    )


def _refuse_inverted(recording: Recording) -> None:
    """Refuse inverted accelerometers: one may be chance, half of them are the file's convention."""
    names = [name for name in recording.placed if force_in_wrong_axes(recording.imus[name]) == INVERTED]
    if len(names) > len(recording.placed) / 2:
        raise RecordingError(
            f"wearer '{recording.subject.name}': orientations of {len(names)} of {len(recording.placed)} sensors are "
            "inverted: gravity is upright if they turn the inertial frame into the sensor's; expected the sensor's "
            "into the inertial one; invert them (the conjugate of each quaternion) and convert again"
        )


def _refuse_without_gravity(recording: Recording) -> None:
    """Raise if no sensor's accelerations hold gravity: of one sensor it is a fault, of all the file's convention."""
    scales = [scale for name in recording.placed if (scale := accelerometer_scale(recording.imus[name])) is not None]
    if scales and not any(_has_gravity(scale) for scale, _ in scales):
        raise RecordingError(
            f"wearer '{recording.subject.name}': accelerometers measure gravity as {9.81 * scales[0][0]:.2f} m/s²: "
            "expected 9.81; give accelerations with gravity in them (specific force), not what is left without it"
        )


def _correction(wearer: str, stream: ImuStream) -> tuple[SensorCorrection, list[Finding]]:
    """Check one accelerometer by itself; return its correction, and findings if it is wrong."""
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
    return best_axes if errors[best_axes] < LEVEL else None


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
    return [(a, b) for a, b in runs(at_end).tolist() if b - a >= 2]


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
    starts, ends = runs(same).T
    return float(np.max(stream.time[ends] - stream.time[starts], initial=0.0))


def is_sign_opposite(recording: Recording, settings: CommonSettings) -> bool:
    """Return True if accelerations of the opposite sign explain a wearer's sensors much better.

    Only checked if most sensors on trunk, thighs and shanks are upside down relative to their sites.
    """
    least_gain = 8.0  # nats: correct recordings gain 1 at most, 5 with all straps upside down; a wrong sign 20 to 60
    names, streams = recording.placed, [recording.imus[name] for name in recording.placed]
    if len(names) < 2 or any(stream.R_inertial_sensor is None or stream.specific_force is None for stream in streams):
        return False
    time = np.arange(max(stream.time[0] for stream in streams), min(stream.time[-1] for stream in streams), 1 / RATE)
    if len(time) < 2:
        return False
    frames = frames_of(recording.imus, names, time)
    if not frames.orientation_valid.any(axis=0).all() or not _are_upside_down(recording, frames):
        return False
    mirrored_recording = replace(
        recording, imus={name: mirror_stream(stream) for name, stream in recording.imus.items()}
    )
    other_frames = frames_of(mirrored_recording.imus, names, time)
    _, start = find_start(recording, frames, settings, lambda _: None)
    _, mirrored_start = find_start(mirrored_recording, other_frames, settings, lambda _: None)
    return start is not None and mirrored_start is not None and start.best.cost - mirrored_start.best.cost > least_gain


def _are_upside_down(recording: Recording, frames: ImuFrames) -> bool:
    least_share, largest_cosine = 0.7, -0.5  # of the sensors; of the bone's placed long axis to the vertical
    cosines = [
        _along_vertical(recording.placement.site(name).R_bone_sensor, frames, s)
        for s, name in enumerate(frames.sensors)
        if recording.placement.site(name).bone_index in UPRIGHT
    ]
    return bool(cosines) and float(np.mean(np.array(cosines) < largest_cosine)) >= least_share


def _along_vertical(R_bone_sensor: Array, frames: ImuFrames, s: int) -> float:
    """Mean cosine of a bone's long axis to the vertical for a given mounting."""
    vertical = frames.R_inertial_sensor[frames.orientation_valid[:, s], s, 2]
    return float(np.mean(vertical @ R_bone_sensor[1]))
