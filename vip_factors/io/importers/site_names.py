"""Guessing a sensor's site from the name somebody gave it: pelvis_imu, femur_r, LTibia, Right Ankle, hand_left."""

import re

_IGNORED = ("", "imu", "sensor", "offset")  # as in OpenSim's torso_imu_offset_imu
_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_MIDLINE = {
    "pelvis": "pelvis", "hip": "pelvis", "hips": "pelvis", "sacrum": "pelvis", "sacral": "pelvis",
    "lumbar": "lower_back", "lowerback": "lower_back", "sternum": "sternum", "torso": "sternum", "chest": "sternum",
    "thorax": "sternum", "head": "head", "skull": "head", "trunk": "sternum", "upperback": "upper_back",
    "belly": "belly", "abdomen": "belly", "stomach": "belly", "waist": "pelvis",
}  # fmt: skip
_LIMBS = {
    "femur": "thigh", "thigh": "thigh", "upperleg": "thigh", "upleg": "thigh",
    "tibia": "shank", "shank": "shank", "lowerleg": "shank", "lowleg": "shank",
    "ankle": "ankle", "calcn": "foot", "foot": "foot", "toe": "foot", "toes": "foot", "shin": "shank",
    "instep": "foot",
    "humerus": "upper_arm", "upperarm": "upper_arm", "uparm": "upper_arm",
    "radius": "forearm", "ulna": "forearm", "forearm": "forearm", "lowerarm": "forearm", "lowarm": "forearm",
    "wrist": "forearm", "hand": "hand", "handback": "hand", "backofhand": "hand",
    "backhand": "hand", "shoulder": "shoulder", "scapula": "shoulder", "clavicle": "shoulder",
}  # fmt: skip


def site_of_name(name: str) -> str | None:
    """The site of :data:`~vip_factors.sensors.calibration.SITES` that a sensor's name tells, or None."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[LR])(?=[A-Z][a-z])", " ", name)
    words = [word for word in re.split(r"[^a-z]+", spaced.lower()) if word not in _IGNORED]
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


# Two or three letters, as loggers' labels have them. Too short to be believed, but a guess that somebody will look at.
_SHORT_LIMBS = {
    "F": "foot", "FT": "foot", "S": "shank", "SH": "shank", "LL": "shank", "T": "thigh", "TH": "thigh", "UL": "thigh",
    "UA": "upper_arm", "FA": "forearm", "LA": "forearm", "W": "forearm", "H": "hand", "A": "ankle",
}  # fmt: skip
_SHORT_MIDLINE = {
    "SA": "pelvis", "PE": "pelvis", "P": "pelvis", "TR": "sternum", "ST": "sternum", "CH": "sternum", "HE": "head",
    "HD": "head", "LB": "lower_back", "BACK": "upper_back",
}  # fmt: skip


def likely_sites(names: list[str]) -> dict[str, str]:
    """Sites as :func:`default_sites` has them, and for the other names what their letters suggest: LF, RUA, TR."""
    told = default_sites(names)
    for name in names:
        letters = re.sub(r"^[a-z]+(?=[A-Z])", "", name).upper()
        site = _SHORT_MIDLINE.get(letters)
        if site is None and letters[:1] in ("L", "R") and letters[1:] in _SHORT_LIMBS:
            site = f"{_SIDES[letters[0].lower()]}_{_SHORT_LIMBS[letters[1:]]}"
        if site is not None and name not in told and site not in told.values():
            told[name] = site
    return told
