"""Placement files: TOML or JSON files with the wearer and the positions of the sensors, which no log states.

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

OpenSense's mapping files (``myIMUMappings.xml``) state positions, too. The log's mountings and the sensors' names
stand in for the rest.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated
from xml.etree import ElementTree

import msgspec
import numpy as np

from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import BONE_ALIASES, JOINT_NAMES, Skeleton
from vip_factors.display import one_line
from vip_factors.errors import FileFormatError, InputError, nearest
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.io.importers.shared import ImportedLog, site_of_name
from vip_factors.io.typed_files import Number, Vector, convert, read_json, read_text, read_toml, toml_text
from vip_factors.sensors.calibration import (
    CARELESS_MOUNTING_SIGMA,
    PRESETS,
    SITES,
    STRAPPED_MOUNTING_SIGMA,
    Placement,
    SensorSite,
    sensor_site,
    site_axes,
)
from vip_factors.sensors.recording import DEFAULT_STATURE_M

INITIAL_POSES = ("t-pose", "n-pose", "none")


class SensorEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Position of one sensor: a named site, or any place on a bone.

    Attributes:
        site: one of :data:`~vip_factors.sensors.calibration.SITES`, or None if a bone is given.
        bone: SMPL joint name or alias, or None if a site is given.
        position_m: in the bone's frame; from the site, or the bone's joint, if None.
        mounting_wxyz: ``R_bone_sensor`` as a quaternion; from the site if None.
        sigma_deg: of the mounting; 15° for a mounting that was given and 40° for one that was not, if None.
    """

    site: str | None = None
    bone: str | None = None
    position_m: Vector | None = None
    mounting_wxyz: tuple[Number, Number, Number, Number] | None = None
    sigma_deg: Annotated[float, msgspec.Meta(gt=0, le=180)] | None = None

    def on(self, skeleton: Skeleton, sensor: str) -> SensorSite:
        """The sensor's site on a skeleton."""
        sigma = STRAPPED_MOUNTING_SIGMA if self.mounting_wxyz is None else CARELESS_MOUNTING_SIGMA
        if self.sigma_deg is not None:
            sigma = float(np.deg2rad(self.sigma_deg))
        if self.site is not None:
            usual = sensor_site(self.site, skeleton, sensor)
        else:
            usual = SensorSite(sensor, str(self.bone), np.zeros(3), np.eye(3))
        position = usual.p_bone_sensor if self.position_m is None else np.array(self.position_m)
        R = usual.R_bone_sensor
        if self.mounting_wxyz is not None:
            R = matrix_from_quaternion(np.array(self.mounting_wxyz), Order.WXYZ)
        return SensorSite(sensor, usual.bone, position, R, sigma)


class PlacementFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Content of a placement file; everything is optional."""

    subject: str | None = None
    stature_m: Number | None = None
    mass_kg: Number | None = None
    sex: str | None = None
    initial_pose: str | None = None
    segment_lengths_m: dict[str, Number] = {}
    sensors: dict[str, SensorEntry] = {}


def placement_from_file(path: str | Path) -> PlacementFile:
    """Read a placement file (TOML, or JSON by its suffix), or OpenSense's mapping of sensors to frames (XML)."""
    path = Path(path)
    if path.suffix.lower() == ".xml":
        return _opensense_mappings(path)
    read = read_json if path.suffix.lower() == ".json" else read_toml
    table = read(path, dict[str, object], "a placement file (TOML or JSON with [sensors] …)")
    entries = table.get("sensors")
    if isinstance(entries, dict):  # text stands for a table with a site
        table["sensors"] = {name: {"site": site} if isinstance(site, str) else site for name, site in entries.items()}
    content = convert(path, "", table, PlacementFile)
    pose = content.initial_pose
    if pose is not None and pose not in INITIAL_POSES:
        raise InputError(f"{path}: initial_pose '{pose}'{nearest(pose, INITIAL_POSES)}")
    if len(content.sensors) > 1000:
        raise InputError(f"{path}: {len(content.sensors)} sensors: expected at most 1000 on a body")
    for name, entry in content.sensors.items():
        _check_entry(f"{path}: sensors.{name}", entry)
    return content


def _check_entry(where: str, entry: SensorEntry) -> None:
    if (entry.site is None) == (entry.bone is None):
        raise InputError(f"{where}: expected either a site, such as 'left_thigh', or a bone")
    if entry.site is not None and entry.site not in SITES:
        raise InputError(f"{where}: unknown site '{entry.site}'{nearest(entry.site, SITES)}")
    bones = [*JOINT_NAMES, *BONE_ALIASES]
    if entry.bone is not None and entry.bone not in bones:
        raise InputError(f"{where}: unknown bone '{entry.bone}'{nearest(entry.bone, bones)}")
    if entry.bone is not None and entry.mounting_wxyz is None:
        raise InputError(f"{where}: a bone needs mounting_wxyz too, R_bone_sensor as a quaternion w, x, y, z")
    if entry.mounting_wxyz is not None:
        try:
            matrix_from_quaternion(np.array(entry.mounting_wxyz), Order.WXYZ)
        except InputError as error:
            raise InputError(f"{where}.mounting_wxyz: {error}") from error


def _opensense_mappings(path: Path) -> PlacementFile:
    """Sites by sensor, from the names of the experimental sensors' frames: ``_00B42268`` is ``torso_imu``.

    OpenSense begins sensors' names with the ``_`` that ends the trial's in the files' names; it is left out.
    """
    text = read_text(path, "OpenSense's IMU mappings (XML)")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FileFormatError(f"{path}: {error}: expected OpenSense's IMU mappings (XML)") from error
    sensors: dict[str, SensorEntry] = {}
    for sensor in root.iter("ExperimentalSensor"):
        name = (sensor.get("name") or "").strip().lstrip("_")
        frame = (sensor.findtext("name_in_model") or "").strip()
        site = site_of_name(frame)
        if not name or site is None:
            raise FileFormatError(
                f"{path}: sensor '{name}' is frame '{frame}' of the model: expected a name that tells the segment, "
                "such as pelvis_imu, femur_r_imu, torso_imu; or write a placement file (.toml)"
            )
        sensors[name] = SensorEntry(site)
    if not sensors:
        raise FileFormatError(f"{path}: names no ExperimentalSensor: expected OpenSense's IMU mappings")
    return PlacementFile(sensors=sensors)


# A preset's name, or site → sensor name, or sensor name → entry of a placement file; None leaves it to the log.
Rule = str | Mapping[str, str] | Mapping[str, SensorEntry] | None


def place_sensors(log: ImportedLog, skeleton: Skeleton, rule: Rule, notes: list[str]) -> Placement:
    """The placement of a log's sensors on a skeleton; a rule of the user replaces the log's own placement.

    Sensors without an orientation are not placed.
    """
    of_log = _sites_of_log(log, skeleton)
    if isinstance(rule, str):
        sites, name = _placed(_entries_of_preset(log, rule, notes), skeleton, of_log), rule
    elif rule:
        sites, name = _placed(_entries_of_user(log, rule, notes), skeleton, of_log), "custom"
    else:
        sites, name = list(of_log.values()), log.placement.name if log.placement else "custom"
    usable = [site for site in sites if log.imus[site.sensor].R_inertial_sensor is not None]
    if not usable:
        raise InputError(_nothing_placed(log, sites))
    placed = {site.sensor for site in usable}
    without = [sensor for sensor in log.imus if sensor not in placed]
    if without:
        notes.append(f"not placed on the body, and so not used: {', '.join(without)}")
    return Placement(tuple(usable), name)


def _sites_of_log(log: ImportedLog, skeleton: Skeleton) -> dict[str, SensorSite]:
    """Sites by sensor from the log itself: its mountings first, then its names."""
    of_log: dict[str, SensorSite] = {}
    if log.placement is not None:
        stature_m = log.stature_m  # the stature that the positions of the log's own placement are for
        if stature_m is None:
            stature_m = stature_of(log.truth_motion.skeleton) if log.truth_motion is not None else DEFAULT_STATURE_M
        scale = stature_of(skeleton) / stature_m
        for site in log.placement.sites:
            of_log[site.sensor] = replace(site, p_bone_sensor=scale * site.p_bone_sensor)
    for sensor, site_name in log.default_sites.items():
        if sensor not in of_log:
            of_log[sensor] = sensor_site(site_name, skeleton, sensor)
    return {sensor: site for sensor, site in of_log.items() if sensor in log.imus}


def _entries_of_preset(log: ImportedLog, name: str, notes: list[str]) -> dict[str, SensorEntry]:
    if name not in PRESETS:
        raise InputError(f"unknown placement '{name}'{nearest(name, PRESETS)}, or a .toml file")
    by_site = {site: sensor for sensor, site in log.default_sites.items()}
    sensors = {site: by_site.get(site, site) for site in PRESETS[name]}
    missing = [site for site, sensor in sensors.items() if sensor not in log.imus]
    if missing and len(missing) < len(sensors):
        notes.append(f"placement {name} has sites without a sensor in the log: {', '.join(missing)}")
    return {sensor: SensorEntry(site) for site, sensor in sensors.items() if sensor in log.imus}


def _entries_of_user(
    log: ImportedLog, rule: Mapping[str, str] | Mapping[str, SensorEntry], notes: list[str]
) -> dict[str, SensorEntry]:
    entries: dict[str, SensorEntry] = {}
    for key, value in rule.items():
        if isinstance(value, SensorEntry):
            entries[key] = value
        elif key not in SITES:
            raise InputError(f"unknown site '{key}'{nearest(key, SITES)}")
        elif value in entries:
            raise InputError(f"sensor '{value}' is placed twice: give each sensor one site")
        else:
            entries[value] = SensorEntry(site=key)
    for sensor in entries:
        if sensor not in log.imus:
            notes.append(f"placed sensor '{sensor}' is not in the log{nearest(sensor, log.imus)}")
    if not any(sensor in log.imus for sensor in entries):
        raise InputError(
            f"none of the placed sensors ({', '.join(entries)}) is in the log, whose sensors are {', '.join(log.imus)}"
        )
    return {sensor: entry for sensor, entry in entries.items() if sensor in log.imus}


def _placed(
    entries: Mapping[str, SensorEntry], skeleton: Skeleton, of_log: Mapping[str, SensorSite]
) -> list[SensorSite]:
    """Sites of the entries; one without a mounting gets the log's on the same bone, if its sigma is smaller."""
    sites = []
    for sensor, entry in entries.items():
        site, known = entry.on(skeleton, sensor), of_log.get(sensor)
        is_free = entry.mounting_wxyz is None and entry.sigma_deg is None
        if is_free and known and known.bone == site.bone and known.mounting_sigma < site.mounting_sigma:
            site = replace(site, R_bone_sensor=known.R_bone_sensor, mounting_sigma=known.mounting_sigma)
        sites.append(site)
    return sites


def _nothing_placed(log: ImportedLog, sites: list[SensorSite]) -> str:
    if sites:
        return (
            f"none of the placed sensors ({', '.join(site.sensor for site in sites)}) has an orientation, nor "
            "acceleration and angular rate to find it from: export the orientation too"
        )
    example = next(iter(log.imus), "sensor")
    return (
        f"nothing tells where the sensors {', '.join(log.imus)} sit on the body: name them in a placement file (begun "
        f'by convert LOG --template NAME), such as\n  [sensors]\n  "{example}" = "pelvis"\n'
        f"with the sites {', '.join(SITES)}"
    )


PLACEMENT_HEAD = """\
# Placement of the sensors of {log}, guessed from their names. Check every line, then run:
# {command} --placement {placement}

# The wearer. Remove the # where you know a value; stature matters most.
# subject = "S01"
# stature_m = 1.75
# mass_kg = 70
# sex = "female"
# initial_pose = "n-pose"  # pose at the start: n-pose (arms hanging) or t-pose (arms sideways)

[sensors]
"""
PLACEMENT_END = """\

# The axes of a sensor are expected within 40° of those of its site. Other rotations are estimated from the
# motion; a declared pose, or standing still at the start, helps. Left, right, up, down, front and back are the
# wearer's in a T-pose (arms sideways, palms down). If the axes are known, give the rotation:
#   "…" = { site = "left_thigh", mounting_wxyz = [1, 0, 0, 0], sigma_deg = 15 }
# Sites:
"""


def placement_text(path: Path, sites: Mapping[str, str | None], placement: Path, columns: Path | None) -> str:
    """A placement file of the log at ``path`` with sites by sensor, where they are known, and all sites explained."""
    log = one_line(str(path))
    command = f"vip-factors convert {log} RECORDING.mcap"
    command += f" --columns {one_line(str(columns))}" if columns is not None else ""
    key_width, site_width = max(len(toml_text(sensor)) for sensor in sites), max(map(len, SITES))
    lines = [PLACEMENT_HEAD.format(log=log, command=command, placement=one_line(str(placement)))]
    for sensor, site in sites.items():
        key = toml_text(sensor).ljust(key_width)
        lines.append(f"{key} = {toml_text(site)}  # {site_axes(site)}\n" if site else f'# {key} = "…"  # not told\n')
    lines += [PLACEMENT_END, *(f"#   {name.ljust(site_width)}  {site_axes(name)}\n" for name in SITES)]
    return "".join(lines)
