"""A recording of somebody whose body was found before: the subject gets that skeleton, and the sensors their places."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from vip_factors.body.lengths import STRETCHED, stature_of
from vip_factors.body.skeleton import PARENTS, Skeleton
from vip_factors.errors import InputError
from vip_factors.io.body_file import BodyFile
from vip_factors.io.placement_file import PlacementFile
from vip_factors.sensors.calibration import Placement, SensorSite
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.sensors.scene import Scene


def subject_with(body: BodyFile, given: PlacementFile) -> Subject:
    """The wearer with a body; name and mass are those that were given, if they were."""
    name, stature = given.subject or body.name, stature_of(body.skeleton)
    return Subject(
        name, stature, given.mass_kg, given.sex, skeleton=body.skeleton, length_prior=body.lengths, hinges=body.hinges
    )


def with_body(recording: Recording, body: BodyFile) -> Recording:
    """The recording with the body in the place of what it said of the wearer's; truth and samples stay."""
    before, said = recording.subject, PlacementFile(recording.subject.name, None, recording.subject.mass_kg)
    subject = subject_with(body, replace(said, sex=before.sex))
    return replace(recording, subject=subject, placement=_moved(recording.placement, before.body(), body.skeleton))


def scene_with_body(scene: Scene, body: BodyFile, path: Path) -> Scene:
    """The scene whose wearer of the body's name, or only wearer, has the body, which was read from ``path``.

    Raises:
        InputError: if none of several wearers has that name.
    """
    names = [one.subject.name for one in scene.wearers]
    if len(names) > 1 and body.name not in names:
        raise InputError(
            f"{path} is the body of '{body.name}', scene '{scene.name}' has the wearers {', '.join(names)}: expected "
            "one of them; set its name to the wearer's"
        )
    place = names.index(body.name) if body.name in names else 0
    wearers = tuple(with_body(one, body) if number == place else one for number, one in enumerate(scene.wearers))
    return replace(scene, wearers=wearers)


def _moved(placement: Placement, before: Skeleton, after: Skeleton) -> Placement:
    """Sensors along limbs keep their share of them."""
    return replace(placement, sites=tuple(_moved_site(site, before, after) for site in placement.sites))


def _moved_site(site: SensorSite, before: Skeleton, after: Skeleton) -> SensorSite:
    for child in STRETCHED:
        if PARENTS[child] == site.bone_index:
            old, new = before.p_parent_joint[child], after.p_parent_joint[child]
            share = float(np.clip(site.p_bone_sensor @ old / (old @ old), 0.0, 1.0))
            return replace(site, p_bone_sensor=site.p_bone_sensor + share * (new - old))
    return site
