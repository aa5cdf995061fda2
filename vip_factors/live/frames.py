"""Frames of a stream, and stretches of consecutive frames as scenes for the batch stages."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vip_factors.geometry.rotations import Array, transpose
from vip_factors.problem.scene import KeypointView
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import VideoFrame, detections_of, sensor_columns
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.stages.scene_solution import SceneSolution


@dataclass
class LiveFrame:
    """One frame of a stream with ``S`` sensors, a row of :class:`~vip_factors.sensors.frames.ImuFrames`.

    Attributes:
        number: from 0, without holes.
        time: seconds from the start of the stream; evenly spaced, except at restarts.
        R_inertial_sensor: ``(S, 3, 3)``; identity where not valid.
        orientation_valid: ``(S,)`` whether the orientation was measured here.
        specific_force_before: ``(S, 3)`` m/s² of the frame *before* this one, in each sensor's inertial frame (with
            gravity): its triangular window, of half-width one frame, ends only here. Zero where not valid.
        acceleration_valid_before: ``(S,)`` whether all of that window was measured.
        video: new video frames of this or an earlier frame within the lag; several with several cameras or a fast one.
        restart: whether frames were left out before this one, so that tracking starts again.
        views: by camera, then wearer, for this frame alone; None where the camera gave no frame.
        contacts: for each wearer ``(C,)``, confidences that the contact points hold until the next frame.
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
    """Arrays of all sensors at consecutive frames, as in ImuFrames; the last accelerations are not measured yet."""
    R, orientation_valid = (
        np.array([getattr(frame, name) for frame in frames]) for name in ("R_inertial_sensor", "orientation_valid")
    )
    force, acceleration_valid = np.zeros((*orientation_valid.shape, 3)), np.zeros(orientation_valid.shape, bool)
    for t, frame in enumerate(frames[1:]):
        force[t], acceleration_valid[t] = frame.specific_force_before, frame.acceleration_valid_before
    return R, orientation_valid, force, acceleration_valid


class MeasuredStretch:
    """Consecutive frames of a stream, from which scenes for the batch stages are made.

    Attributes:
        head: the set-up of the stream.
        frames: the frames.
        columns: carrier and name of each sensor in the frames.
        time: ``(T,)`` seconds of the frames.
    """

    def __init__(self, head: Scene, frames: Sequence[LiveFrame]) -> None:
        self.head, self.frames, self.columns = head, list(frames), sensor_columns(head)
        self.time = np.array([frame.time for frame in self.frames])

    @property
    def seconds(self) -> float:
        """Duration from the first frame to the last."""
        return float(self.time[-1] - self.time[0])

    @property
    def first_number(self) -> int:
        """Number of the first frame."""
        return self.frames[0].number

    def measuring(self, carrier: str) -> list[str]:
        """Names of a carrier's sensors that measured enough orientations, overall or recently."""
        measuring_share = 0.3  # of the frames, with which a sensor is used at a start
        lately_s = 2.0  # so that a sensor that came late, or has moved, is used as well
        orientation_valid = self._stacked[1]
        lately = orientation_valid[self.time > self.time[-1] - lately_s]
        is_measuring = np.maximum(orientation_valid.mean(axis=0), lately.mean(axis=0)) > measuring_share
        return [name for (who, name), used in zip(self.columns, is_measuring, strict=True) if who == carrier and used]

    def columns_of(self, carrier: str, sensors: Sequence[str]) -> np.ndarray:
        """Columns of a carrier's sensors in the frames."""
        return np.array([self.columns.index((carrier, sensor)) for sensor in sensors], dtype=int)

    def imu_frames(self, carrier: str, sensors: Sequence[str]) -> ImuFrames:
        """Measurements of some of a carrier's sensors at all frames."""
        columns = self.columns_of(carrier, sensors)
        R, orientation_valid, force, acceleration_valid = (values[:, columns] for values in self._stacked)
        return ImuFrames(tuple(sensors), self.time, R, orientation_valid, force, acceleration_valid)

    def frames_of(self, solution: SceneSolution) -> tuple[ImuFrames, ...]:
        """Measurements of each wearer's sensors in a solution, at all frames."""
        return tuple(
            self.imu_frames(recording.subject.name, wearer.frames.sensors)
            for recording, wearer in zip(solution.scene.wearers, solution.fusion.model.wearers, strict=True)
        )

    @cached_property
    def _stacked(self) -> tuple[Array, ...]:
        """Orientations, their validity, specific forces and their validity, for all sensors at all frames."""
        return imu_arrays(self.frames)

    def scene(self) -> Scene:
        """The set-up with the measurements of the frames as samples."""
        wearers, cameras = list[Recording](), list[Camera]()
        video = sorted(video_of(self.frames), key=lambda frame: frame.time)
        for wearer in self.head.wearers:
            name = wearer.subject.name
            imus = {sensor: self._stream(name, sensor) for sensor in self.measuring(name)}
            # The declared pose was held at the start of the stream only.
            pose = wearer.initial_pose if self.first_number == 0 else "none"
            wearers.append(replace(wearer, imus=imus, initial_pose=pose))
        for camera in self.head.cameras:
            mount, name = camera.mount, camera.name
            if mount is not None:
                sensor = mount.imu.name
                is_measuring = sensor in self.measuring(name)
                mount = replace(mount, imu=self._stream(name, sensor)) if is_measuring else None
            detections = detections_of([frame for frame in video if frame.camera == name], camera.keypoints)
            cameras.append(replace(camera, detections=detections, mount=mount))
        return replace(self.head, wearers=tuple(wearers), cameras=tuple(cameras))

    def _stream(self, carrier: str, sensor: str) -> ImuStream:
        frames = self.imu_frames(carrier, [sensor])
        is_valid = frames.orientation_valid[:, 0]
        R = frames.R_inertial_sensor[is_valid, 0]
        force: Array = (transpose(R) @ frames.specific_force_inertial[is_valid, 0, :, None])[..., 0]
        return ImuStream(sensor, frames.time[is_valid], force, R)


def video_of(frames: Sequence[LiveFrame]) -> list[VideoFrame]:
    """Video of consecutive frames, in the order of its arrival."""
    first_number = frames[0].number if frames else 0
    return [video for frame in frames for video in frame.video if video.frame >= first_number]
