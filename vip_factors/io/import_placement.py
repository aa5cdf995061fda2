"""Which sensor of a log sits where: what the user said, else what the log's mountings or the sensors' names tell."""

from collections.abc import Mapping
from dataclasses import replace

from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import Skeleton
from vip_factors.errors import InputError
from vip_factors.io.imported import ImportedLog
from vip_factors.io.placement_file import SensorEntry
from vip_factors.io.toml_values import nearest
from vip_factors.sensors.calibration import PRESETS, SITES, Placement, SensorSite, place
from vip_factors.sensors.recording import DEFAULT_STATURE_M

# A preset's name, or site → sensor name, or sensor name → entry of a placement file; None leaves it to the log.
Rule = str | Mapping[str, str] | Mapping[str, SensorEntry] | None


def place_sensors(log: ImportedLog, skeleton: Skeleton, rule: Rule, notes: list[str]) -> Placement:
    """The placement of a log's sensors on a skeleton; a rule of the user's replaces what the log tells.

    Only sensors that have an orientation are placed: nothing can be done with the others.

    Raises:
        InputError: for an unknown preset, site or sensor, or if no sensor is placed.
    """
    known = _known_sites(log, skeleton)
    if isinstance(rule, str):
        sites, name = _of_preset(log, skeleton, rule, known, notes), rule
    elif rule:
        sites, name = _of_user(log, skeleton, rule, known, notes), "custom"
    else:
        sites, name = list(known.values()), log.placement.name if log.placement else "custom"
    usable = [site for site in sites if log.imus[site.sensor].R_inertial_sensor is not None]
    if not usable:
        raise InputError(_nothing_placed(log, sites))
    placed = {site.sensor for site in usable}
    without = [sensor for sensor in log.imus if sensor not in placed]
    if without:
        notes.append(f"not placed on the body, and so not used: {', '.join(without)}")
    return Placement(tuple(usable), name)


def _known_sites(log: ImportedLog, skeleton: Skeleton) -> dict[str, SensorSite]:
    """By sensor, what the log itself tells: its mountings first, then its names."""
    known: dict[str, SensorSite] = {}
    if log.placement is not None:
        scale = stature_of(skeleton) / (_stature_of_log(log))
        for site in log.placement.sites:
            known[site.sensor] = replace(site, p_bone_sensor=scale * site.p_bone_sensor)
    for sensor, site_name in log.default_sites.items():
        if sensor not in known:
            known[sensor] = place(site_name, skeleton, sensor)
    return {sensor: site for sensor, site in known.items() if sensor in log.imus}


def _stature_of_log(log: ImportedLog) -> float:
    """The stature that the positions of the log's own placement are for."""
    if log.stature_m is not None:
        return log.stature_m
    return stature_of(log.truth_motion.skeleton) if log.truth_motion is not None else DEFAULT_STATURE_M


def _of_preset(
    log: ImportedLog, skeleton: Skeleton, name: str, known: Mapping[str, SensorSite], notes: list[str]
) -> list[SensorSite]:
    if name not in PRESETS:
        raise InputError(f"unknown placement '{name}'{nearest(name, PRESETS)}, or a .toml file")
    told = {site: sensor for sensor, site in log.default_sites.items()}
    sensors = {site: told.get(site, site) for site in PRESETS[name]}
    missing = [site for site, sensor in sensors.items() if sensor not in log.imus]
    if missing and len(missing) < len(sensors):
        notes.append(f"placement {name} has sites without a sensor in the log: {', '.join(missing)}")
    return [_mounted(place(site, skeleton, sensor), known) for site, sensor in sensors.items() if sensor in log.imus]


def _of_user(
    log: ImportedLog,
    skeleton: Skeleton,
    rule: Mapping[str, str] | Mapping[str, SensorEntry],
    known: Mapping[str, SensorSite],
    notes: list[str],
) -> list[SensorSite]:
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
    if entries and not any(sensor in log.imus for sensor in entries):
        raise InputError(
            f"none of the placed sensors ({', '.join(entries)}) is in the log, whose sensors are {', '.join(log.imus)}"
        )
    return [
        _mounted(entry.on(skeleton, sensor), known)
        if entry.R_bone_sensor is None and entry.sigma_deg is None
        else entry.on(skeleton, sensor)
        for sensor, entry in entries.items()
        if sensor in log.imus
    ]


def _mounted(site: SensorSite, known: Mapping[str, SensorSite]) -> SensorSite:
    """The site with the mounting that the log knows, if it has the sensor on the same bone and knows it better."""
    told = known.get(site.sensor)
    if told is None or told.bone != site.bone or told.mounting_sigma >= site.mounting_sigma:
        return site
    return replace(site, R_bone_sensor=told.R_bone_sensor, mounting_sigma=told.mounting_sigma)


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
