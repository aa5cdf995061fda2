"""All IMU streams resampled onto the estimator's evenly spaced frames."""

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

POSE_S = 4.0  # from the start: what is silent sooner comes after a pose that was held before, and is tied to it


@dataclass(frozen=True, repr=False)
class ImuFrames(Summarised):
    """Measurements of ``S`` sensors at ``T`` frames.

    Attributes:
        sensors: names, in the order of the second axis.
        time: ``(T,)`` seconds from the recording's start, evenly spaced; of several stretches, within each.
        R_inertial_sensor: ``(T, S, 3, 3)``; identity where not valid.
        orientation_valid: ``(T, S)`` whether the orientation was measured there.
        specific_force_inertial: ``(T, S, 3)`` m/s² in each sensor's inertial frame (gravity included), averaged with
            the triangular window of half-width one frame; zero where not valid.
        acceleration_valid: ``(T, S)`` whether the whole window was measured.
        period: seconds between frames; 0: as many as between the first two.
        begins: ``(T,)`` whether the frame is the first one of a stretch, after a leap in time or a silence of all
            sensors (which belongs to the stretch before it); found if not given.
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
        # Without a sample of any sensor, nothing ties what comes after to what was before: nobody saw it
        silence_s = 0.5
        leap = 1.5  # steps: what is further apart are frames of two stretches
        seen, frames = self.orientation_valid.any(axis=1), np.arange(len(self))
        last = np.maximum.accumulate(np.where(seen, frames, -1))
        silent = frames - np.concatenate([[-1], last])[: len(self)] - 1
        leaps = np.diff(self.time, prepend=-np.inf) > leap * self.step
        silences = (silent * self.step >= silence_s) & (self.time >= self.time[:1] + POSE_S)
        return np.asarray(leaps | (seen & silences))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def step(self) -> float:
        """Seconds between two frames."""
        if self.period:
            return self.period
        return float(self.time[1] - self.time[0]) if len(self) > 1 else 1.0

    @cached_property
    def follows(self) -> np.ndarray:
        """``(T − 1,)`` whether the next frame is the next step, and not the first one of another stretch."""
        return ~self.begins[1:]

    @cached_property
    def beginnings(self) -> np.ndarray:
        """The first frame of each stretch; of evenly spaced frames without a silence 0 alone."""
        return np.concatenate([[0], np.flatnonzero(~self.follows) + 1])

    def window(self, selection: slice) -> "ImuFrames":
        """Some of the frames, all consecutive (a step would break the triangular window)."""
        names = (one.name for one in fields(self) if one.name not in ("sensors", "period"))
        measured = {name: getattr(self, name)[selection] for name in names}
        return replace(self, **measured, period=self.step)  # some may be one frame, or begin where a stretch ends


def frame_count(start: float, end: float, rate: float) -> int:
    """How many frames at ``rate`` Hz fit between two instants, the first on the first one.

    Raises:
        RecordingError: if more than a day lies between them.
    """
    longest_s = 86_400.0  # more is no recording of a person, but the time of a sample that was damaged
    if not end - start <= longest_s:
        raise RecordingError(
            f"the samples lie between {start:.7g} and {end:.7g} s: expected a day at most; a sensor's clock jumped ('"
            "vip-factors info' tells which one has a gap of that length), so leave out what is before or behind"
        )
    return int(np.floor((end - start) * rate + 1e-6)) + 1


def resample(recording: Recording, rate: float, sensors: list[str] | None = None) -> ImuFrames:
    """Put the placed sensors of a recording onto frames at ``rate`` Hz, over the time that any of them covers.

    Orientation is interpolated spherically between neighbouring samples. Acceleration is *averaged*, by
    :func:`triangular_average`: the second difference of positions over one frame equals just that average.

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
    """Put streams onto given, evenly spaced frames; what they do not cover is not valid.

    Raises:
        RecordingError: if a stream has no orientation.
    """
    step = float(time[1] - time[0]) if len(time) > 1 else 1.0
    columns = [_resample_stream(stream, time, step) for stream in streams]
    R, seen, force, whole = (np.stack(parts, axis=1) for parts in zip(*columns, strict=True))
    return ImuFrames(tuple(stream.name for stream in streams), time, R, seen, force, whole)


def in_stretches(stretches: Sequence[ImuFrames]) -> ImuFrames:
    """Frames of several stretches of one recording, in the order of time; no acceleration spans a leap."""
    parts = []
    for number, one in enumerate(stretches):
        whole = one.acceleration_valid.copy()
        whole[:1] &= number == 0
        whole[len(whole) - 1 :] &= number == len(stretches) - 1
        parts.append((one.time, one.R_inertial_sensor, one.orientation_valid, one.specific_force_inertial, whole))
    time, R, seen, force, valid = (np.concatenate(column) for column in zip(*parts, strict=True))
    return ImuFrames(stretches[0].sensors, time, R, seen, force, valid, stretches[0].step)


def coarser(frames: ImuFrames, factor: int) -> ImuFrames:
    """Every ``factor``-th frame, as :func:`resample_streams` of the streams themselves would give it.

    A triangular window is a weighted sum of narrower ones: no sample is needed to widen it.
    """
    weights = (factor - np.abs(np.arange(1 - factor, factor))) / factor**2
    kept = np.arange(0, len(frames), factor)
    reach = kept[:, None] + np.arange(1 - factor, factor)
    inside = (reach >= 0) & (reach < len(frames))
    reach = np.clip(reach, 0, len(frames) - 1)
    whole = np.all(frames.acceleration_valid[reach] & inside[..., None], axis=1)
    force = np.einsum("k,nksi->nsi", weights, frames.specific_force_inertial[reach])
    return ImuFrames(
        frames.sensors, frames.time[kept], frames.R_inertial_sensor[kept], frames.orientation_valid[kept],
        np.where(whole[..., None], force, 0.0), whole,
    )  # fmt: skip


def _resample_stream(stream: ImuStream, time: Array, step: float) -> tuple[Array, np.ndarray, Array, np.ndarray]:
    T = len(time)
    if stream.R_inertial_sensor is None:
        raise RecordingError(f"sensor '{stream.name}' has no orientation: run an attitude filter over it first")
    seen = _covered(stream, time, time)
    R = interpolate_rotations(stream.time, stream.R_inertial_sensor, time)
    R[~seen] = np.eye(3)
    if stream.specific_force is None or len(stream) < 2:
        return R, seen, np.zeros((T, 3)), np.zeros(T, bool)
    force_inertial = np.einsum("nij,nj->ni", stream.R_inertial_sensor, stream.specific_force)
    whole = _covered(stream, time - step, time + step) & _measured(stream, time, step)
    force = np.zeros((T, 3))
    force[whole] = triangular_average(stream.time, force_inertial, time[whole], step)
    return R, seen, force, whole


def _covered(stream: ImuStream, start: Array, end: Array) -> np.ndarray:
    """Whether the stream has samples without a gap over each of the intervals."""
    slack = 0.5 / stream.rate if stream.rate else 0.0
    inside = (start >= stream.time[0] - slack) & (end <= stream.time[-1] + slack)
    for gap_start, gap_end in stream.gaps:
        inside &= (end <= gap_start + slack) | (start >= gap_end - slack)
    return inside


def _measured(stream: ImuStream, time: Array, reach: float) -> np.ndarray:
    """Whether all samples of specific force within the reach of each instant, and those beside, were measured."""
    missing = np.r_[0, np.cumsum(~stream.force_measured_mask)]
    first = np.searchsorted(stream.time, time - reach, side="right") - 1
    last = np.searchsorted(stream.time, time + reach) + 1
    return np.asarray(missing[np.minimum(last, len(stream))] == missing[np.maximum(first, 0)])


def triangular_average(time: Array, values: Array, query: Array, half_width: float) -> Array:
    """Average of a signal under a triangular window around each query.

    The signal ``values`` ``(N, D)`` at ``time`` ``(N,)`` is taken as piecewise linear. Its exact average under the
    triangle of half-width ``h`` is the second difference over ``h`` of its second antiderivative, divided by ``h²``:
    the same second difference that the acceleration factor takes of positions (thesis eq. 4.25).
    """
    mean = values.mean(axis=0)  # taken out so that the antiderivative stays small over long recordings
    from scipy.interpolate import make_interp_spline  # takes a fifth of a second, which info need not wait for

    position = make_interp_spline(time, values - mean, k=1).antiderivative(2)
    h = half_width
    return mean + (position(query - h) - 2 * position(query) + position(query + h)) / h**2
