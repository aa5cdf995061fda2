"""What was measured in one frame of a stream, and in consecutive ones: these as a scene for the batch stages."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vip_factors.geometry.rotations import Array, transpose
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import VideoFrame, sensor_columns
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.stages.scene_solution import SceneSolution


@dataclass(frozen=True)
class PlacedVideoFrame:
    """A video frame and the number of the frame nearest to it in time (half a frame off at most)."""

    frame: int
    video: VideoFrame


@dataclass(frozen=True)
class FrameMeasurement:
    """Measurements of ``S`` sensors in one frame: what :class:`~vip_factors.sensors.frames.ImuFrames` has in a row.

    Attributes:
        frame: number, from 0, without holes.
        time: seconds from the start of the stream; evenly spaced, but for restarts.
        R_inertial_sensor: ``(S, 3, 3)``; identity where not valid.
        orientation_valid: ``(S,)`` whether the orientation was measured here.
        specific_force_inertial: ``(S, 3)`` m/s² of the frame *before* this one, in each sensor's inertial frame
            (gravity included): its triangular window, of half-width one frame, ends only here. Zero where not valid.
        acceleration_valid: ``(S,)`` whether all of that window was measured.
        video: what has become available since the frame before; each with its own frame, this one or an earlier one
            within the lag. A frame may get several, of several cameras or of a fast one.
        restart: whether frames have been left out before this one: track anew from here.
    """

    frame: int
    time: float
    R_inertial_sensor: Array
    orientation_valid: np.ndarray
    specific_force_inertial: Array
    acceleration_valid: np.ndarray
    video: tuple[PlacedVideoFrame, ...] = ()
    restart: bool = False


MEASURES = 0.3  # of the frames: a third of its packets is enough to start with a sensor


class MeasuredStretch:
    """Consecutive frames of a stream in memory; a scene of any part of them is made for the stages of the pipeline.

    Attributes:
        head: of the stream.
        measurements: of the frames.
        columns: carrier and name of each sensor in the measurements.
        time: ``(T,)`` seconds of the frames.
    """

    def __init__(self, head: Scene, measurements: Sequence[FrameMeasurement]) -> None:
        self.head, self.measurements, self.columns = head, list(measurements), sensor_columns(head)
        self.time = np.array([one.time for one in self.measurements])

    @property
    def seconds(self) -> float:
        """From its first frame to its last."""
        return float(self.time[-1] - self.time[0])

    @property
    def first(self) -> int:
        """Number of its first frame."""
        return self.measurements[0].frame

    @property
    def video(self) -> list[PlacedVideoFrame]:
        """Video of these frames."""
        return video_of(self.measurements)

    def tail(self, frames: int) -> "MeasuredStretch":
        """The last ``frames`` of it."""
        return MeasuredStretch(self.head, self.measurements[-frames:])

    def measuring(self, carrier: str) -> list[str]:
        """Names of a carrier's sensors that measured orientations throughout, or of late, or nearly so."""
        lately_s = 2.0  # of a long stretch: a sensor that came late, or has moved, is used as well
        seen = self._stacked[1]
        lately = seen[self.time > self.time[-1] - lately_s]
        share = np.maximum(seen.mean(axis=0), lately.mean(axis=0))
        return [name for (who, name), own in zip(self.columns, share, strict=True) if who == carrier and own > MEASURES]

    def column(self, carrier: str, sensor: str) -> int:
        """Where a sensor's measurements are."""
        return self.columns.index((carrier, sensor))

    def frames(self, carrier: str, sensors: Sequence[str]) -> ImuFrames:
        """Some of a carrier's sensors at all frames."""
        columns = np.array([self.column(carrier, sensor) for sensor in sensors], dtype=int)
        R, seen, force, whole = (values[:, columns] for values in self._stacked)
        return ImuFrames(tuple(sensors), self.time, R, seen, force, whole)

    def frames_of(self, solution: SceneSolution) -> tuple[ImuFrames, ...]:
        """Of each wearer, the sensors that were solved at all frames."""
        return tuple(
            self.frames(recording.subject.name, wearer.frames.sensors)
            for recording, wearer in zip(solution.scene.wearers, solution.fused.model.wearers, strict=True)
        )

    @cached_property
    def _stacked(self) -> tuple[Array, ...]:
        """All sensors at all frames: orientations, whether they were measured, specific forces, whether they were."""
        names = ("R_inertial_sensor", "orientation_valid", "specific_force_inertial", "acceleration_valid")
        R, seen, *late = (np.stack([getattr(one, name) for one in self.measurements]) for name in names)
        # A measurement holds the specific force of the frame before it.
        return R, seen, *(np.concatenate([values[1:], np.zeros_like(values[:1])]) for values in late)

    def scene(self) -> Scene:
        """The head with what was measured, frames as if they were samples."""
        wearers, video = [], self.video
        for wearer in self.head.wearers:
            name = wearer.subject.name
            imus = {sensor: self._stream(name, sensor) for sensor in self.measuring(name)}
            # The declared pose was held at the start of the stream, not whenever tracking starts again.
            pose = wearer.initial_pose if self.first == 0 else "none"
            wearers.append(replace(wearer, imus=imus, initial_pose=pose))
        cameras = [
            self._camera(one, [v.video for v in video if v.video.camera == one.name]) for one in self.head.cameras
        ]
        return replace(
            self.head, wearers=tuple(wearers), camera=next(iter(cameras), None), further_cameras=tuple(cameras[1:])
        )

    def _camera(self, camera: Camera, video: Sequence[VideoFrame]) -> Camera:
        video, K = sorted(video, key=lambda one: one.time), len(camera.keypoints)
        frame = np.repeat(np.arange(len(video)), [len(one.pixels) for one in video])
        pixels = np.concatenate([np.zeros((0, K, 2)), *[one.pixels for one in video]])
        confidence = np.concatenate([np.zeros((0, K)), *[one.confidence for one in video]])
        time = np.array([one.time for one in video])
        mount = camera.mount
        if mount is not None:
            sensor = mount.imu.name
            whole = sensor in self.measuring(camera.name)
            mount = replace(mount, imu=self._stream(camera.name, sensor)) if whole else None
        detections = Detections(camera.keypoints, time, frame, pixels, confidence)
        return replace(camera, detections=detections, mount=mount)

    def _stream(self, carrier: str, sensor: str) -> ImuStream:
        frames = self.frames(carrier, [sensor])
        seen = frames.orientation_valid[:, 0]
        R = frames.R_inertial_sensor[seen, 0]
        force: Array = (transpose(R) @ frames.specific_force_inertial[seen, 0, :, None])[..., 0]
        return ImuStream(sensor, frames.time[seen], force, R)


def video_of(measurements: Sequence[FrameMeasurement]) -> list[PlacedVideoFrame]:
    """Video of consecutive frames, in the order of its arrival."""
    first = measurements[0].frame if measurements else 0
    return [one for measured in measurements for one in measured.video if one.frame >= first]
