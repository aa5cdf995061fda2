"""Stages without cameras: the start of headings and mountings, the inertial tracker, and the calibration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from scipy.interpolate import make_interp_spline

from vip_factors.body.joint_priors import joint_vector
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import held_pose
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import interpolate_smoothly
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.calibration import InitialCalibration, first_poses, initial_calibration, known_calibration
from vip_factors.initialise.start_search import Starts
from vip_factors.problem.scene import ExtraTerms
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import ImuFrames, resample_streams
from vip_factors.sensors.recording import Recording, nothing_placed
from vip_factors.sensors.scene import Scene
from vip_factors.settings import CommonSettings
from vip_factors.stages.calibration_start import search_start
from vip_factors.stages.drift import with_estimated_drift
from vip_factors.stages.inertial_model import (
    frame_by_frame,
    gauge_sensor,
    inertial_model,
    place_on_floor,
    with_contacts,
    with_heading_times,
    with_inflated_contact_sigma,
)
from vip_factors.stages.pauses import frames_between_pauses, headings_after_pauses
from vip_factors.stages.solver import Solver

# Beyond a joint's range in most frames, limits contradict the declared pose; the declared pose then takes precedence.
CONTRADICTION = np.deg2rad(60.0)


@dataclass(frozen=True)
class InertialSolution:
    """A wearer's problem, its state, and the result of the search of its start, if any."""

    model: WearerProblem
    state: WearerState
    starts: Starts | None = None

    @property
    def motion(self) -> Motion:
        """The motion at the state."""
        model, state = self.model, self.state
        rate, start = 1 / model.frames.step, float(model.frames.time[0])
        return Motion(model.skeleton, state.R_parent_child, state.p_world_pelvis, rate, start, model.name)


@dataclass(frozen=True)
class WearerStart:
    """Initial headings and mountings of a wearer.

    Attributes:
        time: ``(T,)`` seconds of the frames used.
        calibration: headings and mountings.
        starts: result of the search.
    """

    time: Array
    calibration: InitialCalibration
    starts: Starts

    def matches_frames(self, time: Array) -> bool:
        """Return True if the start was computed on frames at ``time`` ``(T,)``."""
        return len(time) == len(self.time) and bool(np.allclose(time, self.time, rtol=0.0, atol=1e-6))


def inertial_tracker(
    recording: Recording,
    frames: ImuFrames,
    settings: CommonSettings,
    solver: Solver,
    known_calibration: InitialCalibration | None = None,
) -> InertialSolution:
    """Solve orientations and priors frame by frame (IT; thesis eq. 4.10), then place the root by standing feet.

    A ``known_calibration`` from earlier frames replaces the search of the start.
    """
    calibration, starts = (
        (known_calibration, None)
        if known_calibration
        else find_start(recording, frames, settings, solver.progress_of("start"))
    )
    restarts, headings = headings_after_pauses(recording, frames.sensors, calibration, settings)
    model = inertial_model(recording, frames, replace(calibration, headings=headings[0]), settings)
    model = with_heading_times(replace(model, restarts=restarts), settings.calibration)
    middles = restarts.mean(axis=1)
    path = headings[np.r_[0, np.searchsorted(middles, model.heading_times[1:])]]
    by_frame = headings[np.searchsorted(middles, frames.time)] if len(restarts) else headings[0]
    start = start_state(model, calibration.R_bone_sensor, path, by_frame)
    state = solver.solve_wearer(frame_by_frame(model), start, "inertial tracker")
    if model.initial_pose is not None:  # violated limits mean another zero of the joint
        model = replace(model, limits=model.limits.reaching(joint_vector(state.R_parent_child), CONTRADICTION))
    return InertialSolution(model, place_on_floor(model, state), starts)


def inertial_trackers(
    scene: Scene, time: Array, settings: CommonSettings, solver: Solver, known_starts: Sequence[WearerStart | None] = ()
) -> tuple[InertialSolution, ...]:
    """Track each wearer by itself at ``time`` ``(T,)``; ``known_starts`` on the same frames replace the search.

    Raises:
        RecordingError: for a wearer without samples of placed sensors.
    """
    for wearer in scene.wearers:
        if not wearer.placed:
            raise nothing_placed(wearer.name, wearer.imus)
    trackers = []
    for wearer, start in zip_longest(scene.wearers, known_starts):
        frames = resample_streams([wearer.imus[name] for name in wearer.placed], time)
        if start is not None and start.matches_frames(time):
            tracker = inertial_tracker(wearer, frames, settings, solver, start.calibration)
            trackers.append(replace(tracker, starts=start.starts))
        else:
            trackers.append(inertial_tracker(wearer, frames, settings, solver))
    return tuple(trackers)


def calibrate_inertial(
    inertial: InertialSolution, settings: CommonSettings, solver: Solver, extra: ExtraTerms | None = None
) -> InertialSolution:
    """Run the sparse inertial poser on the tracker's frames, with free headings, mountings and mean pose."""
    free, state = with_inflated_contact_sigma(inertial.model), inertial.state
    for _ in range(settings.calibration.passes):
        state = solver.solve_wearer(with_contacts(free, state), state, "calibration", extra)
        free = with_estimated_drift(free, state)
    return replace(inertial, model=with_estimated_drift(inertial.model, state), state=state)


def first_calibration(recording: Recording, frames: ImuFrames, settings: CommonSettings) -> InitialCalibration:
    """Compute headings and mountings from straps, declared pose and motion; or return the true ones, by setting."""
    if settings.calibration.from_truth:
        if recording.truth is None or recording.truth.calibration is None:
            raise InputError(f"recording '{recording.name}' has no true calibration: leave calibration.from_truth off")
        return known_calibration(frames, dict(recording.truth.calibration))
    body, declared = recording.subject.body(), settings.factors.initial_pose
    pose = None if recording.initial_pose == "none" else held_pose(recording.initial_pose, declared.nominal)
    reference = gauge_sensor([recording.placement.site(name).bone_index for name in frames.sensors])
    return initial_calibration(frames, recording.placement, body, pose, declared.seconds, reference)


def find_start(
    recording: Recording,
    frames: ImuFrames,
    settings: CommonSettings,
    on_progress: Callable[[float], None],
    stretch: ImuFrames | None = None,
) -> tuple[InitialCalibration, Starts | None]:
    """Compute the initial headings and mountings; also return the result of the search, in a ``stretch`` if given."""
    frames = frames_between_pauses(recording, frames)
    usual = first_calibration(recording, frames, settings)
    if settings.calibration.from_truth or not settings.calibration.start.search:
        return usual, None
    on_progress(0.0)
    starts = search_start(recording, frames, usual, settings, stretch)
    return (starts.best.calibration if starts else usual), starts


def start_state(
    model: WearerProblem, R_bone_sensor: Array, heading_path: Array, headings_by_frame: Array
) -> WearerState:
    """Initial state of the inertial tracker, with prior means and headings ``(K, S)``; see :func:`_first_poses`."""
    R = _first_poses(model, R_bone_sensor, headings_by_frame)
    return WearerState(
        R,
        np.zeros((len(R), 3)),
        heading_path[0],
        R_bone_sensor,
        model.prior.mean,
        heading_path[1:],
        hinges=model.hinge_prior.mean,
    )


def _first_poses(model: WearerProblem, R_bone_sensor: Array, headings: Array) -> Array:
    """Joint rotations ``(T, 24, 3, 3)`` from mountings and headings, ``(S,)`` or ``(T, S)`` per frame."""
    return first_poses(model.frames, [sensor.bone for sensor in model.sensors], headings, R_bone_sensor, model.prior)


def track_window(model: WearerProblem, shared: WearerState, headings: Array, solver: Solver) -> WearerState:
    """Run the inertial tracker on the frames of a window, with fixed shared variables, and place the root.

    Args:
        model: problem of the window.
        shared: state of the shared variables.
        headings: ``(S,)`` radians, initial values.
        solver: solver of the window.
    """
    R = _first_poses(model, shared.R_bone_sensor, headings)
    state = replace(shared, R_parent_child=R, p_world_pelvis=np.zeros((len(R), 3)))
    state = solver.solve_wearer(frame_by_frame(model), state, "inertial tracker")
    return place_on_floor(model, state)


def at_frames(state: WearerState, time: Array, new_time: Array) -> WearerState:
    """Interpolate a state from frames at ``time`` ``(T,)`` to ``new_time`` ``(N,)``; constant beyond the ends."""
    R = interpolate_smoothly(time, state.R_parent_child, new_time)  # a kink would be an acceleration
    path = make_interp_spline(time, state.p_world_pelvis, k=min(3, len(time) - 1))
    return replace(state, R_parent_child=R, p_world_pelvis=path(np.clip(new_time, time[0], time[-1])))
