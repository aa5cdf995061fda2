"""Where a window of a filmed scene starts: from what calibrates it, and from where the window before has everything."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.problem.state import WearerState
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.frames import ImuFrames
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.sampled import frames_of
from vip_factors.sensors.scene import Camera
from vip_factors.settings import Settings
from vip_factors.stages.associated_cameras import AssociatedCamera
from vip_factors.stages.filming import Filmed, camera_problem, inertial_orientations
from vip_factors.stages.inertial import Tracked, inertial_tracker
from vip_factors.stages.inertial_model import inertial_model, walking
from vip_factors.stages.scene_calibration import Headings, WearerCalibration
from vip_factors.stages.solver import Solver


@dataclass(frozen=True)
class Begin:
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


def begun(
    recording: Recording, sensors: Sequence[str], known: WearerCalibration, begin: Begin, time: Array,
    settings: Settings, solver: Solver,
) -> Tracked:  # fmt: skip
    """A wearer at a window's coarse frames by the sensors alone, where the window before has had him at first.

    Args:
        recording: of the window, with what is known declared.
        sensors: all that are used; some may be silent now.
        known: about the wearer.
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
        tracked = _unmoved(recording, frames, calibration, begin.R_parent_child, settings)
    else:
        tracked = inertial_tracker(recording, frames, settings, solver, calibration)
    model, state = tracked.model, tracked.state
    factors = replace(model.settings, sole=replace(model.settings.sole, thickness=known.sole))
    model = replace(model, settings=factors, prior_headings=begin.headings.at(float(time[0])))
    if model.headings_walk and len(known.drift_deg):
        model = replace(model, heading_drift_deg=known.drift_deg)
    if begin.p_world_pelvis is not None:
        shift = begin.p_world_pelvis - state.p_world_pelvis[0]
        state = replace(state, p_world_pelvis=state.p_world_pelvis + shift)
    return Tracked(model, state)


def _unmoved(
    recording: Recording, frames: ImuFrames, calibration: InitialCalibration, R_parent_child: Array, settings: Settings
) -> Tracked:
    """A wearer in a window in which none of the sensors measured anything: as at its beginning."""
    model, T = inertial_model(recording, frames, calibration, settings), len(frames)
    model = walking(model, settings.calibration)
    state = WearerState(
        np.tile(R_parent_child, (T, 1, 1, 1)), np.zeros((T, 3)), calibration.headings, calibration.R_bone_sensor,
        model.prior.mean, hinges=model.hinge_prior.mean,
    )  # fmt: skip
    return Tracked(model, state.with_knots(len(model.heading_knots)))


def continued(
    filmed: Filmed, trackers: Sequence[Tracked], associated: Sequence[AssociatedCamera], begins: Sequence[Begin],
    settings: Settings,
) -> Filmed:  # fmt: skip
    """The wearers as cameras place them, in a world that is known already.

    Which way their sensors point the frames before say, and not a window's first look. Whom no camera sees for as long
    as the window before knows where he is begins there, and from there goes to where he is seen. Whom none sees either
    at the beginning or at the end walks on his feet, as without a camera: nothing else holds him.
    """
    wearers = []
    for number, (one, tracker, begin) in enumerate(zip(filmed.wearers, trackers, begins, strict=True)):
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
        filmed, wearers=tuple(wearers), state=replace(filmed.state, wearers=tuple(one.state for one in wearers))
    )


def _from_before(tracked: Tracked, p_world_start: Array, seen: Array) -> Tracked:
    """A wearer who begins where the window before has him, and goes to where he is ``seen`` first, if he is."""
    time, p = tracked.model.frames.time, tracked.state.p_world_pelvis
    first = float(seen.min()) if len(seen) else np.inf
    left = np.clip((first - time) / (first - time[0]), 0.0, 1.0) if np.isfinite(first) else np.ones(len(time))
    state = replace(tracked.state, p_world_pelvis=p + left[:, None] * (p_world_start - p[0]))
    return replace(tracked, model=replace(tracked.model, is_gauge=True), state=state)


def unseeing(camera: Camera, path: CameraPath | None, heading: float, time: Array, settings: Settings) -> Camera:
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
