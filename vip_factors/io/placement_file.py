"""A small TOML or JSON file that says who wore which sensor where: what the wearer knows and no log does.

::

    subject = "S02"
    stature_m = 1.78
    initial_pose = "n-pose"

    [segment_lengths_m]
    thigh = 0.43

    [sensors]
    00B40B91 = "pelvis"
    00B40C45 = { site = "left_thigh", sigma_deg = 20 }
    00B40C99 = { bone = "spine3", position_m = [0, 0.1, -0.1], mounting_wxyz = [1, 0, 0, 0] }
"""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.skeleton import BONE_ALIASES, JOINT_NAMES, Skeleton
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array
from vip_factors.io.sensor_mappings import sites_of_mappings
from vip_factors.io.toml_values import known_keys, nearest, number_at, numbers_at, table_at, text_at
from vip_factors.sensors.calibration import CARELESS_MOUNTING_SIGMA, SITES, STRAPPED_MOUNTING_SIGMA, SensorSite, place

INITIAL_POSES = ("t-pose", "n-pose", "none")


@dataclass(frozen=True)
class SensorEntry:
    """Where one sensor sits: at a named site, or anywhere on a bone.

    Attributes:
        site: one of :data:`~vip_factors.sensors.calibration.SITES`, or None if a bone is given.
        bone: SMPL joint name or alias, or None if a site is given.
        position_m: ``(3,)`` in the bone's frame; from the site, or the bone's joint, if None.
        R_bone_sensor: ``(3, 3)`` mounting; from the site if None.
        sigma_deg: of the mounting; 15° for a mounting that was given and 40° for one that was not, if None.
    """

    site: str | None = None
    bone: str | None = None
    position_m: Array | None = None
    R_bone_sensor: Array | None = None
    sigma_deg: float | None = None

    def on(self, skeleton: Skeleton, sensor: str) -> SensorSite:
        """The sensor's site on a skeleton.

        Raises:
            InputError: for an unknown site or bone.
        """
        given = self.R_bone_sensor is not None
        sigma = CARELESS_MOUNTING_SIGMA if given else STRAPPED_MOUNTING_SIGMA
        if self.sigma_deg is not None:
            sigma = float(np.deg2rad(self.sigma_deg))
        if self.site is not None:
            usual = place(self.site, skeleton, sensor)
        else:
            usual = SensorSite(sensor, str(self.bone), np.zeros(3), np.eye(3))
        position = usual.p_bone_sensor if self.position_m is None else self.position_m
        R = usual.R_bone_sensor if self.R_bone_sensor is None else self.R_bone_sensor
        return SensorSite(sensor, usual.bone, position, R, sigma)


@dataclass(frozen=True)
class PlacementFile:
    """Content of a placement file; everything is optional."""

    subject: str | None = None
    stature_m: float | None = None
    mass_kg: float | None = None
    sex: str | None = None
    initial_pose: str | None = None
    segment_lengths_m: Mapping[str, float] = field(default_factory=dict)
    sensors: Mapping[str, SensorEntry] = field(default_factory=dict)


def placement_from_file(path: str | Path) -> PlacementFile:
    """Read a placement file, TOML or (by its suffix) JSON, or OpenSense's mapping of sensors to a model's frames (XML).

    Raises:
        FileFormatError: if it cannot be read or parsed.
        InputError: for an unknown key, site or bone (the nearest known one is named) or a value of the wrong kind.
    """
    path = Path(path)
    if path.suffix.lower() == ".xml":
        return PlacementFile(sensors={name: SensorEntry(site) for name, site in sites_of_mappings(path).items()})
    try:
        text = path.read_text(encoding="utf-8-sig")
        content = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror}): expected a TOML or JSON file") from error
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: {error}: expected {path.suffix or 'TOML'} syntax") from error
    if not isinstance(content, Mapping):
        raise FileFormatError(f"{path}: expected an object with what is known of wearer and sensors")
    known = [one.name for one in fields(PlacementFile)]
    known_keys(path, "", content, known)
    values: dict[str, Any] = {}
    for key in ("subject", "sex", "initial_pose"):
        if key in content:
            values[key] = text_at(path, key, content[key])
    for key in ("stature_m", "mass_kg"):
        if key in content:
            values[key] = number_at(path, key, content[key])
    pose = values.get("initial_pose")
    if pose is not None and pose not in INITIAL_POSES:
        raise InputError(f"{path}: initial_pose '{pose}'{nearest(pose, INITIAL_POSES)}")
    lengths = table_at(path, "segment_lengths_m", content.get("segment_lengths_m", {}))
    values["segment_lengths_m"] = {
        key: number_at(path, f"segment_lengths_m.{key}", one) for key, one in lengths.items()
    }
    sensors = table_at(path, "sensors", content.get("sensors", {}))
    values["sensors"] = {name: _entry(path, name, entry) for name, entry in sensors.items()}
    return PlacementFile(**values)


def _entry(path: Path, name: str, entry: Any) -> SensorEntry:
    where = f"sensors.{name}"
    if isinstance(entry, str):
        entry = {"site": entry}
    table = table_at(path, where, entry)
    known_keys(path, where, table, ("site", "bone", "position_m", "mounting_wxyz", "sigma_deg"))
    if ("site" in table) == ("bone" in table):
        raise InputError(f"{path}: {where}: expected either a site, such as 'left_thigh', or a bone")
    site = text_at(path, f"{where}.site", table["site"]) if "site" in table else None
    if site is not None and site not in SITES:
        raise InputError(f"{path}: {where}: unknown site '{site}'{nearest(site, SITES)}")
    bone = text_at(path, f"{where}.bone", table["bone"]) if "bone" in table else None
    bones = [*JOINT_NAMES, *BONE_ALIASES]
    if bone is not None and bone not in bones:
        raise InputError(f"{path}: {where}: unknown bone '{bone}'{nearest(bone, bones)}")
    if bone is not None and "mounting_wxyz" not in table:
        raise InputError(f"{path}: {where}: a bone needs mounting_wxyz too, R_bone_sensor as a quaternion w, x, y, z")
    position = numbers_at(path, f"{where}.position_m", table["position_m"], 3) if "position_m" in table else None
    R = None
    if "mounting_wxyz" in table:
        quaternion = numbers_at(path, f"{where}.mounting_wxyz", table["mounting_wxyz"], 4)
        try:
            R = matrix_from_quaternion(quaternion, Order.WXYZ)
        except InputError as error:
            raise InputError(f"{path}: {where}.mounting_wxyz: {error}") from error
    sigma = number_at(path, f"{where}.sigma_deg", table["sigma_deg"]) if "sigma_deg" in table else None
    if sigma is not None and not 0 < sigma <= 180:
        raise InputError(f"{path}: {where}.sigma_deg is {sigma:g}: expected degrees between 0 and 180")
    return SensorEntry(site, bone, position, R, sigma)
