"""One frame of a stream, and consecutive ones: these as a scene for the batch stages."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vip_factors.geometry.rotations import Array, transpose
from vip_factors.problem.scene import KeypointView
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import VideoFrame, detections_of, sensor_columns
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.stages.scene_solution import SceneSolution


@dataclass
class LiveFrame:
    """One frame of a stream with ``S`` sensors: what :class:`~vip_factors.sensors.frames.ImuFrames` has in a row.

    Attributes:
        number: from 0, without holes.
        time: seconds from the start of the stream; evenly spaced, but for restarts.
        R_inertial_sensor: ``(S, 3, 3)``; identity where not valid.
        orientation_valid: ``(S,)`` whether the orientation was measured here.
        specific_force_before: ``(S, 3)`` m/s² of the frame *before* this one, in each sensor's inertial frame (gravity
            included): its triangular window, of half-width one frame, ends only here. Zero where not valid.
        acceleration_valid_before: ``(S,)`` whether all of that window was measured.
        video: what has become available since the frame before, of this one or an earlier one within the lag. A frame
            may get several, of several cameras or of a fast one.
        restart: whether frames have been left out before this one: track anew from here.
        views: by camera, then wearer, of this frame alone; None where the camera gave no frame.
        contacts: of each wearer ``(C,)``, confidences that the contact points hold until the next frame.
    """

    number: int
    time: float
    R_inertial_sensor: Array
    orientation_valid: np.ndarray
    specific_force_before: Array
    acceleration_valid_before: np.ndarray
    video: tuple[VideoFrame, ...] = ()
    restart: bool = False
    views: list[tuple[KeypointView, ...] | None] = field(default_factory=list)
    contacts: list[Array] = field(default_factory=list)


def imu_arrays(frames: Sequence[LiveFrame]) -> tuple[Array, np.ndarray, Array, np.ndarray]:
    """All sensors at consecutive frames, as in ImuFrames; accelerations of the last one are not measured yet."""
    R, seen = (
        np.array([getattr(frame, name) for frame in frames]) for name in ("R_inertial_sensor", "orientation_valid")
    )
    force, whole = np.zeros((*seen.shape, 3)), np.zeros(seen.shape, bool)
    for t, frame in enumerate(frames[1:]):
        force[t], whole[t] = frame.specific_force_before, frame.acceleration_valid_before
    return R, seen, force, whole


MEASURES = 0.3  # of the frames: a third of its packets is enough to start with a sensor


class MeasuredStretch:
    """Consecutive frames of a stream in memory; a scene of any part of them is made for the stages of the pipeline.

    Attributes:
        head: of the stream.
        frames: consecutive ones.
        columns: carrier and name of each sensor in the frames.
        time: ``(T,)`` seconds of the frames.
    """

    def __init__(self, head: Scene, frames: Sequence[LiveFrame]) -> None:
        self.head, self.frames, self.columns = head, list(frames), sensor_columns(head)
        self.time = np.array([frame.time for frame in self.frames])

    @property
    def seconds(self) -> float:
        """From its first frame to its last."""
        return float(self.time[-1] - self.time[0])

    @property
    def first(self) -> int:
        """Number of its first frame."""
        return self.frames[0].number

    @property
    def video(self) -> list[VideoFrame]:
        """Video of these frames."""
        return video_of(self.frames)

    def tail(self, frames: int) -> "MeasuredStretch":
        """The last ``frames`` of it."""
        return MeasuredStretch(self.head, self.frames[-frames:])

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

    def imu_frames(self, carrier: str, sensors: Sequence[str]) -> ImuFrames:
        """Some of a carrier's sensors at all frames."""
        columns = np.array([self.column(carrier, sensor) for sensor in sensors], dtype=int)
        R, seen, force, whole = (values[:, columns] for values in self._stacked)
        return ImuFrames(tuple(sensors), self.time, R, seen, force, whole)

    def frames_of(self, solution: SceneSolution) -> tuple[ImuFrames, ...]:
        """Of each wearer, the sensors that were solved at all frames."""
        return tuple(
            self.imu_frames(recording.subject.name, wearer.frames.sensors)
            for recording, wearer in zip(solution.scene.wearers, solution.fused.model.wearers, strict=True)
        )

    @cached_property
    def _stacked(self) -> tuple[Array, ...]:
        """All sensors at all frames: orientations, whether they were measured, specific forces, whether they were."""
        return imu_arrays(self.frames)

    def scene(self) -> Scene:
        """The head with what was measured, frames as if they were samples."""
        wearers, video = [], self.video
        for wearer in self.head.wearers:
            name = wearer.subject.name
            imus = {sensor: self._stream(name, sensor) for sensor in self.measuring(name)}
            # The declared pose was held at the start of the stream, not whenever tracking starts again.
            pose = wearer.initial_pose if self.first == 0 else "none"
            wearers.append(replace(wearer, imus=imus, initial_pose=pose))
        cameras = tuple(
            self._camera(one, [frame for frame in video if frame.camera == one.name]) for one in self.head.cameras
        )
        return replace(self.head, wearers=tuple(wearers), cameras=cameras)

    def _camera(self, camera: Camera, video: Sequence[VideoFrame]) -> Camera:
        detections = detections_of(sorted(video, key=lambda frame: frame.time), camera.keypoints)
        mount = camera.mount
        if mount is not None:
            sensor = mount.imu.name
            whole = sensor in self.measuring(camera.name)
            mount = replace(mount, imu=self._stream(camera.name, sensor)) if whole else None
        return replace(camera, detections=detections, mount=mount)

    def _stream(self, carrier: str, sensor: str) -> ImuStream:
        frames = self.imu_frames(carrier, [sensor])
        seen = frames.orientation_valid[:, 0]
        R = frames.R_inertial_sensor[seen, 0]
        force: Array = (transpose(R) @ frames.specific_force_inertial[seen, 0, :, None])[..., 0]
        return ImuStream(sensor, frames.time[seen], force, R)


def video_of(frames: Sequence[LiveFrame]) -> list[VideoFrame]:
    """Video of consecutive frames, in the order of its arrival."""
    first = frames[0].number if frames else 0
    return [video for frame in frames for video in frame.video if video.frame >= first]
