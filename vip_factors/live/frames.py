"""Frames of a stream: measurements, variables, and the problem or the scene of any stretch of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.poses import retract_pose
from vip_factors.geometry.rotations import Array, exp, transpose
from vip_factors.problem.layout import ROOT, Owner
from vip_factors.problem.scene import CameraProblem, KeypointView, SceneProblem
from vip_factors.problem.state import CameraPoses, SceneState
from vip_factors.problem.variables import scene_layout
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import POSE_S, ImuFrames
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.live import VideoFrame, detections_of, sensor_columns
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.settings import LiveSettings
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


@dataclass(frozen=True)
class FrameState:
    """Variables of one frame.

    Attributes:
        R_parent_child: ``(W, 24, 3, 3)`` joint rotations of the wearers.
        p_world_pelvis: ``(W, 3)`` metres.
        R_world_camera, p_world_camera: ``(M, 3, 3)`` and ``(M, 3)`` of the carried cameras, in their order.
    """

    R_parent_child: Array
    p_world_pelvis: Array
    R_world_camera: Array
    p_world_camera: Array

    @classmethod
    def of(cls, state: SceneState, t: int) -> "FrameState":
        """Frame ``t`` of a scene."""
        carried = [camera.poses for camera in state.cameras if len(camera.poses) > 1]
        return cls(
            np.stack([wearer.R_parent_child[t] for wearer in state.wearers]),
            np.stack([wearer.p_world_pelvis[t] for wearer in state.wearers]),
            np.array([poses.R_world_camera[t] for poses in carried]).reshape(-1, 3, 3),
            np.array([poses.p_world_camera[t] for poses in carried]).reshape(-1, 3),
        )


def frame_arrays(frames: Sequence[FrameState]) -> list[Array]:
    """The arrays of :class:`FrameState`, each with the frames along its first axis."""
    return [np.array([getattr(frame, entry.name) for frame in frames]) for entry in fields(FrameState)]


def stacked(frames: Sequence[FrameState], static: SceneState) -> SceneState:
    """State of a scene from a stretch of frames; shared variables, and which cameras move, as in ``static``."""
    R, p, R_camera, p_camera = frame_arrays(frames)
    wearers = tuple(
        replace(wearer, R_parent_child=R[:, number], p_world_pelvis=p[:, number])
        for number, wearer in enumerate(static.wearers)
    )
    carried = iter([CameraPoses(R_camera[:, number], p_camera[:, number]) for number in range(p_camera.shape[1])])
    cameras = tuple(camera if len(camera.poses) else replace(camera, poses=next(carried)) for camera in static.cameras)
    return replace(static, wearers=wearers, cameras=cameras)


class LagProblem:
    """Makes the problem of any stretch of frames.

    Attributes:
        wearers, cameras: problems without frames: body, sensors, priors, free variables.
        step: seconds between frames.
        sensors: for each wearer, its columns among all sensors; then the column of the IMU of each camera with one.
        feet: by camera and wearer, the feet whose ground contact is used; None where it is not.
        layout: layout of the variables.
        carried: numbers of the cameras whose poses belong to the frames.
    """

    def __init__(
        self,
        wearers: Sequence[WearerProblem],
        cameras: Sequence[CameraProblem],
        views: Sequence[Sequence[KeypointView]],
        sensors: Sequence[np.ndarray],
        step: float,
        settings: LiveSettings,
    ) -> None:
        self.wearers, self.cameras = tuple(wearers), tuple(cameras)
        self.sensors, self.step = list(sensors), step
        self._points = [[view.points for view in row] for row in views]
        self.feet = [[None if view.ground is None else view.ground.feet for view in row] for row in views]
        bare = SceneProblem(self.wearers, self.cameras, tuple(map(tuple, views)))
        self.layout = scene_layout(bare, settings.walk, settings.relinearisation.shared_deg)
        self.carried = [number for number, camera in enumerate(self.cameras) if camera.moving]

    def begin_at(self, p_world_pelvis: Array) -> None:
        """Place the wearers at ``(W, 3)`` metres in the first frame, unless a standing camera determines that."""
        gauge = bool(self.carried) or not self.has_views
        self.wearers = tuple(
            replace(wearer, p_world_start=p, is_gauge=wearer.is_gauge and gauge)
            for wearer, p in zip(self.wearers, p_world_pelvis, strict=True)
        )

    def turn_headings(self, angle: float) -> None:
        """Turn the prior headings with the world, about the vertical by an angle in radians."""
        self.wearers = tuple(replace(wearer, prior_headings=wearer.prior_headings + angle) for wearer in self.wearers)
        self.cameras = tuple(replace(camera, prior_heading=camera.prior_heading + angle) for camera in self.cameras)

    def moved_frames(self, origins: Sequence[FrameState], steps: Array) -> list[FrameState]:
        """States of frames at coordinates ``(n, w)`` from their origins."""
        R, p, R_camera, p_camera = frame_arrays(origins)
        for chain, columns in zip(self.layout.chains, self.layout.chain_columns, strict=True):
            step, number = steps[:, columns], chain.owner.number
            if chain.owner.kind is Owner.CAMERA:
                m = self.carried.index(number)
                R_camera[:, m], p_camera[:, m] = retract_pose(R_camera[:, m], p_camera[:, m], step)
            else:
                R[:, number] @= exp(step[:, :ROOT].reshape(len(step), JOINT_COUNT, 3))
                p[:, number] += step[:, ROOT:]
        return [FrameState(*values) for values in zip(R, p, R_camera, p_camera, strict=True)]

    def camera_sensors(self, camera: int) -> np.ndarray:
        """Column among all sensors of the IMU on a camera that has one."""
        carriers = [problem for problem in self.cameras[:camera] if problem.imu is not None]
        return self.sensors[len(self.wearers) + len(carriers)]

    def model(self, frames: Sequence[LiveFrame], beginning: bool) -> SceneProblem:
        """The problem of consecutive frames; ``beginning``: they are the first ones."""
        time: np.ndarray = frames[0].time + self.step * np.arange(len(frames))
        measurements = imu_arrays(frames)
        # The lag is shorter than a silence that begins a new stretch.
        begins = np.arange(len(time)) == 0 if len(time) * self.step < POSE_S else np.zeros(0, bool)

        def imu_frames(names: tuple[str, ...], columns: np.ndarray) -> ImuFrames:
            R, orientation_valid, force, acceleration_valid = (values[:, columns] for values in measurements)
            return ImuFrames(names, time, R, orientation_valid, force, acceleration_valid, self.step, begins)

        wearers, cameras, views = list[WearerProblem](), list[CameraProblem](), list[tuple[KeypointView, ...]]()
        for number, wearer in enumerate(self.wearers):
            pose = wearer.initial_pose
            wearers.append(
                replace(
                    wearer,
                    frames=imu_frames(wearer.frames.sensors, self.sensors[number]),
                    contact_confidence=np.array([frame.contacts[number] for frame in frames]),
                    initial_pose=None if pose is None else replace(pose, passed=frames[0].number),
                    is_beginning=beginning,
                )
            )
        for number, camera in enumerate(self.cameras):
            imu = None if camera.imu is None else imu_frames(camera.imu.sensors, self.camera_sensors(number))
            cameras.append(replace(camera, is_beginning=beginning, imu=imu))
        for number, (points, feet) in enumerate(zip(self._points, self.feet, strict=True)):
            seen = [frame.views[number] or (None,) * len(points) for frame in frames]
            of_wearers = zip(points, zip(*seen, strict=True), feet, strict=True)
            views.append(tuple(KeypointView.joined(*of_wearer) for of_wearer in of_wearers))
        return SceneProblem(tuple(wearers), tuple(cameras), tuple(views))

    @property
    def has_views(self) -> bool:
        """Whether any camera observes a wearer."""
        return any(len(points) for camera in self._points for points in camera)
