"""How tracking begins, and begins again: the stages of the batch pipeline over the last second or so."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.assembly.objective import WearerObjective
from vip_factors.errors import RecordingError
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.live.buffered import MeasuredStretch
from vip_factors.live.problem import LagFrame, LagProblem, lag_frame
from vip_factors.live.settings import LiveSettings
from vip_factors.live.state import FrameState, without_frames
from vip_factors.problem.scene import CameraProblem, KeypointView, SceneProblem
from vip_factors.problem.state import CameraState, SceneState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.calibration import Calibration, SensorCalibration
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.frames import coarser
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.stages.associated_cameras import AssociatedCamera, of_use, watch, watch_again
from vip_factors.stages.decode import motion_of
from vip_factors.stages.filming import start_filming
from vip_factors.stages.fusion import at_full_rate, fuse
from vip_factors.stages.inertial import Tracked, at_frames, first_calibration, inertial_tracker
from vip_factors.stages.inertial_model import kept, loosened, with_contacts
from vip_factors.stages.solver import Solver

UNKNOWN_HEADING = np.pi  # radians: of a sensor that comes late, before it has been seen to move
# Stands for the camera where there is none: nobody is seen by it.
NO_CAMERA = CameraModel(640, 480, (500.0, 500.0), (320.0, 240.0))


@dataclass(frozen=True)
class Known:
    """What an earlier start and all since has taught.

    Attributes:
        calibration: of each wearer's sensors, with standard deviations.
        p_world_pelvis: ``(W, 3)`` metres, of the wearers at the first frame of the new start, or where they were lost.
    """

    calibration: Mapping[str, Calibration]
    p_world_pelvis: Array


@dataclass(frozen=True)
class Started:
    """Where tracking begins.

    Attributes:
        problem: of any stretch from here on.
        shared: what all frames share, without frames.
        frames, states: of the stretch.
        associated: of the cameras that are of use: who is who in each of their video frames.
        spreads: by camera and wearer, scatter of the detections in OKS sigmas.
    """

    problem: LagProblem
    shared: SceneState
    frames: list[LagFrame]
    states: list[FrameState]
    associated: tuple[AssociatedCamera, ...]
    spreads: tuple[tuple[float, ...], ...]

    @property
    def filmed(self) -> bool:
        """Whether a camera sees a wearer."""
        return bool(self.associated)


def start(stretch: MeasuredStretch, settings: LiveSettings, known: Known | None = None) -> Started:
    """Begin with a stretch: coarsely by the batch stages, as they would a short scene, then frame by frame.

    Args:
        stretch: a second or so.
        settings: of all.
        known: from before, where this is not the first start.

    Raises:
        RecordingError: if a wearer has no sensor that measures.
        SolveError: if the problem is not determined.
    """
    silent = [wearer.name for wearer in stretch.setup.wearers if not stretch.alive(wearer.name)]
    if silent:
        raise RecordingError(f"no sensor of '{silent[0]}' has measured in the last {len(stretch.time)} frames")
    scene, solver = stretch.scene(), Solver(settings.solve, lambda stage, fraction: None)
    wearers = tuple(_tracked(stretch, one, settings, solver, known) for one in scene.wearers)
    filmed = (
        _filmed(stretch, scene, wearers, settings, solver) if scene.cameras and settings.fusion.use_camera else None
    )
    model, state, associated, spreads = filmed or _unfilmed(stretch, scene, wearers, settings, solver)
    if known is not None and ((associated and associated[0].camera.known_path is None) or not associated):
        state = _shifted(state, known.p_world_pelvis[0] - state.wearers[0].p_world_pelvis[0])
    freed = tuple(
        _freed(one, tracked.model, settings, own.p_world_pelvis[0])
        for one, tracked, own in zip(model.wearers, wearers, state.wearers, strict=True)
    )
    model = replace(model, wearers=freed)
    return _started(stretch, scene, model, state, associated, spreads, settings)


def _tracked(
    stretch: MeasuredStretch, recording: Recording, settings: LiveSettings, solver: Solver, known: Known | None
) -> Tracked:
    frames = coarser(stretch.frames(recording.subject.name, recording.placed), settings.coarse_factor)
    if known is None:
        return inertial_tracker(recording, frames, settings, solver)
    own = dict(known.calibration[recording.subject.name])
    if any(name not in own for name in frames.sensors):
        fresh = first_calibration(recording, frames, settings)
        for s, name in enumerate(frames.sensors):
            sigma = np.full(3, recording.placement.site(name).mounting_sigma)
            heading = float(fresh.headings[s])
            own.setdefault(name, SensorCalibration(heading, fresh.R_bone_sensor[s], UNKNOWN_HEADING, sigma))
    one = [own[name] for name in frames.sensors]
    sigma = np.array([each.heading_sigma for each in one])
    calibration = InitialCalibration(
        np.array([each.heading for each in one]), sigma, np.stack([each.R_bone_sensor for each in one])
    )
    tracked = inertial_tracker(recording, frames, settings, solver, calibration)
    mounting = np.array([np.sqrt(np.mean(each.mounting_sigma**2)) for each in one])
    return replace(tracked, model=replace(tracked.model, mounting_sigma=mounting))


Problem = tuple[SceneProblem, SceneState, tuple[AssociatedCamera, ...], tuple[tuple[float, ...], ...]]


def _filmed(
    stretch: MeasuredStretch, scene: Scene, wearers: Sequence[Tracked], settings: LiveSettings, solver: Solver
) -> Problem | None:
    """The problem in front of cameras; None if they do not show anybody whom it knows."""
    if not any(len(camera.detections) for camera in scene.cameras):
        return None
    names = [one.subject.name for one in scene.wearers]
    motions = [motion_of(one.model, one.state, name) for one, name in zip(wearers, names, strict=True)]
    associated = of_use(watch(scene, wearers, motions, settings, lambda fraction: None))
    if not associated:
        return None
    filmed = start_filming(associated, wearers, settings)
    fused = fuse(filmed, None, associated, settings, solver)
    for _ in range(settings.fusion.rounds - 1):
        associated = watch_again(associated, fused.camera_path, fused.motions(names), settings, lambda fraction: None)
        fused = fuse(filmed, fused, associated, settings, solver)
    model, state, spreads = at_full_rate(scene, filmed, fused, associated, stretch.time, settings)
    return model, state, associated, spreads


def _unfilmed(
    stretch: MeasuredStretch, scene: Scene, wearers: Sequence[Tracked], settings: LiveSettings, solver: Solver
) -> Problem:
    """The problem of the IMUs alone."""
    models, states = [], []
    for recording, tracked in zip(scene.wearers, wearers, strict=True):
        free = replace(loosened(tracked.model, settings.calibration), free_pose_mean=False)
        state = solver.solve_wearer(WearerObjective(with_contacts(free, tracked.state)), tracked.state, "start")
        fine = stretch.frames(recording.subject.name, tracked.model.frames.sensors)
        state = at_frames(state, tracked.model.frames.time, stretch.time)
        models.append(with_contacts(kept(tracked.model, fine), state))
        states.append(state)
    nothing = tuple(
        KeypointView(
            (), np.zeros((T, 0, 2)), np.ones((T, 0)), np.zeros((T, 0), bool), np.zeros((T, 0, 2)), np.zeros((T, 0))
        )
        for T in [len(stretch.time)] * len(models)
    )
    camera = CameraProblem(NO_CAMERA, moving=False, free_pose=False, settings=settings.camera)
    poses = CameraState(CameraPoses(np.eye(3)[None], np.zeros((1, 3))))
    return SceneProblem(tuple(models), camera, nothing), SceneState(tuple(states), poses), (), ()


def _freed(model: WearerProblem, tracked: WearerProblem, settings: LiveSettings, p_start: Array) -> WearerProblem:
    """A wearer's problem with calibration free and less believed that is wrong in every frame alike."""
    pose = tracked.initial_pose
    if pose is not None:
        pose = replace(pose, frames=pose.frames * settings.coarse_factor)
    freed = replace(
        model,
        free_headings=tracked.free_headings,
        free_mountings=tracked.free_mountings,
        initial_pose=pose,
        p_world_start=p_start,
    )
    return loosened(freed, settings.calibration)


def _shifted(state: SceneState, shift: Array) -> SceneState:
    camera, poses = state.camera, state.camera.poses
    poses = CameraPoses(poses.R_world_camera, poses.p_world_camera + shift)
    return SceneState(tuple(one.turned(0.0, shift) for one in state.wearers), replace(camera, poses=poses))


def _started(
    stretch: MeasuredStretch, scene: Scene, model: SceneProblem, state: SceneState,
    associated: tuple[AssociatedCamera, ...], spreads: tuple[tuple[float, ...], ...], settings: LiveSettings,
) -> Started:  # fmt: skip
    sensors = [
        np.array([stretch.column(recording.subject.name, name) for name in one.frames.sensors], dtype=int)
        for recording, one in zip(scene.wearers, model.wearers, strict=True)
    ]
    if model.camera.imu is not None:
        sensors.append(np.array([stretch.column(associated[0].camera.name, model.camera.imu.sensors[0])]))
    cameras = model.viewpoints(state.camera)
    problem = LagProblem(
        model.wearers, model.camera, cameras[0].views, model.further, sensors, model.wearers[0].frames.step, settings
    )
    poses = state.camera.poses
    shared = without_frames(state)
    frames, states = [], []
    for t, (one, after) in enumerate(zip(stretch.measurements, [*stretch.measurements[1:], None], strict=True)):
        seen: list[tuple[KeypointView, ...] | None] = [
            tuple(view.at_frames(slice(t, t + 1)) for view in camera.views) for camera in cameras
        ]
        frame = lag_frame(one, seen)
        if after is not None:
            frame.take_accelerations(after)
        frame.contacts = [own.contact_confidence[t] for own in model.wearers]
        frames.append(frame)
        at = t if len(poses) > 1 else 0
        states.append(
            FrameState(
                np.stack([own.R_parent_child[t] for own in state.wearers]),
                np.stack([own.p_world_pelvis[t] for own in state.wearers]),
                poses.R_world_camera[at],
                poses.p_world_camera[at],
            )
        )
    return Started(problem, shared, frames, states, associated, spreads)
