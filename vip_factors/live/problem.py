"""The frames of the lag: their measurements, their variables, and the least-squares problem of any stretch of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.poses import retract_pose
from vip_factors.geometry.rotations import Array, exp
from vip_factors.live.measurement import LiveFrame, imu_arrays
from vip_factors.problem.layout import ROOT, Layout, Owner
from vip_factors.problem.scene import CameraProblem, KeypointView, SceneProblem
from vip_factors.problem.state import CameraPoses, SceneState
from vip_factors.problem.variables import scene_layout
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import POSE_S, ImuFrames
from vip_factors.settings import LiveSettings


@dataclass(frozen=True)
class FrameState:
    """What belongs to one frame.

    Attributes:
        R_parent_child: ``(W, 24, 3, 3)`` of the wearers.
        p_world_pelvis: ``(W, 3)`` metres.
        R_world_camera, p_world_camera: of the carried camera, ``(3, 3)`` and ``(3,)``, else of the first one; those
            that stand still have no coordinates here.
    """

    R_parent_child: Array
    p_world_pelvis: Array
    R_world_camera: Array
    p_world_camera: Array


CAMERA_ARRAYS = ("R_world_camera", "p_world_camera")  # of a frame


def moved_frames(layout: Layout, origins: Sequence[FrameState], steps: Array) -> list[FrameState]:
    """Each of the frames at coordinates ``(n, w)`` from where these are zero."""
    R, p = (np.array([getattr(one, name) for one in origins]) for name in ("R_parent_child", "p_world_pelvis"))
    camera = [(one.R_world_camera, one.p_world_camera) for one in origins]
    for chain, columns in zip(layout.chains, layout.chain_columns, strict=True):
        own = steps[:, columns]
        if chain.owner.kind is Owner.CAMERA:
            R_camera, p_camera = (np.array(one) for one in zip(*camera, strict=True))
            camera = list(zip(*retract_pose(R_camera, p_camera, own), strict=True))
        else:
            at = chain.owner.number
            R[:, at] @= exp(own[:, :ROOT].reshape(len(own), JOINT_COUNT, 3))
            p[:, at] += own[:, ROOT:]
    return [FrameState(R[t], p[t], *camera[t]) for t in range(len(origins))]


def stacked(frames: Sequence[FrameState], static: SceneState) -> SceneState:
    """A stretch of frames as the state of a scene; what they share, and which camera moves, as in ``static``."""
    R, p = (np.array([getattr(one, name) for one in frames]) for name in ("R_parent_child", "p_world_pelvis"))
    wearers = tuple(
        replace(one, R_parent_child=R[:, at], p_world_pelvis=p[:, at]) for at, one in enumerate(static.wearers)
    )
    carried = CameraPoses(*(np.array([getattr(frame, name) for frame in frames]) for name in CAMERA_ARRAYS))
    cameras = tuple(one if len(one.poses) else replace(one, poses=carried) for one in static.cameras)
    return replace(static, wearers=wearers, cameras=cameras)


def without_frames(state: SceneState) -> SceneState:
    """What all frames share, as a scene without any; the pose of a camera that stands still is among it."""
    return state.window(slice(0, 0))


class LagProblem:
    """Makes the problem of any stretch of frames.

    Attributes:
        wearers, cameras: the problems without frames: body, sensors, priors, what is free. At most one camera moves.
        step: seconds between frames.
        sensors: of each wearer, its columns among all carriers' sensors; then that of the IMU of each camera with one.
        feet: by camera and wearer, those whose contact with the ground is used; None where it is not.
        layout: of the variables that move.
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
        self._points = [[view.points for view in own] for own in views]
        self.feet = [[None if view.ground is None else view.ground.feet for view in own] for own in views]
        bare = SceneProblem(self.wearers, self.cameras, tuple(map(tuple, views)))
        self.layout = scene_layout(bare, settings.walk, settings.relinearisation.shared_deg)

    def begin_at(self, p_world_pelvis: Array) -> None:
        """Take the wearers to be at ``(W, 3)`` metres in the first frame, where no standing camera tells."""
        gauge = self.moving or not self.has_views
        self.wearers = tuple(
            replace(wearer, p_world_start=p, is_gauge=wearer.is_gauge and gauge)
            for wearer, p in zip(self.wearers, p_world_pelvis, strict=True)
        )

    def turn_headings(self, angle: float) -> None:
        """The same in a world turned about the vertical by an angle in radians."""
        self.wearers = tuple(replace(one, prior_headings=one.prior_headings + angle) for one in self.wearers)
        self.cameras = tuple(replace(one, prior_heading=one.prior_heading + angle) for one in self.cameras)

    @property
    def carried(self) -> int | None:
        """Number of the camera whose pose belongs to the frame; None if all stand still."""
        return next((number for number, camera in enumerate(self.cameras) if camera.moving), None)

    @property
    def moving(self) -> bool:
        """Whether a camera's pose belongs to the frame."""
        return self.carried is not None

    def camera_sensors(self, camera: int) -> np.ndarray:
        """Column of the IMU on a camera that has one, among all carriers' sensors."""
        return self.sensors[len(self.wearers) + sum(one.imu is not None for one in self.cameras[:camera])]

    def model(self, frames: Sequence[LiveFrame], beginning: bool) -> SceneProblem:
        """The problem of consecutive frames; ``beginning``: they are the first ones."""
        time = frames[0].time + self.step * np.arange(len(frames))
        parts = imu_arrays(frames)
        wearers = []
        for number, wearer in enumerate(self.wearers):
            contacts = np.array([frame.contacts[number] for frame in frames])
            pose = wearer.initial_pose
            if pose is not None:
                pose = replace(pose, passed=frames[0].number)
            wearers.append(
                replace(
                    wearer,
                    frames=_imu_frames(wearer.frames.sensors, time, parts, self.sensors[number], self.step),
                    contact_confidence=contacts,
                    initial_pose=pose,
                    is_beginning=beginning,
                )
            )
        cameras = list[CameraProblem]()
        for number, camera in enumerate(self.cameras):
            imu = camera.imu
            if imu is not None:
                imu = _imu_frames(imu.sensors, time, parts, self.camera_sensors(number), self.step)
            cameras.append(replace(camera, is_beginning=beginning, imu=imu))
        views = tuple(self._views(frames, number) for number in range(len(self._points)))
        return SceneProblem(tuple(wearers), tuple(cameras), views)

    @property
    def has_views(self) -> bool:
        """Whether there is a camera that sees anybody."""
        return any(len(points) for camera in self._points for points in camera)

    def _views(self, frames: Sequence[LiveFrame], camera: int) -> tuple[KeypointView, ...]:
        views = [frame.views[camera] for frame in frames]
        return tuple(
            KeypointView.joined(points, [None if one is None else one[wearer] for one in views], feet)
            for wearer, (points, feet) in enumerate(zip(self._points[camera], self.feet[camera], strict=True))
        )


def _imu_frames(
    names: tuple[str, ...], time: np.ndarray, parts: tuple[Array, ...], columns: np.ndarray, step: float
) -> ImuFrames:
    R, seen, force, whole = (part[:, columns] for part in parts)
    begins = np.arange(len(time)) == 0 if len(time) * step < POSE_S else np.zeros(0, bool)  # too short for a silence
    return ImuFrames(names, time, R, seen, force, whole, step, begins)
