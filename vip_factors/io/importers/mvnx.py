"""MVNX, the XML that Xsens MVN exports (versions 3 and 4): its sensors as streams, its segments as the truth.

Sensor orientations are global (w first, Z up). Version 3 gives the sensors' specific force itself, version 4 their
acceleration in the world without gravity, from which it follows.
"""

from pathlib import Path

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, ancestors
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, mean_rotation, transpose
from vip_factors.io.imported import ImportedLog
from vip_factors.io.importers.mvnx_body import SANE_CLOSURE_M, MvnBody, body_of
from vip_factors.io.importers.mvnx_document import MvnxDocument, read_document
from vip_factors.sensors.calibration import Placement, SensorSite, place
from vip_factors.sensors.imu_stream import ImuStream

FORMAT = "mvnx"
FULL_BODY = "FullBody"  # MVN's configuration in which every limb carries a sensor

GRAVITY = np.array([0.0, 0.0, 9.80665])  # the value MVN subtracts
# MVN's mountings come from a pose held by eye and some steps walked: better than a careless pose (15°), not exact.
MVN_MOUNTING_SIGMA = np.deg2rad(10.0)
UTC_YEAR_2000_MS = 946_684_800_000  # earlier "ms" attributes count from the recording's start, not from 1970

SENSOR_SITES = {"Pelvis": "pelvis", "T8": "sternum", "Head": "head"} | {
    f"{side}{segment}": f"{side.lower()}_{site}"
    for side in ("Left", "Right")
    for segment, site in {
        "Shoulder": "shoulder", "UpperArm": "upper_arm", "ForeArm": "forearm", "Hand": "hand",
        "UpperLeg": "thigh", "LowerLeg": "shank", "Foot": "foot",
    }.items()
}  # fmt: skip


def matches(path: Path) -> bool:
    """Whether the first kilobytes hold the root element of MVNX."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(8192)
    return b"<mvnx " in head or b"<mvnx>" in head


def read(path: Path) -> ImportedLog:
    """The sensors, MVN's own motion and its mountings.

    Raises:
        FileFormatError: if the file is no MVNX, or was exported without the sensors' orientations.
        RecordingError: if a sensor's samples cannot be used.
    """
    document = read_document(path)
    notes = [f"MVN {document.software}, MVNX version {document.version}"]
    if document.truncated:
        notes.append(f"the file breaks off ({document.truncated}): {len(document.samples)} frames were read")
    time = _times(document)
    imus = _streams(document, time)
    body = body_of(document, time)
    placement = None
    if isinstance(body, str):
        notes.append(body)
    else:
        notes += _notes_on(document, body)
        placement = _placement(imus, body)
        notes.append("the mountings are those that MVN's own motion implies")
    sites = {name: SENSOR_SITES[name] for name in imus if name in SENSOR_SITES}
    notes += [f"sensor {name} has no usual place on the body" for name in imus if name not in sites]
    return ImportedLog(
        format=FORMAT,
        imus=imus,
        default_sites=sites,
        placement=placement,
        truth_motion=None if isinstance(body, str) else body.motion,
        truth_bones=_known_bones(document, placement),
        stature_m=body.motion.skeleton.stature if isinstance(body, MvnBody) and body.has_landmarks else None,
        start_ns=_start_ns(document),
        notes=tuple(notes),
    )


def _times(document: MvnxDocument) -> Array:
    """Seconds from the first sample: by frame index, which is exact, else by the milliseconds, else by counting."""
    for name, unit in (("index", 1 / document.frame_rate), ("time", 1e-3)):
        values = [sample.attributes.get(name, "") for sample in document.samples]
        if all(value.lstrip("-").isdigit() for value in values):
            counts = np.array(values, dtype=float)
            return (counts - counts[0]) * unit
    return np.arange(len(document.samples)) / document.frame_rate


def _start_ns(document: MvnxDocument) -> int:
    text = document.samples[0].attributes.get("ms", "")
    return int(text) * 1_000_000 if text.isdigit() and int(text) > UTC_YEAR_2000_MS else 0


def _streams(document: MvnxDocument, time: Array) -> dict[str, ImuStream]:
    quaternions = document.channel("sensorOrientation")
    if quaternions is None:
        raise FileFormatError(
            f"{document.path}: no sensorOrientation in any frame: export from MVN again with the sensor data included"
        )
    free, force = document.channel("sensorFreeAcceleration"), document.channel("sensorAcceleration")
    rate = document.channel("sensorAngularVelocity")
    imus = {}
    for row, name in enumerate(document.sensors):
        lost = ~np.all(np.isfinite(quaternions[:, row]), axis=1)
        filled = np.where(lost[:, None], [1.0, 0, 0, 0], quaternions[:, row])
        try:
            R = matrix_from_quaternion(filled, Order.WXYZ)
        except InputError as error:
            raise FileFormatError(f"{document.path}: sensorOrientation of {name}: {error}") from error
        R[lost] = np.nan
        f = None if force is None else force[:, row]
        if f is None and free is not None:
            f = np.einsum("nji,nj->ni", R, free[:, row] + GRAVITY)
        imus[name] = ImuStream.from_samples(name, time, f, R, None if rate is None else rate[:, row])
    return imus


def _placement(imus: dict[str, ImuStream], body: MvnBody) -> Placement:
    """Each sensor where its kind is worn, turned on its bone as MVN has it on average."""
    state, time, sites = body.motion.state, body.motion.time, []
    for name, stream in imus.items():
        if name not in SENSOR_SITES or stream.R_inertial_sensor is None:
            continue
        usual = place(SENSOR_SITES[name], body.motion.skeleton, name)
        frames = np.searchsorted(time, stream.time - 0.5 / body.motion.rate)
        R_world_bone = state.R_world_bone[frames, usual.bone_index]
        R_bone_sensor = mean_rotation(transpose(R_world_bone) @ stream.R_inertial_sensor)
        sites.append(SensorSite(name, usual.bone, usual.p_bone_sensor, R_bone_sensor, MVN_MOUNTING_SIGMA))
    return Placement(tuple(sites), FORMAT)


def _known_bones(document: MvnxDocument, placement: Placement | None) -> frozenset[str] | None:
    """Bones that carry a sensor, and those between such bones; None, which is all, where every limb has one."""
    if placement is None or document.attributes.get("configuration", FULL_BODY) == FULL_BODY:
        return None
    worn = {site.bone_index for site in placement.sites}
    between = {joint for joint in range(JOINT_COUNT) if worn & set(_below(joint)) and worn & set(ancestors(joint))}
    return frozenset(JOINT_NAMES[joint] for joint in between)


def _below(joint: int) -> list[int]:
    """A joint and all that hang on it."""
    return [other for other in range(JOINT_COUNT) if joint in ancestors(other)]


def _notes_on(document: MvnxDocument, body: MvnBody) -> list[str]:
    notes = [
        f"segment orientations refer to {body.convention}; joints meet within {body.closure_m * 1000:.1f} mm; our "
        f"joints lie {body.joint_error_m * 1000:.1f} mm from MVN's"
    ]
    if body.closure_m > SANE_CLOSURE_M:
        notes.append("MVN's joints do not meet in any known convention of its axes: distrust its motion")
    if document.attributes.get("configuration", FULL_BODY) != FULL_BODY:
        configuration = document.attributes["configuration"]
        notes.append(f"MVN's configuration is {configuration}: limbs without sensors are no truth, and not compared")
    return notes
