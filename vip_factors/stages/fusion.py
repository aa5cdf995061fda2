"""Video-inertial fusion (thesis 4.3.3): wearers, camera, headings and mountings jointly; coarsely, then finely."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.body.kinematics import Motion
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import angle_between
from vip_factors.initialise.start_candidates import SETTLED_NATS
from vip_factors.problem.scene import CameraProblem, ExtraTerms, KeypointView, SceneProblem, Viewpoint
from vip_factors.problem.state import CameraPoses, CameraState, SceneState, WearerState, seconds_late
from vip_factors.problem.variables import camera_owner
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.scene import UNKNOWN_MOUNTING_SIGMA
from vip_factors.settings import CommonSettings
from vip_factors.stages.association import (
    AssociatedCamera,
    CameraPlacement,
    add_unassigned_detections,
    associate_cameras_again,
)
from vip_factors.stages.drift import estimated_clock, with_estimated_drift
from vip_factors.stages.floor import levelled, seen_standing
from vip_factors.stages.fusion_start import FusionStart, camera_problem
from vip_factors.stages.inertial import InertialSolution, at_frames
from vip_factors.stages.inertial_model import on_frames_with_fixed_calibration, with_contacts, with_foot_contact
from vip_factors.stages.solver import Solver
from vip_factors.stages.views import image_scale, keypoint_view, predicted_pixels, scatter
from vip_factors.terms.evaluation import ViewEvaluation, WearerEvaluation
from vip_factors.terms.reprojection import whitened_reprojections

HELD = np.deg2rad(1.0)  # of a mounting that is kept where the start had it
TURNED = np.deg2rad(60.0)  # of a sensor on its bone, against the placement or another solution


@dataclass(frozen=True)
class FusionSolution:
    """A scene's problem and its solution.

    ``spreads`` is what was taken for the scatter of each camera's detections of each wearer, in OKS sigmas;
    ``findings`` tell of another solution that is hardly less likely.
    """

    model: SceneProblem
    state: SceneState
    spreads: tuple[tuple[float, ...], ...]
    findings: tuple[Finding, ...] = ()

    def measured_spreads(self) -> tuple[tuple[float, ...], ...]:
        """Spread of each camera's detections of each wearer about the solution, in OKS sigmas."""
        if not all(camera.settings.reprojection.adaptive for camera in self.model.cameras):
            return self.spreads
        bodies = [WearerEvaluation(number, wearer.model, wearer.state) for number, wearer in enumerate(self.wearers)]
        offsets, measured = self.state.detector.keypoint_offsets, list[tuple[float, ...]]()
        for camera, spreads in zip(self.model.viewpoints(self.state), self.spreads, strict=True):
            scatters = []
            for view, body, spread in zip(camera.views, bodies, spreads, strict=True):
                evaluation = ViewEvaluation(body, camera_owner(0), camera.problem, camera.state, view, offsets)
                scatters.append(scatter(whitened_reprojections(evaluation), view, spread))
            measured.append(tuple(scatters))
        return tuple(measured)

    def is_consistent(self) -> bool:
        """Whether the detections scatter about the solution as it was made to believe, and were taken when it says."""
        settled = 1.5  # a detector believed less than this much too rough costs less than another solve
        timed = 0.01  # s: so far keypoints move nearly straight; half a video frame
        ratios = np.divide(self.spreads, np.maximum(self.measured_spreads(), 1e-9))
        if np.any(ratios >= settled):
            return False
        ends = self.model.wearers[0].frames.time[[0, -1]]
        for camera in self.model.viewpoints(self.state):
            (offset, drift), state = camera.views[0].clock, camera.state
            moved = seconds_late(state.clock - offset, state.clock_drift - drift, ends, camera.problem.clock_middle)
            if np.max(np.abs(moved)) >= timed:
                return False
        return True

    @property
    def wearers(self) -> tuple[InertialSolution, ...]:
        """Each wearer's problem and solution, in one world."""
        return tuple(map(InertialSolution, self.model.wearers, self.state.wearers))

    @property
    def motions(self) -> list[Motion]:
        """The wearers' motions, in one world."""
        return [wearer.motion for wearer in self.wearers]

    @property
    def placements(self) -> tuple[CameraPlacement, ...]:
        """Paths of the cameras; a standing camera's has one instant."""
        time, placements = self.model.wearers[0].frames.time, list[CameraPlacement]()
        for camera in self.model.viewpoints(self.state):
            poses = camera.state.poses
            path = CameraPath(time[: len(poses)], poses.R_world_camera, poses.p_world_camera)
            clock = estimated_clock(camera.state, camera.problem.clock_middle)
            placements.append(CameraPlacement(path, camera.lens, clock))
        return tuple(placements)


def fuse(
    initial: FusionStart,
    previous: FusionSolution | None,
    associated: Sequence[AssociatedCamera],
    settings: CommonSettings,
    solver: Solver,
) -> FusionSolution:
    """Everything free, on the coarse frames; ``previous`` is the round before this one."""
    start = fusion_problem(initial, previous, associated, settings, solver.extra)
    solved = solver.solve(SceneObjective(start.model), start.state, "video-inertial fusion")
    return with_found_bodies(replace(start, state=solved))


def with_found_bodies(solution: FusionSolution) -> FusionSolution:
    """Return the problem with estimated bodies in place of the assumed ones."""
    wearers = tuple(wearer.model.with_body(wearer.state.body) for wearer in solution.wearers)
    states = tuple(replace(state, body=np.zeros_like(state.body)) for state in solution.state.wearers)
    return replace(
        solution, model=replace(solution.model, wearers=wearers), state=replace(solution.state, wearers=states)
    )


def with_level_floor(solution: FusionSolution, solver: Solver) -> FusionSolution:
    """Return the problem with standing cameras of unknown pose levelled by the floor; calibration follows.

    Pictures hardly tell 1–2° of a camera's tilt from mountings and bodies that are bent to fit; soles that rest do,
    where wearers come and go. A camera's own sensor knows better, and so does who says that the floor is not level.
    """
    model = solution.model
    stand = all(not camera.moving and camera.imu is None for camera in model.cameras)
    if not stand or not all(wearer.has_floor for wearer in model.wearers):
        return solution
    state = levelled(model.wearers, solution.state)
    if state is None:
        return solution
    wearers = tuple(
        replace(problem, p_world_start=wearer.p_world_pelvis[problem.frames.beginnings].squeeze())
        for problem, wearer in zip(model.wearers, state.wearers, strict=True)
    )
    model = replace(model, wearers=wearers)
    state = solver.solve(SceneObjective(_with_cameras_held(model)), state, "level floor")
    return with_found_bodies(replace(solution, model=model, state=state))


def with_body_of(model: WearerProblem, source: WearerProblem) -> WearerProblem:
    """A wearer's problem with the body of an earlier one."""
    return replace(model, skeleton=source.skeleton, variation=source.variation, sensors=source.sensors)


def fusion_problem(
    initial: FusionStart,
    previous: FusionSolution | None,
    associated: Sequence[AssociatedCamera],
    settings: CommonSettings,
    extra: ExtraTerms | None = None,
) -> FusionSolution:
    """The problem of :func:`fuse`, and where it starts."""
    start = previous.state if previous else initial.state
    usual = (settings.camera.reprojection.spread,) * len(start.wearers)
    spreads = previous.measured_spreads() if previous else (usual,) * len(associated)
    is_refined, calibration, wearers = previous is not None, settings.calibration, list[WearerProblem]()
    for number, (wearer, state) in enumerate(zip(initial.wearers, start.wearers, strict=True)):
        model = replace(  # with all free that only a camera shows
            wearer.model,
            free_body=calibration.estimate_body,
            free_places=calibration.estimate_places,
            free_sole=calibration.estimate_sole,
        )
        if previous is not None:
            model = with_estimated_drift(with_body_of(model, previous.model.wearers[number]), state)
        wearers.append(with_contacts(model, state, path_known=is_refined))
    scene = _scene_model(tuple(wearers), initial.cameras, start, associated, spreads, path_known=is_refined)
    return FusionSolution(replace(scene, extra=extra, free_keypoints=calibration.estimate_keypoints), start, spreads)


def fuse_finely(
    initial: FusionStart,
    coarse: FusionSolution,
    associated: Sequence[AssociatedCamera],
    frames: Sequence[ImuFrames],
    settings: CommonSettings,
    solver: Solver,
) -> FusionSolution:
    """At the full frame rate, with headings, mountings and mean poses kept.

    The coarse solution has settled how cameras and wearers lie to each other: what is left is fast and small. Moving
    cameras follow the wearers as they are, and then each wearer is refined in front of them, by itself.
    """
    start = fusion_problem_on_frames(initial, coarse, associated, frames, settings)
    model, state = replace(start.model, extra=solver.extra), start.state
    states = list(state.wearers)
    if any(camera.moving and camera.free_pose for camera in model.cameras):
        state = solver.solve(SceneObjective(model, wearers_move=False), state, "full rate, camera")
    if model.extra is not None:  # it may tie wearers to one another
        together = SceneObjective(_with_cameras_held(model))
        return replace(start, model=model, state=solver.solve(together, state, "full rate"))
    for number, wearer in enumerate(model.wearers):
        objective = SceneObjective(_one_wearer(model, number)), replace(state, wearers=(state.wearers[number],))
        refined = solver.solve(*objective, f"full rate, {wearer.name}")
        states[number] = refined.wearers[0]
    return replace(start, model=model, state=replace(state, wearers=tuple(states)))


def fusion_problem_on_frames(
    initial: FusionStart,
    coarse: FusionSolution,
    associated: Sequence[AssociatedCamera],
    frames: Sequence[ImuFrames],
    settings: CommonSettings,
) -> FusionSolution:
    """The problem on each wearer's ``frames``, with headings, mountings and mean poses kept, and where to start."""
    coarse_time, time = coarse.model.wearers[0].frames.time, frames[0].time
    contact = settings.factors.foot_contact
    contact = replace(contact, sigma=settings.fusion.contact_tightening * contact.sigma)
    wearers, states = [], []
    for measured, inertial, solved in zip(frames, initial.wearers, coarse.wearers, strict=True):
        states.append(at_frames(solved.state, coarse_time, time))
        planted = with_foot_contact(with_body_of(inertial.model, solved.model), contact)
        wearers.append(with_contacts(on_frames_with_fixed_calibration(planted, measured), states[-1], True))
    cameras, paths = list[CameraProblem](), list[CameraState]()
    for video, filming, placed in zip(associated, coarse.state.cameras, coarse.placements, strict=True):
        camera = replace(camera_problem(video.camera, time, settings), free_clock=False, focal_sigma=0.0)
        camera = replace(camera, prior_heading=filming.heading)
        if not camera.mounting_sigma < UNKNOWN_MOUNTING_SIGMA:
            camera = replace(camera, prior_R_camera_imu=filming.R_camera_imu)
        cameras.append(camera)
        if len(placed.path) > 1:
            path = placed.path.at(time)
            filming = replace(filming, poses=CameraPoses(path.R_world_camera, path.p_world_camera))
        paths.append(filming)
    scene = SceneState(tuple(states), tuple(paths), coarse.state.detector)
    spreads = coarse.measured_spreads()
    problem = _scene_model(tuple(wearers), cameras, scene, associated, spreads, path_known=True)
    return FusionSolution(problem, scene, spreads)


def _one_wearer(model: SceneProblem, number: int) -> SceneProblem:
    """One wearer before cameras that are kept as they are."""
    views = tuple(views[number : number + 1] for views in model.views)
    return replace(_with_cameras_held(model), wearers=model.wearers[number : number + 1], views=views)


def _with_cameras_held(model: SceneProblem) -> SceneProblem:
    """The cameras as they are: nothing of them moves, and their sensors have nothing more to say."""
    cameras = tuple(
        replace(camera, free_pose=False, imu=None, free_clock=False, focal_sigma=0.0, odometry=None)
        for camera in model.cameras
    )
    return replace(model, cameras=cameras)


def _scene_model(
    wearers: tuple[WearerProblem, ...],
    cameras: Sequence[CameraProblem],
    state: SceneState,
    associated: Sequence[AssociatedCamera],
    spreads: Sequence[Sequence[float]],
    path_known: bool,
) -> SceneProblem:
    """The scene's problem: what each camera saw, put onto the frames."""
    views = tuple(
        _views(wearers, Viewpoint(camera, camera_state, ()), state.wearers, video, spread, path_known)
        for camera, camera_state, video, spread in zip(cameras, state.cameras, associated, spreads, strict=True)
    )
    return SceneProblem(wearers, tuple(cameras), views)


def _views(
    wearers: Sequence[WearerProblem],
    camera: Viewpoint,
    states: Sequence[WearerState],
    video: AssociatedCamera,
    spreads: Sequence[float],
    path_known: bool,
) -> tuple[KeypointView, ...]:
    lens, settings, views = camera.lens, camera.problem.settings, list[KeypointView]()
    keypoints, clock = video.detections.keypoints, (camera.state.clock, camera.state.clock_drift)
    detections = video.detections.timed(estimated_clock(camera.state, camera.problem.clock_middle))
    for number, (wearer, state) in enumerate(zip(wearers, states, strict=True)):
        body = wearer.skeleton
        view = keypoint_view(
            detections,
            video.association.wearer == number,
            body,
            wearer.frames.time,
            image_scale(body, state, camera.state, lens),
            spreads[number],
            settings.reprojection,
            predicted_pixels(keypoints, body, state, camera.state, lens) if path_known else None,
            lens.width,
        )
        if settings.ground_contact.use and not camera.problem.free_pose:
            ground = seen_standing(
                wearer, state, camera.state, keypoints, view, lens, path_known, settings.ground_contact
            )
            view = replace(view, ground=ground)
        views.append(replace(view, clock=clock))
    return tuple(views)


def fuse_in_rounds(
    initial: FusionStart, settings: CommonSettings, solver: Solver
) -> tuple[FusionSolution, tuple[AssociatedCamera, ...]]:
    """The coarse solution, and the association that it was made from.

    Raises:
        SolveError: if the problem is not determined.
    """
    on_progress, associated = solver.progress_of("association"), initial.associated
    solution = fuse(initial, None, associated, settings, solver)
    # Whom no camera shows is not to be found by a guess
    rounds = settings.fusion.rounds if any(video.shows_wearer for video in associated) else 1
    for _ in range(rounds - 1):
        associated = associate_cameras_again(associated, solution.placements, solution.motions, settings, on_progress)
        solution = fuse(initial, solution, associated, settings, solver)
    for _ in range(settings.fusion.refits):
        if not solution.is_consistent():
            solution = fuse(initial, solution, associated, settings, solver)
    solution = _reconsidered(initial, solution, associated, settings, solver)
    return solution, add_unassigned_detections(associated, solution.placements, solution.motions, settings)


def _reconsidered(
    initial: FusionStart,
    solution: FusionSolution,
    associated: Sequence[AssociatedCamera],
    settings: CommonSettings,
    solver: Solver,
) -> FusionSolution:
    """The better of a solution and, if something ended far from where it is likely, of one that began with that held.

    Many frames of one posture may lead a mounting or a hinge's axis from where a single statement had it into another
    valley, from which no way leads back. Where both stand, findings say so.
    """
    cautious = [_with_unlikely_fixed(wearer.model, wearer.state) for wearer in solution.wearers]
    if all(
        cautious_model is wearer_model
        for cautious_model, wearer_model in zip(cautious, solution.model.wearers, strict=True)
    ):
        return solution
    likely = [
        replace(
            wearer,
            model=replace(
                wearer.model, mounting_sigma=cautious_model.mounting_sigma, free_hinges=cautious_model.free_hinges
            ),
        )
        for wearer, cautious_model in zip(initial.wearers, cautious, strict=True)
    ]
    alternative = fuse(replace(initial, wearers=tuple(likely)), None, associated, settings, solver)
    alternative = fuse(initial, alternative, associated, settings, solver)
    (cost, solution_kept), (rival_cost, rival) = sorted(
        ((_cost(candidate, solution), candidate) for candidate in (solution, alternative)), key=lambda pair: pair[0]
    )
    if rival_cost - cost > SETTLED_NATS:
        return solution_kept
    return replace(solution_kept, findings=tuple(_rival_findings(solution_kept, rival, rival_cost - cost)))


def _rival_findings(solution: FusionSolution, rival: FusionSolution, margin: float) -> Iterator[Finding]:
    """List the sensors that two solutions turn by more than 60°; ``margin`` is their difference in nats."""
    for model, wearer, rival_wearer in zip(
        solution.model.wearers, solution.state.wearers, rival.state.wearers, strict=True
    ):
        turned = np.rad2deg(angle_between(wearer.R_bone_sensor, rival_wearer.R_bone_sensor))
        far = {
            sensor: float(by)
            for sensor, by in zip(model.frames.sensors, turned, strict=True)
            if by > np.rad2deg(TURNED)
        }
        if far:
            turns = ", ".join(f"{sensor} by {degrees:.0f}°" for sensor, degrees in far.items())
            reason = (
                f"another calibration, which turns {turns} on their bones, explains the recording only "
                f"{np.exp(margin):.1f} times less well"
            )
            yield Finding("not settled", model.name, subject="how sensors sat", numbers=far, words={"reason": reason})


def _with_unlikely_fixed(model: WearerProblem, state: WearerState) -> WearerProblem:
    """The problem with what is far from likely kept where it began; the same one if nothing is."""
    unlikely = 4.0  # sigmas of its prior: what ends there is a hypothesis
    turned = angle_between(model.prior_R_bone_sensor, state.R_bone_sensor) > TURNED
    axes = np.abs(model.hinge_prior.whitening @ (state.hinges - model.hinge_prior.mean)) > unlikely
    if not (model.free_mountings and turned.any()) and not (model.free_hinges and axes.any()):
        return model
    return replace(model, mounting_sigma=np.where(turned, HELD, model.mounting_sigma), free_hinges=not axes.any())


def _cost(solution: FusionSolution, reference: FusionSolution) -> float:
    """Cost of a solution, with the detection sigmas of another."""
    believed = tuple(
        tuple(
            replace(view, sigma=reference_view.sigma)
            for view, reference_view in zip(views, reference_views, strict=True)
        )
        for views, reference_views in zip(solution.model.views, reference.model.views, strict=True)
    )
    return sum(SceneObjective(replace(solution.model, views=believed)).cost(solution.state).values())
