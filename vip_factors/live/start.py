"""How tracking begins, and begins again: the stages of the batch pipeline over the last second or so."""

from collections.abc import Iterator, Mapping, Sequence
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
from vip_factors.live.measurement import LiveFrame, MeasuredStretch
from vip_factors.live.problem import FrameState, LagProblem, without_frames
from vip_factors.problem.scene import KeypointView, SceneProblem
from vip_factors.problem.state import CameraState, SceneState, WearerState
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

UNKNOWN_HEADING = np.pi  # radians: of a sensor that comes late, before it has been seen to move
# By which a start from nothing may differ from the calibration found before that is gone on from: nearer than to any
# other way to strap a sensor on. A wrong one is got out of by the next start that is right.
# Of two wearers 45° cost one of them 2 mm over the first half of a recording.
ALIKE = np.deg2rad(20.0)


@dataclass(frozen=True)
class EarlierCalibration:
    """What an earlier start and all since has taught.

    Attributes:
        calibration: of each wearer's sensors, with standard deviations.
        p_world_pelvis: ``(W, 3)`` metres, of the wearers at the first frame of the new start, or where they were lost.
        bodies: of wearers whose lengths have been found.
    """

    calibration: Mapping[str, Calibration]
    p_world_pelvis: Array
    bodies: Mapping[str, Skeleton] = field(default_factory=dict)

    def embodied(self, wearer: Recording) -> Recording:
        """A wearer with the body that was found."""
        found = self.bodies.get(wearer.subject.name)
        return wearer if found is None else replace(wearer, subject=replace(wearer.subject, skeleton=found))


def solve_stretch(
    stretch: MeasuredStretch, settings: LiveSettings, earlier: EarlierCalibration | None = None,
    before: "TrackingStart | None" = None,
) -> SceneSolution:  # fmt: skip
    """Inertial trackers, association and fusion of a stretch.

    Args:
        stretch: what was measured.
        settings: of all.
        earlier: from before a pause.
        before: found from less of the same; gone on from if a start from nothing is like it.

    Raises:
        RecordingError: if the sensors say too little.
        SolveError: if the problem is not determined.
    """
    scene, solver = stretch.scene(), Solver(settings.solve, silent)
    if earlier is not None:
        scene = replace(scene, wearers=tuple(earlier.embodied(one) for one in scene.wearers))
    each = [
        (one, coarser(stretch.imu_frames(one.subject.name, one.placed), settings.coarse_factor))
        for one in scene.wearers
    ]
    is_calibrated = False
    if earlier is not None:
        wearers = tuple(_inertial_after(*one, settings, solver, earlier) for one in each)
    else:
        starts = [find_start(*one, settings, solver.progress_of("start")) for one in each]
        found = () if before is None else zip(before.problem.wearers, before.shared.wearers, strict=True)
        known = [_as_before(start, own, *one) for (start, _), (_, own), one in zip(starts, each, found, strict=False)]
        is_calibrated = bool(known) and all(one is not None for one in known)
        every = zip(each, starts, known if is_calibrated else [None] * len(each), strict=True)
        wearers = tuple(_inertial(*one, settings, solver, start, kept) for one, start, kept in every)
    if settings.fusion.use_camera and any(len(camera.detections) for camera in scene.cameras):
        start = start_before_cameras(scene, wearers, settings, solver, is_calibrated)
        if isinstance(start, FusionStart):
            return solve_from(start, scene, settings, solver).on_floor(settings)
    models = [with_contacts(replace(one.model, free_pose_mean=False), one.state) for one in wearers]
    states = [solver.solve_wearer(model, one.state, "start") for model, one in zip(models, wearers, strict=True)]
    fused = FusionSolution(unfilmed_problem(models), SceneState.unfilmed(states), ())
    return SceneSolution(scene, wearers, fused)


def _as_before(
    start: InitialCalibration, frames: ImuFrames, found: WearerProblem, state: WearerState
) -> InitialCalibration | None:
    """The calibration found before; None if the start from nothing is another, or it is of other sensors."""
    if frames.sensors != found.frames.sensors:
        return None
    headings = state.headings + robust_mean_angle(wrap_angle(start.headings - state.headings))
    turned = angle_between(start.R_bone_sensor, state.R_bone_sensor)
    if max(np.abs(wrap_angle(start.headings - headings)).max(), turned.max()) > ALIKE:
        return None
    return replace(start, headings=headings, R_bone_sensor=state.R_bone_sensor)


def _inertial(
    recording: Recording, frames: ImuFrames, settings: LiveSettings, solver: Solver,
    found: tuple[InitialCalibration, Starts | None], known: InitialCalibration | None,
) -> InertialSolution:  # fmt: skip
    """The tracker from a start; or with a calibration ``known`` before, and the start for what is expected of it."""
    start, starts = found
    tracked = replace(inertial_tracker(recording, frames, settings, solver, known or start), starts=starts)
    expected = replace(tracked.model, prior_headings=start.headings, prior_R_bone_sensor=start.R_bone_sensor)
    return tracked if known is None else replace(tracked, model=expected)


def _inertial_after(
    recording: Recording, frames: ImuFrames, settings: LiveSettings, solver: Solver, earlier: EarlierCalibration
) -> InertialSolution:
    """The tracker with the calibration of before a pause."""
    own = dict(earlier.calibration[recording.subject.name])
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


@dataclass(frozen=True)
class TrackingStart:
    """Where tracking begins.

    Attributes:
        problem: of any stretch from here on.
        shared: what all frames share, without frames.
        frames, states: of the stretch.
        associated: of the cameras that are of use: who is who in each of their video frames.
        spreads: by camera and wearer, scatter of the detections in OKS sigmas.
        information: ``(s, s)`` about ``shared``, from frames that are not here; None without any.
        seconds: of data that what frames share was found from.
        video: of the frames.
        findings: about a start that the stretch does not settle.
        in_place: whether it was shown that no sensors are in each other's places.
        tracked: the last of the frames, as it was tracked meanwhile; None where nothing was.
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
    tracked: FrameState | None = None
    moved: tuple[int, ...] = ()

    @property
    def has_views(self) -> bool:
        """Whether a camera sees a wearer."""
        return bool(self.associated)

    def with_lens(self, camera: Camera) -> Camera:
        """A camera of the stream with the lens that was estimated, if it is of use."""
        for each, problem, state in zip(self.associated, self.problem.cameras, self.shared.cameras, strict=True):
            if each.camera.name == camera.name:
                return replace(camera, model=problem.model.zoomed(state.zoom), focal_sigma=0.0)
        return camera


def start_tracking(
    stretch: MeasuredStretch, settings: LiveSettings, earlier: EarlierCalibration | None = None
) -> TrackingStart:
    """Begin with a stretch: coarsely by the batch stages, as they would a short scene, then frame by frame.

    Args:
        stretch: a second or so.
        settings: of all.
        earlier: from before, where this is not the first start.

    Raises:
        RecordingError: if a wearer has no sensor that measures.
        SolveError: if the problem is not determined.
    """
    silent = [wearer.subject.name for wearer in stretch.head.wearers if not stretch.measuring(wearer.subject.name)]
    if silent:
        raise RecordingError(f"no sensor of '{silent[0]}' has measured in the last {len(stretch.time)} frames")
    coarse = solve_stretch(stretch, settings, earlier)
    fine = coarse.problem_on(stretch.frames_of(coarse), settings)
    state = fine.state
    if earlier is not None and not coarse.is_world_known:
        shift = earlier.p_world_pelvis[0] - state.wearers[0].p_world_pelvis[0]
        state = _shifted(state, shift * [1, 1, 0] if coarse.associated and settings.floor == "found" else shift)
    freed = tuple(
        _freed(one, tracked.model, settings, own.p_world_pelvis[0])
        for one, tracked, own in zip(fine.model.wearers, coarse.wearers, state.wearers, strict=True)
    )
    fine = replace(fine, model=replace(fine.model, wearers=freed), state=state)
    begun = tracking_start(stretch, coarse, fine, settings)
    return replace(begun, findings=tuple(unsettled_starts(coarse)))


def unsettled_starts(coarse: SceneSolution) -> Iterator[Finding]:
    """About set-ups, starts and floors that the data does not settle."""
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
    return SceneState(tuple(one.turned(0.0, shift) for one in state.wearers), cameras, state.detector)


def tracking_start(
    stretch: MeasuredStretch, coarse: SceneSolution, fine: FusionSolution, settings: LiveSettings
) -> TrackingStart:
    """The problem on all frames of a stretch, ``fine``, frame by frame."""
    model, state, spreads = fine.model, fine.state, fine.spreads
    frames, carried = _lag_frames(stretch, model), [camera for camera in state.cameras if len(camera.poses) > 1]
    states = [_frame_state(state, [*carried, *state.cameras][:1], t) for t in range(len(frames))]
    problem, video = _lag_problem(stretch, coarse, model, settings), tuple(stretch.video)
    return TrackingStart(problem, without_frames(state), frames, states, coarse.associated, spreads, video=video)


def _lag_problem(
    stretch: MeasuredStretch, coarse: SceneSolution, model: SceneProblem, settings: LiveSettings
) -> LagProblem:
    sensors = [
        np.array([stretch.column(recording.subject.name, name) for name in one.frames.sensors], dtype=int)
        for recording, one in zip(coarse.scene.wearers, model.wearers, strict=True)
    ]
    sensors += [
        np.array([stretch.column(each.camera.name, camera.imu.sensors[0])])
        for each, camera in zip(coarse.associated, model.cameras, strict=True)
        if camera.imu is not None
    ]
    return LagProblem(model.wearers, model.cameras, model.views, sensors, model.wearers[0].frames.step, settings)


def _lag_frames(stretch: MeasuredStretch, model: SceneProblem) -> list[LiveFrame]:
    frames = list[LiveFrame]()
    for t, frame in enumerate(stretch.frames):
        views: list[tuple[KeypointView, ...] | None] = [
            tuple(view.at_frames(slice(t, t + 1)) for view in of_camera) for of_camera in model.views
        ]
        frames.append(replace(frame, views=views, contacts=[wearer.contact_confidence[t] for wearer in model.wearers]))
    return frames


def _frame_state(state: SceneState, cameras: Sequence[CameraState], t: int) -> FrameState:
    """Of one frame, with the pose of the only one of ``cameras``; anything without one."""
    R, p = np.eye(3)[None], np.zeros((1, 3))
    for camera in cameras:
        R, p = camera.poses.R_world_camera, camera.poses.p_world_camera
    at = t if len(p) > 1 else 0
    return FrameState(
        np.stack([own.R_parent_child[t] for own in state.wearers]),
        np.stack([own.p_world_pelvis[t] for own in state.wearers]),
        R[at],
        p[at],
    )
