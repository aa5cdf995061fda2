"""A window of a long filmed scene: solved as a scene whose calibration is known, which goes on from the one before.

A window begins before the last one ends: there the wearers are where the coarse frames of that have put them, and its
headings are as these have left them. So nothing waits for a window's full rate, which may be solved elsewhere.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.keypoints import KeypointOffsets
from vip_factors.estimate import CameraEstimate, Estimate, WearerEstimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.camera import CameraPath, VideoClock
from vip_factors.sensors.frames import ImuFrames, coarser
from vip_factors.sensors.scene import Camera
from vip_factors.sensors.sources import SceneSource, frames_of
from vip_factors.settings import Settings
from vip_factors.stages.accelerometers import Corrections
from vip_factors.stages.association import AssociatedCamera, CameraPlacement, associate_cameras, usable_cameras
from vip_factors.stages.calibrate import Calibration
from vip_factors.stages.decode import SceneCovariance, decode_cameras, decode_wearers
from vip_factors.stages.drift import estimated_clock
from vip_factors.stages.findings import quality_checks, who_is_who
from vip_factors.stages.floor import with_declared_floor
from vip_factors.stages.fusion import FusionSolution, with_body_of
from vip_factors.stages.fusion_start import FusionStart, camera_problem, inertial_orientations, start_fusion
from vip_factors.stages.inertial import InertialSolution, at_frames, track_window
from vip_factors.stages.inertial_model import (
    declared_pose,
    with_fixed_calibration,
    with_foot_contact,
    with_heading_times,
)
from vip_factors.stages.reporting import full_rate_covariance
from vip_factors.stages.scene_solution import SceneSolution, solve_from
from vip_factors.stages.sensor_checks import corrected_elsewhere
from vip_factors.stages.solver import Solver
from vip_factors.stages.window_join import Headings, SolvedWindow
from vip_factors.stages.windows import WindowPlan

# Degrees, of a heading as the frames before have left it: as sure as a minute in front of a camera makes it.
HEADING_DEG = 3.0


@dataclass(frozen=True)
class WearerStart:
    """Start of a wearer in a window.

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

    def track(self, model: WearerProblem, shared: WearerState, settings: Settings, solver: Solver) -> InertialSolution:
        """The wearer on a window's coarse frames by the sensors alone; stands still if none measured anything.

        Args:
            model: of the window, with constant headings.
            shared: what all frames share.
            settings, solver: of the window.
        """
        time, frames = model.frames.time, model.frames
        headings = self.headings.at(max(float(time[0]), self.known_until))
        shared = replace(shared, headings=headings, later_headings=np.zeros((0, len(headings))))
        if self.R_parent_child is not None and not frames.orientation_valid.any():
            R = np.tile(self.R_parent_child, (len(frames), 1, 1, 1))
            state = replace(shared, R_parent_child=R, p_world_pelvis=np.zeros((len(frames), 3)))
        else:
            state = track_window(model, shared, headings, solver)
        if self.p_world_pelvis is not None:
            shift = self.p_world_pelvis - state.p_world_pelvis[0]
            state = replace(state, p_world_pelvis=state.p_world_pelvis + shift)
        model = with_heading_times(model, settings.calibration)
        if not model.headings_drift:
            model = replace(model, heading_drift_deg=np.zeros(0))
        model = replace(model, prior_headings=self.headings.at(float(time[0])))
        return InertialSolution(model, state.with_headings(len(model.heading_times)))


@dataclass(frozen=True)
class CameraStart:
    """Start of a camera in a window.

    Attributes:
        clock: of its video.
        path: before the window; None if it was nowhere.
        heading: radians, of the sensor on it.
    """

    clock: VideoClock
    path: CameraPath | None = None
    heading: float = 0.0


@dataclass(frozen=True)
class WindowStart:
    """Start of a filmed window: wearers in their order, and cameras by name."""

    wearers: tuple[WearerStart, ...]
    cameras: Mapping[str, CameraStart]

    def placed(
        self, associated: Sequence[AssociatedCamera], trackers: Sequence[InertialSolution], settings: Settings
    ) -> FusionStart:
        """Wearers and cameras in the world of the windows before; a camera that sees nobody is where it was.

        Which way sensors point the frames before say, and not a window's first look. Whom no camera sees for as long as
        the window before knows where he is begins there, and from there goes to where he is seen. Whom none sees either
        at the beginning or at the end walks on his feet, as without a camera: nothing else holds him.
        """
        time = trackers[0].model.frames.time
        usable, used = usable_cameras(associated), list[AssociatedCamera]()
        for video in associated:
            if any(video is candidate for candidate in usable):
                used.append(video)
            elif video.camera.known_path is None or not usable:
                previous = self.cameras[video.camera.name]
                camera = camera_without_sight(video.camera, previous, time, settings)
                used += [replace(video, camera=camera)] if camera.known_path is not None else []
        start = start_fusion(used, trackers, settings)
        wearers = []
        for number, (wearer, tracker, begin) in enumerate(zip(start.wearers, trackers, self.wearers, strict=True)):
            sighting_times = np.concatenate([video.sightings[number].time for video in used])
            model = replace(wearer.model, prior_headings=tracker.model.prior_headings)
            wearer = replace(wearer, model=model)
            if begin.p_world_pelvis is not None and not np.any(sighting_times <= begin.known_until):
                wearer = _from_before(wearer, begin.p_world_pelvis, sighting_times)
            reach = settings.windows.overlap_s
            if not (np.any(sighting_times <= time[0] + reach) and np.any(sighting_times >= time[-1] - reach)):
                contact = tracker.model.settings.foot_contact
                loose = replace(contact, sigma=settings.fusion.contact_loosening * contact.sigma)
                wearer = replace(wearer, model=with_foot_contact(wearer.model, loose))
            wearers.append(wearer)
        state = replace(start.state, wearers=tuple(wearer.state for wearer in wearers))
        return replace(start, wearers=tuple(wearers), state=state)


def _from_before(wearer: InertialSolution, p_world_start: Array, sighting_times: Array) -> InertialSolution:
    """A wearer who begins where the window before has him, and goes to the first of ``sighting_times``, if any."""
    time, p = wearer.model.frames.time, wearer.state.p_world_pelvis
    first_sighting = float(sighting_times.min()) if len(sighting_times) else np.inf
    weight = (
        np.clip((first_sighting - time) / (first_sighting - time[0]), 0.0, 1.0)
        if np.isfinite(first_sighting)
        else np.ones(len(time))
    )
    state = replace(wearer.state, p_world_pelvis=p + weight[:, None] * (p_world_start - p[0]))
    return replace(wearer, model=replace(wearer.model, is_gauge=True), state=state)


def camera_without_sight(camera: Camera, previous: CameraStart, time: Array, settings: Settings) -> Camera:
    """A camera that sees no wearer in a window, where it was last: turned by its sensor, if it has one, and unmoved.

    Args:
        camera: the camera.
        previous: its start in this window, that is, its last state in the window before.
        time: ``(T,)`` of the window's frames.
        settings: of windows.
    """
    if not camera.moving or camera.known_path is not None:
        return camera
    path = (previous.path or CameraPath(time[:1], np.eye(3)[None], np.zeros((1, 3)))).at(time)
    valid, measured = inertial_orientations(camera_problem(camera, time, settings), len(time))
    if not valid.any():
        return replace(camera, known_path=path)
    turned = CameraPath(time[valid], rotation_z(previous.heading) @ measured, path.p_world_camera[valid]).at(time)
    return replace(camera, known_path=replace(path, R_world_camera=turned.R_world_camera))


@dataclass(frozen=True)
class FilmedWindow:
    """A window of a long scene whose coarse frames are solved: all that the next one and its full rate ask for.

    Attributes:
        span: its frames, of the whole recording.
        frames: of each wearer at the full rate.
        solution: of its coarse frames.
        cameras: as they were given.
        calibrated_cameras: cameras of the calibration.
        start: how it began.
        settings, solver: of the window.
        sensor_findings: findings about the sensors.
    """

    span: slice
    frames: tuple[ImuFrames, ...]
    solution: SceneSolution
    cameras: tuple[Camera, ...]
    calibrated_cameras: "KnownCameras"
    start: WindowStart
    settings: Settings
    solver: Solver
    sensor_findings: tuple[Finding, ...]

    def start_at(self, frame: int) -> WindowStart:
        """Return the start of a window that begins at a frame of this one."""
        fused, time = self.solution.fusion, self.frames[0].time
        wearers, row, cameras = list[WearerStart](), frame - self.span.start, dict(self.start.cameras)
        for wearer in fused.wearers:
            pose, headings = at_frames(wearer.state, wearer.model.frames.time, time[row : row + 1]), Headings.of(wearer)
            wearers.append(WearerStart(headings, pose.R_parent_child[0], pose.p_world_pelvis[0], float(time[-1])))
        for video, viewpoint, placed in zip(
            self.solution.associated, fused.model.viewpoints(fused.state), fused.placements, strict=True
        ):
            name, state = video.camera.name, viewpoint.state
            clock = cameras[name].clock.corrected(state.clock, state.clock_drift, viewpoint.problem.clock_middle)
            cameras[name] = CameraStart(clock, placed.path, state.heading)
        return WindowStart(tuple(wearers), cameras)

    def solved(self) -> SolvedWindow:
        """The window at its full rate, in a world of its own if nothing ties it to the last one's.

        Raises:
            SolveError: if its problem is not determined.
        """
        coarse, associated = self.solution.fusion, self.solution.associated
        fine = self.solution.at_full_rate(self.frames, self.settings, self.solver)
        covariance = None
        if self.settings.covariance:  # with mountings as sure as they were found
            free = tuple(replace(model, free_mountings=True) for model in coarse.model.wearers)
            unsure = replace(coarse, model=replace(coarse.model, wearers=free))
            covariance = full_rate_covariance(unsure, fine, self.solver)
        wearers = decode_wearers(fine, covariance)
        detection_times = {
            camera.name: camera.timed_detections.time[camera.detections.frame] for camera in self.cameras
        }
        return SolvedWindow(
            self.span,
            wearers,
            tuple(self._cameras(fine, covariance)),
            tuple(map(Headings.of, coarse.wearers)),
            tuple(detection_times[name] for name in self.calibrated_cameras),
            any(video.shows_wearer and video.camera.known_path is not None for video in associated),
            tuple(self.solver.reports),
            (*self.sensor_findings, *self._findings(fine, wearers)),
        )

    def _cameras(self, fine: FusionSolution, covariance: SceneCovariance | None) -> Iterator[CameraEstimate]:
        """Return all calibrated cameras; one without a place in this window keeps its last one."""
        decoded = {camera.name: camera for camera in decode_cameras(self.solution.associated, fine, covariance)}
        time = fine.model.wearers[0].frames.time
        for name, (placed, _) in self.calibrated_cameras.items():
            if name in decoded:
                yield decoded[name]
            else:
                camera, start = next(camera for camera in self.cameras if camera.name == name), self.start.cameras[name]
                path = start.path or placed.path
                yield CameraEstimate(
                    name,
                    placed.lens,
                    path.at(time) if camera.moving else path,
                    residual_px=np.full((len(time), len(fine.model.wearers)), np.nan),
                    clock=start.clock,
                    wearer_of_detection=np.full(len(camera.detections), -1),
                )

    def _findings(self, fine: FusionSolution, wearers: Sequence[WearerEstimate]) -> Iterator[Finding]:
        """Return the findings of the window except drift, which concerns all windows; cameras are as declared."""
        camera_of_name, scene = {camera.name: camera for camera in self.cameras}, self.solution.scene
        associated = [replace(video, camera=camera_of_name[video.camera.name]) for video in self.solution.associated]
        none = np.zeros(0)
        still = [
            replace(
                wearer,
                calibration={
                    name: replace(sensor, heading_time=none, heading_path=none)
                    for name, sensor in wearer.calibration.items()
                },
            )
            for wearer in wearers
        ]
        yield from who_is_who(scene, associated)
        yield from quality_checks(scene, associated, fine, still)


def filmed_windows(
    source: SceneSource,
    calibration: Calibration,
    calibrated: Estimate,
    plan: WindowPlan,
    settings: Settings,
    solver: Solver,
) -> Iterator[FilmedWindow]:
    """The coarse frames of every window solved, one after the other.

    Args:
        source: the scene.
        calibration: what all windows share.
        calibrated: the estimate of the calibrating frames.
        plan, settings, solver: of the scene.

    Raises:
        RecordingError: for samples that cannot be used.
        SolveError: if a window's problem is not determined.
    """
    scene = KnownScene.of(calibration, calibrated, settings)
    start, overlap = scene.start, None
    for span in plan.windows():
        if overlap is not None:
            start = overlap.start_at(span.start)
        overlap = scene.solve(source, start, plan, span, replace(solver, reports=[]))
        yield overlap


KnownCameras = Mapping[str, tuple[CameraPlacement, Array]]
"""By name, where cameras were as the scene was calibrated, and ``(3, 3)`` the mounting of the sensor on each."""


@dataclass(frozen=True)
class KnownScene:
    """A scene whose calibration is known.

    Attributes:
        wearers: each with all that its frames share fixed, but for headings and the mean pose.
        corrections: of each wearer's sensors.
        start: of the first window.
        cameras: those of the calibration.
        keypoint_offsets: of the detector.
        settings: of windows.
    """

    wearers: tuple[InertialSolution, ...]
    corrections: tuple[Corrections, ...]
    start: WindowStart
    cameras: "KnownCameras"
    keypoint_offsets: KeypointOffsets
    settings: Settings

    @classmethod
    def of(cls, calibration: Calibration, calibrated: Estimate, settings: Settings) -> "KnownScene":
        """Build the scene from a calibration; ``calibrated`` gives its standard deviations."""
        solution, scene = calibration.solution, calibration.solution.scene
        model, state = solution.fusion.model, solution.fusion.state
        settings = _settings_of_windows(settings, any(camera.known_path is not None for camera in scene.cameras))
        wearers, starts = list[InertialSolution](), list[WearerStart]()
        for recording, begun, solved, estimate in zip(
            scene.wearers, solution.wearers, solution.fusion.wearers, calibrated.wearers, strict=True
        ):
            sites = [recording.placement.site(name) for name in solved.model.frames.sensors]
            mounting_sigmas = [estimate.calibration[site.sensor].mounting_sigma for site in sites]
            sigmas = [_size(sigma, site.mounting_sigma) for sigma, site in zip(mounting_sigmas, sites, strict=True)]
            factors = replace(
                begun.model.settings,
                foot_contact=settings.factors.foot_contact,
                heading_prior=settings.factors.heading_prior,
            )
            calibrated_model = replace(
                with_fixed_calibration(with_body_of(begun.model, solved.model)),
                free_headings=settings.calibration.estimate_headings,
                free_pose_mean=True,
                heading_sigma=np.zeros(len(sites)),
                prior_R_bone_sensor=solved.state.R_bone_sensor,
                mounting_sigma=np.array(sigmas),
                heading_times=np.zeros(0),
                heading_drift_deg=solved.model.heading_drift_deg,
                settings=factors,
                variation=None,
                free_body=False,
                is_gauge=True,
            )
            wearers.append(InertialSolution(calibrated_model, solved.state))
            starts.append(WearerStart(Headings.of(solved)))
        cameras = {
            video.camera.name: (placed, camera_state.R_camera_imu)
            for video, placed, camera_state in zip(
                solution.associated, solution.fusion.placements, state.cameras, strict=True
            )
        }
        camera_starts = dict[str, CameraStart]()
        for video, viewpoint, placed in zip(
            solution.associated, model.viewpoints(state), solution.fusion.placements, strict=True
        ):
            clock = estimated_clock(viewpoint.state, viewpoint.problem.clock_middle, video.camera.clock)
            camera_starts[video.camera.name] = CameraStart(clock, placed.path)
        offsets = KeypointOffsets(state.detector.keypoint_offsets, model.cameras[0].prior_offsets.sigma)
        start = WindowStart(tuple(starts), camera_starts)
        return cls(tuple(wearers), calibration.corrections, start, cameras, offsets, settings)

    def solve(
        self, source: SceneSource, start: WindowStart, plan: WindowPlan, span: slice, solver: Solver
    ) -> FilmedWindow:
        """The coarse frames of one window."""
        time, settings = plan.time(span), self.settings
        window_scene = with_declared_floor(source.between(float(time[0]), float(time[-1])), settings.floor)
        recordings, frames, trackers, findings = [], list[ImuFrames](), list[InertialSolution](), list[Finding]()
        for recording, corrections, wearer, begin in zip(
            window_scene.wearers, self.corrections, self.wearers, start.wearers, strict=True
        ):
            recording, sensor_findings = corrected_elsewhere(recording, corrections, settings)
            findings += sensor_findings
            if span.start:
                recording = replace(recording, initial_pose="none")
            recordings.append(recording)
            frames.append(frames_of(recording.imus, wearer.model.frames.sensors, time))
            coarse = coarser(frames[-1], plan.factor)
            model = replace(wearer.model, frames=coarse, initial_pose=declared_pose(recording, coarse, settings))
            trackers.append(begin.track(model, wearer.state, settings, solver))
        cameras = (self._calibrated(camera, start) for camera in window_scene.cameras if camera.name in self.cameras)
        scene = replace(window_scene, wearers=tuple(recordings), cameras=tuple(cameras))
        associated = associate_cameras(scene, trackers, settings, solver.progress_of("association"))
        solution = solve_from(start.placed(associated, trackers, settings), scene, settings, solver)
        return FilmedWindow(
            span, tuple(frames), solution, window_scene.cameras, self.cameras, start, settings, solver, tuple(findings)
        )

    def _calibrated(self, camera: Camera, start: WindowStart) -> Camera:
        """A camera of a window with what is known of it: if it stands still, its pose too."""
        camera = replace(camera, keypoint_offsets=self.keypoint_offsets, clock=start.cameras[camera.name].clock)
        (placed, R_camera_imu), mount, path = self.cameras[camera.name], camera.mount, camera.known_path
        if mount is not None:
            mount = replace(mount, R_camera_imu=R_camera_imu)
        if not camera.moving and path is None:
            path = placed.path
        return replace(camera, model=placed.lens, focal_sigma=0.0, mount=mount, known_path=path)


def _settings_of_windows(settings: Settings, is_world_known: bool) -> Settings:
    """Settings of the windows: calibrated quantities stay, and headings are as certain as the last window left them."""
    fixed = replace(
        settings.calibration,
        estimate_mountings=False,
        estimate_body=False,
        estimate_hinges=False,
        estimate_places=False,
        estimate_sole=False,
        estimate_keypoints=False,
    )
    factors, camera = settings.factors, settings.camera
    least = min(HEADING_DEG, factors.heading_prior.least_sigma_deg)
    factors = replace(factors, heading_prior=replace(factors.heading_prior, least_sigma_deg=least))
    if not is_world_known:  # a camera that was found knows of no floor
        camera = replace(camera, ground_contact=replace(camera.ground_contact, use=False))
    return replace(settings, calibration=fixed, factors=factors, camera=camera)


def _size(sigma: Array, otherwise: float) -> float:
    """Root mean square of ``(3,)``, if known."""
    return float(np.sqrt(np.mean(sigma**2))) if np.all(np.isfinite(sigma)) else otherwise
