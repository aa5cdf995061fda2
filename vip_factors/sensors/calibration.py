"""Placement of sensors on the body, and their estimated calibration: headings and mountings."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton, joint_index
from vip_factors.display import Summarised
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class SensorCalibration:
    """Heading and mounting of one sensor.

    Attributes:
        heading: γ in radians, ``R_world_inertial = rotation_z(γ)``; the first value if it drifts.
        R_bone_sensor: ``(3, 3)`` mounting.
        heading_sigma: standard deviation in radians, NaN if not estimated.
        mounting_sigma: ``(3,)`` standard deviations in radians about the sensor's axes, NaN if not estimated.
        heading_time, heading_path: ``(n,)`` seconds and ``(n,)`` radians (not wrapped) of a drifting heading, linear in
            between; empty if it is constant.
        bone: name of the sensor's bone; empty if unknown, or if the sensor is on a camera.
    """

    heading: float
    R_bone_sensor: Array
    heading_sigma: float = float("nan")
    mounting_sigma: Array = field(default_factory=lambda: np.full(3, np.nan))
    heading_time: Array = field(default_factory=lambda: np.zeros(0))
    heading_path: Array = field(default_factory=lambda: np.zeros(0))
    bone: str = ""

    def heading_at(self, time: Array) -> Array:
        """Headings in radians at instants in seconds; constant beyond the ends of the path."""
        if len(self.heading_path) == 0:
            return np.full(np.shape(time), self.heading)
        return np.interp(time, self.heading_time, self.heading_path)


Calibration = Mapping[str, SensorCalibration]
"""Calibrations by sensor name."""


CARELESS_MOUNTING_SIGMA = np.deg2rad(15.0)  # from a calibration pose held by eye: 10–15° (thesis 4.4.2)
STRAPPED_MOUNTING_SIGMA = np.deg2rad(40.0)  # of a sensor strapped on roughly as declared, without a pose

# Bone axes; at rest they are alike for all bones.
_DIRECTIONS = {
    "left": (1, 0, 0),
    "right": (-1, 0, 0),
    "up": (0, 1, 0),
    "down": (0, -1, 0),
    "front": (0, 0, 1),
    "back": (0, 0, -1),
}
_SIDES = {name: f"{name} side" for name in ("left", "right")} | {"up": "upper side", "down": "lower side"}


@dataclass(frozen=True)
class SensorSite:
    """One sensor on one bone.

    Attributes:
        sensor: name in the recording.
        bone: SMPL joint name of the bone.
        p_bone_sensor: ``(3,)`` metres, position in the bone's frame.
        R_bone_sensor: ``(3, 3)`` rough mounting.
        mounting_sigma: standard deviation in radians of the rough mounting about each axis.
    """

    sensor: str
    bone: str
    p_bone_sensor: Array
    R_bone_sensor: Array
    mounting_sigma: float = STRAPPED_MOUNTING_SIGMA

    def __post_init__(self) -> None:
        object.__setattr__(self, "bone", JOINT_NAMES[joint_index(self.bone)])
        if not np.all(np.isfinite(self.p_bone_sensor)) or np.shape(self.p_bone_sensor) != (3,):
            raise InputError(f"sensor '{self.sensor}': position {self.p_bone_sensor}: expected three finite metres")
        R = self.R_bone_sensor
        if not (np.abs(R @ R.T - np.eye(3)).max() <= 1e-3 and np.linalg.det(R) > 0):
            raise InputError(f"sensor '{self.sensor}': its mounting is not a rotation matrix")
        if not self.mounting_sigma > 0:
            raise InputError(f"sensor '{self.sensor}': mounting sigma {self.mounting_sigma}: expected radians above 0")

    @property
    def bone_index(self) -> int:
        """Index of the bone in :data:`~vip_factors.body.skeleton.JOINT_NAMES`."""
        return joint_index(self.bone)


@dataclass(frozen=True, repr=False)
class Placement(Summarised):
    """All sensors of one wearer; ``name`` is the preset's or ``"custom"``."""

    sites: tuple[SensorSite, ...] = ()
    name: str = "custom"

    def __post_init__(self) -> None:
        names = [site.sensor for site in self.sites]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"sensor '{twice[0]}' is placed twice: give each sensor one bone")

    def site(self, sensor: str) -> SensorSite:
        """Return the site of a sensor.

        Raises:
            InputError: if the sensor is not placed.
        """
        for site in self.sites:
            if site.sensor == sensor:
                return site
        sensors = ", ".join(site.sensor for site in self.sites) or "none"
        raise InputError(f"sensor '{sensor}' has no place on the body: placed are {sensors}")


@dataclass(frozen=True)
class NamedSite:
    """Usual site of a sensor, in proportions, so that it fits any skeleton.

    Convention: the sensor's x axis points along ``x_axis`` (towards the trunk, or up), its z axis away from the skin,
    along ``outward``.
    """

    bone: str
    child: str | None  # the joint at the bone's far end; None for bones without one
    along: float  # fraction of the way from the bone's joint to the child
    outward: str
    depth: float  # distance of the sensor from the bone's axis, as a fraction of stature
    x_axis: str
    lift: float = 0.0  # shift along the bone's y axis, as a fraction of stature


def _both_sides(name: str, site: NamedSite) -> dict[str, NamedSite]:
    """Return a left site and its mirror image on the right."""

    def mirror(word: str) -> str:
        return {"left": "right", "right": "left"}.get(word, word.replace("left_", "right_"))

    words = {key: mirror(getattr(site, key) or "") for key in ("bone", "child", "outward", "x_axis")}
    return {f"left_{name}": site, f"right_{name}": replace(site, **words)}  # type: ignore[arg-type]


# Depths are rough radii of the segment with skin and sensor box, from girths in Winter's and de Leva's subjects.
SITES: dict[str, NamedSite] = {
    "head": NamedSite("head", None, 0.0, "back", 0.055, "up", lift=0.050),
    "sternum": NamedSite("spine3", "neck", 0.35, "front", 0.065, "up"),
    "upper_back": NamedSite("spine3", "neck", 0.20, "back", 0.065, "up"),
    "pelvis": NamedSite("pelvis", None, 0.0, "back", 0.060, "up"),
    "belly": NamedSite("pelvis", None, 0.0, "front", 0.060, "up"),
    "lower_back": NamedSite("spine1", "spine2", 0.5, "back", 0.055, "up"),
    **_both_sides("shoulder", NamedSite("left_collar", "left_shoulder", 0.6, "back", 0.045, "up")),
    **_both_sides("upper_arm", NamedSite("left_shoulder", "left_elbow", 0.6, "back", 0.027, "right")),
    **_both_sides("forearm", NamedSite("left_elbow", "left_wrist", 0.85, "up", 0.018, "right")),
    **_both_sides("hand", NamedSite("left_wrist", "left_hand", 0.9, "up", 0.012, "right")),
    **_both_sides("thigh", NamedSite("left_hip", "left_knee", 0.6, "left", 0.045, "up")),
    **_both_sides("thigh_front", NamedSite("left_hip", "left_knee", 0.6, "front", 0.050, "up")),
    **_both_sides("shank", NamedSite("left_knee", "left_ankle", 0.3, "front", 0.030, "up")),
    **_both_sides("shank_side", NamedSite("left_knee", "left_ankle", 0.4, "left", 0.040, "up")),
    **_both_sides("ankle", NamedSite("left_knee", "left_ankle", 0.85, "left", 0.022, "up")),
    **_both_sides("foot", NamedSite("left_ankle", "left_foot", 0.55, "up", 0.020, "back")),
}


def site_axes(name: str) -> str:
    """Describe a site and the sensor's axes there, for tables and templates.

    Raises:
        InputError: for an unknown site.
    """
    site = _known_site(name)
    words = {tuple(direction): word for word, direction in _DIRECTIONS.items()}
    y_axis = np.cross(_DIRECTIONS[site.outward], _DIRECTIONS[site.x_axis])
    side = _SIDES.get(site.outward, site.outward)
    position = f"{side} of {site.bone}"
    if site.child is not None:
        position = f"{side}, {100 * site.along:.0f} % of the way from {site.bone} to {site.child}"
    return f"{position}; x {site.x_axis}, y {words[tuple(int(component) for component in y_axis)]}, z {site.outward}"


def _known_site(name: str) -> NamedSite:
    if name not in SITES:
        raise InputError(f"unknown site '{name}': expected one of {', '.join(SITES)}")
    return SITES[name]


_SIX = ("head", "pelvis", "left_forearm", "right_forearm", "left_shank", "right_shank")
_LIMBS = [f"{side}_{limb}" for limb in ("upper_arm", "forearm", "thigh", "shank") for side in ("left", "right")]
_TEN = ("sternum", "pelvis", *_LIMBS)
_THIRTEEN = ("head", *_TEN, "left_foot", "right_foot")
PRESETS: dict[str, tuple[str, ...]] = {
    "sip6": _SIX,  # thesis 3.2.2
    "tnt10": _TEN,  # TNT15, thesis 2.5.1
    "totalcapture13": _THIRTEEN,
    "mvn17": (*_THIRTEEN, "left_shoulder", "right_shoulder", "left_hand", "right_hand"),  # Xsens MVN full body
}


def sensor_site(site_name: str, skeleton: Skeleton, sensor: str | None = None) -> SensorSite:
    """Place a sensor at one of the :data:`SITES` of a skeleton.

    Raises:
        InputError: for an unknown site.
    """
    site = _known_site(site_name)
    outward, x_axis = np.array(_DIRECTIONS[site.outward], float), np.array(_DIRECTIONS[site.x_axis], float)
    along = skeleton.p_parent_joint[joint_index(site.child)] if site.child else np.zeros(3)
    p_bone_sensor = site.along * along + stature_of(skeleton) * (site.depth * outward + np.array([0, site.lift, 0]))
    R_bone_sensor = np.stack([x_axis, np.cross(outward, x_axis), outward], axis=1)
    return SensorSite(sensor or site_name, site.bone, p_bone_sensor, R_bone_sensor)


def placement_of(rule: Placement | Mapping[str, str] | str, skeleton: Skeleton) -> Placement:
    """Make a placement from the name of a preset, or from a mapping site → sensor.

    Raises:
        InputError: for an unknown preset or site.
    """
    if isinstance(rule, Placement):
        return rule
    if isinstance(rule, str):
        return preset(rule, skeleton)
    return Placement(tuple(sensor_site(site, skeleton, sensor) for site, sensor in rule.items()))


def site_name(site: SensorSite, skeleton: Skeleton) -> str | None:
    """Name of the one of the :data:`SITES` at which a sensor is placed; None if it is elsewhere on the bone."""
    at_the_site_m = 0.005  # more than rounding, less than the distance between sites
    positions = {
        name: sensor_site(name, skeleton).p_bone_sensor for name, usual in SITES.items() if usual.bone == site.bone
    }
    distances = {
        name: float(np.linalg.norm(p_bone_sensor - site.p_bone_sensor)) for name, p_bone_sensor in positions.items()
    }
    nearest = min(distances, key=lambda name: distances[name], default=None)
    return nearest if nearest is not None and distances[nearest] < at_the_site_m else None


def preset(name: str, skeleton: Skeleton) -> Placement:
    """Make one of the :data:`PRESETS` for a skeleton; sensors have the names of their sites.

    Raises:
        InputError: for an unknown preset.
    """
    if name not in PRESETS:
        raise InputError(f"unknown placement '{name}': expected one of {', '.join(PRESETS)}")
    return Placement(tuple(sensor_site(site, skeleton) for site in PRESETS[name]), name)
