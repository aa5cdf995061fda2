"""A filmed scene of hours, window by window: each is solved as a scene of its own whose calibration is known.

A window begins before the last one ends: there the wearers are where the coarse frames of that have put them, and its
headings are as these have left them. So nothing waits for a window's full rate, which may be solved elsewhere.
The world of a camera that stands still, or whose pose is known, is the same in all windows; before one that is carried,
a solved window is moved to where the last one has its wearers and the camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.estimate import WearerEstimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.sensors.camera import CameraPath, VideoClock
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.sensors.sources import SceneSource, frames_of
from vip_factors.settings import Settings
from vip_factors.stages.association import AssociatedCamera, associate_cameras, usable_cameras
from vip_factors.stages.decode import SceneCovariance, decode_camera, decode_wearers
from vip_factors.stages.findings import quality_checks
from vip_factors.stages.floor import with_declared_floor
from vip_factors.stages.fusion import FusionSolution, fuse_finely, fuse_in_rounds
from vip_factors.stages.fusion_start import FusionStart, camera_problem, inertial_orientations, start_fusion
from vip_factors.stages.inertial import InertialSolution, at_frames, inertial_tracker, start_state
from vip_factors.stages.inertial_model import inertial_model, with_heading_knots
from vip_factors.stages.reporting import full_rate_covariance, who_is_who
from vip_factors.stages.scene_calibration import SceneCalibration, WearerCalibration
from vip_factors.stages.solver import Solver
from vip_factors.stages.window_join import Headings, SolvedWindow
from vip_factors.stages.windows import WindowPlan


@dataclass(frozen=True)
class WindowStart:
    """How a wearer begins a window.

    Attributes:
        headings: as known before.
        R_parent_child, p_world_pelvis: ``(24, 3, 3)`` and ``(3,)`` metres, the pose at the window's first frame; None
            of the first window.
        known_until: seconds until when the wearer's place is known from before.
    """

    headings: Headings
    R_parent_child: Array | None = None
    p_world_pelvis: Array | None = None
    known_until: float = -np.inf


@dataclass(frozen=True)
class CoarseWindow:
    """A window whose coarse frames are solved: what the next one begins with, and all that its full rate asks for.

    Attributes:
        span: its frames, of the whole recording.
        time: ``(T,)`` seconds of these.
        cameras: as they were given.
        scene: the window, with what is known declared.
        clock: that its first camera's video was said to have.
        initial, solution, associated: of its coarse frames.
        settings: of windows.
        solver: of the window.
        about_sensors: findings on them.
    """

    span: slice
    time: Array
    cameras: tuple[Camera, ...]
    scene: Scene
    clock: VideoClock
    initial: FusionStart
    solution: FusionSolution
    associated: tuple[AssociatedCamera, ...]
    settings: Settings
    solver: Solver
    about_sensors: tuple[Finding, ...]

    @property
    def found_clock(self) -> VideoClock:
        """The clock that the first camera's video was found to have."""
        camera = self.solution.state.camera
        return self.clock.corrected(camera.clock, camera.clock_drift, self.solution.model.camera.clock_middle)

    def start_at(self, number: int, frame: int) -> WindowStart:
        """How a wearer begins a window at one of this one's frames."""
        model, state = self.solution.model.wearers[number], self.solution.state.wearers[number]
        at = frame - self.span.start
        pose = at_frames(state, model.frames.time, self.time[at : at + 1])
        return WindowStart(
            Headings.of(model, state), pose.R_parent_child[0], pose.p_world_pelvis[0], float(self.time[-1])
        )

    def solved(self) -> SolvedWindow:
        """The window at its full rate, in a world of its own if nothing ties it to the last one's.

        Raises:
            SolveError: if its problem is not determined.
        """
        solution, associated, first = self.solution, self.associated, self.cameras[0]
        fine = fuse_finely(self.scene, self.initial, solution, associated, self.time, self.settings, self.solver)
        covariance = _covariance(self.scene, solution, fine, self.solver) if self.settings.covariance else None
        estimates = decode_wearers(fine.model, fine.state, covariance)
        wearer = np.full(len(first.detections), -1)
        if associated[0].camera.name == first.name:
            wearer = associated[0].association.wearer
        return SolvedWindow(
            self.span,
            estimates,
            decode_camera(first.name, fine.model, fine.state, covariance, self.clock),
            tuple(Headings.of(*one) for one in zip(solution.model.wearers, solution.state.wearers, strict=True)),
            first.timed_detections.time[first.detections.frame],
            wearer,
            any(each.shows_somebody and each.camera.known_path is not None for each in associated),
            tuple(self.solver.reports),
            (*self.about_sensors, *_findings(self.cameras, self.scene, associated, fine, estimates)),
        )


def solve_coarsely(
    source: SceneSource, calibration: SceneCalibration, before: CoarseWindow | None, plan: WindowPlan, span: slice,
    settings: Settings, solver: Solver,
) -> CoarseWindow:  # fmt: skip
    """The coarse frames of one window.

    Args:
        source: the scene.
        calibration: what all windows share.
        before: the last one.
        plan: of all.
        span: its frames.
        settings: of all.
        solver: of the window.

    Raises:
        RecordingError: for samples that cannot be used.
        SolveError: if its problem is not determined.
    """
    settings, time = calibration.settings(settings), plan.time(span)
    measured = with_declared_floor(source.between(float(time[0]), float(time[-1])), settings.floor)
    clock = calibration.clock if before is None else before.found_clock
    scene, about_sensors = calibration.declared(measured, span.start == 0, clock, settings)
    coarse = time[:: plan.factor]
    begins = [
        WindowStart(known.headings) if before is None else before.start_at(number, span.start)
        for number, known in enumerate(calibration.wearers)
    ]
    trackers = [
        track_from_start(recording, one.sensors, known, begin, coarse, settings, solver)
        for recording, one, known, begin in zip(scene.wearers, source.wearers, calibration.wearers, begins, strict=True)
    ]
    last = calibration.camera_path, 0.0
    if before is not None:
        last = before.solution.camera_path, before.solution.state.camera.heading
    found = _fused(scene, trackers, begins, last, settings, solver)
    return CoarseWindow(span, time, measured.cameras, scene, clock, *found, settings, solver, about_sensors)


def _fused(
    scene: Scene,
    trackers: Sequence[InertialSolution],
    begins: Sequence[WindowStart],
    last: tuple[CameraPath | None, float],
    settings: Settings,
    solver: Solver,
) -> tuple[FusionStart, FusionSolution, tuple[AssociatedCamera, ...]]:
    """Association and fusion; a first camera that sees no wearer is where it was ``last``."""
    filmed_by = associate_cameras(scene, trackers, settings, solver.progress_of("association"))
    associated = usable_cameras(filmed_by) or tuple(each for each in filmed_by if each.camera.known_path is not None)
    if not any(each.camera is scene.camera for each in associated):
        first = camera_without_sight(filmed_by[0].camera, *last, trackers[0].model.frames.time, settings)
        if first.known_path is not None:
            associated = (replace(filmed_by[0], camera=first), *associated)
    if not any(each.shows_somebody for each in associated):  # who is seen is not to be found by a guess
        settings = replace(settings, fusion=replace(settings.fusion, rounds=1))
    initial = with_window_starts(start_fusion(associated, trackers, settings), trackers, associated, begins, settings)
    solution, associated = fuse_in_rounds(initial, associated, settings, solver)
    return initial, solution, associated


def _covariance(scene: Scene, solution: FusionSolution, fine: FusionSolution, solver: Solver) -> SceneCovariance:
    """Of a window's poses, with mountings as sure as they were found."""
    wearers = tuple(
        replace(
            model, free_mountings=True,
            mounting_sigma=np.array([one.placement.site(name).mounting_sigma for name in model.frames.sensors]),
        )
        for one, model in zip(scene.wearers, solution.model.wearers, strict=True)
    )  # fmt: skip
    return full_rate_covariance(replace(solution, model=replace(solution.model, wearers=wearers)), fine, solver)


def _findings(
    cameras: Sequence[Camera],
    scene: Scene,
    associated: Sequence[AssociatedCamera],
    fine: FusionSolution,
    estimates: Sequence[WearerEstimate],
) -> list[Finding]:
    """What is odd about a window, but for drift, which is of all of them; cameras are as they were given."""
    given = {camera.name: camera for camera in cameras}
    associated = [replace(each, camera=given[each.camera.name]) for each in associated]
    still = [
        replace(one, calibration={
            name: replace(own, heading_time=np.zeros(0), heading_path=np.zeros(0))
            for name, own in one.calibration.items()
        })
        for one in estimates
    ]  # fmt: skip
    return [*who_is_who(scene, associated), *quality_checks(scene, associated, fine, still)]


def track_from_start(
    recording: Recording, sensors: Sequence[str], shared: WearerCalibration, begin: WindowStart, time: Array,
    settings: Settings, solver: Solver,
) -> InertialSolution:  # fmt: skip
    """A wearer at a window's coarse frames by the sensors alone, where the window before has had him at first.

    Args:
        recording: of the window, with what is known declared.
        sensors: all that are used; some may be silent now.
        shared: about the wearer.
        begin: of the window.
        time: ``(T,)`` of the coarse frames.
        settings: of windows.
        solver: of the window.
    """
    frames = frames_of(recording.imus, sensors, time)
    mountings = np.stack([recording.placement.site(name).R_bone_sensor for name in sensors])
    nearest = begin.headings.at(max(float(time[0]), begin.known_until))
    calibration = InitialCalibration(nearest, np.zeros(len(sensors)), mountings)
    if begin.R_parent_child is not None and not frames.orientation_valid.any():
        inertial = _unmoved(recording, frames, calibration, begin.R_parent_child, settings)
    else:
        inertial = inertial_tracker(recording, frames, settings, solver, calibration)
    model, state = inertial.model, inertial.state
    factors = replace(model.settings, sole=replace(model.settings.sole, thickness=shared.sole))
    model = replace(model, settings=factors, prior_headings=begin.headings.at(float(time[0])))
    if model.headings_walk and len(shared.drift_deg):
        model = replace(model, heading_drift_deg=shared.drift_deg)
    if begin.p_world_pelvis is not None:
        shift = begin.p_world_pelvis - state.p_world_pelvis[0]
        state = replace(state, p_world_pelvis=state.p_world_pelvis + shift)
    return InertialSolution(model, state)


def _unmoved(
    recording: Recording, frames: ImuFrames, calibration: InitialCalibration, R_parent_child: Array, settings: Settings
) -> InertialSolution:
    """A wearer in a window in which none of the sensors measured anything: as at its beginning."""
    model, T = inertial_model(recording, frames, calibration, settings), len(frames)
    model = with_heading_knots(model, settings.calibration)
    state = start_state(model, calibration, np.tile(R_parent_child, (T, 1, 1, 1)))
    return InertialSolution(model, state.with_knots(len(model.heading_knots)))


def with_window_starts(
    initial: FusionStart,
    trackers: Sequence[InertialSolution],
    associated: Sequence[AssociatedCamera],
    begins: Sequence[WindowStart],
    settings: Settings,
) -> FusionStart:
    """The wearers as cameras place them, in a world that is known already.

    Which way their sensors point the frames before say, and not a window's first look. Whom no camera sees for as long
    as the window before knows where he is begins there, and from there goes to where he is seen. Whom none sees either
    at the beginning or at the end walks on his feet, as without a camera: nothing else holds him.
    """
    wearers = []
    for number, (one, tracker, begin) in enumerate(zip(initial.wearers, trackers, begins, strict=True)):
        seen = np.concatenate([each.seen[number].time for each in associated])
        one = replace(one, model=replace(one.model, prior_headings=tracker.model.prior_headings))
        if begin.p_world_pelvis is not None and not np.any(seen <= begin.known_until):
            one = _from_before(one, begin.p_world_pelvis, seen)
        time, reach = one.model.frames.time, settings.windows.overlap_s
        if not (np.any(seen <= time[0] + reach) and np.any(seen >= time[-1] - reach)):
            contact = tracker.model.settings.foot_contact
            loose = replace(contact, sigma=settings.fusion.contact_loosening * contact.sigma)
            one = replace(one, model=replace(one.model, settings=replace(one.model.settings, foot_contact=loose)))
        wearers.append(one)
    return replace(
        initial, wearers=tuple(wearers), state=replace(initial.state, wearers=tuple(one.state for one in wearers))
    )


def _from_before(inertial: InertialSolution, p_world_start: Array, seen: Array) -> InertialSolution:
    """A wearer who begins where the window before has him, and goes to where he is ``seen`` first, if he is."""
    time, p = inertial.model.frames.time, inertial.state.p_world_pelvis
    first = float(seen.min()) if len(seen) else np.inf
    left = np.clip((first - time) / (first - time[0]), 0.0, 1.0) if np.isfinite(first) else np.ones(len(time))
    state = replace(inertial.state, p_world_pelvis=p + left[:, None] * (p_world_start - p[0]))
    return replace(inertial, model=replace(inertial.model, is_gauge=True), state=state)


def camera_without_sight(
    camera: Camera, path: CameraPath | None, heading: float, time: Array, settings: Settings
) -> Camera:
    """A camera that sees no wearer in a window, where it was last: turned by its sensor, if it has one, and unmoved.

    Args:
        camera: it.
        path: its, before; None if it was nowhere.
        heading: radians, of the sensor on it.
        time: ``(T,)`` of the window's frames.
        settings: of windows.
    """
    if not camera.moving or camera.known_path is not None:
        return camera
    there = (path or CameraPath(time[:1], np.eye(3)[None], np.zeros((1, 3)))).at(time)
    valid, measured = inertial_orientations(camera_problem(camera, time, settings), len(time))
    if not valid.any():
        return replace(camera, known_path=there)
    R = CameraPath(time[valid], rotation_z(heading) @ measured, there.p_world_camera[valid]).at(time).R_world_camera
    return replace(camera, known_path=replace(there, R_world_camera=R))
