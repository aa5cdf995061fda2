"""Guessing a sensor's site from the name somebody gave it: pelvis_imu, femur_r, LTibia, Right Ankle, hand_left."""

import re

_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_MIDLINE = {
    "pelvis": "pelvis", "hip": "pelvis", "hips": "pelvis", "sacrum": "pelvis", "sacral": "pelvis",
    "lumbar": "lower_back", "lowerback": "lower_back", "sternum": "sternum", "torso": "sternum", "chest": "sternum",
    "thorax": "sternum", "head": "head", "skull": "head",
}  # fmt: skip
_LIMBS = {
    "femur": "thigh", "thigh": "thigh", "upperleg": "thigh", "upleg": "thigh",
    "tibia": "shank", "shank": "shank", "lowerleg": "shank", "lowleg": "shank",
    "ankle": "ankle", "calcn": "foot", "foot": "foot",
    "humerus": "upper_arm", "upperarm": "upper_arm", "uparm": "upper_arm",
    "radius": "forearm", "ulna": "forearm", "forearm": "forearm", "lowerarm": "forearm", "lowarm": "forearm",
    "wrist": "forearm", "hand": "hand", "shoulder": "shoulder", "scapula": "shoulder", "clavicle": "shoulder",
}  # fmt: skip


def site_of_name(name: str) -> str | None:
    """The site of :data:`~vip_factors.sensors.placement.SITES` that a sensor's name tells, or None."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[LR])(?=[A-Z][a-z])", " ", name)
    words = [word for word in re.split(r"[^a-z]+", spaced.lower()) if word not in ("", "imu", "sensor")]
    sides = {_SIDES[word] for word in words if word in _SIDES}
    segment = "".join(word for word in words if word not in _SIDES)
    if not sides:
        return _MIDLINE.get(segment)
    if len(sides) == 1 and segment in _LIMBS:
        return f"{sides.pop()}_{_LIMBS[segment]}"
    return None


def default_sites(names: list[str]) -> dict[str, str]:
    """Sites of the sensors whose names tell one; none where two names tell the same."""
    told = {name: site for name in names if (site := site_of_name(name))}
    return {name: site for name, site in told.items() if list(told.values()).count(site) == 1}
