"""What all frames of a long scene share, found from a stretch of it, and a scene that is declared to have it.

Every window is then solved by the stages of a scene of its own: of wearers whose bodies, hinges and mountings are
known, filmed by a camera whose detector is known, and, if it stands still, at a known pose.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vip_factors.body.hinges import hinge_estimates
from vip_factors.body.keypoints import KeypointOffsets
from vip_factors.display import silent
from vip_factors.estimate import Estimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.camera import CameraPath, VideoClock
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.sensors.sources import SceneSource
from vip_factors.settings import Settings
from vip_factors.solve.levenberg_marquardt import SolveSettings
from vip_factors.stages.association import AssociatedCamera, first_association, usable_cameras
from vip_factors.stages.calibration_start import start_choice, start_findings
from vip_factors.stages.decode import SceneCovariance, decode_camera, decode_wearers, scene_covariance
from vip_factors.stages.drift import found_clock
from vip_factors.stages.findings import film_findings
from vip_factors.stages.floor import on_floor, with_declared_floor
from vip_factors.stages.fusion import FusionSolution, fuse_finely, fuse_in_rounds, with_level_floor
from vip_factors.stages.fusion_start import FusionStart, start_fusion
from vip_factors.stages.inertial import InertialSolution, inertial_trackers
from vip_factors.stages.reporting import at_nearest, scene_estimate, who_is_who
from vip_factors.stages.rival_starts import with_rivals_solved
from vip_factors.stages.sensor_checks import Corrections, checked_scene, corrected_elsewhere
from vip_factors.stages.solver import Solver
from vip_factors.stages.window_join import Headings, SolvedWindow
from vip_factors.stages.windows import Each, WindowPlan

# Degrees, of a heading as the frames before have left it: as sure as a minute in front of a camera makes it.
HEADING_DEG = 3.0


@dataclass(frozen=True)
class WearerCalibration:
    """What all frames of a wearer share.

    Attributes:
        subject: with the body that was found.
        placement: with mountings and places as found, of the sensors that are used.
        headings: over the stretch.
        drift_deg: ``(S,)`` degrees per √minute; empty where headings are constant.
        sole: metres.
        corrections: of the sensors, by name.
    """

    subject: Subject
    placement: Placement
    headings: Headings
    drift_deg: Array
    sole: float
    corrections: Corrections

    @classmethod
    def of(
        cls, recording: Recording, model: WearerProblem, state: WearerState, mounting_sigma: Array,
        corrections: Corrections,
    ) -> "WearerCalibration":  # fmt: skip
        """Of a solved stretch, whose body is the problem's; ``mounting_sigma`` ``(S, 3)`` radians, NaN if unknown."""
        before, sensors = recording.subject, list(model.frames.sensors)
        places = model.sensor_points.p_bone_point + state.sensor_positions
        sites = tuple(
            site
            if site.sensor not in sensors
            else replace(
                site,
                p_bone_sensor=places[sensors.index(site.sensor)],
                R_bone_sensor=state.R_bone_sensor[sensors.index(site.sensor)],
                mounting_sigma=_size(mounting_sigma[sensors.index(site.sensor)], site.mounting_sigma),
            )
            for site in recording.placement.sites
        )
        found = hinge_estimates(state.hinges, model.hinge_prior.covariance)
        subject = replace(before, skeleton=model.skeleton, length_prior=None, hinges=found)
        sole = model.settings.sole.of(state.sole)
        placement = replace(recording.placement, sites=sites)
        return cls(subject, placement, Headings.of(model, state), model.heading_drift_deg, sole, corrections)


@dataclass(frozen=True)
class SceneCalibration:
    """What all frames of a scene share.

    Attributes:
        wearers: in their order.
        camera_path: of the first camera over the stretch; a single pose if it stands still. None if it is nowhere.
        R_camera_imu: mounting of the sensor on it.
        keypoint_offsets: of its detector.
        clock: of the first camera's video.
        is_world_known: whether the pose of a camera was given: the floor is at z = 0 then.
    """

    wearers: tuple[WearerCalibration, ...]
    camera_path: CameraPath | None
    R_camera_imu: Array
    keypoint_offsets: KeypointOffsets
    clock: VideoClock
    is_world_known: bool

    @classmethod
    def of(
        cls, scene: Scene, solution: FusionSolution, filmed_by: Camera, mounting_sigmas: Sequence[Array],
        corrections: Sequence[Corrections],
    ) -> "SceneCalibration":  # fmt: skip
        """Of a stretch's coarse solution.

        Args:
            scene: the stretch.
            solution: the solution.
            filmed_by: the camera whose path it has: the first one, if that is of use.
            mounting_sigmas: ``(S, 3)`` radians of each wearer, NaN if unknown.
            corrections: of each wearer's sensors.
        """
        model, state = solution.model, solution.state
        wearers = zip(scene.wearers, model.wearers, state.wearers, mounting_sigmas, corrections, strict=True)
        offsets = KeypointOffsets(state.detector.keypoint_offsets, model.camera.prior_offsets.sigma)
        known = any(camera.known_path is not None for camera in scene.cameras)
        path = solution.camera_path if filmed_by is scene.camera else None
        return cls(
            tuple(WearerCalibration.of(*one) for one in wearers), path, state.camera.R_camera_imu, offsets,
            found_clock(state.camera, model.camera.clock_middle, scene.cameras[0].clock), known,
        )  # fmt: skip

    def declared(
        self, scene: Scene, is_first: bool, clock: VideoClock, settings: Settings
    ) -> tuple[Scene, tuple[Finding, ...]]:
        """A window of the scene with all this declared, its sensors put right, and what was found on these.

        The first one begins with the wearers' declared poses. ``clock`` is that of the first camera's video.
        """
        found = [
            corrected_elsewhere(
                replace(
                    one, subject=known.subject, placement=known.placement,
                    initial_pose=one.initial_pose if is_first else "none",
                ),
                known.corrections,
                settings,
            )
            for one, known in zip(scene.wearers, self.wearers, strict=True)
        ]  # fmt: skip
        assert scene.camera is not None
        further = tuple(replace(one, keypoint_offsets=self.keypoint_offsets) for one in scene.further_cameras)
        wearers, told = tuple(one for one, _ in found), tuple(finding for _, own in found for finding in own)
        return replace(scene, wearers=wearers, camera=self._camera(scene.camera, clock), further_cameras=further), told

    def _camera(self, camera: Camera, clock: VideoClock) -> Camera:
        mount = camera.mount
        if mount is not None:
            mount = replace(mount, R_camera_imu=self.R_camera_imu)
        known = camera.known_path if camera.moving or camera.known_path is not None else self.camera_path
        return replace(
            camera, mount=mount, known_path=known, keypoint_offsets=self.keypoint_offsets, time_offset=clock.offset,
            time_drift=clock.drift,
        )  # fmt: skip

    def settings(self, settings: Settings) -> Settings:
        """Those of windows: what is declared is kept, and headings are as sure as the frames before have left them."""
        held = replace(
            settings.calibration, estimate_mountings=False, estimate_body=False, estimate_hinges=False,
            estimate_places=False, estimate_sole=False, estimate_keypoints=False,
        )  # fmt: skip
        factors, camera = settings.factors, settings.camera
        least = min(HEADING_DEG, factors.heading_prior.least_sigma_deg)
        factors = replace(factors, heading_prior=replace(factors.heading_prior, least_sigma_deg=least))
        if not self.is_world_known:  # a camera that was found knows of no floor
            camera = replace(camera, ground_contact=replace(camera.ground_contact, use=False))
        return replace(settings, calibration=held, factors=factors, camera=camera)


def _size(sigma: Array, otherwise: float) -> float:
    """Root mean square of ``(3,)``, if known."""
    return float(np.sqrt(np.mean(sigma**2))) if np.all(np.isfinite(sigma)) else otherwise


@dataclass(frozen=True)
class SolvedStretch:
    """A stretch of coarse frames solved with everything free.

    Attributes:
        scene: the stretch, its sensors put right.
        corrections: of each wearer's sensors.
        about_sensors: findings on them.
        inertial: the wearers by their sensors alone.
        initial: where the fusion started.
        solution: the solution.
        associated: the cameras that it was made from.
        solver: of all this, with its reports.
    """

    scene: Scene
    corrections: tuple[Corrections, ...]
    about_sensors: tuple[Finding, ...]
    inertial: tuple[InertialSolution, ...]
    initial: FusionStart
    solution: FusionSolution
    associated: tuple[AssociatedCamera, ...]
    solver: Solver

    @property
    def shown(self) -> int:
        """How many wearers were found in a video."""
        return sum(any(len(each.seen[n]) for each in self.associated) for n in range(len(self.scene.wearers)))

    def estimate(self, settings: Settings, time: Array | None = None) -> Estimate:
        """The estimate at its coarse frames, or at the full rate at ``time`` ``(T,)``."""
        fine = self.solution
        if time is not None:
            fine = fuse_finely(self.scene, self.initial, fine, self.associated, time, settings, self.solver)
        else:
            settings = replace(settings, covariance=False)
        estimate = scene_estimate(self.scene, self.solution, fine, self.associated, settings, self.solver)
        sensors = [one.model.frames.sensors for one in self.inertial]
        wearers = tuple(
            replace(one, start=start_choice(own, inertial.starts))
            for one, own, inertial in zip(estimate.wearers, sensors, self.inertial, strict=True)
        )
        about_starts = (
            finding
            for recording, own, inertial in zip(self.scene.wearers, sensors, self.inertial, strict=True)
            for finding in start_findings(recording.subject.name, own, inertial.starts)
        )
        findings = (*self.about_sensors, *estimate.findings, *about_starts)
        return replace(estimate, wearers=wearers, findings=(*film_findings(self.scene, findings), *findings))

    def windows(self, plan: WindowPlan, settings: Settings, each: Each) -> Iterator[SolvedWindow]:
        """Windows at the full rate, which start from the solution of all coarse frames and are in its world."""
        coarse = self.solution
        covariance = scene_covariance(coarse.model, coarse.state, self.solver) if settings.covariance else None
        sent = replace(self, inertial=(), solver=replace(self.solver, on_progress=silent, reports=[]))
        return each(partial(sent._window, plan, settings, covariance), plan.windows())

    def _window(
        self, plan: WindowPlan, settings: Settings, covariance: SceneCovariance | None, span: slice
    ) -> SolvedWindow:
        coarse, time, own = self.solution, plan.time(span), replace(self.solver, reports=[])
        fine = fuse_finely(self.scene, self.initial, coarse, self.associated, time, settings, own)
        sure = None if covariance is None else at_nearest(covariance, coarse, time)
        wearers = decode_wearers(fine.model, fine.state, sure)
        first = self.scene.cameras[0]
        camera = decode_camera(first.name, fine.model, fine.state, sure, first.clock)
        return SolvedWindow(span, wearers, camera, reports=tuple(own.reports))

    def calibration(self, estimate: Estimate) -> SceneCalibration:
        """What it says of all frames, given its own estimate."""
        sigmas = [np.array([one.calibration[name].mounting_sigma for name in one.sensors]) for one in estimate.wearers]
        return SceneCalibration.of(self.scene, self.solution, self.associated[0].camera, sigmas, self.corrections)


def calibrate_scene(
    source: SceneSource, plan: WindowPlan, settings: Settings, solver: Solver
) -> tuple[SolvedStretch | None, tuple[Finding, ...]]:
    """The first stretch that shows everybody; of none does, that which shows most. None if nobody is seen in any.

    Returns:
        The stretch, and findings on what the cameras saw where nobody was recognised.
    """
    looks = 3  # at stretches that are spread over a scene, where the first does not show every wearer
    best, findings, coarse = None, tuple[Finding, ...](), -(-plan.frames // plan.factor)
    for begin in sorted({round(one) for one in np.linspace(0, max(coarse - plan.stretch, 0), looks)}):
        own = replace(solver, reports=[])
        found = _solved_stretch(source, plan, slice(begin, min(begin + plan.stretch, coarse)), settings, own)
        if not isinstance(found, SolvedStretch):
            findings = findings or found
            continue
        if best is None or found.shown > best.shown:
            best = found
        if best.shown == len(source.wearers):
            break
    return best, findings


def _solved_stretch(
    source: SceneSource, plan: WindowPlan, stretch: slice, settings: Settings, solver: Solver
) -> SolvedStretch | tuple[Finding, ...]:
    """One stretch; or why nobody was recognised in it."""
    time = plan.coarse_time(stretch)
    scene = source.between() if plan.all_calibrate else source.between(float(time[0]), float(time[-1]))
    scene = with_declared_floor(scene, settings.floor)
    if stretch.start:
        scene = replace(scene, wearers=tuple(replace(one, initial_pose="none") for one in scene.wearers))
    scene, corrections, about_sensors = checked_scene(scene, settings)
    inertial = inertial_trackers(scene, time, settings, solver)
    inertial, filmed_by = first_association(scene, inertial, settings, solver)
    associated = usable_cameras(filmed_by)
    if not associated:
        findings = who_is_who(scene, filmed_by)
        return *film_findings(scene, findings), *findings
    initial = start_fusion(associated, inertial, settings)
    solution, associated = fuse_in_rounds(initial, associated, settings, solver)
    inertial = tuple(
        replace(one, starts=with_rivals_solved(
            one.starts, solution.model, solution.state, number, recording, settings, solver
        ))
        for number, (recording, one) in enumerate(zip(scene.wearers, inertial, strict=True))
    )  # fmt: skip
    known = any(one.camera.known_path is not None for one in associated)
    if settings.floor != "none" and not known:
        solution = with_level_floor(solution, solver)
    state, about_floor = on_floor(solution.model.wearers, solution.state, settings.floor, known)
    solution, about_sensors = replace(solution, state=state), (*about_sensors, *about_floor)
    return SolvedStretch(scene, corrections, about_sensors, inertial, initial, solution, associated, solver)


def fusion_solve_settings(settings: Settings) -> SolveSettings:
    """The optimiser's settings in front of cameras."""
    return replace(settings.solve, relative_decrease=settings.fusion.relative_decrease)
