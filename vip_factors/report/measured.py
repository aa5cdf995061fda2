"""Which joint angles the sensors measured, and which are only what usually goes with the rest of the body."""

from vip_factors.report.material import Wearer

# A joint's angles are between two segments; of the trunk any bone does.
_CHEST = ("spine1", "spine2", "spine3", "left_collar", "right_collar", "neck")
_BETWEEN = {
    "hip": (("pelvis",), ("{}_hip",)),
    "knee": (("{}_hip",), ("{}_knee",)),
    "ankle": (("{}_knee",), ("{}_ankle", "{}_foot")),
    "shoulder": (_CHEST, ("{}_shoulder",)),
    "elbow": (("{}_shoulder",), ("{}_elbow",)),
    "trunk": (("pelvis",), _CHEST),
    "pelvis": (("pelvis",), ("pelvis",)),
}


def bones_with_sensors(wearer: Wearer) -> set[str] | None:
    """Names of the bones that sensors which were used sit on; None if neither recording nor estimate tells."""
    used = set(wearer.estimate.sensors)
    if wearer.recording is not None:
        return {site.bone for site in wearer.recording.placement.sites if site.sensor in used}
    return {one.bone for one in wearer.estimate.sensor_places} or None


def is_measured(bones: set[str] | None, angle: str) -> bool:
    """Whether both segments of an angle, such as ``hip_flexion``, have sensors on both sides; yes if nobody knows."""
    if bones is None:
        return True
    ends = _BETWEEN[angle.partition("_")[0]]
    return all(any(name.format(side) in bones for name in end) for end in ends for side in ("left", "right"))
