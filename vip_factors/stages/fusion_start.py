"""Cameras and wearers put into one world: where the fusion starts from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.keypoints import KeypointOffsets
from vip_factors.errors import InputError
from vip_factors.factor_settings import KeypointOffsetSettings
from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import Array, transpose, yaw_of
from vip_factors.initialise.camera import (
    Sightings,
    camera_mounting,
    carried_camera,
    filmed_path,
    moving_camera,
    robust_mean_angle,
    standing_camera,
    together,
    world_turn,
)
from vip_factors.io.keypoint_offsets_file import read_keypoint_offsets
from vip_factors.problem.scene import CameraProblem, Viewpoint, keypoint_offset_sigmas
from vip_factors.problem.state import CameraPoses, CameraState, DetectorState, SceneState
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.scene import Camera
from vip_factors.settings import CommonSettings
from vip_factors.stages.association import AssociatedCamera
from vip_factors.stages.drift import middle_of
from vip_factors.stages.inertial import InertialSolution
from vip_factors.stages.inertial_model import with_foot_contact


@dataclass(frozen=True)
class FusionStart:
    """Wearers and cameras in one world.

    Attributes:
        wearers: their problems and states.
        camera: the first one's problem.
        state: of all.
        further: cameras of known pose, without views yet.
        associated: the cameras that are of use, by the first association.
    """

    wearers: tuple[InertialSolution, ...]
    camera: CameraProblem
    state: SceneState
    further: tuple[Viewpoint, ...]
    associated: tuple[AssociatedCamera, ...]


def camera_problem(camera: Camera, time: Array, settings: CommonSettings) -> CameraProblem:
    """What the camera brings to the problem at the frames ``time`` ``(T,)``."""
    mount = camera.mount
    known = camera.known_path is not None
    problem = CameraProblem(
        camera.model,
        camera.moving,
        not known,
        free_clock=settings.fusion.estimate_clock,
        clock_middle=middle_of(camera),
        focal_sigma=camera.focal_sigma if settings.calibration.estimate_lens and not known else 0.0,
        settings=settings.camera,
        learned_offsets=prior_offsets(camera, settings.camera.keypoint_offset),
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


def start_fusion(
    associated: Sequence[AssociatedCamera], wearers: Sequence[InertialSolution], settings: CommonSettings
) -> FusionStart:
    """The first camera by the wearer it saw most, and the other wearers by that camera.

    Cameras of known pose place the wearers whom they saw before that: their world is the scene's.

    Args:
        associated: that are of use (:func:`~vip_factors.stages.association.usable_cameras`).
        wearers: each in a world of their own.
        settings: of all rooms.
    """
    camera, seen, time = associated[0].camera, list(associated[0].seen), wearers[0].model.frames.time
    problem = camera_problem(camera, time, settings)
    placed = [_anchored(one, [each.camera for each in associated], settings) for one in wearers]
    known = [each for each in associated if each.camera.known_path is not None]
    settled = [number for number in range(len(placed)) if any(len(each.seen[number]) for each in known)]
    for number in settled:
        look = _sightings_of_known(known, number)
        placed[number] = _placed(placed[number], look, time)
        seen[number] = seen[number].turned(world_turn(*look))
    first = max([n for n in settled if len(seen[n])] or range(len(placed)), key=lambda number: len(seen[number]))
    problem = _with_found_mounting(camera, problem, seen[first])
    path, heading = _first_path(camera, problem, placed[first], seen[first], time)
    for number in set(range(len(placed))) - set(settled):
        is_gauge = number == first and camera.known_path is None
        if is_gauge and camera.moving:
            continue  # the camera was placed by this very path
        placed[number] = _placed(placed[number], (path, seen[number]), time, is_gauge)
    poses = path if len(path) == 1 and not camera.moving else path.at(time)
    state = CameraState(CameraPoses(poses.R_world_camera, poses.p_world_camera), heading, problem.prior_R_camera_imu)
    scene = SceneState(tuple(one.state for one in placed), state, DetectorState(problem.prior_offsets.mean))
    further = tuple(_known_viewpoint(each.camera, settings) for each in associated[1:])
    return FusionStart(tuple(placed), replace(problem, prior_heading=heading), scene, further, tuple(associated))


def _with_found_mounting(camera: Camera, problem: CameraProblem, seen: Sightings) -> CameraProblem:
    """How the sensor sits on the camera by what it saw of a wearer, if nobody told; that is hardly believed."""
    if problem.imu is None or camera.mount is None or camera.mount.is_declared:
        return problem
    valid, time = problem.imu.orientation_valid[:, 0], problem.imu.time
    inside = (seen.time >= time[0]) & (seen.time <= time[-1])
    if not valid.any() or not inside.any():
        return problem
    at = seen.time[inside]
    R_world_camera = transpose(seen.R_camera_world[inside])
    if camera.known_path is not None:
        R_world_camera = camera.known_path.at(at).R_world_camera
    R_inertial_imu = interpolate_rotations(time[valid], problem.imu.R_inertial_sensor[valid, 0], at)
    return replace(problem, prior_R_camera_imu=camera_mounting(R_world_camera, R_inertial_imu)[0])


def _sightings_of_known(cameras: Sequence[AssociatedCamera], wearer: int) -> tuple[CameraPath, Sightings]:
    """What the cameras of known pose saw of a wearer."""
    looks = [
        (each.camera.known_path, each.seen[wearer])
        for each in cameras
        if each.camera.known_path is not None and len(each.seen[wearer])
    ]
    return looks[0] if len(looks) == 1 else together(looks)


def _known_viewpoint(camera: Camera, settings: CommonSettings) -> Viewpoint:
    assert camera.known_path is not None
    problem = CameraProblem(camera.model, False, False, settings=settings.camera)
    poses = CameraPoses(camera.known_path.R_world_camera, camera.known_path.p_world_camera)
    return Viewpoint(problem, CameraState(poses), ())


def _anchored(inertial: InertialSolution, cameras: Sequence[Camera], settings: CommonSettings) -> InertialSolution:
    """The wearer with looser foot contacts, or without any, if a camera holds the root without them."""
    anchor = any(not camera.moving or camera.known_path is not None for camera in cameras)
    contact, fusion = inertial.model.settings.foot_contact, settings.fusion
    contact = replace(contact, sigma=fusion.contact_loosening * contact.sigma)
    if anchor and not fusion.contacts_with_standing_camera:
        contact = replace(contact, use=False)
    return replace(inertial, model=with_foot_contact(inertial.model, contact))


def _first_path(
    camera: Camera, problem: CameraProblem, inertial: InertialSolution, seen: Sightings, time: Array
) -> tuple[CameraPath, float]:
    """The camera's path in the first wearer's world (or the known one in its own), and its IMU's heading."""
    if camera.known_path is not None:
        known = camera.known_path if not camera.moving else camera.known_path.at(time)
        return known, _heading_on(known.at(time), problem)
    root = interpolate_points(time, inertial.state.p_world_pelvis, seen.time)
    if not camera.moving:
        path = standing_camera(seen, root)
        return path, _heading_on(path.at(time), problem)
    valid, measured = inertial_orientations(problem, len(time))
    if valid.any():
        return carried_camera(seen, root, time, interpolate_rotations(time[valid], measured, time))
    path = moving_camera(seen, root, time)
    return path, _heading_on(path, problem)


def _heading_on(path: CameraPath, problem: CameraProblem) -> float:
    """The heading of the camera's IMU that fits a path, radians; 0 without one."""
    valid, measured = inertial_orientations(problem, len(path))
    return robust_mean_angle(yaw_of(path.R_world_camera[valid] @ transpose(measured))) if valid.any() else 0.0


def inertial_orientations(problem: CameraProblem, frames: int) -> tuple[np.ndarray, Array]:
    """In which frames ``(T,)`` the camera's IMU gave an orientation, and there ``R_inertial_camera`` ``(n, 3, 3)``."""
    if problem.imu is None:
        return np.zeros(frames, bool), np.zeros((0, 3, 3))
    valid = problem.imu.orientation_valid[:, 0]
    return valid, problem.imu.R_inertial_sensor[valid, 0] @ transpose(problem.prior_R_camera_imu)


def _placed(
    inertial: InertialSolution, look: tuple[CameraPath, Sightings], time: Array, is_gauge: bool = False
) -> InertialSolution:
    """A wearer in the world of a camera that saw them; one that was never seen stays in their own."""
    model, state = inertial.model, inertial.state
    if not len(look[1]):
        return inertial
    turn = 0.0 if is_gauge else world_turn(*look)
    state = state.turned(turn)
    state = replace(state, p_world_pelvis=filmed_path(*look, state.p_world_pelvis, time))
    model = replace(
        model,
        is_gauge=is_gauge,
        prior_headings=model.prior_headings + turn,
        p_world_start=state.p_world_pelvis[0],
    )
    return replace(inertial, model=model, state=state)


def prior_offsets(camera: Camera, settings: KeypointOffsetSettings) -> KeypointOffsets:
    """What was found of a camera's detector before, or learnt of others where a file is named; else its family's.

    Raises:
        FileFormatError, InputError: for a file that is none, or knows nothing of the camera's keypoints.
    """
    if camera.keypoint_offsets is not None:
        return camera.keypoint_offsets
    if settings.learned is None:
        sigmas = keypoint_offset_sigmas(settings) * camera.detections.keypoints.offset_spread
        return KeypointOffsets(np.zeros_like(sigmas), sigmas)
    learned, name = read_keypoint_offsets(settings.learned), camera.detections.keypoints.name
    if name not in learned:
        raise InputError(
            f"{settings.learned}: has no offsets of '{name}', the keypoints of camera '{camera.name}': it has "
            f"{', '.join(learned) or 'none'}"
        )
    return learned[name]
