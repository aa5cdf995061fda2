"""Video-inertial fusion (thesis 4.3.3): wearers, camera, headings and mountings jointly; coarsely, then finely."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.associate.associate import Association
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.motion import Motion
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.geometry.rotations import Array
from vip_factors.graph.decode import motion_of
from vip_factors.graph.following import FollowingObjective
from vip_factors.graph.model import InertialModel
from vip_factors.graph.reprojection_batch import reprojections
from vip_factors.graph.scene_batch import SceneObjective
from vip_factors.graph.scene_model import CameraProblem, KeypointView, SceneModel
from vip_factors.graph.scene_state import CameraState, SceneState
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.stages.filming import Filmed, camera_problem
from vip_factors.stages.inertial import at_frames
from vip_factors.stages.inertial_model import kept, loosened, with_contacts
from vip_factors.stages.solver import Solver
from vip_factors.stages.views import image_scale, keypoint_view, scatter

SETTLED = 1.5  # a detector believed less than this much too rough costs less than another solve


@dataclass(frozen=True)
class Fused:
    """A scene's problem and its solution.

    ``spreads`` is what was taken for the scatter of each wearer's detections, in OKS sigmas.
    """

    model: SceneModel
    state: SceneState
    spreads: tuple[float, ...]

    def measured_spreads(self) -> tuple[float, ...]:
        """How each wearer's detections scatter about the solution, in OKS sigmas."""
        settings = self.model.camera.settings.reprojection
        if not settings.adaptive:
            return self.spreads
        poses, spreads = self.state.camera.at_frames(slice(0, self.model.frames)), []
        for number, (view, spread) in enumerate(zip(self.model.views, self.spreads, strict=True)):
            wearer, own = self.model.wearers[number], self.state.wearers[number]
            body = forward_kinematics(wearer.skeleton, own.R_parent_child, own.p_world_pelvis)
            residual, _ = reprojections(view, self.model.camera, poses, self.state.camera.clock, body)
            spreads.append(scatter(residual, view, spread, settings))
        return tuple(spreads)

    def is_settled(self) -> bool:
        """Whether the detections scatter about the solution as it was made to believe."""
        ratios = np.divide(self.spreads, np.maximum(self.measured_spreads(), 1e-9))
        return bool(np.all(ratios < SETTLED))

    def motions(self, names: Sequence[str]) -> list[Motion]:
        """The wearers' motions, in one world."""
        return [
            motion_of(model, state, name)
            for model, state, name in zip(self.model.wearers, self.state.wearers, names, strict=True)
        ]

    @property
    def camera_path(self) -> CameraPath:
        """The camera's path; a single instant if it stands still."""
        time, poses = self.model.wearers[0].frames.time, self.state.camera.poses
        return CameraPath(time[: len(poses)], poses.R_world_camera, poses.p_world_camera)


def fuse(
    filmed: Filmed, before: Fused | None, association: Association, detections: Detections, settings: Settings,
    solver: Solver,
) -> Fused:  # fmt: skip
    """Everything free, on the coarse frames; ``before`` is the round before this one."""
    start = before.state if before else filmed.state
    spreads = before.measured_spreads() if before else (settings.camera.reprojection.spread,) * len(start.wearers)
    wearers = tuple(
        with_contacts(_with_plain_prior(one.model, settings), state, path_known=before is not None)
        for one, state in zip(filmed.wearers, start.wearers, strict=True)
    )
    views = _views(wearers, filmed.camera, start, association, detections, spreads)
    model = SceneModel(wearers, filmed.camera, views)
    return Fused(model, solver.solve(SceneObjective(model), start, "video-inertial fusion"), spreads)


def _with_plain_prior(model: InertialModel, settings: Settings) -> InertialModel:
    """The loosened model with the prior's own mean: the camera shows how the wearer stands, a mean need not."""
    return replace(loosened(model, settings.calibration), free_pose_mean=False)


def fuse_finely(
    scene: Scene, filmed: Filmed, coarse: Fused, association: Association, detections: Detections, time: Array,
    settings: Settings, solver: Solver,
) -> Fused:  # fmt: skip
    """At the full frame rate, with headings, mountings and mean poses kept.

    The coarse solution has settled how camera and wearers lie to each other: what is left is fast and small. A moving
    camera follows the wearers as they are, and then each wearer is refined in front of it, by itself.
    """
    assert scene.camera is not None
    before = coarse.model.wearers[0].frames.time
    wearers, states = [], []
    for recording, tracked, own in zip(scene.wearers, filmed.wearers, coarse.state.wearers, strict=True):
        streams = [recording.imus[name] for name in tracked.model.frames.sensors]
        states.append(at_frames(own, before, time))
        wearers.append(with_contacts(kept(tracked.model, resample_streams(streams, time)), states[-1], True))
    camera = replace(camera_problem(scene.camera, time, settings), free_clock=False)
    camera = replace(camera, prior_heading=coarse.state.camera.heading)
    state, spreads = SceneState(tuple(states), _camera_at(coarse, time)), coarse.measured_spreads()
    model = SceneModel(tuple(wearers), camera, _views(wearers, camera, state, association, detections, spreads))
    if camera.moving and camera.free_pose:
        found = solver.solve(FollowingObjective(model, state.wearers), state.camera, "full rate, camera")
        state = replace(state, camera=found)
    for number, name in enumerate(recording.subject.name for recording in scene.wearers):
        alone = replace(model, wearers=(wearers[number],), views=(model.views[number],), camera=_held(camera))
        start = SceneState((state.wearers[number],), state.camera)
        refined = solver.solve(SceneObjective(alone), start, f"full rate, {name}")
        states[number] = refined.wearers[0]
    return Fused(model, SceneState(tuple(states), state.camera), spreads)


def _held(camera: CameraProblem) -> CameraProblem:
    """The camera as it is: nothing of it moves, and its sensor has nothing more to say."""
    return replace(camera, free_pose=False, imu=None, free_clock=False)


def _camera_at(coarse: Fused, time: Array) -> CameraState:
    camera = coarse.state.camera
    if len(camera.poses) == 1:
        return camera
    path = coarse.camera_path.at(time)
    return replace(camera, poses=CameraPoses(path.R_world_camera, path.p_world_camera))


def _views(
    wearers: Sequence[InertialModel], camera: CameraProblem, state: SceneState, association: Association,
    detections: Detections, spreads: Sequence[float],
) -> tuple[KeypointView, ...]:  # fmt: skip
    return tuple(
        keypoint_view(
            detections,
            association.wearer == number,
            wearer.skeleton,
            wearer.frames.time,
            image_scale(wearer.skeleton, state, number, camera.model),
            spreads[number],
            camera.settings.reprojection,
        )
        for number, wearer in enumerate(wearers)
    )


def gravity_in_camera(scene: Scene, time: Array) -> Array | None:
    """Which way is down in the camera's frame at the video's instants ``(F, 3)``, by its IMU; None without one."""
    mount = scene.camera.mount if scene.camera is not None else None
    if mount is None or mount.imu.R_inertial_sensor is None:
        return None
    nearest = np.clip(np.searchsorted(mount.imu.time, time), 0, len(mount.imu) - 1)
    return -mount.imu.R_inertial_sensor[nearest, 2] @ mount.R_camera_imu.T
