"""Conversion of a solved state to an estimate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import SolveError
from vip_factors.estimate import CameraEstimate, PoseCovariance, WearerEstimate
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.problem.layout import FRAME, ROOT, Layout, Owner, OwnerId
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState, WearerState
from vip_factors.problem.variables import camera_owner
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.camera import CameraPath
from vip_factors.stages.association import AssociatedCamera
from vip_factors.stages.fusion import FusionSolution
from vip_factors.stages.inertial import InertialSolution
from vip_factors.stages.solver import Solver
from vip_factors.terms import acceleration, orientation
from vip_factors.terms.evaluation import ViewEvaluation, WearerEvaluation
from vip_factors.terms.reprojection import reprojection_residual


def decode(
    method: str,
    model: WearerProblem,
    state: WearerState,
    covariance: PoseCovariance | None,
    settings: Mapping[str, str] | None = None,
) -> WearerEstimate:
    """Convert a state to a wearer's estimate."""
    motion, sensors = InertialSolution(model, state).motion, model.frames.sensors
    calibration = {sensor: _calibration(model, state, s) for s, sensor in enumerate(sensors)}
    return WearerEstimate(
        model.name, method, motion, calibration, covariance, residuals(model, state), sensors, settings=settings or {}
    )


def _calibration(model: WearerProblem, state: WearerState, sensor: int) -> SensorCalibration:
    heading, R_bone_sensor = float(wrap_angle(state.headings[sensor])), state.R_bone_sensor[sensor]
    bone = JOINT_NAMES[model.sensors[sensor].bone]
    if not model.headings_drift:
        return SensorCalibration(heading, R_bone_sensor, bone=bone)
    path, steps = state.heading_path[:, sensor], model.restart_steps
    path = heading + path - path[0]
    # Interpolates linearly over a pause
    time = np.insert(model.heading_times, np.repeat(steps + 1, 2), model.restarts.ravel())
    path = np.insert(path, np.repeat(steps + 1, 2), np.stack([path[steps], path[steps + 1]], axis=1).ravel())
    return SensorCalibration(heading, R_bone_sensor, heading_time=time, heading_path=path, bone=bone)


def residuals(model: WearerProblem, state: WearerState) -> dict[str, Array]:
    """Norm of the residual of every sensor in every frame ``(T, S)``, by kind; NaN where nothing is measured."""
    evaluation, frames, settings = WearerEvaluation(0, model, state), model.frames, model.settings
    kinds = dict[str, Array]()
    for terms in orientation.equations(evaluation, slice(0, len(frames))):
        misfit = np.rad2deg(settings.orientation.sigma * terms.norm)
        kinds["orientation_deg"] = np.where(frames.orientation_valid, misfit, np.nan)
    for acceleration_terms in acceleration.equations(evaluation, slice(0, max(len(frames) - 2, 0))):
        misfit = np.full(frames.acceleration_valid.shape, np.nan)
        misfit[1:-1] = settings.acceleration.sigma * acceleration_terms.norm
        kinds["acceleration_m_s2"] = np.where(frames.acceleration_valid, misfit, np.nan)
    return kinds


@dataclass(frozen=True)
class SceneCovariance:
    """Marginal covariance of a scene: poses of wearers, poses of cameras ``(T, 6, 6)``, and shared variables.

    A camera whose pose is fixed has None.
    """

    wearers: tuple[PoseCovariance, ...]
    cameras: tuple[Array | None, ...]
    shared: "SharedCovariance"

    def at(self, frames: np.ndarray) -> "SceneCovariance":
        """Select frames by index ``(n,)``; a static camera has one covariance for all frames."""
        wearers = tuple(
            PoseCovariance(covariance.joints[frames], covariance.root[frames]) for covariance in self.wearers
        )
        cameras = tuple(
            covariance[frames] if covariance is not None and len(covariance) > 1 else covariance
            for covariance in self.cameras
        )
        return SceneCovariance(wearers, cameras, self.shared)


def scene_covariance(model: SceneProblem, state: SceneState, solver: Solver) -> SceneCovariance | None:
    """Compute the covariance of all poses at a solution; None if a variable is not determined."""
    objective, wearers = SceneObjective(model), list[PoseCovariance]()
    layout, progress = objective.layout, solver.progress_of("standard deviations")
    try:
        marginals = objective.linearise(state).marginals(progress)
    except SolveError:
        return None
    for number in range(len(model.wearers)):
        chain = layout.chain_of(OwnerId(Owner.WEARER, number))
        assert chain is not None
        covariance = marginals.chains[chain]  # (T, 75, 75)
        joints = np.stack([covariance[:, c : c + 3, c : c + 3] for c in range(0, ROOT, 3)], axis=1)
        wearers.append(PoseCovariance(joints, covariance[:, ROOT:FRAME, ROOT:FRAME]))
    cameras, shared = list[Array | None](), SharedCovariance(layout, marginals.static)
    for number in range(len(model.cameras)):
        path, pose = layout.chain_of(camera_owner(number)), shared.of(camera_owner(number), "poses")
        cameras.append(marginals.chains[path] if path is not None else None if pose is None else pose[None])
    return SceneCovariance(tuple(wearers), tuple(cameras), shared)


@dataclass(frozen=True)
class SharedCovariance:
    """Covariance ``(s, s)`` of the variables that all frames share; None if the data do not determine them."""

    layout: Layout
    covariance: Array | None

    @classmethod
    def at(cls, model: SceneProblem, state: SceneState) -> "SharedCovariance":
        """Compute the marginals at a solution; costs as much as one iteration."""
        objective = SceneObjective(model)
        if not objective.layout.static_width:
            return cls(objective.layout, np.zeros((0, 0)))
        try:
            return cls(objective.layout, objective.linearise(state).static_covariance())
        except SolveError:
            return cls(objective.layout, None)

    def of(self, owner: OwnerId, block: str) -> Array | None:
        """Covariance ``(c, c)`` of a static block; None if it is no variable or not determined."""
        columns = self.layout.columns(owner, block)
        return None if self.covariance is None or not len(columns) else self.covariance[np.ix_(columns, columns)]

    def sigmas(self, owner: OwnerId, block: str) -> Array | None:
        """Standard deviations ``(c,)`` of a static block; None as in :meth:`of`."""
        covariance = self.of(owner, block)
        return None if covariance is None else np.sqrt(np.diag(covariance))


def decode_wearers(solution: FusionSolution, covariance: SceneCovariance | None) -> tuple[WearerEstimate, ...]:
    """Convert the solution of a scene to an estimate of each wearer."""
    poses = covariance.wearers if covariance is not None else [None] * len(solution.wearers)
    pairs = zip(solution.wearers, poses, strict=True)
    return tuple(decode("VIP", wearer.model, wearer.state, pose_covariance) for wearer, pose_covariance in pairs)


def decode_cameras(
    associated: Sequence[AssociatedCamera], solution: FusionSolution, covariance: SceneCovariance | None
) -> tuple[CameraEstimate, ...]:
    """Convert the solution of a scene to an estimate of each camera that it uses."""
    return tuple(_decode_camera(video, number, solution, covariance) for number, video in enumerate(associated))


def _decode_camera(
    video: AssociatedCamera, number: int, solution: FusionSolution, covariance: SceneCovariance | None
) -> CameraEstimate:
    model, state = solution.model, solution.state
    problem, camera, time = model.cameras[number], state.cameras[number], model.wearers[0].frames.time
    poses, calibration = camera.poses, None
    if problem.imu is not None:
        calibration = SensorCalibration(float(wrap_angle(camera.heading)), camera.R_camera_imu)
    return CameraEstimate(
        video.camera.name,
        problem.model.zoomed(camera.zoom),
        CameraPath(time[: len(poses)], poses.R_world_camera, poses.p_world_camera),
        calibration,
        covariance.cameras[number] if covariance is not None else None,
        reprojection_rms(model, state, number),
        video.camera.clock.corrected(camera.clock, camera.clock_drift, problem.clock_middle),
        wearer_of_detection=video.association.wearer,
    )


def reprojection_rms(model: SceneProblem, state: SceneState, camera: int) -> Array:
    """Root mean square reprojection error of a camera in pixels, ``(T, wearers)``; NaN where not visible."""
    viewpoint, columns = model.viewpoints(state)[camera], []
    poses, offsets = viewpoint.state.at_frames(slice(0, model.frames)), state.detector.keypoint_offsets
    for number, (wearer, wearer_state, view) in enumerate(
        zip(model.wearers, state.wearers, viewpoint.views, strict=True)
    ):
        body = WearerEvaluation(number, wearer, wearer_state)
        evaluation = ViewEvaluation(body, camera_owner(camera), viewpoint.problem, viewpoint.state, view, offsets)
        points = evaluation.points_on(view.body_points).on(evaluation.wearer.body)
        residual, _ = reprojection_residual(points, poses, evaluation.lens, view.pixels)
        squares = np.where(view.seen, np.sum(residual**2, axis=2), 0.0)
        count = view.seen.sum(axis=1)
        columns.append(np.where(count > 0, np.sqrt(squares.sum(axis=1) / np.maximum(count, 1)), np.nan))
    return np.stack(columns, axis=1)


def with_sigmas(estimate: WearerEstimate, number: int, shared: SharedCovariance) -> WearerEstimate:
    """Add the standard deviations of the calibration to a wearer's estimate."""
    owner = OwnerId(Owner.WEARER, number)
    headings, mountings = shared.sigmas(owner, "headings"), shared.sigmas(owner, "R_bone_sensor")
    calibration = {
        sensor: replace(
            sensor_calibration,
            heading_sigma=sensor_calibration.heading_sigma if headings is None else float(headings[s]),
            mounting_sigma=sensor_calibration.mounting_sigma if mountings is None else mountings[3 * s : 3 * s + 3],
        )
        for s, (sensor, sensor_calibration) in enumerate(estimate.calibration.items())
    }
    return replace(estimate, calibration=calibration)


def camera_with_sigmas(estimate: CameraEstimate, number: int, shared: SharedCovariance) -> CameraEstimate:
    """Add the standard deviations of clock, lens and IMU calibration to a camera's estimate."""
    owner, blocks = camera_owner(number), ("clock", "clock_drift", "zoom", "heading", "R_camera_imu")
    clock, drift, zoom, heading, mounting = (shared.sigmas(owner, block) for block in blocks)
    if zoom is not None:
        estimate = replace(estimate, focal_sigma=float(zoom[0]))
    if clock is not None and drift is not None:
        estimate = replace(estimate, clock_sigma=(float(clock[0]), float(drift[0])))
    if heading is None or mounting is None or estimate.calibration is None:
        return estimate
    calibration = replace(estimate.calibration, heading_sigma=float(heading[0]), mounting_sigma=mounting)
    return replace(estimate, calibration=calibration)
