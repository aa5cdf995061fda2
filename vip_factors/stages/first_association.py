"""The first association of a scene: from trackers' motions, and from calibrated ones where these do not do."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.associate.hypothesis import Hypotheses, hypotheses, wearer_points
from vip_factors.body.kinematics import Motion
from vip_factors.initialise.camera import Sightings
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.stages.associated_cameras import AssociatedCamera, watch
from vip_factors.stages.decode import motion_of
from vip_factors.stages.inertial import Tracked, calibrated
from vip_factors.stages.solver import Solver

# Of the video frames that show anybody. A tracker whose start is poor finds its wearer in none of them or in three
# quarters, and one in twelve of those may be a stranger; calibrated motions find theirs in nine of ten.
OFTEN_SEEN = 0.9

Seen = tuple[tuple[Tracked, ...], tuple[AssociatedCamera, ...]]


def first_association(
    scene: Scene, wearers: Sequence[Tracked], settings: Settings, solver: Solver
) -> Seen:  # fmt: skip
    """Who is who before each camera, and from where the fusion starts.

    Wearers who are hardly seen are calibrated by the sparse inertial poser, and looked for again. Such a wearer starts
    as the one or the other has it, whichever looks more like whom the cameras saw.

    Args:
        scene: with cameras.
        wearers: as inertially tracked.
        settings: of all rooms.
        solver: of the scene.
    """
    names = [wearer.subject.name for wearer in scene.wearers]
    tell = solver.telling("association")
    first = watch(scene, wearers, _motions(wearers, names), settings, tell)
    poor = [number for number in range(len(wearers)) if share_seen(first, number) < OFTEN_SEEN]
    if not poor or not settings.acceleration:
        return tuple(wearers), first
    better = [_calibrated(one, settings, solver) if number in poor else one for number, one in enumerate(wearers)]
    again = watch(scene, better, _motions(better, names), settings, tell)
    for number in poor:
        again, better[number] = _starting(again, number, better[number], wearers[number], names[number])
    return tuple(better), again


def share_seen(associated: Sequence[AssociatedCamera], wearer: int) -> float:
    """In which share of the video frames that show anybody a wearer was found."""
    shown = sum(len(np.unique(each.detections.frame)) for each in associated)
    found = sum(int(np.sum(each.association.wearer == wearer)) for each in associated)
    return found / max(shown, 1)


def _calibrated(tracked: Tracked, settings: Settings, solver: Solver) -> Tracked:
    """Calibrated, but for the mean pose: that is the fusion's to find."""
    found = calibrated(tracked, settings, solver)
    return replace(found, state=replace(found.state, pose_mean=tracked.state.pose_mean))


def _motions(wearers: Sequence[Tracked], names: Sequence[str]) -> list[Motion]:
    return [motion_of(one.model, one.state, name) for one, name in zip(wearers, names, strict=True)]


def _starting(
    associated: Sequence[AssociatedCamera], number: int, found: Tracked, before: Tracked, name: str
) -> tuple[tuple[AssociatedCamera, ...], Tracked]:
    """A wearer as calibrated or as before, with what the cameras then saw of him."""
    looks = [[_look(each, number, one, name) for each in associated] for one in (found, before)]
    as_found, as_before = (np.concatenate([look.cost for look in each]) for each in looks)
    if not len(as_before) or np.median(as_found) <= np.median(as_before):
        return tuple(associated), found
    changed = []
    for each, look in zip(associated, looks[1], strict=True):
        seen = list(each.seen)
        seen[number] = Sightings(each.detections.time[look.frame], look.R_camera_world, look.p_camera_pelvis)
        changed.append(replace(each, seen=tuple(seen)))
    return tuple(changed), before


def _look(each: AssociatedCamera, number: int, tracked: Tracked, name: str) -> Hypotheses:
    """The hypothesis cameras of a motion for the detections that were given to a wearer."""
    own = each.detections.select(each.association.wearer == number)
    motion = motion_of(tracked.model, tracked.state, name)
    points = wearer_points(motion, own.keypoints, own.time)
    return hypotheses(own, each.camera.model.normalise(own.pixels), [points])
