"""The stages that need nothing but IMUs: which way the wearer faced, the inertial tracker, from coarse to fine."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from vip_factors.assembly.objective import WearerObjective
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.initialise.calibration import InitialCalibration, initial_calibration, known_calibration
from vip_factors.initialise.pose import first_poses
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import ImuFrames, resample, resample_streams
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt
from vip_factors.stages.inertial_model import alone, gauge_sensor, inertial_model, placed_on_floor, walking
from vip_factors.stages.solver import Progress, Solver

# Which way the wearer faces at the start, relative to what the straps say.
FACINGS = np.deg2rad([0, 45, -45, 90, -90, 135, -135, 180])  # the solve itself turns by half a step
FACING_RATE, FACING_FRAMES, FACING_ITERATIONS = 5.0, 150, 4  # Hz; a choice of eight needs no more
FACING_SIGMA = np.deg2rad(45.0)  # of a strap put on by eye: decides where the motion does not


@dataclass(frozen=True)
class Tracked:
    """A wearer's problem and where it stands."""

    model: WearerProblem
    state: WearerState


def inertial_tracker(
    recording: Recording, frames: ImuFrames, settings: Settings, solver: Solver, known: InitialCalibration | None = None
) -> Tracked:
    """Orientations and priors alone, every frame by itself (IT; thesis eq. 4.10); then the root, on standing feet.

    A ``known`` calibration, of earlier frames, spares the guess from straps and the declared pose.
    """
    calibration = known or _facing(recording, first_calibration(recording, frames, settings), settings, solver.tell)
    model = inertial_model(recording, frames, calibration, settings)
    state = solver.solve_wearer(WearerObjective(alone(model)), _start(model, calibration), "inertial tracker")
    model = walking(model, settings.calibration)
    return Tracked(model, placed_on_floor(model, state).with_knots(len(model.heading_knots)))


def inertial_trackers(scene: Scene, time: Array, settings: Settings, solver: Solver) -> tuple[Tracked, ...]:
    """Each wearer of a scene at the instants ``time`` ``(T,)``, alone."""
    return tuple(
        inertial_tracker(
            wearer, resample_streams([wearer.imus[name] for name in wearer.placed], time), settings, solver
        )
        for wearer in scene.wearers
    )


def first_calibration(recording: Recording, frames: ImuFrames, settings: Settings) -> InitialCalibration:
    """Headings and mountings from straps, the declared pose and the motion; or the true ones, if settings say so."""
    if settings.calibration.from_truth:
        if recording.truth is None or recording.truth.calibration is None:
            raise InputError(f"recording '{recording.name}' has no true calibration: leave calibration.from_truth off")
        return known_calibration(frames, dict(recording.truth.calibration))
    body, declared = recording.subject.body(), settings.factors.initial_pose
    pose = None if recording.initial_pose == "none" else declared.pose(recording.initial_pose)
    reference = gauge_sensor([recording.placement.site(name).bone_index for name in frames.sensors])
    return initial_calibration(frames, recording.placement, body, pose, declared.seconds, reference)


def _facing(
    recording: Recording, calibration: InitialCalibration, settings: Settings, tell: Progress
) -> InitialCalibration:
    """Which way the wearer faced in the declared pose: the way in which the motion bends the joints least badly.

    A sensor strapped on back to front would have the wearer walk backwards on knees that bend forwards.
    """
    if calibration.R_world_bone is None:
        return calibration
    start, end = recording.interval
    frames = resample(recording, min(FACING_RATE, FACING_FRAMES / (end - start)))
    least, best = np.inf, calibration
    for number, angle in enumerate(FACINGS):
        tell("facing", number / len(FACINGS))
        turned = calibration.facing(float(angle))
        model = replace(alone(inertial_model(recording, frames, turned, settings)), initial_pose=None)
        solve = replace(settings.solve, max_iterations=FACING_ITERATIONS)
        _, report = levenberg_marquardt(WearerObjective(model), _start(model, turned), solve, "facing")
        cost = sum(report.final_cost.values()) + 0.5 * (wrap_angle(angle) / FACING_SIGMA) ** 2
        if cost < least:
            least, best = cost, turned
    return best


def _start(model: WearerProblem, calibration: InitialCalibration) -> WearerState:
    R = first_poses(model.frames, [sensor.bone for sensor in model.sensors], calibration, model.prior)
    return WearerState(
        R, np.zeros((len(R), 3)), calibration.headings, calibration.R_bone_sensor, model.prior.mean,
        hinges=model.hinge_prior.mean,
    )  # fmt: skip


def at_frames(state: WearerState, time: Array, wanted: Array) -> WearerState:
    """The state's motion, of frames at ``time`` ``(T,)``, at other instants ``(N,)``; the ends are kept beyond it."""
    R = np.stack(
        [interpolate_rotations(time, state.R_parent_child[:, joint], wanted) for joint in range(JOINT_COUNT)], axis=1
    )
    path = make_interp_spline(time, state.p_world_pelvis, k=min(3, len(time) - 1))
    return replace(state, R_parent_child=R, p_world_pelvis=path(np.clip(wanted, time[0], time[-1])))
