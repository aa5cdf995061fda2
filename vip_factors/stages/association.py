"""The association stage: who is who in what each camera filmed, and which cameras can be used."""

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
from vip_factors.stages.decode import motion_of
from vip_factors.stages.inertial import InertialSolution, calibrated
from vip_factors.stages.solver import Solver


@dataclass(frozen=True)
class AssociatedCamera:
    """One camera's part of a scene.

    Attributes:
        camera: which.
        detections: of it, with times on the recording's clock.
        association: who is who in them.
        seen: the hypothesis cameras of each wearer in the wearer's own world, of the first association.
    """

    camera: Camera
    detections: Detections
    association: Association
    seen: tuple[Sightings, ...]

    @property
    def shows_somebody(self) -> bool:
        """Whether any wearer was found in it."""
        return any(len(one) for one in self.seen)


def associate_cameras(
    scene: Scene, wearers: Sequence[InertialSolution], settings: CommonSettings, on_progress: Callable[[float], None],
    before: Sequence[AssociatedCamera] = (),
) -> tuple[AssociatedCamera, ...]:  # fmt: skip
    """The first association, of each camera by itself: nobody's place in the world is known yet.

    ``before`` is that of the same scene with other motions, if there was one.
    """
    associated, motions = [], [motion_of(one.model, one.state) for one in wearers]
    for number, camera in enumerate(scene.cameras):
        detections = camera.timed_detections
        association = associate(
            detections,
            camera.model,
            motions,
            settings.association,
            gravity_camera=gravity_in_camera(camera, detections.time),
            progress=_share_of_progress(on_progress, number, len(scene.cameras)),
            before=before[number].association if before else None,
        )
        seen = tuple(_sightings(association, number, detections, one) for number, one in enumerate(wearers))
        associated.append(AssociatedCamera(camera, detections, association, seen))
    return tuple(associated)


@dataclass(frozen=True)
class CameraPlacement:
    """Where a camera was in the world of the wearers, as estimated.

    Attributes:
        path: of the camera.
        lens: its intrinsics.
        clock: from the time that its video was supposed to have to the estimated one.
    """

    path: CameraPath
    lens: CameraModel
    clock: VideoClock


def associate_cameras_again(
    associated: Sequence[AssociatedCamera], placements: Sequence[CameraPlacement], motions: Sequence[Motion],
    settings: CommonSettings, on_progress: Callable[[float], None],
) -> tuple[AssociatedCamera, ...]:  # fmt: skip
    """The association of motions in one world, in which each camera has its placement."""
    again = []
    for number, (each, placed) in enumerate(zip(associated, placements, strict=True)):
        detections = each.detections.timed(placed.clock)
        association = associate(
            detections, placed.lens, motions, settings.association, placed.path,
            gravity_in_camera(each.camera, detections.time), _share_of_progress(on_progress, number, len(associated)),
            each.association,
        )  # fmt: skip
        # Bodies have given way to keypoints in a wrong order by now: it is the first association that tells.
        order = [one for one in each.association.findings if one.kind == "keypoint order"]
        findings = tuple(dict.fromkeys((*order, *association.findings)))
        again.append(replace(each, association=replace(association, findings=findings)))
    return tuple(again)


def add_left_over_detections(
    associated: Sequence[AssociatedCamera], placements: Sequence[CameraPlacement], motions: Sequence[Motion],
    settings: CommonSettings,
) -> tuple[AssociatedCamera, ...]:  # fmt: skip
    """Detections that are nobody's added to whom they show by now, in the world of :func:`associate_cameras_again`."""
    again = []
    for each, placed in zip(associated, placements, strict=True):
        detections = each.detections.timed(placed.clock)
        association = add_by_position(
            each.association, detections, placed.lens, motions, placed.path, settings.association
        )
        again.append(replace(each, association=association))
    return tuple(again)


def usable_cameras(associated: Sequence[AssociatedCamera]) -> tuple[AssociatedCamera, ...]:
    """The cameras that have wearers in common, most of the sightings; none if no camera shows a wearer.

    Cameras of known pose have a world in common, and all of them count if one shows somebody.
    """
    worlds = list[list[AssociatedCamera]]()
    for each in associated:
        if each.shows_somebody:
            connected = [world for world in worlds if any(_have_in_common(each, other) for other in world)]
            worlds = [world for world in worlds if not any(world is other for other in connected)]
            worlds.append([each, *(other for world in connected for other in world)])
    if not worlds:
        return ()
    largest = max(worlds, key=lambda world: sum(len(seen) for each in world for seen in each.seen))
    is_known = any(each.camera.known_path is not None for each in largest)
    return tuple(
        each for each in associated
        if any(each is other for other in largest) or (is_known and each.camera.known_path is not None)
    )  # fmt: skip


def _have_in_common(camera: AssociatedCamera, other: AssociatedCamera) -> bool:
    """Whether two cameras are known to be in one world, or show the same wearer."""
    if camera.camera.known_path is not None and other.camera.known_path is not None:
        return True
    return any(len(seen) and len(others) for seen, others in zip(camera.seen, other.seen, strict=True))


def gravity_in_camera(camera: Camera, time: Array) -> Array | None:
    """Which way is down in the camera's frame at the video's instants ``(F, 3)``, by its IMU.

    None without one, or if nobody told how it sits.
    """
    mount = camera.mount
    if mount is None or not mount.is_declared or mount.imu.R_inertial_sensor is None:
        return None
    nearest = np.clip(np.searchsorted(mount.imu.time, time), 0, len(mount.imu) - 1)
    return -mount.imu.R_inertial_sensor[nearest, 2] @ mount.R_camera_imu.T


def _sightings(association: Association, wearer: int, detections: Detections, inertial: InertialSolution) -> Sightings:
    """The hypothesis cameras of one wearer."""
    rows, own = np.flatnonzero(association.wearer == wearer), inertial.model.frames.time
    time = detections.time[detections.frame[rows]]
    inside = (time >= own[0]) & (time <= own[-1])
    rows, time = rows[inside], time[inside]
    R, p = association.R_camera_world[rows], association.p_camera_world[rows]
    root = interpolate_points(own, inertial.state.p_world_pelvis, time)
    return Sightings(time, R, np.einsum("nij,nj->ni", R, root) + p)


def _share_of_progress(on_progress: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    return lambda done: on_progress((number + done) / count)


def first_association(
    scene: Scene, wearers: Sequence[InertialSolution], settings: CommonSettings, solver: Solver
) -> tuple[tuple[InertialSolution, ...], tuple[AssociatedCamera, ...]]:
    """Who is who before each camera, and from where the fusion starts.

    Wearers who are hardly seen are calibrated by the sparse inertial poser, and looked for again. Such a wearer starts
    as the one or the other has it, whichever looks more like whom the cameras saw.

    Args:
        scene: with cameras.
        wearers: as inertially tracked.
        settings: of all rooms.
        solver: of the scene.
    """
    # Of the video frames that show anybody. A tracker whose start is poor finds its wearer in none of them or in three
    # quarters, and one in twelve of those may be a stranger; calibrated motions find theirs in nine of ten.
    often_seen = 0.9
    on_progress = solver.progress_of("association")
    first = associate_cameras(scene, wearers, settings, on_progress)
    poor = [number for number in range(len(wearers)) if share_seen(first, number) < often_seen]
    if not poor or not settings.acceleration:
        return tuple(wearers), first
    better = [_calibrated(one, settings, solver) if number in poor else one for number, one in enumerate(wearers)]
    again = associate_cameras(scene, better, settings, on_progress, first)
    for number in poor:
        again, better[number] = _starting(again, number, better[number], wearers[number])
    return tuple(better), again


def share_seen(associated: Sequence[AssociatedCamera], wearer: int) -> float:
    """In which share of the video frames that show anybody a wearer was found."""
    shown = sum(len(np.unique(each.detections.frame)) for each in associated)
    found = sum(int(np.sum(each.association.wearer == wearer)) for each in associated)
    return found / max(shown, 1)


def _calibrated(inertial: InertialSolution, settings: CommonSettings, solver: Solver) -> InertialSolution:
    """Calibrated, but for the mean pose: that is the fusion's to find."""
    found = calibrated(inertial, settings, solver)
    return replace(found, state=replace(found.state, pose_mean=inertial.state.pose_mean))


def _starting(
    associated: Sequence[AssociatedCamera], number: int, calibrated_one: InertialSolution, before: InertialSolution
) -> tuple[tuple[AssociatedCamera, ...], InertialSolution]:
    """A wearer as calibrated or as before, with what the cameras then saw of him."""
    looks = [[_look(each, number, one) for each in associated] for one in (calibrated_one, before)]
    as_found, as_before = (np.concatenate([look.cost for look in each]) for each in looks)
    if not len(as_before) or np.median(as_found) <= np.median(as_before):
        return tuple(associated), calibrated_one
    changed = []
    for each, look in zip(associated, looks[1], strict=True):
        seen = list(each.seen)
        seen[number] = Sightings(each.detections.time[look.frame], look.R_camera_world, look.p_camera_pelvis)
        changed.append(replace(each, seen=tuple(seen)))
    return tuple(changed), before


def _look(each: AssociatedCamera, number: int, inertial: InertialSolution) -> Hypotheses:
    """The hypothesis cameras of a motion for the detections that were given to a wearer."""
    own = each.detections.select(each.association.wearer == number)
    points = wearer_points(motion_of(inertial.model, inertial.state), own.keypoints, own.time)
    return hypotheses(own, each.camera.model.normalise(own.pixels), [points])
