"""The pipeline on one page: recording → calibration → inertial tracker → sparse inertial poser → estimate."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from vip_factors.body.calibration_pose import calibration_pose
from vip_factors.body.joint_limits import load_joint_limits
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.pose_prior import load_pose_prior
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, PoseCovariance, SolveReport
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import wrap_angle
from vip_factors.graph.batch import BatchObjective
from vip_factors.graph.decode import decode, pose_covariance
from vip_factors.graph.model import BodyPoint, InertialModel, InitialPose
from vip_factors.graph.state import GraphState
from vip_factors.initialise.calibration import InitialCalibration, initial_calibration, known_calibration
from vip_factors.initialise.pose import first_poses
from vip_factors.initialise.root_path import contact_confidence, contact_points, standing_path
from vip_factors.sensors.frames import ImuFrames, resample
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CalibrationSettings, Settings, flatten
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt
from vip_factors.solve.marginals import chain_marginals

Progress = Callable[[str, float], None]
FEW_SENSORS = 6  # with so few, acceleration is all that some limbs have, and the papers' IT is called SOP
DEFAULT = Settings()
# Which way the wearer faces at the start, relative to what the straps say.
FACINGS = np.deg2rad([0, 45, -45, 90, -90, 135, -135, 180])  # the solve itself turns by half a step
FACING_RATE, FACING_FRAMES, FACING_ITERATIONS = 5.0, 150, 4  # Hz; a choice of eight needs no more
FACING_SIGMA = np.deg2rad(45.0)  # of a strap put on by eye: decides where the motion does not


def smooth(recording: Recording, settings: Settings = DEFAULT, progress: Progress | None = None) -> Estimate:
    """Reconstruct a whole recording from its IMUs.

    First coarsely: the inertial tracker (IT; thesis eq. 4.10) starts the sparse inertial poser (SIP; thesis 3.3) on
    every n-th frame, with headings, mountings and the mean pose free. Then at the full rate, with those kept. The
    acceleration factor is exact at either rate.

    Args:
        recording: with at least one placed sensor.
        settings: of all rooms.
        progress: called with the name of the stage and the fraction of it done.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if the problem is not determined.
    """
    run = _Run(settings, progress or (lambda stage, fraction: None))
    coarse = settings.coarse_factor if settings.acceleration else 1
    frames = resample(recording, settings.frame_rate / coarse)
    calibration = run.face(recording, _first_calibration(recording, frames, settings))
    model = _model(recording, frames, calibration, settings)
    state = run.track(model, _start(model, calibration))
    if not settings.acceleration:
        model = _alone(model)
    else:
        free = _loosened(model, settings.calibration)
        for _ in range(settings.calibration.passes):
            _, state = run.pose(free, state, "calibration")
        model, state = _at_full_rate(recording, settings, model, state)
        model, state = run.pose(model, state, "sparse inertial poser")
    covariance = _covariance(model, state) if settings.covariance else None
    return decode(
        recording.name, _method(model, settings), model, state, covariance, tuple(run.reports), flatten(settings)
    )


@dataclass
class _Run:
    """The solves of one recording, and what they report."""

    settings: Settings
    told: Progress
    reports: list[SolveReport] = field(default_factory=list)

    def face(self, recording: Recording, calibration: InitialCalibration) -> InitialCalibration:
        """Which way the wearer faced in the declared pose: the way in which the motion bends the joints least badly.

        A sensor strapped on back to front would have the wearer walk backwards on knees that bend forwards.
        """
        if calibration.R_world_bone is None:
            return calibration
        start, end = recording.interval
        frames = resample(recording, min(FACING_RATE, FACING_FRAMES / (end - start)))
        least, best = np.inf, calibration
        for number, angle in enumerate(FACINGS):
            self.told("facing", number / len(FACINGS))
            turned = calibration.facing(float(angle))
            model = replace(_alone(_model(recording, frames, turned, self.settings)), initial_pose=None)
            objective, solve = BatchObjective(model), replace(self.settings.solve, max_iterations=FACING_ITERATIONS)
            _, report = levenberg_marquardt(objective, _start(model, turned), solve, "facing")
            cost = sum(report.final_cost.values()) + 0.5 * (wrap_angle(angle) / FACING_SIGMA) ** 2
            if cost < least:
                least, best = cost, turned
        return best

    def track(self, model: InertialModel, state: GraphState) -> GraphState:
        """Orientations and priors alone, every frame by itself; then the root, from the standing foot."""
        alone = replace(model, use_acceleration=False, free_headings=False, free_mountings=False, free_pose_mean=False)
        return _placed_on_floor(model, self._solve(alone, state, "inertial tracker"))

    def pose(self, model: InertialModel, state: GraphState, stage: str) -> tuple[InertialModel, GraphState]:
        """All factors, with the foot contacts that the state shows."""
        model = _with_contacts(model, state)
        return model, self._solve(model, state, stage)

    def _solve(self, model: InertialModel, state: GraphState, stage: str) -> GraphState:
        objective = BatchObjective(model)
        state, report = levenberg_marquardt(
            objective, state, self.settings.solve, stage, lambda done: self.told(stage, done)
        )
        self.reports.append(report)
        return state


def _at_full_rate(
    recording: Recording, settings: Settings, model: InertialModel, state: GraphState
) -> tuple[InertialModel, GraphState]:
    """The model at the full frame rate with headings, mountings and mean pose kept, and where to start from."""
    frames = resample(recording, settings.frame_rate)
    R = np.stack(
        [
            interpolate_rotations(model.frames.time, state.R_parent_child[:, joint], frames.time)
            for joint in range(JOINT_COUNT)
        ],
        axis=1,
    )
    path = make_interp_spline(model.frames.time, state.p_world_pelvis, k=min(3, len(model.frames) - 1))
    p = path(np.clip(frames.time, model.frames.time[0], model.frames.time[-1]))
    fine = replace(
        model, frames=frames, free_headings=False, free_mountings=False, free_pose_mean=False, initial_pose=None
    )
    return fine, replace(state, R_parent_child=R, p_world_pelvis=p)


def _first_calibration(recording: Recording, frames: ImuFrames, settings: Settings) -> InitialCalibration:
    if settings.calibration.from_truth:
        if recording.truth is None or recording.truth.calibration is None:
            raise InputError(f"recording '{recording.name}' has no true calibration: leave calibration.from_truth off")
        return known_calibration(frames, dict(recording.truth.calibration))
    body, seconds = recording.subject.body(), settings.factors.initial_pose.seconds
    reference = _gauge_sensor([recording.placement.site(name).bone_index for name in frames.sensors])
    return initial_calibration(frames, recording.placement, body, recording.initial_pose, seconds, reference)


def _model(
    recording: Recording, frames: ImuFrames, calibration: InitialCalibration, settings: Settings
) -> InertialModel:
    sites = [recording.placement.site(name) for name in frames.sensors]
    declared = recording.initial_pose != "none"
    free = not settings.calibration.from_truth
    pose = calibration_pose(recording.initial_pose) if declared else None
    factors = settings.factors
    if len(sites) <= FEW_SENSORS:
        sparse = replace(factors.acceleration, sigma=factors.acceleration.sparse_sigma)
        factors = replace(factors, acceleration=sparse)
    held = max(1, round(settings.factors.initial_pose.seconds / frames.step))
    return InertialModel(
        skeleton=recording.subject.body(),
        prior=load_pose_prior(),
        limits=load_joint_limits(),
        frames=frames,
        sensors=tuple(BodyPoint(site.bone_index, site.p_bone_sensor) for site in sites),
        prior_headings=calibration.headings,
        heading_sigma=calibration.heading_sigma,
        prior_R_bone_sensor=calibration.R_bone_sensor,
        mounting_sigma=np.array([site.mounting_sigma for site in sites]),
        settings=factors,
        initial_pose=InitialPose(pose, min(held, len(frames))) if pose is not None else None,
        free_headings=free and settings.calibration.estimate_headings,
        free_mountings=free and settings.calibration.estimate_mountings,
        free_pose_mean=True,
        gauge_sensor=_gauge_sensor([site.bone_index for site in sites]),
    )


def _alone(model: InertialModel) -> InertialModel:
    """The model of the inertial tracker: every frame by itself, the calibration kept."""
    return replace(model, use_acceleration=False, free_headings=False, free_mountings=False, free_pose_mean=False)


def _loosened(model: InertialModel, calibration: CalibrationSettings) -> InertialModel:
    """The model for finding headings and mountings: less is believed that is wrong in every frame alike."""
    factors, k = model.settings, calibration.loosening
    sigma = max(calibration.acceleration_sigma, factors.acceleration.sigma)
    loose = replace(
        factors,
        acceleration=replace(factors.acceleration, sigma=sigma),
        foot_contact=replace(factors.foot_contact, sigma=k * factors.foot_contact.sigma),
        pose_prior=replace(factors.pose_prior, scale=factors.pose_prior.scale / k),
        smoothness=replace(factors.smoothness, time=factors.smoothness.time / k),
    )
    return replace(model, settings=loose)


def _gauge_sensor(bones: list[int]) -> int:
    """The sensor whose heading defines the world's: the pelvis's, or the first."""
    return bones.index(0) if 0 in bones else 0


def _start(model: InertialModel, calibration: InitialCalibration) -> GraphState:
    R = first_poses(model.frames, [sensor.bone for sensor in model.sensors], calibration, model.prior)
    return GraphState(R, np.zeros((len(R), 3)), calibration.headings, calibration.R_bone_sensor, model.prior.mean)


def _placed_on_floor(model: InertialModel, state: GraphState) -> GraphState:
    """The state with a root path on which whichever foot stands lowest stands still."""
    body = forward_kinematics(model.skeleton, state.R_parent_child, np.zeros_like(state.p_world_pelvis))
    return replace(state, p_world_pelvis=standing_path(body, contact_points(model.skeleton)))


def _with_contacts(model: InertialModel, state: GraphState) -> InertialModel:
    """The model with the foot contacts that a first motion shows."""
    points = contact_points(model.skeleton) if model.settings.foot_contact.use else ()
    grounded = _placed_on_floor(model, state)  # contact shows in the pose; a path that has drifted would hide it
    body = forward_kinematics(model.skeleton, state.R_parent_child, grounded.p_world_pelvis)
    confidence = contact_confidence(body, points, model.frames.step) if points else np.zeros((len(model.frames), 0))
    return replace(
        model,
        p_world_start=state.p_world_pelvis[0],
        contacts=tuple(BodyPoint(bone, p) for bone, p in points),
        contact_confidence=confidence,
    )


def _method(model: InertialModel, settings: Settings) -> str:
    if settings.acceleration:
        return "SIP"
    return "SOP" if len(model.sensors) <= FEW_SENSORS else "IT"


def _covariance(model: InertialModel, state: GraphState) -> PoseCovariance:
    objective = BatchObjective(model)
    return pose_covariance(objective, chain_marginals(objective.linearise(state)))
