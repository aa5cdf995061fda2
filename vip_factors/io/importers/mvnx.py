"""MVNX, the XML that Xsens MVN exports (versions 3 and 4): its sensors as streams, its segments as the truth.

Sensor orientations are global (w first, Z up). Version 3 gives the sensors' specific force itself, version 4 their
acceleration in the world without gravity, from which it follows.

MVN's segment axes are x forward, y left, z up on a person in the T-pose, with every orientation the identity there.
Older files (MVN Studio 4) follow the ISB instead and turn the arms' axes; the pose of the calibration in which the
bones are straight then says how. Which convention a file follows is not written in it, so it is found: under the
right one, the points that two segments share coincide in every frame.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.body.anthropometry import STATURE_RANGE_M, skeleton_from_stature
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.lengths import HAND_KNUCKLES, LEGS
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, Landmark, Skeleton, ancestors, joint_index
from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, exp, log, mean_rotation, transpose
from vip_factors.io.importers.mvnx_document import MvnxDocument, read_document
from vip_factors.io.importers.shared import ImportedLog, rotations_or_nan
from vip_factors.io.motions.skeleton_maps import both_sides
from vip_factors.sensors.calibration import Placement, SensorSite, sensor_site
from vip_factors.sensors.imu_stream import ImuStream

# Our bone axes in MVN's: x left, y up, z forward.
R_segment_bone = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

SEGMENT_PARENTS = {
    "L5": "Pelvis", "L3": "L5", "T12": "L3", "T8": "T12", "Neck": "T8", "Head": "Neck",
} | {
    f"{side}{child}": (f"{side}{parent}" if parent not in ("T8", "Pelvis") else parent)
    for side in ("Right", "Left")
    for child, parent in {
        "Shoulder": "T8", "UpperArm": "Shoulder", "ForeArm": "UpperArm", "Hand": "ForeArm",
        "UpperLeg": "Pelvis", "LowerLeg": "UpperLeg", "Foot": "LowerLeg", "Toe": "Foot",
    }.items()
}  # fmt: skip
# Our bones and the segment whose turning they take; L3 shares spine1 with L5, see _bone_rotations.
BONE_SEGMENTS = {
    "pelvis": "Pelvis", "spine1": "L5", "spine2": "T12", "spine3": "T8", "neck": "Neck", "head": "Head",
} | both_sides(
    {
        "collar": "{}Shoulder", "shoulder": "{}UpperArm", "elbow": "{}ForeArm", "wrist": "{}Hand", "hand": "{}Hand",
        "hip": "{}UpperLeg", "knee": "{}LowerLeg", "ankle": "{}Foot", "foot": "{}Toe",
    }, "Left", "Right",
)  # fmt: skip

STRAIGHT_POSES = ("identity", "npose", "tpose")  # poses of the calibration that show the zero pose, the best first
SANE_CLOSURE_M = 0.03  # joints of a right convention meet within millimetres; the arms of a wrong one miss by 0.3 m


@dataclass(frozen=True)
class MvnBody:
    """What MVN says of the wearer.

    Attributes:
        motion: in our skeleton.
        convention: which zero pose the segments' orientations refer to.
        closure_m: mean distance of the points that should coincide.
        joint_error_m: mean distance between our joints and MVN's: what merging L3 away costs.
        has_landmarks: whether head top and heels, and so the stature, are from the file.
    """

    motion: Motion
    convention: str
    closure_m: float
    joint_error_m: float
    has_landmarks: bool


def body_of(document: MvnxDocument, time: Array) -> MvnBody | str:
    """The wearer's motion, or a sentence saying why there is none."""
    quaternions, positions = document.channel("orientation"), document.channel("position")
    missing = sorted({"Pelvis", *SEGMENT_PARENTS} - set(document.segments))
    if missing:
        return f"no motion of MVN's own: segment {missing[0]} is missing"
    if quaternions is None or positions is None:
        return "no motion of MVN's own: the frames hold no segment orientations and positions"
    whole = np.all(np.isfinite(quaternions), axis=(1, 2)) & np.all(np.isfinite(positions), axis=(1, 2))
    if not np.all(whole) or np.any(np.abs(np.diff(time) * document.frame_rate - 1) > 0.1):
        return "no motion of MVN's own: some frames are missing"
    offsets = _offsets(document)
    if offsets is None:
        return "no motion of MVN's own: neither the segments' points nor a pose of the calibration is in the file"
    try:
        R_world_segment = matrix_from_quaternion(quaternions, Order.WXYZ)
        R_zero, convention, closure = _zero_pose(document, offsets, R_world_segment, positions)
    except ValueError as error:
        raise FileFormatError(f"{document.path}: segment orientations: {error}") from error
    R_world_segment = R_world_segment @ transpose(R_zero)
    skeleton, has_landmarks = _skeleton(document, offsets)
    R_world_bone = _bone_rotations(document, offsets, R_world_segment)
    pelvis = document.segments.index("Pelvis")
    start = float(time[0])
    motion = Motion(
        skeleton, local_rotations(R_world_bone), positions[:, pelvis], document.frame_rate, start, "Xsens MVN"
    )
    rows = [document.segments.index(BONE_SEGMENTS[name]) for name in JOINT_NAMES]
    miss = np.linalg.norm(motion.state.p_world_joint - positions[:, rows], axis=-1)[:, :-2]  # knuckles have no twin
    return MvnBody(motion, convention, closure, float(miss.mean()), has_landmarks)


def _offsets(document: MvnxDocument) -> dict[str, Array] | None:
    """Origin of each segment from its parent's origin, in MVN's axes in the T-pose."""
    offsets = {
        child: document.points[parent, label] - document.points[child, own]
        for (parent, label), (child, own) in document.joints
        if {(parent, label), (child, own)} <= set(document.points) and SEGMENT_PARENTS.get(child) == parent
    }
    if set(offsets) == set(SEGMENT_PARENTS):
        return offsets
    for kind in STRAIGHT_POSES:
        for pose in document.calibration_poses:
            if pose.attributes.get("type") == kind and "position" in pose.channels:
                at = dict(zip(document.segments, pose.channels["position"], strict=True))
                return {child: at[child] - at[parent] for child, parent in SEGMENT_PARENTS.items()}
    return None


def _zero_pose(
    document: MvnxDocument, offsets: dict[str, Array], R_world_segment: Array, positions: Array
) -> tuple[Array, str, float]:
    """The orientations of the segments in the straight T-pose, what they were taken from, and how well joints meet."""
    row = document.segments.index
    candidates = [("all segments at identity", np.broadcast_to(np.eye(3), (len(document.segments), 3, 3)))]
    for pose in document.calibration_poses:
        if "orientation" in pose.channels:
            kind = pose.attributes.get("type", "?")
            candidates.append((f"its {kind} frame", matrix_from_quaternion(pose.channels["orientation"], Order.WXYZ)))
    found = []
    for label, R_zero in candidates:
        R = R_world_segment @ transpose(R_zero)
        misses = [
            np.linalg.norm(positions[:, row(parent)] + R[:, row(parent)] @ offset - positions[:, row(child)], axis=1)
            for child, offset in offsets.items()
            for parent in [SEGMENT_PARENTS[child]]
        ]
        found.append((R_zero, label, float(np.mean(misses))))
    return min(found, key=lambda candidate: candidate[2])


def _bone_rotations(document: MvnxDocument, offsets: dict[str, Array], R_world_segment: Array) -> Array:
    at = {name: R_world_segment[:, row] for row, name in enumerate(document.segments)}
    # spine1 spans L5 and L3: it turns as they do on average, by length, so that spine2 stays where MVN has it.
    lengths = np.linalg.norm(offsets["L3"]), np.linalg.norm(offsets["T12"])  # of L5, of L3
    share = float(lengths[1] / (lengths[0] + lengths[1]))
    spine1 = at["L5"] @ exp(share * log(transpose(at["L5"]) @ at["L3"]))
    bones = [spine1 if name == "spine1" else at[BONE_SEGMENTS[name]] for name in JOINT_NAMES]
    return np.stack(bones, axis=1) @ R_segment_bone


def _skeleton(document: MvnxDocument, offsets: dict[str, Array]) -> tuple[Skeleton, bool]:
    """Our skeleton with MVN's lengths; what the file does not tell of hands and feet follows from the leg's length."""
    legs = np.linalg.norm(offsets["LeftLowerLeg"]) + np.linalg.norm(offsets["LeftFoot"])
    usual = skeleton_from_stature(float(np.clip(legs / LEGS, *STATURE_RANGE_M)))
    p_parent_joint = usual.p_parent_joint.copy()
    for name in JOINT_NAMES[1:]:
        segment = BONE_SEGMENTS[name]
        offset = offsets["L3"] + offsets["T12"] if name == "spine2" else offsets[segment]
        if not name.endswith("_hand"):
            p_parent_joint[joint_index(name)] = offset @ R_segment_bone
    landmarks, known = dict(usual.landmarks), True
    for name, (segment, point) in _landmark_points().items():
        if (segment, point) not in document.points:
            known = False
            continue
        p_bone_point = document.points[segment, point] @ R_segment_bone
        if name.endswith("_fingertip"):  # given from the wrist: part of the way is our hand joint
            joint = joint_index(name.replace("fingertip", "hand"))
            p_parent_joint[joint] = HAND_KNUCKLES * p_bone_point
            p_bone_point = (1 - HAND_KNUCKLES) * p_bone_point
        landmarks[name] = Landmark(usual.landmarks[name].bone, p_bone_point)
    return Skeleton(p_parent_joint, landmarks, f"Xsens MVN {document.software}, {document.path.name}"), known


def _landmark_points() -> dict[str, tuple[str, str]]:
    points = {"head_top": ("Head", "pTopOfHead")}
    for side in ("Left", "Right"):
        points[f"{side.lower()}_heel"] = (f"{side}Foot", f"p{side}HeelFoot")
        points[f"{side.lower()}_toe_tip"] = (f"{side}Toe", f"p{side}Toe")
        points[f"{side.lower()}_fingertip"] = (f"{side}Hand", f"p{side}TopOfHand")
    return points


FORMAT = "mvnx"
FULL_BODY = "FullBody"  # MVN's configuration in which every limb carries a sensor

GRAVITY = np.array([0.0, 0.0, 9.80665])  # the value MVN subtracts
# MVN's mountings come from a pose held by eye and some steps walked: better than a careless pose (15°), not exact.
MVN_MOUNTING_SIGMA = np.deg2rad(10.0)
UTC_YEAR_2000_MS = 946_684_800_000  # earlier "ms" attributes count from the recording's start, not from 1970

_LIMBS = {
    "shoulder": "{}Shoulder", "upper_arm": "{}UpperArm", "forearm": "{}ForeArm", "hand": "{}Hand",
    "thigh": "{}UpperLeg", "shank": "{}LowerLeg", "foot": "{}Foot",
}  # fmt: skip
SENSOR_SITES = {"Pelvis": "pelvis", "T8": "sternum", "Head": "head"} | {
    segment: site for site, segment in both_sides(_LIMBS, "Left", "Right").items()
}


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
    imus = _streams(document, time, notes)
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


def _streams(document: MvnxDocument, time: Array, notes: list[str]) -> dict[str, ImuStream]:
    quaternions = document.channel("sensorOrientation")
    if quaternions is None:
        raise FileFormatError(
            f"{document.path}: no sensorOrientation in any frame: export from MVN again with the sensor data included"
        )
    free, force = document.channel("sensorFreeAcceleration"), document.channel("sensorAcceleration")
    rate = document.channel("sensorAngularVelocity")
    imus = {}
    for row, name in enumerate(document.sensors):
        R = rotations_or_nan(quaternions[:, row], Order.WXYZ, f"{document.path}, sensor {name}", notes)
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
        usual = sensor_site(SENSOR_SITES[name], body.motion.skeleton, name)
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
