"""Camera and wearers put into one world: where the fusion starts from."""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.associate.associate import Association
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, transpose, yaw_of
from vip_factors.graph.scene_model import CameraProblem
from vip_factors.graph.scene_state import CameraState, SceneState
from vip_factors.initialise.camera import (
    Sightings,
    carried_camera,
    filmed_path,
    moving_camera,
    robust_mean_angle,
    standing_camera,
    world_turn,
)
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.scene import Camera
from vip_factors.settings import Settings
from vip_factors.stages.inertial import Tracked


@dataclass(frozen=True)
class Filmed:
    """Wearers and camera in one world.

    Attributes:
        wearers: their problems and states.
        camera: its problem.
        state: of all.
    """

    wearers: tuple[Tracked, ...]
    camera: CameraProblem
    state: SceneState


def camera_problem(camera: Camera, time: Array, settings: Settings) -> CameraProblem:
    """What the camera brings to the problem at the frames ``time`` ``(T,)``."""
    mount = camera.mount
    known = camera.known_path is not None
    problem = CameraProblem(
        camera.model, camera.moving, not known, free_clock=settings.fusion.estimate_clock, settings=settings.camera
    )
    if mount is None or mount.imu.R_inertial_sensor is None or not settings.fusion.camera_imu:
        return problem
    return replace(
        problem,
        imu=resample_streams([mount.imu], time),
        p_camera_imu=mount.p_camera_imu,
        prior_R_camera_imu=mount.R_camera_imu,
        mounting_sigma=mount.mounting_sigma,
    )


def sightings(association: Association, wearer: int, detections: Detections, tracked: Tracked) -> Sightings:
    """The hypothesis cameras of one wearer."""
    rows = np.flatnonzero(association.wearer == wearer)
    time, pelvis = detections.time[detections.frame[rows]], tracked.state.p_world_pelvis
    inside = (time >= tracked.model.frames.time[0]) & (time <= tracked.model.frames.time[-1])
    rows, time = rows[inside], time[inside]
    R, p = association.R_camera_world[rows], association.p_camera_world[rows]
    root = _at(pelvis, tracked.model.frames.time, time)
    return Sightings(time, R, np.einsum("nij,nj->ni", R, root) + p)


def start_filming(
    camera: Camera, wearers: tuple[Tracked, ...], seen: tuple[Sightings, ...], settings: Settings
) -> Filmed:
    """The camera by the wearer it saw most, and the other wearers by that camera."""
    time = wearers[0].model.frames.time
    problem = camera_problem(camera, time, settings)
    first = int(np.argmax([len(one) for one in seen]))
    path, heading = _first_path(camera, problem, wearers[first], seen[first], time)
    placed = []
    for number, (tracked, one) in enumerate(zip(wearers, seen, strict=True)):
        is_gauge = number == first and camera.known_path is None
        placed.append(_placed(_anchored(tracked, camera, settings), one, path, time, is_gauge, camera.moving))
    poses = path if len(path) == 1 and not camera.moving else path.at(time)
    state = CameraState(CameraPoses(poses.R_world_camera, poses.p_world_camera), heading, problem.prior_R_camera_imu)
    scene = SceneState(tuple(one.state for one in placed), state)
    return Filmed(tuple(placed), replace(problem, prior_heading=heading), scene)


def _anchored(tracked: Tracked, camera: Camera, settings: Settings) -> Tracked:
    """The wearer with looser foot contacts, or without any, if the camera holds the root without them."""
    anchor = not camera.moving or camera.known_path is not None
    factors, fusion = tracked.model.settings, settings.fusion
    contact = replace(factors.foot_contact, sigma=fusion.contact_loosening * factors.foot_contact.sigma)
    if anchor and not fusion.contacts_with_standing_camera:
        contact = replace(contact, use=False)
    loose = replace(factors, foot_contact=contact)
    return replace(tracked, model=replace(tracked.model, settings=loose))


def _first_path(
    camera: Camera, problem: CameraProblem, tracked: Tracked, seen: Sightings, time: Array
) -> tuple[CameraPath, float]:
    """The camera's path in the first wearer's world (or the known one in its own), and its IMU's heading."""
    if camera.known_path is not None:
        known = camera.known_path if not camera.moving else camera.known_path.at(time)
        return known, _heading_on(known.at(time), problem)
    root = _at(tracked.state.p_world_pelvis, time, seen.time)
    if not camera.moving:
        path = standing_camera(seen, root)
        return path, _heading_on(path.at(time), problem)
    valid, measured = _inertial_orientations(problem, len(time))
    if valid.any():
        return carried_camera(seen, root, time, interpolate_rotations(time[valid], measured, time))
    path = moving_camera(seen, root, time)
    return path, _heading_on(path, problem)


def _heading_on(path: CameraPath, problem: CameraProblem) -> float:
    """The heading of the camera's IMU that fits a path, radians; 0 without one."""
    valid, measured = _inertial_orientations(problem, len(path))
    return robust_mean_angle(yaw_of(path.R_world_camera[valid] @ transpose(measured))) if valid.any() else 0.0


def _inertial_orientations(problem: CameraProblem, frames: int) -> tuple[np.ndarray, Array]:
    """In which frames ``(T,)`` the camera's IMU gave an orientation, and there ``R_inertial_camera`` ``(n, 3, 3)``."""
    if problem.imu is None:
        return np.zeros(frames, bool), np.zeros((0, 3, 3))
    valid = problem.imu.orientation_valid[:, 0]
    return valid, problem.imu.R_inertial_sensor[valid, 0] @ transpose(problem.prior_R_camera_imu)


def _placed(tracked: Tracked, seen: Sightings, path: CameraPath, time: Array, is_gauge: bool, moving: bool) -> Tracked:
    """A wearer in the camera's world; one that was never seen stays in their own."""
    model, state = tracked.model, tracked.state
    if not len(seen):
        return tracked
    if is_gauge and moving:
        return tracked  # the camera was placed by this very path
    turn = 0.0 if is_gauge else world_turn(path, seen)
    state = state.turned(turn)
    state = replace(state, p_world_pelvis=filmed_path(path, seen, state.p_world_pelvis, time))
    model = replace(
        model,
        is_gauge=is_gauge,
        prior_headings=model.prior_headings + turn,
        p_world_start=state.p_world_pelvis[0],
    )
    return Tracked(model, state)


def _at(p: Array, time: Array, wanted: Array) -> Array:
    return np.stack([np.interp(wanted, time, column) for column in p.T], axis=1).reshape(-1, 3)
