"""A recording that gives its samples by time: what is longer than memory is read window by window."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import ImuFrames, resample_streams
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, nothing_placed

MARGIN_S = 1.0  # of samples read on either side of frames: each frame looks a coarse step to both sides
LEAST_SAMPLES = 2  # of a stream: one alone has no rate


class SampledRecording(Protocol):
    """Where samples come from: memory, or a file."""

    @property
    def head(self) -> Recording:
        """All but the samples."""
        ...

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors that have both samples and a place on the body, in the placement's order."""
        ...

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of the first and last sample of any of these sensors."""
        ...

    def between(self, start: float, end: float) -> Mapping[str, ImuStream]:
        """The samples of these sensors with ``start <= time <= end``; sensors that have hardly any are left out."""
        ...


@dataclass(frozen=True)
class RecordingInMemory:
    """A recording that is in memory already."""

    recording: Recording

    @cached_property
    def head(self) -> Recording:
        """See :class:`SampledRecording`."""
        return replace(self.recording, imus={})

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """See :class:`SampledRecording`."""
        return tuple(self.recording.placed)

    @property
    def interval(self) -> tuple[float, float]:
        """See :class:`SampledRecording`."""
        streams = [self.recording.imus[name] for name in self.sensors]
        if not streams:
            raise nothing_placed(self.recording.name, self.recording.imus)
        return float(min(one.time[0] for one in streams)), float(max(one.time[-1] for one in streams))

    def between(self, start: float, end: float) -> Mapping[str, ImuStream]:
        """See :class:`SampledRecording`."""
        found = {}
        for name in self.sensors:
            stream = self.recording.imus[name]
            first, last = np.searchsorted(stream.time, start, "left"), np.searchsorted(stream.time, end, "right")
            if last - first >= LEAST_SAMPLES:
                found[name] = stream.cut(start, end)
        return found


def samples_around(recording: SampledRecording, time: Array) -> Mapping[str, ImuStream]:
    """All samples that frames at ``time`` ``(T,)`` look at."""
    return recording.between(float(time[0]) - MARGIN_S, float(time[-1]) + MARGIN_S)


def frames_of(streams: Mapping[str, ImuStream], sensors: Sequence[str], time: Array) -> ImuFrames:
    """Frames at ``time`` ``(T,)`` of all ``sensors``; of those without a stream nothing is valid.

    Raises:
        RecordingError: if a stream has no orientation.
    """
    T, S = len(time), len(sensors)
    R, force = np.tile(np.eye(3), (T, S, 1, 1)), np.zeros((T, S, 3))
    seen, whole = np.zeros((T, S), bool), np.zeros((T, S), bool)
    own = [name for name in sensors if name in streams]
    if own:
        found = resample_streams([streams[name] for name in own], time)
        columns = [list(sensors).index(name) for name in own]
        R[:, columns], force[:, columns] = found.R_inertial_sensor, found.specific_force_inertial
        seen[:, columns], whole[:, columns] = found.orientation_valid, found.acceleration_valid
    return ImuFrames(tuple(sensors), time, R, seen, force, whole)


def closed_up(head: Recording, stretches: Sequence[Mapping[str, ImuStream]], times: Sequence[Array]) -> Recording:
    """A recording of several stretches with the time between them left out: the first instant of each follows the last.

    Args:
        head: all but the samples.
        stretches: samples of each.
        times: ``(T,)`` seconds of the frames of each, evenly spaced; samples beyond them are left out.

    Raises:
        RecordingError: if there is no sample.
    """
    parts: dict[str, list[ImuStream]] = {}
    begin = float(times[0][0])
    for streams, time in zip(stretches, times, strict=True):
        step, end = float(time[1] - time[0]), float(time[-1])
        for name, stream in streams.items():
            inside = (stream.time >= time[0]) & (stream.time < end + step / 2)
            if np.count_nonzero(inside) >= LEAST_SAMPLES:
                cut = stream.cut(float(time[0]), float(stream.time[inside][-1]))
                parts.setdefault(name, []).append(replace(cut, time=cut.time + (begin - float(time[0]))))
        begin += end - float(time[0]) + step
    if not parts:
        raise RecordingError(f"recording '{head.name}': no sensor measured in any of the stretches")
    return replace(head, imus={name: one_stream(own) for name, own in parts.items()})


def one_stream(parts: Sequence[ImuStream]) -> ImuStream:
    """Streams of one sensor, one after another, as one."""

    def together(values: Sequence[Array | None]) -> Array | None:
        there = [one for one in values if one is not None]
        return np.concatenate(there) if len(there) == len(parts) else None

    partly = any(one.force_measured is not None for one in parts)
    return ImuStream(
        parts[0].name, np.concatenate([one.time for one in parts]), together([one.specific_force for one in parts]),
        together([one.R_inertial_sensor for one in parts]), together([one.angular_rate for one in parts]),
        np.concatenate([one.force_measured_mask for one in parts]) if partly else None,
    )  # fmt: skip
