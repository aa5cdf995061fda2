"""Cameras and wearers put into one world: where the fusion starts from."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from vip_factors.body.keypoints import KeypointOffsets
from vip_factors.errors import InputError
from vip_factors.factor_settings import KeypointOffsetSettings
from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import Array, transpose, yaw_of
from vip_factors.initialise.camera import (
    Sightings,
    along_odometry,
    camera_mounting,
    carried_camera,
    filmed_path,
    in_camera_axes,
    moving_camera,
    robust_mean_angle,
    standing_camera,
    together,
    world_turn,
)
from vip_factors.problem.scene import CameraProblem, keypoint_offset_sigmas
from vip_factors.problem.state import CameraPoses, CameraState, DetectorState, SceneState
from vip_factors.sensors.camera import CameraPath, Odometry
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.scene import Camera
from vip_factors.settings import CommonSettings
from vip_factors.stages.association import AssociatedCamera
from vip_factors.stages.drift import middle_time
from vip_factors.stages.inertial import InertialSolution
from vip_factors.stages.inertial_model import with_foot_contact

T = TypeVar("T")


@dataclass(frozen=True)
class FusionStart:
    """Wearers and cameras in one world.

    Attributes:
        wearers: their problems and states.
        cameras: their problems.
        state: of all.
        associated: the same cameras, by the first association.
    """

    wearers: tuple[InertialSolution, ...]
    cameras: tuple[CameraProblem, ...]
    state: SceneState
    associated: tuple[AssociatedCamera, ...]

    def without_camera(self, number: int) -> "FusionStart":
        """Return the start without the camera of a number."""

        def without_number(cameras: Sequence[T]) -> tuple[T, ...]:
            return (*cameras[:number], *cameras[number + 1 :])

        state = replace(self.state, cameras=without_number(self.state.cameras))
        return replace(
            self, cameras=without_number(self.cameras), state=state, associated=without_number(self.associated)
        )


def camera_problem(camera: Camera, time: Array, settings: CommonSettings) -> CameraProblem:
    """Build a camera's part of the problem at the frames ``time`` ``(T,)``."""
    mount = camera.mount
    has_known_pose = camera.known_path is not None
    problem = CameraProblem(
        camera.model,
        camera.moving,
        not has_known_pose,
        free_clock=settings.fusion.estimate_clock,
        clock_middle=middle_time(camera),
        focal_sigma=camera.focal_sigma if settings.calibration.estimate_lens and not has_known_pose else 0.0,
        settings=settings.camera,
        learned_offsets=prior_offsets(camera, settings.camera.keypoint_offset),
        odometry=_odometry(camera, time),
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


def _odometry(camera: Camera, time: Array) -> Odometry | None:
    """The motion along the path that the camera came with, between frames at ``time`` ``(T,)``."""
    path = camera.timed_odometry
    if path is None or not camera.moving or camera.known_path is not None:
        return None
    return Odometry.between(path, time, camera.scale_free_odometry)


def start_fusion(
    associated: Sequence[AssociatedCamera], wearers: Sequence[InertialSolution], settings: CommonSettings
) -> FusionStart:
    """Cameras by the wearers whom they saw, and wearers by the cameras that saw them, in one world.

    That is the world of the cameras of known pose, if there are any; else that of the wearer whom a camera saw most.

    Args:
        associated: that are of use (:func:`~vip_factors.stages.association.usable_cameras`).
        wearers: each in a world of their own.
        settings: of all rooms.
    """
    time = wearers[0].model.frames.time
    world = _World.of(
        associated,
        [_anchored(wearer, [video.camera for video in associated], settings) for wearer in wearers],
        [camera_problem(video.camera, time, settings) for video in associated],
        time,
    )
    world.place_by_known_cameras()
    while (pair := world.next_pair()) is not None:
        world.place_camera(*pair)
    scene = SceneState(
        tuple(wearer.state for wearer in world.wearers),
        tuple(world.states[number] for number in range(len(associated))),
        DetectorState(world.problems[0].prior_offsets.mean),
    )
    return FusionStart(tuple(world.wearers), tuple(world.problems), scene, tuple(world.associated))


@dataclass
class _World:
    """Wearers and cameras on their way into one world.

    Attributes:
        associated: the cameras.
        wearers: in the world, those that are in ``settled``.
        problems: of the cameras.
        seen: of each camera, of each wearer, in the wearer's world.
        time: ``(T,)`` seconds of the frames.
        settled: numbers of the wearers who are in the world.
        paths, states: of the cameras that are in the world, by number.
    """

    associated: list[AssociatedCamera]
    wearers: list[InertialSolution]
    problems: list[CameraProblem]
    seen: list[list[Sightings]]
    time: Array
    settled: set[int] = field(default_factory=set)
    paths: dict[int, CameraPath] = field(default_factory=dict)
    states: dict[int, CameraState] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        associated: Sequence[AssociatedCamera],
        wearers: list[InertialSolution],
        problems: list[CameraProblem],
        time: Array,
    ) -> "_World":
        """Build a world in which no wearer is placed yet."""
        return cls(
            list(associated),
            wearers,
            problems,
            [list(video.sightings) for video in associated],
            time,
        )

    def place_by_known_cameras(self) -> None:
        """Put in the wearers whom cameras of known pose saw."""
        known_cameras = [video for video in self.associated if video.camera.known_path is not None]
        for number in range(len(self.wearers)):
            if any(len(video.sightings[number]) for video in known_cameras):
                look = _sightings_of_known(known_cameras, number)
                self._settle(number, look, is_gauge=False)

    def next_pair(self) -> tuple[int, int] | None:
        """The camera that is put in next, and the wearer by whom: of those that can be, the pair with most sightings.

        Where nobody is settled yet, by any wearer; cameras of known pose go first, then those that stand still.
        """
        unplaced = [number for number in range(len(self.associated)) if number not in self.paths]
        if not unplaced:
            return None
        allowed = self.settled or set(range(len(self.wearers)))

        def preference(pair: tuple[int, int]) -> tuple[bool, bool, int]:
            camera, sightings = self.associated[pair[0]].camera, len(self.seen[pair[0]][pair[1]])
            return camera.known_path is not None, sightings > 0 and not camera.moving, sightings

        return max(((number, wearer) for number in unplaced for wearer in sorted(allowed)), key=preference)

    def place_camera(self, number: int, wearer: int) -> None:
        """Put in a camera by a wearer, and the wearers whom it saw and nobody has put in yet."""
        camera, sightings = self.associated[number].camera, self.seen[number]
        problem = _with_found_mounting(camera, self.problems[number], sightings[wearer])
        path, heading = _first_path(camera, problem, self.wearers[wearer], sightings[wearer], self.time)
        poses, scale = path if len(path) == 1 and not camera.moving else path.at(self.time), 1.0
        if problem.odometry is not None:
            camera = in_camera_axes(camera, poses)
            self.associated[number] = replace(self.associated[number], camera=camera)
            measured_path, odometry = camera.timed_odometry, _odometry(camera, self.time)
            assert measured_path is not None
            assert odometry is not None  # only the axes changed
            path, scale = along_odometry(measured_path, odometry, poses)
            poses, problem = path, replace(problem, odometry=odometry)
        self.problems[number], self.paths[number] = replace(problem, prior_heading=heading), path
        poses_at_frames, mounting = CameraPoses(poses.R_world_camera, poses.p_world_camera), problem.prior_R_camera_imu
        self.states[number] = CameraState(poses_at_frames, heading, mounting, path_scale=float(np.log(scale)))
        for wearer_number in set(range(len(self.wearers))) - self.settled:
            is_gauge = wearer_number == wearer and camera.known_path is None
            if is_gauge and camera.moving and problem.odometry is None:
                self.settled.add(wearer_number)  # the camera was placed by this very path
            else:
                self._settle(wearer_number, (path, sightings[wearer_number]), is_gauge)

    def _settle(self, number: int, look: tuple[CameraPath, Sightings], is_gauge: bool) -> None:
        """Put in a wearer by what a camera in the world saw of him; one whom it never saw stays outside."""
        if not len(look[1]):
            return
        turn = 0.0 if is_gauge else world_turn(*look)
        self.wearers[number] = _placed(self.wearers[number], look, self.time, turn, is_gauge)
        self.settled.add(number)
        for sightings in self.seen:
            sightings[number] = sightings[number].turned(turn)


def _with_found_mounting(camera: Camera, problem: CameraProblem, sightings: Sightings) -> CameraProblem:
    """Estimate the mounting of a camera's IMU from sightings of a wearer, with a wide prior, if none is declared."""
    if problem.imu is None or camera.mount is None or camera.mount.is_declared:
        return problem
    valid, time = problem.imu.orientation_valid[:, 0], problem.imu.time
    inside = (sightings.time >= time[0]) & (sightings.time <= time[-1])
    if not valid.any() or not inside.any():
        return problem
    instants = sightings.time[inside]
    R_world_camera = transpose(sightings.R_camera_world[inside])
    if camera.known_path is not None:
        R_world_camera = camera.known_path.at(instants).R_world_camera
    R_inertial_imu = interpolate_rotations(time[valid], problem.imu.R_inertial_sensor[valid, 0], instants)
    return replace(problem, prior_R_camera_imu=camera_mounting(R_world_camera, R_inertial_imu)[0])


def _sightings_of_known(cameras: Sequence[AssociatedCamera], wearer: int) -> tuple[CameraPath, Sightings]:
    """Sightings of a wearer by the cameras of known pose."""
    looks = [
        (video.camera.known_path, video.sightings[wearer])
        for video in cameras
        if video.camera.known_path is not None and len(video.sightings[wearer])
    ]
    return looks[0] if len(looks) == 1 else together(looks)


def _anchored(inertial: InertialSolution, cameras: Sequence[Camera], settings: CommonSettings) -> InertialSolution:
    """The wearer with looser foot contacts, or without any, if a camera holds the root without them."""
    anchor = any(not camera.moving or camera.known_path is not None for camera in cameras)
    contact, fusion = inertial.model.settings.foot_contact, settings.fusion
    contact = replace(contact, sigma=fusion.contact_loosening * contact.sigma)
    if anchor and not fusion.contacts_with_standing_camera:
        contact = replace(contact, use=False)
    return replace(inertial, model=with_foot_contact(inertial.model, contact))


def _first_path(
    camera: Camera, problem: CameraProblem, inertial: InertialSolution, sightings: Sightings, time: Array
) -> tuple[CameraPath, float]:
    """The camera's path in the first wearer's world (or the known one in its own), and its IMU's heading."""
    if camera.known_path is not None:
        known_path = camera.known_path if not camera.moving else camera.known_path.at(time)
        return known_path, _heading_on(known_path.at(time), problem)
    root = interpolate_points(time, inertial.state.p_world_pelvis, sightings.time)
    if not camera.moving:
        path = standing_camera(sightings, root)
        return path, _heading_on(path.at(time), problem)
    valid, measured = inertial_orientations(problem, len(time))
    if valid.any():
        return carried_camera(sightings, root, time, interpolate_rotations(time[valid], measured, time))
    path = moving_camera(sightings, root, time)
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
    inertial: InertialSolution, look: tuple[CameraPath, Sightings], time: Array, turn: float, is_gauge: bool
) -> InertialSolution:
    """A wearer, turned by an angle in radians, in the world of a camera that saw them."""
    model, state = inertial.model, inertial.state
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
    """Return the prior on a camera's keypoint offsets: estimated before, learned from a file, or its keypoint set's.

    Raises:
        InputError: for a file without the camera's keypoints.
    """
    if camera.keypoint_offsets is not None:
        return camera.keypoint_offsets
    if settings.learned is None:
        sigmas = keypoint_offset_sigmas(settings) * camera.detections.keypoints.offset_spread
        return KeypointOffsets(np.zeros_like(sigmas), sigmas)
    learned, name = settings.learned.by_set, camera.detections.keypoints.name
    if name not in learned:
        raise InputError(
            f"{settings.learned}: has no offsets of '{name}', the keypoints of camera '{camera.name}': it has "
            f"{', '.join(learned) or 'none'}"
        )
    return KeypointOffsets(*(np.array(values, float) for values in learned[name]))
