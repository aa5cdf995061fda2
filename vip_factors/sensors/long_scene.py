"""A scene that gives what was measured by time: what is longer than memory is read window by window."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from vip_factors.sensors.camera_model import VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.sampled import LEAST_SAMPLES, MARGIN_S, RecordingInMemory, SampledRecording
from vip_factors.sensors.scene import Camera, CameraMount, Scene


class LongScene(Protocol):
    """Where the samples and detections of a filmed scene come from: memory, or a file."""

    @property
    def head(self) -> Scene:
        """All but samples, detections and truth; its cameras have no video frame, and no IMU."""
        ...

    @property
    def wearers(self) -> tuple[SampledRecording, ...]:
        """The recordings."""
        ...

    @property
    def video_start(self) -> float:
        """Seconds of the first camera's first video frame, on the recordings' clock."""
        ...

    def between(self, start: float, end: float) -> Scene:
        """The scene within ``start <= time <= end``, with samples on either side that frames look at.

        Sensors that hardly measured are left out; detections have numbers of their own.
        """
        ...

    def detected(self, start: float, end: float) -> int:
        """How many people the first camera's detector found in ``start <= time < end``; either may be infinite."""
        ...


@dataclass(frozen=True)
class SceneInMemory:
    """A scene with a camera that is in memory already; see :class:`LongScene`."""

    scene: Scene

    @cached_property
    def head(self) -> Scene:
        """See the protocol."""
        scene = self.scene
        wearers = tuple(one.head for one in self.wearers)
        first, *further = (without_frames(one) for one in scene.cameras)
        return Scene(scene.name, wearers, first, None, tuple(further))

    @cached_property
    def wearers(self) -> tuple[RecordingInMemory, ...]:
        """See the protocol."""
        return tuple(RecordingInMemory(one) for one in self.scene.wearers)

    @property
    def video_start(self) -> float:
        """See the protocol."""
        time = self.scene.cameras[0].timed_detections.time
        return float(time[0]) if len(time) else np.inf

    def between(self, start: float, end: float) -> Scene:
        """See the protocol."""
        wearers = tuple(
            replace(one.head, imus=one.between(start - MARGIN_S, end + MARGIN_S), truth=None) for one in self.wearers
        )
        first, *further = (camera_between(one, start, end) for one in self.scene.cameras)
        return Scene(self.scene.name, wearers, first, None, tuple(further))

    def detected(self, start: float, end: float) -> int:
        """See the protocol."""
        first = self.scene.cameras[0]
        time = first.timed_detections.time[first.detections.frame]
        return int(np.count_nonzero((time >= start) & (time < end)))


def without_frames(camera: Camera) -> Camera:
    """All of a camera but what it filmed and what the sensor on it measured."""
    none = camera.detections.select(np.zeros(len(camera.detections), bool))
    return replace(camera, detections=replace(none, time=np.zeros(0)), mount=None, video=None)


def camera_between(camera: Camera, start: float, end: float) -> Camera:
    """A camera within ``start <= time <= end``, seconds on the recordings' clock."""
    mount = camera.mount
    if mount is not None:
        mount = mount_of(mount, mount.imu.cut(start - MARGIN_S, end + MARGIN_S))
    return replace(camera, detections=cut(camera.detections, start, end, camera.clock), mount=mount, video=None)


def mount_of(mount: CameraMount, imu: ImuStream) -> CameraMount | None:
    """The mount with these samples; None if there are hardly any."""
    return replace(mount, imu=imu) if len(imu) >= LEAST_SAMPLES else None


def cut(detections: Detections, start: float, end: float, clock: VideoClock) -> Detections:
    """Detections from one instant of the sensors' clock to another; their video frames are counted anew."""
    time = clock.at(detections.time)
    first, last = np.searchsorted(time, start, "left"), np.searchsorted(time, end, "right")
    own = detections.select((detections.frame >= first) & (detections.frame < last))
    return replace(own, time=detections.time[first:last], frame=own.frame - first)
