"""The association stage: which detection is which wearer in each camera, and which cameras can be used."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.associate.associate import Association, add_by_position, associate
from vip_factors.associate.hypothesis import Hypotheses, hypotheses, wearer_points
from vip_factors.body.kinematics import Motion
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.camera import Sightings
from vip_factors.sensors.camera import CameraModel, CameraPath, VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.settings import CommonSettings
from vip_factors.stages.inertial import InertialSolution, calibrate_inertial
from vip_factors.stages.solver import Solver


@dataclass(frozen=True)
class AssociatedCamera:
    """A camera with its detections assigned to wearers.

    Attributes:
        camera: the camera of the scene.
        detections: its detections, with times on the recording's clock.
        association: the wearer of each detection.
        sightings: hypothesis cameras of each wearer in the wearer's own world, from the first association.
    """

    camera: Camera
    detections: Detections
    association: Association
    sightings: tuple[Sightings, ...]

    @property
    def shows_wearer(self) -> bool:
        """True if the camera shows any wearer."""
        return any(len(sightings) for sightings in self.sightings)


def associate_cameras(
    scene: Scene,
    wearers: Sequence[InertialSolution],
    settings: CommonSettings,
    on_progress: Callable[[float], None],
    previous: Sequence[AssociatedCamera] = (),
) -> tuple[AssociatedCamera, ...]:
    """Associate each camera by itself, before positions in a common world are known.

    ``previous`` is an earlier association of the same scene with other motions, if any.
    """
    associated, motions = [], [wearer.motion for wearer in wearers]
    for number, camera in enumerate(scene.cameras):
        detections = camera.timed_detections
        association = associate(
            detections,
            camera.model,
            motions,
            settings.association,
            gravity_camera=gravity_in_camera(camera, detections.time),
            progress=_share_of_progress(on_progress, number, len(scene.cameras)),
            previous=previous[number].association if previous else None,
        )
        sightings = tuple(_sightings(association, number, detections, wearer) for number, wearer in enumerate(wearers))
        associated.append(AssociatedCamera(camera, detections, association, sightings))
    return tuple(associated)


@dataclass(frozen=True)
class CameraPlacement:
    """Estimated pose, lens and clock of a camera in the world of the wearers.

    Attributes:
        path: poses of the camera.
        lens: its intrinsics.
        clock: correction from the nominal to the estimated time of its video.
    """

    path: CameraPath
    lens: CameraModel
    clock: VideoClock


def associate_cameras_again(
    associated: Sequence[AssociatedCamera],
    placements: Sequence[CameraPlacement],
    motions: Sequence[Motion],
    settings: CommonSettings,
    on_progress: Callable[[float], None],
) -> tuple[AssociatedCamera, ...]:
    """Associate all cameras with motions in one world, given the placement of each camera."""
    updated = []
    for number, (video, placement) in enumerate(zip(associated, placements, strict=True)):
        detections = video.detections.timed(placement.clock)
        association = associate(
            detections,
            placement.lens,
            motions,
            settings.association,
            placement.path,
            gravity_in_camera(video.camera, detections.time),
            _share_of_progress(on_progress, number, len(associated)),
            video.association,
        )
        # Bodies have adapted to a wrong order of keypoints by now; only the first association reveals it.
        order = [finding for finding in video.association.findings if finding.kind == "keypoint order"]
        findings = tuple(dict.fromkeys((*order, *association.findings)))
        updated.append(replace(video, association=replace(association, findings=findings)))
    return tuple(updated)


def add_unassigned_detections(
    associated: Sequence[AssociatedCamera],
    placements: Sequence[CameraPlacement],
    motions: Sequence[Motion],
    settings: CommonSettings,
) -> tuple[AssociatedCamera, ...]:
    """Assign detections without a wearer by position, in the world of :func:`associate_cameras_again`."""
    updated = []
    for video, placement in zip(associated, placements, strict=True):
        detections = video.detections.timed(placement.clock)
        association = add_by_position(
            video.association, detections, placement.lens, motions, placement.path, settings.association
        )
        updated.append(replace(video, association=association))
    return tuple(updated)


def usable_cameras(associated: Sequence[AssociatedCamera]) -> tuple[AssociatedCamera, ...]:
    """Return the cameras that common wearers connect, with the most sightings; empty if no camera shows a wearer.

    Cameras of known pose share a world: all of them are used if one of them shows a wearer.
    """
    worlds = list[list[AssociatedCamera]]()
    for camera in associated:
        if camera.shows_wearer:
            connected = [world for world in worlds if any(_are_connected(camera, member) for member in world)]
            worlds = [world for world in worlds if not any(world is component for component in connected)]
            worlds.append([camera, *(member for world in connected for member in world)])
    if not worlds:
        return ()
    largest = max(worlds, key=lambda world: sum(len(sightings) for camera in world for sightings in camera.sightings))
    is_posed = any(camera.camera.known_path is not None for camera in largest)
    return tuple(
        camera
        for camera in associated
        if any(camera is member for member in largest) or (is_posed and camera.camera.known_path is not None)
    )


def _are_connected(camera_a: AssociatedCamera, camera_b: AssociatedCamera) -> bool:
    """Return True if both cameras have known poses, or both show the same wearer."""
    if camera_a.camera.known_path is not None and camera_b.camera.known_path is not None:
        return True
    pairs = zip(camera_a.sightings, camera_b.sightings, strict=True)
    return any(len(sightings_a) and len(sightings_b) for sightings_a, sightings_b in pairs)


def gravity_in_camera(camera: Camera, time: Array) -> Array | None:
    """Direction of gravity in the camera's frame at the video's instants ``(F, 3)``, measured by its IMU.

    None without an IMU or without its declared mounting.
    """
    mount = camera.mount
    if mount is None or not mount.is_declared or mount.imu.R_inertial_sensor is None:
        return None
    nearest = np.clip(np.searchsorted(mount.imu.time, time), 0, len(mount.imu) - 1)
    return -mount.imu.R_inertial_sensor[nearest, 2] @ mount.R_camera_imu.T


def _sightings(association: Association, wearer: int, detections: Detections, inertial: InertialSolution) -> Sightings:
    """Hypothesis cameras of a wearer, relative to the wearer's pelvis."""
    rows, frame_times = np.flatnonzero(association.wearer == wearer), inertial.model.frames.time
    time = detections.time[detections.frame[rows]]
    inside = (time >= frame_times[0]) & (time <= frame_times[-1])
    rows, time = rows[inside], time[inside]
    R, p = association.R_camera_world[rows], association.p_camera_world[rows]
    root = interpolate_points(frame_times, inertial.state.p_world_pelvis, time)
    return Sightings(time, R, np.einsum("nij,nj->ni", R, root) + p)


def _share_of_progress(on_progress: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    return lambda done: on_progress((number + done) / count)


def first_association(
    scene: Scene, wearers: Sequence[InertialSolution], settings: CommonSettings, solver: Solver
) -> tuple[tuple[InertialSolution, ...], tuple[AssociatedCamera, ...]]:
    """Associate each camera by itself and choose the motions from which the fusion starts.

    Wearers that are rarely recognised are calibrated by the sparse inertial poser and associated again. The motion that
    fits the detections better, before or after, is kept.
    """
    # Share of the video frames with detections: calibrated motions reach 0.9; motions from a poor start at most 0.75.
    least_share = 0.9
    on_progress = solver.progress_of("association")
    associated = associate_cameras(scene, wearers, settings, on_progress)
    rare = [number for number in range(len(wearers)) if visible_share(associated, number) < least_share]
    if not rare or not settings.acceleration:
        return tuple(wearers), associated
    solutions = list(wearers)
    for number in rare:
        calibrated, pose_mean = calibrate_inertial(wearers[number], settings, solver), wearers[number].state.pose_mean
        # The fusion estimates the mean pose
        solutions[number] = replace(calibrated, state=replace(calibrated.state, pose_mean=pose_mean))
    associated = associate_cameras(scene, solutions, settings, on_progress, associated)
    for number in rare:
        associated, solutions[number] = _better_start(associated, number, solutions[number], wearers[number])
    return tuple(solutions), associated


def visible_share(associated: Sequence[AssociatedCamera], wearer: int) -> float:
    """Share of the video frames with detections in which a wearer is recognised."""
    frame_count = sum(len(np.unique(camera.detections.frame)) for camera in associated)
    sighting_count = sum(int(np.sum(camera.association.wearer == wearer)) for camera in associated)
    return sighting_count / max(frame_count, 1)


def _better_start(
    associated: Sequence[AssociatedCamera], number: int, recalibrated: InertialSolution, previous: InertialSolution
) -> tuple[tuple[AssociatedCamera, ...], InertialSolution]:
    """Choose between two solutions of a wearer by how well they fit the detections, and update the sightings."""
    recalibrated_fits = [_hypothesis_cameras(camera, number, recalibrated) for camera in associated]
    previous_fits = [_hypothesis_cameras(camera, number, previous) for camera in associated]
    recalibrated_cost = np.concatenate([fit.cost for fit in recalibrated_fits])
    previous_cost = np.concatenate([fit.cost for fit in previous_fits])
    if not len(previous_cost) or np.median(recalibrated_cost) <= np.median(previous_cost):
        return tuple(associated), recalibrated
    updated = []
    for camera, fit in zip(associated, previous_fits, strict=True):
        sightings = list(camera.sightings)
        sightings[number] = Sightings(camera.detections.time[fit.frame], fit.R_camera_world, fit.p_camera_pelvis)
        updated.append(replace(camera, sightings=tuple(sightings)))
    return tuple(updated), previous


def _hypothesis_cameras(camera: AssociatedCamera, number: int, inertial: InertialSolution) -> Hypotheses:
    """Hypothesis cameras of a motion for the detections assigned to a wearer."""
    detections = camera.detections.select(camera.association.wearer == number)
    points = wearer_points(inertial.motion, detections.keypoints, detections.time)
    return hypotheses(detections, camera.camera.model.normalise(detections.pixels), [points])
