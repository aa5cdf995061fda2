"""MVNX, the XML that Xsens MVN exports (versions 3 and 4): its sensors as streams, its segments as the truth.

Sensor orientations are global (w first, Z up). Version 3 gives the sensors' specific force itself, version 4 their
acceleration in the world without gravity, from which it follows.

MVN's segment axes are x forward, y left, z up on a person in the T-pose, with every orientation the identity there.
Older files (MVN Studio 4) follow the ISB instead and turn the arms' axes; the pose of the calibration in which the
bones are straight then says how. Which convention a file follows is not written in it, so it is found: under the
right one, the points that two segments share coincide in every frame.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vip_factors.body.anthropometry import STATURE_RANGE_M, skeleton_from_stature
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.lengths import HAND_KNUCKLES, LEGS
from vip_factors.body.skeleton import JOINT_NAMES, Landmark, Skeleton, ancestors, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, exp, log, mean_rotation, transpose
from vip_factors.io.importers.shared import GRAVITY, UP, ImportedLog, rotations_or_nan
from vip_factors.io.motions.skeleton_maps import both_sides
from vip_factors.sensors.calibration import Placement, SensorSite, sensor_site
from vip_factors.sensors.imu_stream import ImuStream

FORMAT = "mvnx"
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
# Our landmarks as points of segments.
LANDMARK_POINTS = {"head_top": ("Head", "pTopOfHead")} | {
    f"{side.lower()}_{name}": (f"{side}{segment}", point.format(side))
    for side in ("Left", "Right")
    for name, segment, point in (
        ("heel", "Foot", "p{}HeelFoot"), ("toe_tip", "Toe", "p{}Toe"), ("fingertip", "Hand", "p{}TopOfHand"),
    )
}  # fmt: skip

# What is read of a frame: the element, and how many numbers each segment or sensor has in it.
CHANNELS = {
    "orientation": 4, "position": 3, "sensorOrientation": 4, "sensorFreeAcceleration": 3, "sensorAcceleration": 3,
    "sensorAngularVelocity": 3,
}  # fmt: skip
FULL_BODY = "FullBody"  # MVN's configuration in which every limb carries a sensor
STRAIGHT_POSES = ("identity", "npose", "tpose")  # poses of the calibration that show the zero pose, the best first
SANE_CLOSURE_M = 0.03  # joints of a right convention meet within millimetres; the arms of a wrong one miss by 0.3 m


class MvnxFrame(NamedTuple):
    """One frame: its attributes, and the numbers of the channels it has, one row per segment or sensor."""

    attributes: dict[str, str]
    channels: dict[str, Array]


@dataclass
class MvnxDocument:
    """The content of an MVNX file.

    Attributes:
        path: of the file.
        version: of the format, as written.
        software: version of MVN, as written.
        frame_rate: Hz.
        configuration: which sensors the subject wears, in MVN's words; blank if the file does not say.
        segments, sensors: labels, in the order of the rows of every channel.
        points: (segment, point) → metres, in the segment's axes in the T-pose (x forward, y left, z up).
        joints: pairs of (segment, point), parent first, that coincide.
        samples: frames of the recording, in order.
        calibration_poses: frames before it: identity, T-pose, N-pose …
        truncated: what is wrong with the end of the file, if it breaks off.
    """

    path: Path
    version: str = "?"
    software: str = "?"
    frame_rate: float = 0.0
    configuration: str = ""
    segments: list[str] = field(default_factory=list)
    sensors: list[str] = field(default_factory=list)
    points: dict[tuple[str, str], Array] = field(default_factory=dict)
    joints: list[tuple[tuple[str, str], tuple[str, str]]] = field(default_factory=list)
    samples: list[MvnxFrame] = field(default_factory=list)
    calibration_poses: list[MvnxFrame] = field(default_factory=list)
    truncated: str = ""

    @property
    def is_full_body(self) -> bool:
        """Whether every limb carries a sensor: as the configuration says, or else the sensors themselves."""
        return self.configuration == FULL_BODY or (not self.configuration and set(SENSOR_SITES) <= set(self.sensors))

    def shape(self, name: str) -> tuple[int, int]:
        """Rows and columns of a channel."""
        return len(self.sensors if name.startswith("sensor") else self.segments), CHANNELS[name]

    def channel(self, name: str) -> Array | None:
        """One channel of all samples, ``(N, rows, width)``, NaN where a sample lacks it; None if all do."""
        if not any(name in sample.channels for sample in self.samples):
            return None
        empty = np.full(self.shape(name), np.nan)
        return np.stack([sample.channels.get(name, empty) for sample in self.samples])


def read_document(path: Path) -> MvnxDocument:
    """Parse an MVNX file of any size as a stream; one that breaks off gives the frames it holds.

    Raises:
        FileFormatError: if the file is not MVNX, has no samples, or a frame's numbers do not fit the labels.
    """
    document, frames = MvnxDocument(path), None
    try:
        for event, element in ET.iterparse(path, events=("start", "end")):
            tag = _tag(element)
            if event == "start" and tag == "frames":
                frames = element
            if (event == "start") == (tag in ("mvnx", "subject")):
                _take(document, tag, element)
            if event == "end" and tag == "frame" and frames is not None:
                frames.clear()  # its numbers are taken
    except FileFormatError:
        raise
    except (ET.ParseError, LookupError, ValueError) as error:  # the latter two: an encoding that is none
        if not document.samples:
            raise FileFormatError(f"{path}: not readable as XML ({error}): expected an MVNX file") from error
        document.truncated = str(error)
    if not document.samples:
        raise FileFormatError(f"{path}: no frame of type 'normal': expected an MVNX recording with frames")
    if not document.frame_rate > 0:
        raise FileFormatError(f"{path}: <subject> gives no frameRate: expected frames per second")
    return document


def _tag(element: ET.Element) -> str:
    """Without its namespace."""
    return element.tag.rpartition("}")[2]


def _take(document: MvnxDocument, tag: str, element: ET.Element) -> None:
    """An element at its end, of ``mvnx`` and ``subject`` at its start."""
    label = element.get("label", "?")
    if tag == "mvnx":
        document.version = element.get("version", "?")
    elif tag == "mvn":
        document.software = element.get("version", "?")
    elif tag == "subject":
        document.configuration = element.get("configuration", "")
        rate = element.get("frameRate", "0")
        try:
            document.frame_rate = float(rate)
        except ValueError as error:
            raise FileFormatError(f"{document.path}: frameRate = '{rate}': expected a number") from error
    elif tag == "segment":
        document.segments.append(label)
        for point in element.iter():
            if _tag(point) == "point" and len(point):
                document.points[label, point.get("label", "?")] = _numbers(document.path, point[0], "a point", 3)
    elif tag == "sensor":
        document.sensors.append(label)
    elif tag == "joint":
        ends = [tuple((end.text or "").strip().split("/", 1)) for end in element]
        if len(ends) == 2 and all(len(end) == 2 for end in ends):
            document.joints.append((ends[0], ends[1]))  # type: ignore[arg-type]
    elif tag == "frame":
        channels = {}
        for child in element:
            if (name := _tag(child)) in CHANNELS:
                rows, width = document.shape(name)
                where = f"<{name}> of frame {element.get('index', len(document.samples))}"
                channels[name] = _numbers(document.path, child, where, rows * width).reshape(-1, width)
        is_sample = element.get("type", "normal") == "normal"
        (document.samples if is_sample else document.calibration_poses).append(MvnxFrame(element.attrib, channels))


def _numbers(path: Path, element: ET.Element, where: str, count: int) -> Array:
    try:
        numbers = np.array((element.text or "").split(), dtype=float)
    except ValueError as error:
        raise FileFormatError(f"{path}: {where}: {error}: expected {count} numbers") from error
    if len(numbers) != count:
        raise FileFormatError(f"{path}: {where} has {len(numbers)} numbers: expected {count}")
    return numbers


def body_of(document: MvnxDocument, time: Array, notes: list[str]) -> tuple[Motion, bool]:
    """The wearer's motion in our skeleton, and whether its stature is from the file.

    Raises:
        InputError: if the file does not hold all of it.
    """
    quaternions, positions = document.channel("orientation"), document.channel("position")
    missing = sorted({"Pelvis", *SEGMENT_PARENTS} - set(document.segments))
    if missing:
        raise InputError(f"segment {missing[0]} is missing")
    if quaternions is None or positions is None:
        raise InputError("the frames hold no segment orientations and positions")
    whole = np.all(np.isfinite(quaternions), axis=(1, 2)) & np.all(np.isfinite(positions), axis=(1, 2))
    if not np.all(whole) or np.any(np.abs(np.diff(time) * document.frame_rate - 1) > 0.1):
        raise InputError("some frames are missing")
    offsets = _offsets(document)
    if offsets is None:
        raise InputError("neither the segments' points nor a pose of the calibration is in the file")
    try:
        R_world_segment = matrix_from_quaternion(quaternions, Order.WXYZ)
        R_zero, convention, closure_m = _zero_pose(document, offsets, R_world_segment, positions)
    except ValueError as error:
        raise FileFormatError(f"{document.path}: segment orientations: {error}") from error
    skeleton, has_stature = _skeleton(document, offsets)
    R_world_bone = _bone_rotations(document, offsets, R_world_segment @ transpose(R_zero))
    p_world_pelvis = positions[:, document.segments.index("Pelvis")]
    motion = Motion(
        skeleton, local_rotations(R_world_bone), p_world_pelvis, document.frame_rate, float(time[0]), "Xsens MVN"
    )
    rows = [document.segments.index(BONE_SEGMENTS[name]) for name in JOINT_NAMES]
    miss = np.linalg.norm(motion.state.p_world_joint - positions[:, rows], axis=-1)[:, :-2]  # knuckles have no twin
    notes.append(
        f"segment orientations refer to {convention}; joints meet within {closure_m * 1000:.1f} mm; our "
        f"joints lie {miss.mean() * 1000:.1f} mm from MVN's"
    )
    if closure_m > SANE_CLOSURE_M:
        notes.append("MVN's joints do not meet in any known convention of its axes: distrust its motion")
    if not document.is_full_body:
        notes.append(
            f"MVN's configuration is {document.configuration or 'not stated'}: limbs without sensors are no truth, and "
            "not compared"
        )
    return motion, has_stature


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
    children = [row(child) for child in offsets]
    parents = [row(SEGMENT_PARENTS[child]) for child in offsets]
    bones = np.stack(list(offsets.values()))[..., None]
    fits = []
    for label, R_zero in candidates:
        R = (R_world_segment @ transpose(R_zero))[:, parents]
        miss = positions[:, parents] + (R @ bones)[..., 0] - positions[:, children]
        fits.append((R_zero, label, float(np.linalg.norm(miss, axis=-1).mean())))
    return min(fits, key=lambda fit: fit[2])


def _bone_rotations(document: MvnxDocument, offsets: dict[str, Array], R_world_segment: Array) -> Array:
    at = {name: R_world_segment[:, row] for row, name in enumerate(document.segments)}
    # spine1 spans L5 and L3: it turns as they do on average, by length, so that spine2 stays where MVN has it.
    lengths = np.linalg.norm(offsets["L3"]), np.linalg.norm(offsets["T12"])  # of L5, of L3
    share = float(lengths[1] / (lengths[0] + lengths[1]))
    spine1 = at["L5"] @ exp(share * log(transpose(at["L5"]) @ at["L3"]))
    bones = [spine1 if name == "spine1" else at[BONE_SEGMENTS[name]] for name in JOINT_NAMES]
    return np.stack(bones, axis=1) @ R_segment_bone


def _skeleton(document: MvnxDocument, offsets: dict[str, Array]) -> tuple[Skeleton, bool]:
    """Our skeleton with MVN's lengths, and whether all landmarks are in the file; others follow from the legs."""
    legs = np.linalg.norm(offsets["LeftLowerLeg"]) + np.linalg.norm(offsets["LeftFoot"])
    usual = skeleton_from_stature(float(np.clip(legs / LEGS, *STATURE_RANGE_M)))
    p_parent_joint = usual.p_parent_joint.copy()
    for name in JOINT_NAMES[1:]:
        segment = BONE_SEGMENTS[name]
        offset = offsets["L3"] + offsets["T12"] if name == "spine2" else offsets[segment]
        if not name.endswith("_hand"):
            p_parent_joint[joint_index(name)] = offset @ R_segment_bone
    landmarks = dict(usual.landmarks)
    present = {name: point for name, point in LANDMARK_POINTS.items() if point in document.points}
    for name, point in present.items():
        p_bone_point = document.points[point] @ R_segment_bone
        if name.endswith("_fingertip"):  # given from the wrist: part of the way is our hand joint
            joint = joint_index(name.replace("fingertip", "hand"))
            p_parent_joint[joint] = HAND_KNUCKLES * p_bone_point
            p_bone_point = (1 - HAND_KNUCKLES) * p_bone_point
        landmarks[name] = Landmark(usual.landmarks[name].bone, p_bone_point)
    skeleton = Skeleton(p_parent_joint, landmarks, f"Xsens MVN {document.software}, {document.path.name}")
    return skeleton, len(present) == len(LANDMARK_POINTS)


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
    motion, placement, has_stature = None, None, False
    try:
        motion, has_stature = body_of(document, time, notes)
        placement = _placement(imus, motion)
        notes.append("the mountings are those that MVN's own motion implies")
    except FileFormatError:
        raise
    except InputError as error:
        notes.append(f"no motion of MVN's own: {error}")
    sites = {name: SENSOR_SITES[name] for name in imus if name in SENSOR_SITES}
    notes += [f"sensor {name} has no usual place on the body" for name in imus if name not in sites]
    return ImportedLog(
        format=FORMAT,
        imus=imus,
        default_sites=sites,
        placement=placement,
        truth_motion=motion,
        truth_bones=_known_bones(document, placement),
        stature_m=motion.skeleton.stature if motion is not None and has_stature else None,
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
            f = np.einsum("nji,nj->ni", R, free[:, row] + GRAVITY * UP)
        imus[name] = ImuStream.from_samples(name, time, f, R, None if rate is None else rate[:, row])
    return imus


def _placement(imus: dict[str, ImuStream], motion: Motion) -> Placement:
    """Each sensor where its kind is worn, turned on its bone as MVN has it on average."""
    sites = []
    for name, stream in imus.items():
        if name not in SENSOR_SITES or stream.R_inertial_sensor is None:
            continue
        usual = sensor_site(SENSOR_SITES[name], motion.skeleton, name)
        frames = np.searchsorted(motion.time, stream.time - 0.5 / motion.rate)
        R_world_bone = motion.state.R_world_bone[frames, usual.bone_index]
        R_bone_sensor = mean_rotation(transpose(R_world_bone) @ stream.R_inertial_sensor)
        sites.append(SensorSite(name, usual.bone, usual.p_bone_sensor, R_bone_sensor, MVN_MOUNTING_SIGMA))
    return Placement(tuple(sites), FORMAT)


def _known_bones(document: MvnxDocument, placement: Placement | None) -> frozenset[str] | None:
    """Bones that carry a sensor, and those between such bones; None, which is all, where every limb has one."""
    if placement is None or document.is_full_body:
        return None
    worn = {site.bone_index for site in placement.sites}
    above = {joint for sensor in worn for joint in ancestors(sensor)}
    return frozenset(JOINT_NAMES[joint] for joint in above if worn & set(ancestors(joint)))
