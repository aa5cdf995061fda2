"""Start and restart of tracking: the stages of the batch pipeline over the last second."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES, Skeleton
from vip_factors.display import silent
from vip_factors.errors import RecordingError
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, angle_between, wrap_angle
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.initialise.camera import robust_mean_angle
from vip_factors.initialise.start_search import Starts
from vip_factors.live.frames import FrameState, LagProblem, LiveFrame, MeasuredStretch, video_of
from vip_factors.problem.scene import KeypointView
from vip_factors.problem.state import SceneState, WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.calibration import Calibration, SensorCalibration
from vip_factors.sensors.frames import ImuFrames, coarser
from vip_factors.sensors.live import VideoFrame
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera
from vip_factors.settings import LiveSettings
from vip_factors.stages.association import AssociatedCamera
from vip_factors.stages.fusion import FusionSolution
from vip_factors.stages.fusion_start import FusionStart
from vip_factors.stages.inertial import InertialSolution, find_start, first_calibration, inertial_tracker
from vip_factors.stages.inertial_model import with_contacts
from vip_factors.stages.reporting import precision_findings
from vip_factors.stages.scene_solution import SceneSolution, solve_from, start_before_cameras
from vip_factors.stages.solver import Solver
from vip_factors.terms.registry import unfilmed_problem

UNKNOWN_HEADING = np.pi  # radians, prior sigma of a sensor without a calibration
# Largest difference between a start from nothing and the previous calibration, from which the start then continues;
# smaller than between any two ways to strap a sensor on.
ALIKE = np.deg2rad(20.0)


@dataclass(frozen=True)
class EarlierCalibration:
    """Calibration and bodies from tracking before a pause.

    Attributes:
        calibration: of each wearer's sensors, with standard deviations.
        p_world_pelvis: ``(W, 3)`` metres, at the first frame of the new start, or where tracking was lost.
        bodies: of wearers whose lengths were estimated.
    """

    calibration: Mapping[str, Calibration]
    p_world_pelvis: Array
    bodies: Mapping[str, Skeleton] = field(default_factory=dict)

    def embodied(self, wearer: Recording) -> Recording:
        """A wearer with the estimated body."""
        skeleton = self.bodies.get(wearer.subject.name)
        return wearer if skeleton is None else replace(wearer, subject=replace(wearer.subject, skeleton=skeleton))


def solve_stretch(
    stretch: MeasuredStretch,
    settings: LiveSettings,
    previous_calibration: EarlierCalibration | None = None,
    previous: "TrackingStart | None" = None,
) -> SceneSolution:
    """Solve a stretch by the batch stages: inertial trackers, association and fusion.

    Args:
        stretch: the measurements.
        settings: settings of a stream.
        previous_calibration: calibration from before a pause.
        previous: solution of a shorter part of the same data; used if a start from nothing is similar.

    Raises:
        RecordingError: if the sensors measure too little.
        SolveError: if the problem is not determined.
    """
    scene, solver = stretch.scene(), Solver(settings.solve, silent)
    if previous_calibration is not None:
        scene = replace(scene, wearers=tuple(previous_calibration.embodied(wearer) for wearer in scene.wearers))
    recordings = list[tuple[Recording, ImuFrames]]()
    for wearer in scene.wearers:
        frames = stretch.imu_frames(wearer.subject.name, wearer.placed)
        recordings.append((wearer, coarser(frames, settings.coarse_factor)))
    is_calibrated = False
    if previous_calibration is not None:
        wearers = tuple(_inertial_after(*pair, settings, solver, previous_calibration) for pair in recordings)
    else:
        starts = [find_start(*pair, settings, solver.progress_of("start")) for pair in recordings]
        calibrations = list[InitialCalibration | None]([None] * len(recordings))
        if previous is not None:
            solved = zip(previous.problem.wearers, previous.shared.wearers, strict=True)
            pairs = zip(starts, recordings, solved, strict=True)
            calibrations = [_as_before(start, imu_frames, *wearer) for (start, _), (_, imu_frames), wearer in pairs]
        is_calibrated = None not in calibrations
        every = zip(recordings, starts, calibrations, strict=True)
        wearers = tuple(
            _inertial(*pair, settings, solver, start, calibration if is_calibrated else None)
            for pair, start, calibration in every
        )
    if settings.fusion.use_camera and any(len(camera.detections) for camera in scene.cameras):
        start = start_before_cameras(scene, wearers, settings, solver, is_calibrated)
        if isinstance(start, FusionStart):
            return solve_from(start, scene, settings, solver).on_floor(settings)
    models = [with_contacts(replace(solution.model, free_pose_mean=False), solution.state) for solution in wearers]
    starting = zip(models, wearers, strict=True)
    states = [solver.solve_wearer(model, solution.state, "start") for model, solution in starting]
    fused = FusionSolution(unfilmed_problem(models), SceneState.unfilmed(states), ())
    return SceneSolution(scene, wearers, fused)


def _as_before(
    start: InitialCalibration, frames: ImuFrames, previous: WearerProblem, state: WearerState
) -> InitialCalibration | None:
    """The previous calibration; None if the start from nothing differs, or the sensors do."""
    if frames.sensors != previous.frames.sensors:
        return None
    headings = state.headings + robust_mean_angle(wrap_angle(start.headings - state.headings))
    turned = angle_between(start.R_bone_sensor, state.R_bone_sensor)
    if max(np.abs(wrap_angle(start.headings - headings)).max(), turned.max()) > ALIKE:
        return None
    return replace(start, headings=headings, R_bone_sensor=state.R_bone_sensor)


def _inertial(
    recording: Recording,
    frames: ImuFrames,
    settings: LiveSettings,
    solver: Solver,
    search: tuple[InitialCalibration, Starts | None],
    calibration: InitialCalibration | None,
) -> InertialSolution:
    """The tracker from a start, or from a previous ``calibration`` with the start as its prior."""
    start, starts = search
    tracked = replace(inertial_tracker(recording, frames, settings, solver, calibration or start), starts=starts)
    expected = replace(tracked.model, prior_headings=start.headings, prior_R_bone_sensor=start.R_bone_sensor)
    return tracked if calibration is None else replace(tracked, model=expected)


def _inertial_after(
    recording: Recording,
    frames: ImuFrames,
    settings: LiveSettings,
    solver: Solver,
    previous_calibration: EarlierCalibration,
) -> InertialSolution:
    """The tracker with the calibration from before a pause."""
    calibration_of = dict(previous_calibration.calibration[recording.subject.name])
    if any(name not in calibration_of for name in frames.sensors):
        fresh = first_calibration(recording, frames, settings)
        for s, name in enumerate(frames.sensors):
            sigma = np.full(3, recording.placement.site(name).mounting_sigma)
            heading = float(fresh.headings[s])
            calibration_of.setdefault(name, SensorCalibration(heading, fresh.R_bone_sensor[s], UNKNOWN_HEADING, sigma))
    sensors = [calibration_of[name] for name in frames.sensors]
    sigma = np.array([sensor.heading_sigma for sensor in sensors])
    calibration = InitialCalibration(
        np.array([sensor.heading for sensor in sensors]), sigma, np.stack([sensor.R_bone_sensor for sensor in sensors])
    )
    tracked = inertial_tracker(recording, frames, settings, solver, calibration)
    mounting = np.array([np.sqrt(np.mean(sensor.mounting_sigma**2)) for sensor in sensors])
    return replace(tracked, model=replace(tracked.model, mounting_sigma=mounting))


@dataclass(frozen=True)
class TrackingStart:
    """Problem, state and measurements with which tracking begins.

    Attributes:
        problem: problem of any stretch from here on.
        shared: state of the shared variables, without frames.
        frames, states: measurements and states of the first frames.
        associated: cameras that are used, with the wearers in each of their video frames.
        spreads: by camera and wearer, scatter of the detections in OKS sigmas.
        information: ``(s, s)`` about ``shared``, from frames that are not included; None without any.
        seconds: duration of the data from which ``shared`` was estimated.
        video: video of the frames.
        findings: ambiguities that the data does not settle.
        in_place: whether exchanged sensors were ruled out.
        tracked_state: state of the last frame as tracked meanwhile; None at a first start.
        moved: columns of sensors that have moved since.
    """

    problem: LagProblem
    shared: SceneState
    frames: list[LiveFrame]
    states: list[FrameState]
    associated: tuple[AssociatedCamera, ...]
    spreads: tuple[tuple[float, ...], ...]
    information: Array | None = None
    seconds: float = 0.0
    video: tuple[VideoFrame, ...] = ()
    findings: tuple[Finding, ...] = ()
    in_place: bool = False
    tracked_state: FrameState | None = None
    moved: tuple[int, ...] = ()

    @property
    def has_views(self) -> bool:
        """Whether a camera observes a wearer."""
        return bool(self.associated)

    def with_lens(self, camera: Camera) -> Camera:
        """A camera of the stream with the estimated lens, if the camera is used."""
        for associated, problem, state in zip(self.associated, self.problem.cameras, self.shared.cameras, strict=True):
            if associated.camera.name == camera.name:
                return replace(camera, model=problem.model.zoomed(state.zoom), focal_sigma=0.0)
        return camera


def start_tracking(
    stretch: MeasuredStretch, settings: LiveSettings, previous_calibration: EarlierCalibration | None = None
) -> TrackingStart:
    """Start from a stretch: coarsely by the batch stages, then at the full frame rate.

    Args:
        stretch: about a second of measurements.
        settings: settings of a stream.
        previous_calibration: calibration from before, if this is not the first start.

    Raises:
        RecordingError: if a wearer has no sensor that measures.
        SolveError: if the problem is not determined.
    """
    silent = [wearer.subject.name for wearer in stretch.head.wearers if not stretch.measuring(wearer.subject.name)]
    if silent:
        raise RecordingError(f"no sensor of '{silent[0]}' has measured in the last {len(stretch.time)} frames")
    coarse = solve_stretch(stretch, settings, previous_calibration)
    fine = coarse.problem_on(stretch.frames_of(coarse), settings)
    state = fine.state
    if previous_calibration is not None and not coarse.is_world_known:
        shift = previous_calibration.p_world_pelvis[0] - state.wearers[0].p_world_pelvis[0]
        state = _shifted(state, shift * [1, 1, 0] if coarse.associated and settings.floor == "found" else shift)
    freed = tuple(
        _freed(model, tracked.model, settings, wearer.p_world_pelvis[0])
        for model, tracked, wearer in zip(fine.model.wearers, coarse.wearers, state.wearers, strict=True)
    )
    fine = replace(fine, model=replace(fine.model, wearers=freed), state=state)
    begun = tracking_start(stretch, coarse, fine, settings)
    return replace(begun, findings=tuple(unsettled_starts(coarse)))


def unsettled_starts(coarse: SceneSolution) -> Iterator[Finding]:
    """Findings about set-ups, starts and floors that the data does not determine."""
    yield from coarse.floor_findings
    yield from coarse.start_findings()
    is_filmed = bool(coarse.scene.cameras)
    for recording, wearer in zip(coarse.scene.wearers, coarse.wearers, strict=True):
        bones = {JOINT_NAMES[sensor.bone] for sensor in wearer.model.sensors}
        yield from precision_findings(recording.subject.name, bones, len(wearer.model.sensors), is_filmed)


def _freed(model: WearerProblem, inertial: WearerProblem, settings: LiveSettings, p_start: Array) -> WearerProblem:
    """A wearer's problem with the calibration free."""
    pose = inertial.initial_pose
    if pose is not None:
        pose = replace(pose, frames=pose.frames * settings.coarse_factor)
    return replace(
        model,
        free_headings=inertial.free_headings,
        free_mountings=inertial.free_mountings,
        initial_pose=pose,
        p_world_start=p_start,
    )


def _shifted(state: SceneState, shift: Array) -> SceneState:
    cameras = tuple(replace(camera, poses=camera.poses.shifted(shift)) for camera in state.cameras)
    return SceneState(tuple(wearer.turned(0.0, shift) for wearer in state.wearers), cameras, state.detector)


def tracking_start(
    stretch: MeasuredStretch, coarse: SceneSolution, fine: FusionSolution, settings: LiveSettings
) -> TrackingStart:
    """Start from a solution ``fine`` on all frames of a stretch."""
    model, state = fine.model, fine.state
    frames, states = list[LiveFrame](), list[FrameState]()
    for t, frame in enumerate(stretch.frames):
        views: list[tuple[KeypointView, ...] | None] = [
            tuple(view.at_frames(slice(t, t + 1)) for view in of_camera) for of_camera in model.views
        ]
        frames.append(replace(frame, views=views, contacts=[wearer.contact_confidence[t] for wearer in model.wearers]))
        states.append(FrameState.of(state, t))
    sensors = [
        stretch.columns_of(recording.subject.name, wearer.frames.sensors)
        for recording, wearer in zip(coarse.scene.wearers, model.wearers, strict=True)
    ]
    sensors += [
        stretch.columns_of(associated.camera.name, camera.imu.sensors)
        for associated, camera in zip(coarse.associated, model.cameras, strict=True)
        if camera.imu is not None
    ]
    step, shared = model.wearers[0].frames.step, state.window(slice(0, 0))
    problem = LagProblem(model.wearers, model.cameras, model.views, sensors, step, settings)
    video = tuple(video_of(stretch.frames))
    return TrackingStart(problem, shared, frames, states, coarse.associated, fine.spreads, video=video)
