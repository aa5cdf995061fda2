"""Where recordings and scenes come from: memory or files, which give by time what is longer than memory."""

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
from vip_factors.sensors.scene import Camera, Scene

MARGIN_S = 1.0  # of samples read on either side of frames: each frame looks a coarse step to both sides
LEAST_SAMPLES = 2  # of a stream: one alone has no rate


class RecordingSource(Protocol):
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

    def between(self, start: float = -np.inf, end: float = np.inf) -> Mapping[str, ImuStream]:
        """The samples of these sensors with ``start <= time <= end``; sensors that have hardly any are left out."""
        ...


@dataclass(frozen=True)
class RecordingInMemory:
    """A recording that is in memory already."""

    recording: Recording

    @cached_property
    def head(self) -> Recording:
        """The recording without what was measured."""
        return replace(self.recording, imus={})

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """Names of the placed sensors that have samples."""
        return tuple(self.recording.placed)

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of their first and last sample."""
        streams = [self.recording.imus[name] for name in self.sensors]
        if not streams:
            raise nothing_placed(self.recording.name, self.recording.imus)
        return float(min(stream.time[0] for stream in streams)), float(max(stream.time[-1] for stream in streams))

    def between(self, start: float = -np.inf, end: float = np.inf) -> Mapping[str, ImuStream]:
        """What was measured from one instant to another."""
        return streams_between(self.recording.imus, self.sensors, start, end)


def streams_between(
    streams: Mapping[str, ImuStream], sensors: Sequence[str], start: float, end: float
) -> dict[str, ImuStream]:
    """The samples of some sensors with ``start <= time <= end``; sensors that have hardly any are left out."""
    found = {}
    for name in sensors:
        time = streams[name].time if name in streams else np.zeros(0)
        if np.searchsorted(time, end, "right") - np.searchsorted(time, start, "left") >= LEAST_SAMPLES:
            found[name] = streams[name].cut(start, end)
    return found


def samples_around(recording: RecordingSource, time: Array) -> Mapping[str, ImuStream]:
    """All samples that frames at ``time`` ``(T,)`` look at."""
    return recording.between(float(time[0]) - MARGIN_S, float(time[-1]) + MARGIN_S)


def frames_of(streams: Mapping[str, ImuStream], sensors: Sequence[str], time: Array) -> ImuFrames:
    """Frames at ``time`` ``(T,)`` of all ``sensors``; of those without a stream nothing is valid."""
    T, S = len(time), len(sensors)
    R, force = np.tile(np.eye(3), (T, S, 1, 1)), np.zeros((T, S, 3))
    orientation_valid, acceleration_valid = np.zeros((T, S), bool), np.zeros((T, S), bool)
    columns = [column for column, name in enumerate(sensors) if name in streams]
    if columns:
        frames = resample_streams([streams[sensors[column]] for column in columns], time)
        R[:, columns], force[:, columns] = frames.R_inertial_sensor, frames.specific_force_inertial
        orientation_valid[:, columns] = frames.orientation_valid
        acceleration_valid[:, columns] = frames.acceleration_valid
    return ImuFrames(tuple(sensors), time, R, orientation_valid, force, acceleration_valid)


def without_gaps(head: Recording, stretches: Sequence[Mapping[str, ImuStream]], times: Sequence[Array]) -> Recording:
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
    return replace(head, imus={name: one_stream(streams) for name, streams in parts.items()})


def one_stream(parts: Sequence[ImuStream]) -> ImuStream:
    """Streams of one sensor, one after another, as one."""

    def together(values: Sequence[Array | None]) -> Array | None:
        measured = [samples for samples in values if samples is not None]
        return np.concatenate(measured) if len(measured) == len(parts) else None

    is_masked = any(part.force_measured is not None for part in parts)
    return ImuStream(
        parts[0].name,
        np.concatenate([part.time for part in parts]),
        together([part.specific_force for part in parts]),
        together([part.R_inertial_sensor for part in parts]),
        together([part.angular_rate for part in parts]),
        np.concatenate([part.force_measured_mask for part in parts]) if is_masked else None,
    )


class SceneSource(Protocol):
    """Where the samples and detections of a scene come from: memory, or a file."""

    @property
    def head(self) -> Scene:
        """All but samples, detections and truth; its cameras have no video frame, and no IMU."""
        ...

    @property
    def wearers(self) -> tuple[RecordingSource, ...]:
        """The recordings."""
        ...

    @property
    def video_start(self) -> float:
        """Seconds of the first camera's first video frame, on the recordings' clock; infinite without one."""
        ...

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """The scene within ``start <= time <= end``, with samples on either side that frames look at.

        Sensors that hardly measured are left out; detections have numbers of their own.
        """
        ...

    def detected(self, start: float, end: float) -> int:
        """How many people the first camera's detector found in ``start <= time < end``; either may be infinite."""
        ...


@dataclass(frozen=True)
class SceneInMemory:
    """A scene that is in memory already; see :class:`SceneSource`."""

    scene: Scene

    @cached_property
    def head(self) -> Scene:
        """The scene without what was measured."""
        return self._scene(
            tuple(wearer.head for wearer in self.wearers), tuple(map(without_frames, self.scene.cameras))
        )

    @cached_property
    def wearers(self) -> tuple[RecordingSource, ...]:
        """The recordings of all wearers, in their order."""
        return tuple(map(RecordingInMemory, self.scene.wearers))

    @property
    def video_start(self) -> float:
        """Seconds of the first video frame; infinite without one."""
        time = self.scene.cameras[0].timed_detections.time if self.scene.cameras else np.zeros(0)
        return float(time[0]) if len(time) else np.inf

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """What was measured from one instant to another; all of it is the scene as it is, with its truth."""
        if start == -np.inf and end == np.inf:
            return self.scene
        wearers = tuple(
            replace(wearer.head, imus=wearer.between(start - MARGIN_S, end + MARGIN_S), truth=None)
            for wearer in self.wearers
        )
        return self._scene(wearers, tuple(camera_between(camera, start, end) for camera in self.scene.cameras))

    def detected(self, start: float, end: float) -> int:
        """How many people were detected between two instants."""
        first = self.scene.cameras[0]
        time = first.timed_detections.time[first.detections.frame]
        return int(np.count_nonzero((time >= start) & (time < end)))

    def _scene(self, wearers: tuple[Recording, ...], cameras: tuple[Camera, ...]) -> Scene:
        return Scene(self.scene.name, wearers, cameras[0] if cameras else None, None, cameras[1:])


@dataclass(frozen=True)
class UnfilmedSource(SceneInMemory):
    """Wearers whom no camera filmed, from wherever their samples come; ``scene`` is what is not measured."""

    sources: tuple[RecordingSource, ...]

    @property
    def wearers(self) -> tuple[RecordingSource, ...]:
        """The recordings."""
        return self.sources

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """What was measured from one instant to another."""
        reach = start - MARGIN_S, end + MARGIN_S
        return self._scene(tuple(replace(wearer.head, imus=wearer.between(*reach)) for wearer in self.wearers), ())

    def detected(self, start: float, end: float) -> int:
        """How many people were detected between two instants: nobody."""
        return 0


def shared_interval(source: SceneSource) -> tuple[float, float]:
    """Seconds from which and until when the sensors of all wearers measure."""
    starts, ends = zip(*(wearer.interval for wearer in source.wearers), strict=True)
    return max(starts), min(ends)


def without_frames(camera: Camera) -> Camera:
    """All of a camera but what it filmed and what the sensor on it measured."""
    none = camera.detections.select(np.zeros(len(camera.detections), bool))
    return replace(camera, detections=replace(none, time=np.zeros(0)), mount=None, video=None)


def camera_between(camera: Camera, start: float, end: float) -> Camera:
    """A camera within ``start <= time <= end``, seconds on the recordings' clock."""
    mount = camera.mount
    if mount is not None:
        near = start - MARGIN_S, end + MARGIN_S
        count = np.searchsorted(mount.imu.time, near[1], "right") - np.searchsorted(mount.imu.time, near[0], "left")
        mount = replace(mount, imu=mount.imu.cut(*near)) if count >= LEAST_SAMPLES else None
    detections, time = camera.detections, camera.timed_detections.time
    first, last = np.searchsorted(time, start, "left"), np.searchsorted(time, end, "right")
    within = detections.select((detections.frame >= first) & (detections.frame < last))
    within = replace(within, time=detections.time[first:last], frame=within.frame - first)  # counted anew
    return replace(camera, detections=within, mount=mount, video=None)
