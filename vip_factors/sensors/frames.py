"""IMU streams resampled to the estimator's evenly spaced frames."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from vip_factors.display import Summarised
from vip_factors.errors import InputError, RecordingError
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, nothing_placed

POSE_S = 4.0  # initial pose: a silence within it does not begin a new stretch


@dataclass(frozen=True, repr=False)
class ImuFrames(Summarised):
    """Measurements of ``S`` sensors at ``T`` frames.

    Attributes:
        sensors: names, in the order of the second axis.
        time: ``(T,)`` seconds from the recording's start, evenly spaced; of several stretches, within each.
        R_inertial_sensor: ``(T, S, 3, 3)``; identity where not valid.
        orientation_valid: ``(T, S)`` mask of measured orientations.
        specific_force_inertial: ``(T, S, 3)`` m/s² in each sensor's inertial frame (gravity included), averaged with
            the triangular window of half-width one frame; zero where not valid.
        acceleration_valid: ``(T, S)`` mask of frames whose whole window was measured.
        period: seconds between frames; 0: the difference of the first two.
        begins: ``(T,)`` mask of the first frame of each stretch, after a leap in time or a silence of all sensors
            (which belongs to the stretch before it); computed by default.
    """

    sensors: tuple[str, ...]
    time: Array
    R_inertial_sensor: Array
    orientation_valid: np.ndarray
    specific_force_inertial: Array
    acceleration_valid: np.ndarray
    period: float = 0.0
    begins: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        if len(self.begins) != len(self.time):
            object.__setattr__(self, "begins", self._beginning())

    def _beginning(self) -> np.ndarray:
        silence_s = 0.5  # without samples of any sensor
        leap = 1.5  # steps between frames of two stretches
        is_measured, frames = self.orientation_valid.any(axis=1), np.arange(len(self))
        last_measured = np.maximum.accumulate(np.where(is_measured, frames, -1))
        silent = frames - np.concatenate([[-1], last_measured])[: len(self)] - 1
        leaps = np.diff(self.time, prepend=-np.inf) > leap * self.step
        silences = (silent * self.step >= silence_s) & (self.time >= self.time[:1] + POSE_S)
        return np.asarray(leaps | (is_measured & silences))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def step(self) -> float:
        """Time between two frames in seconds."""
        if self.period:
            return self.period
        return float(self.time[1] - self.time[0]) if len(self) > 1 else 1.0

    @cached_property
    def follows(self) -> np.ndarray:
        """Mask ``(T − 1,)`` of frames whose next frame belongs to the same stretch."""
        return ~self.begins[1:]

    @cached_property
    def beginnings(self) -> np.ndarray:
        """Indices of the first frame of each stretch."""
        return np.concatenate([[0], np.flatnonzero(~self.follows) + 1])

    def window(self, selection: slice) -> "ImuFrames":
        """Select a range of consecutive frames."""
        names = (entry.name for entry in fields(self) if entry.name not in ("sensors", "period"))
        measured = {name: getattr(self, name)[selection] for name in names}
        return replace(self, **measured, period=self.step)  # the step of a single frame is unknown


def frame_count(start: float, end: float, rate: float) -> int:
    """Number of frames at ``rate`` Hz between two instants, the first one included.

    Raises:
        RecordingError: if more than a day lies between them.
    """
    longest_s = 86_400.0  # more means damaged times
    if not end - start <= longest_s:
        raise RecordingError(
            f"the samples span {start:.7g} to {end:.7g} s: expected at most a day; the clock of a sensor jumped. "
            "'vip-factors info' shows which sensor has a gap of that length: remove the samples before or after it"
        )
    return int(np.floor((end - start) * rate + 1e-6)) + 1


def resample(recording: Recording, rate: float, sensors: list[str] | None = None) -> ImuFrames:
    """Resample the placed sensors of a recording to frames at ``rate`` Hz, over the time that any of them covers.

    Orientation is interpolated spherically. Acceleration is averaged by :func:`triangular_average`: the second
    difference of positions over one frame equals this average.

    Raises:
        InputError: for a rate that is not positive.
        RecordingError: if no sensor is placed, or the placed ones cover less than three frames.
    """
    if not rate > 0:
        raise InputError(f"frame rate {rate:g} Hz: expected a positive number")
    names = recording.placed if sensors is None else sensors
    if not names:
        raise nothing_placed(recording.name, recording.imus)
    streams = [recording.imus[name] for name in names]
    start, end = min(s.time[0] for s in streams), max(s.time[-1] for s in streams)
    count = frame_count(start, end, rate)
    if count < 3:
        raise RecordingError(f"recording '{recording.name}' is {end - start:.3f} s long: expected three frames or more")
    return resample_streams(streams, start + np.arange(count) / rate)


def resample_streams(streams: Sequence[ImuStream], time: Array) -> ImuFrames:
    """Resample streams to evenly spaced frames at ``time`` ``(T,)``; frames that they do not cover are not valid.

    Raises:
        RecordingError: if a stream has no orientation.
    """
    step = float(time[1] - time[0]) if len(time) > 1 else 1.0
    columns = [_resample_stream(stream, time, step) for stream in streams]
    R, orientation_valid, force, acceleration_valid = (
        np.stack(column, axis=1) for column in zip(*columns, strict=True)
    )
    return ImuFrames(tuple(stream.name for stream in streams), time, R, orientation_valid, force, acceleration_valid)


def in_stretches(stretches: Sequence[ImuFrames]) -> ImuFrames:
    """Concatenate the frames of several stretches of one recording; no acceleration spans a leap."""
    columns = []
    for number, frames in enumerate(stretches):
        acceleration_valid = frames.acceleration_valid.copy()
        acceleration_valid[:1] &= number == 0
        acceleration_valid[len(acceleration_valid) - 1 :] &= number == len(stretches) - 1
        columns.append(
            (
                frames.time,
                frames.R_inertial_sensor,
                frames.orientation_valid,
                frames.specific_force_inertial,
                acceleration_valid,
            )
        )
    time, R, orientation_valid, force, valid = (np.concatenate(column) for column in zip(*columns, strict=True))
    return ImuFrames(stretches[0].sensors, time, R, orientation_valid, force, valid, stretches[0].step)


def coarser(frames: ImuFrames, factor: int) -> ImuFrames:
    """Every ``factor``-th frame, equal to :func:`resample_streams` of the streams at these frames.

    A wide triangular window is a weighted sum of narrow ones, so samples are not needed.
    """
    weights = (factor - np.abs(np.arange(1 - factor, factor))) / factor**2
    indices = np.arange(0, len(frames), factor)
    reach = indices[:, None] + np.arange(1 - factor, factor)
    inside = (reach >= 0) & (reach < len(frames))
    reach = np.clip(reach, 0, len(frames) - 1)
    acceleration_valid = np.all(frames.acceleration_valid[reach] & inside[..., None], axis=1)
    force = np.einsum("k,nksi->nsi", weights, frames.specific_force_inertial[reach])
    force = np.where(acceleration_valid[..., None], force, 0.0)
    R, orientation_valid = frames.R_inertial_sensor[indices], frames.orientation_valid[indices]
    return ImuFrames(frames.sensors, frames.time[indices], R, orientation_valid, force, acceleration_valid)


def _resample_stream(stream: ImuStream, time: Array, step: float) -> tuple[Array, np.ndarray, Array, np.ndarray]:
    T = len(time)
    if stream.R_inertial_sensor is None:
        raise RecordingError(f"sensor '{stream.name}' has no orientation: run an attitude filter on it first")
    orientation_valid = _covered(stream, time, time)
    R = interpolate_rotations(stream.time, stream.R_inertial_sensor, time)
    R[~orientation_valid] = np.eye(3)
    if stream.specific_force is None or len(stream) < 2:
        return R, orientation_valid, np.zeros((T, 3)), np.zeros(T, bool)
    force_inertial = np.einsum("nij,nj->ni", stream.R_inertial_sensor, stream.specific_force)
    acceleration_valid = _covered(stream, time - step, time + step) & _measured(stream, time, step)
    force = np.zeros((T, 3))
    force[acceleration_valid] = triangular_average(stream.time, force_inertial, time[acceleration_valid], step)
    return R, orientation_valid, force, acceleration_valid


def _covered(stream: ImuStream, start: Array, end: Array) -> np.ndarray:
    """Test which intervals have samples without a gap."""
    slack = 0.5 / stream.rate if stream.rate else 0.0
    inside = (start >= stream.time[0] - slack) & (end <= stream.time[-1] + slack)
    for gap_start, gap_end in stream.gaps:
        inside &= (end <= gap_start + slack) | (start >= gap_end - slack)
    return inside


def _measured(stream: ImuStream, time: Array, reach: float) -> np.ndarray:
    """Test at which instants all samples of specific force within reach, and the adjacent ones, were measured."""
    missing = np.r_[0, np.cumsum(~stream.force_measured_mask)]
    start = np.searchsorted(stream.time, time - reach, side="right") - 1
    end = np.searchsorted(stream.time, time + reach) + 1
    return np.asarray(missing[np.minimum(end, len(stream))] == missing[np.maximum(start, 0)])


def triangular_average(time: Array, values: Array, query: Array, half_width: float) -> Array:
    """Average a signal under a triangular window around each query.

    The signal ``values`` ``(N, D)`` at ``time`` ``(N,)`` is piecewise linear. Its exact average under a triangle of
    half-width ``h`` is the second difference over ``h`` of its second antiderivative, divided by ``h²``: the difference
    that the acceleration factor takes of positions (thesis eq. 4.25).
    """
    mean = values.mean(axis=0)  # removed, so that the antiderivative stays small over long recordings
    from scipy.interpolate import make_interp_spline  # slow import

    position = make_interp_spline(time, values - mean, k=1).antiderivative(2)
    h = half_width
    return mean + (position(query - h) - 2 * position(query) + position(query + h)) / h**2
