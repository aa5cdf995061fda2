"""Sources of recordings and scenes: memory, or files that are read by time because they exceed memory."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import ImuFrames, resample_streams
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, nothing_placed
from vip_factors.sensors.scene import Camera, Scene

MARGIN_S = 1.0  # of samples on either side of frames: a frame depends on samples within a coarse step
LEAST_SAMPLES = 2  # of a stream: a single sample has no rate


class RecordingSource(Protocol):
    """Source of one wearer's samples."""

    @property
    def head(self) -> Recording:
        """Head of the recording, without its samples."""
        ...

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the placed sensors that have samples, in the placement's order."""
        ...

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of the first and last sample of any of these sensors."""
        ...

    def between(self, start: float = -np.inf, end: float = np.inf) -> Mapping[str, ImuStream]:
        """Samples of these sensors with ``start <= time <= end``; sensors with fewer than two are left out."""
        ...


@dataclass(frozen=True)
class RecordingInMemory:
    """Recording that is held in memory; with ``only_placed=False``, its sensors include those that are not placed."""

    recording: Recording
    only_placed: bool = field(default=True, kw_only=True)

    @cached_property
    def head(self) -> Recording:
        """Head of the recording, without its samples."""
        return replace(self.recording, imus={})

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """Names of the placed sensors that have samples."""
        return tuple(self.recording.placed if self.only_placed else self.recording.imus)

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds of the first and last sample."""
        streams = [self.recording.imus[name] for name in self.sensors]
        if not streams:
            raise nothing_placed(self.recording.name, self.recording.imus)
        return float(min(stream.time[0] for stream in streams)), float(max(stream.time[-1] for stream in streams))

    def between(self, start: float = -np.inf, end: float = np.inf) -> Mapping[str, ImuStream]:
        """Measurements with ``start <= time <= end``."""
        return streams_between(self.recording.imus, self.sensors, start, end)


def streams_between(
    streams: Mapping[str, ImuStream], sensors: Sequence[str], start: float, end: float
) -> dict[str, ImuStream]:
    """Samples of some sensors with ``start <= time <= end``; sensors with fewer than two are left out."""
    selected = {}
    for name in sensors:
        time = streams[name].time if name in streams else np.zeros(0)
        if np.searchsorted(time, end, "right") - np.searchsorted(time, start, "left") >= LEAST_SAMPLES:
            selected[name] = streams[name].cut(start, end)
    return selected


def samples_around(recording: RecordingSource, time: Array) -> Mapping[str, ImuStream]:
    """Samples that frames at ``time`` ``(T,)`` depend on."""
    return recording.between(float(time[0]) - MARGIN_S, float(time[-1]) + MARGIN_S)


def frames_of(streams: Mapping[str, ImuStream], sensors: Sequence[str], time: Array) -> ImuFrames:
    """Resample ``sensors`` to frames at ``time`` ``(T,)``; sensors without a stream are not valid."""
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
    """Concatenate stretches of a recording without the time between them.

    Args:
        head: the recording without samples.
        stretches: samples of each stretch.
        times: ``(T,)`` evenly spaced frame times of each stretch, seconds; samples beyond them are left out.

    Raises:
        RecordingError: if there is no sample.
    """
    pieces: dict[str, list[ImuStream]] = {}
    begin = float(times[0][0])
    for streams, time in zip(stretches, times, strict=True):
        step, end = float(time[1] - time[0]), float(time[-1])
        for name, stream in streams.items():
            inside = (stream.time >= time[0]) & (stream.time < end + step / 2)
            if np.count_nonzero(inside) >= LEAST_SAMPLES:
                cut = stream.cut(float(time[0]), float(stream.time[inside][-1]))
                pieces.setdefault(name, []).append(replace(cut, time=cut.time + (begin - float(time[0]))))
        begin += end - float(time[0]) + step
    if not pieces:
        raise RecordingError(f"recording '{head.name}': no sensor measured in any of the stretches")
    return replace(head, imus={name: one_stream(streams) for name, streams in pieces.items()})


def one_stream(streams: Sequence[ImuStream]) -> ImuStream:
    """Concatenate streams of one sensor."""

    def together(quantity: str) -> Array | None:
        measured = [values for stream in streams if (values := getattr(stream, quantity)) is not None]
        return np.concatenate(measured) if len(measured) == len(streams) else None

    is_masked = any(stream.force_measured is not None for stream in streams)
    force, R, rate = map(together, ("specific_force", "R_inertial_sensor", "angular_rate"))
    time = np.concatenate([stream.time for stream in streams])
    mask = np.concatenate([stream.force_measured_mask for stream in streams]) if is_masked else None
    return ImuStream(streams[0].name, time, force, R, rate, mask)


class SceneSource(Protocol):
    """Source of a scene's samples and detections."""

    @property
    def head(self) -> Scene:
        """The scene without samples, detections and truth; its cameras have no video frames and no IMU."""
        ...

    @property
    def wearers(self) -> tuple[RecordingSource, ...]:
        """Recordings of the wearers, in order."""
        ...

    @property
    def video_start(self) -> float:
        """Seconds of the first camera's first video frame, on the recordings' clock; infinite without a video."""
        ...

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """The scene within ``start <= time <= end``, with a margin of samples on either side.

        Sensors with fewer than two samples are left out; video frames are numbered from 0.
        """
        ...

    def detected(self, start: float, end: float, camera: str) -> int:
        """Number of a camera's detections in ``start <= time < end``; either may be infinite."""
        ...


@dataclass(frozen=True)
class SceneInMemory:
    """Scene in memory; see :class:`SceneSource`."""

    scene: Scene

    @cached_property
    def head(self) -> Scene:
        """Head of the scene, without its measurements."""
        wearers, cameras = (wearer.head for wearer in self.wearers), map(without_frames, self.scene.cameras)
        return Scene(self.scene.name, tuple(wearers), tuple(cameras))

    @cached_property
    def wearers(self) -> tuple[RecordingSource, ...]:
        """The recordings of all wearers, in their order."""
        return tuple(map(RecordingInMemory, self.scene.wearers))

    @property
    def video_start(self) -> float:
        """Seconds of the first video frame; infinite without a video."""
        time = self.scene.cameras[0].timed_detections.time if self.scene.cameras else np.zeros(0)
        return float(time[0]) if len(time) else np.inf

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """The scene within ``start <= time <= end``; with infinite limits the whole scene with its truth."""
        if start == -np.inf and end == np.inf:
            return self.scene
        reach = start - MARGIN_S, end + MARGIN_S
        wearers = tuple(replace(wearer.head, imus=wearer.between(*reach), truth=None) for wearer in self.wearers)
        return Scene(
            self.scene.name, wearers, tuple(camera_between(camera, start, end) for camera in self.scene.cameras)
        )

    def detected(self, start: float, end: float, camera: str) -> int:
        """Number of detections in ``start <= time < end``."""
        filmed = next(candidate for candidate in self.scene.cameras if candidate.name == camera)
        time = filmed.timed_detections.time[filmed.detections.frame]
        return int(np.count_nonzero((time >= start) & (time < end)))


@dataclass(frozen=True)
class UnfilmedSource(SceneInMemory):
    """Wearers without cameras, from any source; ``scene`` is the head."""

    sources: tuple[RecordingSource, ...]

    @property
    def wearers(self) -> tuple[RecordingSource, ...]:
        """Recordings of the wearers, in order."""
        return self.sources

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """Measurements with ``start <= time <= end``."""
        reach = start - MARGIN_S, end + MARGIN_S
        return Scene(
            self.scene.name, tuple(replace(wearer.head, imus=wearer.between(*reach)) for wearer in self.wearers)
        )

    def detected(self, start: float, end: float, camera: str) -> int:
        """Number of detections, which is zero."""
        return 0


def shared_interval(source: SceneSource) -> tuple[float, float]:
    """Seconds from and to which the sensors of all wearers measure."""
    starts, ends = zip(*(wearer.interval for wearer in source.wearers), strict=True)
    return max(starts), min(ends)


def without_frames(camera: Camera) -> Camera:
    """Remove a camera's detections, video and IMU."""
    none = camera.detections.select(np.zeros(len(camera.detections), bool))
    return replace(camera, detections=replace(none, time=np.zeros(0)), mount=None, video=None, truth=None)


def camera_between(camera: Camera, start: float, end: float) -> Camera:
    """Select a camera's measurements with ``start <= time <= end``, seconds on the recordings' clock."""
    mount = camera.mount
    if mount is not None:
        near = start - MARGIN_S, end + MARGIN_S
        count = np.searchsorted(mount.imu.time, near[1], "right") - np.searchsorted(mount.imu.time, near[0], "left")
        mount = replace(mount, imu=mount.imu.cut(*near)) if count >= LEAST_SAMPLES else None
    detections, time = camera.detections, camera.timed_detections.time
    first_frame, end_frame = np.searchsorted(time, start, "left"), np.searchsorted(time, end, "right")
    within = detections.select((detections.frame >= first_frame) & (detections.frame < end_frame))
    frame_numbers = within.frame - first_frame
    within = replace(within, time=detections.time[first_frame:end_frame], frame=frame_numbers)
    return replace(camera, detections=within, mount=mount, video=None, truth=None)
