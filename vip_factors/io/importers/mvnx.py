"""MVNX, the XML that Xsens MVN exports (versions 3 and 4): its sensors as streams, its segments as the truth.

Sensor orientations are global (w first, Z up). Version 3 gives the sensors' specific force itself, version 4 their
acceleration in the world without gravity, from which it follows.

MVN's segment axes are x forward, y left, z up on a person in the T-pose, with every orientation the identity there.
Older files (MVN Studio 4) follow the ISB instead and turn the arms' axes; the calibration's pose with straight bones
then says how. The file does not name its convention: the one is taken under which joints of two segments meet best.
"""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from itertools import pairwise
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
from vip_factors.io.importers.shared import GRAVITY, UP, ImportedLog, rotations_or_nan, site_of_name
from vip_factors.io.importers.text_table import peek
from vip_factors.io.motions.skeleton_maps import both_sides
from vip_factors.sensors.calibration import Placement, SensorSite, sensor_site
from vip_factors.sensors.imu_stream import ImuStream

FORMAT = "mvnx"
# MVN's mountings come from a pose held by eye and some steps walked: better than a careless pose (15°), not exact.
MVN_MOUNTING_SIGMA = np.deg2rad(10.0)
UTC_YEAR_2000_MS = 946_684_800_000  # earlier "ms" attributes count from the recording's start, not from 1970

# Our bone axes in MVN's: x left, y up, z forward.
R_segment_bone = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

_TRUNK = ("Pelvis", "L5", "L3", "T12", "T8", "Neck", "Head")
_ARM = ("T8", "{}Shoulder", "{}UpperArm", "{}ForeArm", "{}Hand")
_LEG = ("Pelvis", "{}UpperLeg", "{}LowerLeg", "{}Foot", "{}Toe")
SEGMENT_PARENTS = {child: parent for parent, child in pairwise(_TRUNK)} | {
    child.format(side): parent.format(side)
    for side in ("Right", "Left")
    for chain in (_ARM, _LEG)
    for parent, child in pairwise(chain)
}
SENSOR_SITES = {"T8": "sternum"} | {
    name: site
    for name in ("Pelvis", *SEGMENT_PARENTS)
    if not name.endswith("Toe") and (site := site_of_name(name)) is not None
}
# Our bones and the segment whose turning they take; L3 shares spine1 with L5, see _bone_rotations.
_TRUNK_BONES = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")
_LIMB_BONES = ("collar", "shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "foot")
BONE_SEGMENTS = dict(zip(_TRUNK_BONES, ("Pelvis", "L5", "T12", "T8", "Neck", "Head"), strict=True)) | both_sides(
    dict(zip(_LIMB_BONES, (*_ARM[1:], _ARM[-1], *_LEG[1:]), strict=True)), "Left", "Right"
)
# Our landmarks as points of segments.
_POINTS = {"heel": "{0}Foot/p{0}HeelFoot", "toe_tip": "{0}Toe/p{0}Toe", "fingertip": "{0}Hand/p{0}TopOfHand"}
LANDMARK_POINTS = {"head_top": "Head/pTopOfHead"} | both_sides(_POINTS, "Left", "Right")

# What is read of a frame: the element, and how many numbers each segment or sensor has in it.
_VECTORS = ("position", "sensorFreeAcceleration", "sensorAcceleration", "sensorAngularVelocity")
CHANNELS = {"orientation": 4, "sensorOrientation": 4} | dict.fromkeys(_VECTORS, 3)
FULL_BODY = "FullBody"  # MVN's configuration in which every limb carries a sensor
STRAIGHT_POSES = ("identity", "npose", "tpose")  # poses of the calibration that show the zero pose, the best first
SANE_CLOSURE_M = 0.03  # joints of a right convention meet within millimetres; the arms of a wrong one miss by 0.3 m


class MvnxFrame(NamedTuple):
    """A frame's attributes, and its numbers by channel, one row per segment or sensor."""

    attributes: dict[str, str]
    channels: dict[str, Array]


@dataclass
class MvnxDocument:
    """Content of an MVNX file.

    Attributes:
        path: the file.
        version, software: of the format and of MVN, as written.
        frame_rate: Hz.
        configuration: the set of sensors that the subject wears, in MVN's words; blank if the file does not say.
        segments, sensors: labels, in the order of the rows of every channel.
        points: ``segment/point`` → metres, in the segment's axes in the T-pose (x forward, y left, z up).
        joints: pairs of such points, the parent's first, that coincide.
        samples: frames of the recording, in order.
        calibration_poses: frames before it: identity, T-pose, N-pose …
        truncated: why the file cannot be read to its end; blank if it can.
    """

    path: Path
    version: str
    software: str
    frame_rate: float
    configuration: str
    segments: list[str]
    sensors: list[str]
    points: dict[str, Array]
    joints: list[tuple[str, str]]
    samples: list[MvnxFrame] = field(default_factory=list)
    calibration_poses: list[MvnxFrame] = field(default_factory=list)
    truncated: str = ""

    @property
    def is_full_body(self) -> bool:
        """Whether every limb carries a sensor, by the configuration, else by the sensors' names."""
        return self.configuration == FULL_BODY or (not self.configuration and set(SENSOR_SITES) <= set(self.sensors))

    def channel(self, name: str) -> Array | None:
        """A channel of all samples, ``(N, rows, width)``, NaN where a sample lacks it; None if all do."""
        present = next((sample.channels[name] for sample in self.samples if name in sample.channels), None)
        if present is None:
            return None
        return np.stack([sample.channels.get(name, np.full_like(present, np.nan)) for sample in self.samples])

    def add(self, frame: ET.Element) -> None:
        """Add a frame, a sample or a pose of the calibration."""
        channels = {}
        for child in frame:
            if (name := _tag(child)) in CHANNELS:
                rows, width = len(self.sensors if name.startswith("sensor") else self.segments), CHANNELS[name]
                where = f"<{name}> of frame {frame.get('index', len(self.samples))}"
                channels[name] = _numbers(self.path, child, where, rows * width).reshape(-1, width)
        is_sample = frame.get("type", "normal") == "normal"
        (self.samples if is_sample else self.calibration_poses).append(MvnxFrame(frame.attrib, channels))


def read_document(path: Path) -> MvnxDocument:
    """Parse an MVNX file of any size as a stream; one that breaks off gives the frames before the break.

    Raises:
        FileFormatError: if the file is not MVNX, has no samples, or a frame's numbers do not fit the labels.
    """
    root, frames, document, problem = None, None, None, ""
    try:
        for event, element in ET.iterparse(path, events=("start", "end")):
            root = element if root is None else root
            if event == "start" and _tag(element) == "frames":
                frames, document = element, _header(path, root)
            elif event == "end" and _tag(element) == "frame" and frames is not None and document is not None:
                document.add(element)
                frames.clear()
    except FileFormatError:
        raise
    except (ET.ParseError, LookupError, ValueError) as error:  # the latter two: an unknown encoding
        problem = str(error)
        if document is None or not document.samples:
            raise FileFormatError(f"{path}: not readable as XML ({error}): expected an MVNX file") from error
    if document is None or not document.samples:
        raise FileFormatError(f"{path}: no frame of type 'normal': expected an MVNX recording with frames")
    document.truncated = problem
    return document


def _tag(element: ET.Element) -> str:
    """The tag without its namespace."""
    return element.tag.rpartition("}")[2]


def _header(path: Path, root: ET.Element) -> MvnxDocument:
    """The document without frames, from the elements above these."""
    software, subject = root.find(".//{*}mvn"), root.find(".//{*}subject")
    rate = "0" if subject is None else subject.get("frameRate", "0")
    try:
        frame_rate = float(rate)
    except ValueError as error:
        raise FileFormatError(f"{path}: frameRate = '{rate}': expected a number") from error
    if not frame_rate > 0:
        raise FileFormatError(f"{path}: <subject> gives no frameRate: expected frames per second")
    segments, points = [], dict[str, Array]()
    for segment in root.iterfind(".//{*}segment"):
        segments.append(segment.get("label", "?"))
        for point in segment.iterfind(".//{*}point"):
            if len(point):
                points[f"{segments[-1]}/{point.get('label', '?')}"] = _numbers(path, point[0], "a point", 3)
    joints = [[(end.text or "").strip() for end in joint] for joint in root.iterfind(".//{*}joint")]
    return MvnxDocument(
        path,
        version=root.get("version", "?"),
        software="?" if software is None else software.get("version", "?"),
        frame_rate=frame_rate,
        configuration="" if subject is None else subject.get("configuration", ""),
        segments=segments,
        sensors=[sensor.get("label", "?") for sensor in root.iterfind(".//{*}sensor")],
        points=points,
        joints=[(ends[0], ends[1]) for ends in joints if len(ends) == 2],
    )


def _numbers(path: Path, element: ET.Element, where: str, count: int) -> Array:
    try:
        numbers = np.array((element.text or "").split(), dtype=float)
    except ValueError as error:
        raise FileFormatError(f"{path}: {where}: {error}: expected {count} numbers") from error
    if len(numbers) != count:
        raise FileFormatError(f"{path}: {where} has {len(numbers)} numbers: expected {count}")
    return numbers


def body_of(document: MvnxDocument, time: Array, notes: list[str]) -> tuple[Motion, bool]:
    """Convert the wearer's motion to our skeleton; also whether its stature is from the file.

    Raises:
        InputError: if a part of it is missing in the file.
    """
    quaternions, positions = document.channel("orientation"), document.channel("position")
    missing = sorted({"Pelvis", *SEGMENT_PARENTS} - set(document.segments))
    if missing:
        raise InputError(f"segment {missing[0]} is missing")
    if quaternions is None or positions is None:
        raise InputError("the frames hold no segment orientations and positions")
    is_complete = np.all(np.isfinite(quaternions), axis=(1, 2)) & np.all(np.isfinite(positions), axis=(1, 2))
    if not np.all(is_complete) or np.any(np.abs(np.diff(time) * document.frame_rate - 1) > 0.1):
        raise InputError("some frames are missing")
    offsets = _offsets(document)
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


def _offsets(document: MvnxDocument) -> dict[str, Array]:
    """Origin of each segment from its parent's origin, in MVN's axes in the T-pose."""
    offsets, points = {}, document.points
    for parent, child in document.joints:
        segment = child.partition("/")[0]
        if {parent, child} <= points.keys() and SEGMENT_PARENTS.get(segment) == parent.partition("/")[0]:
            offsets[segment] = points[parent] - points[child]
    if set(offsets) == set(SEGMENT_PARENTS):
        return offsets
    for kind in STRAIGHT_POSES:
        for pose in document.calibration_poses:
            if pose.attributes.get("type") == kind and "position" in pose.channels:
                p = dict(zip(document.segments, pose.channels["position"], strict=True))
                return {child: p[child] - p[parent] for child, parent in SEGMENT_PARENTS.items()}
    raise InputError("neither the segments' points nor a pose of the calibration is in the file")


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
    R = {name: R_world_segment[:, row] for row, name in enumerate(document.segments)}
    # spine1 spans L5 and L3: it turns as they do on average, by length, so that spine2 stays where MVN has it.
    length_L5, length_L3 = np.linalg.norm(offsets["L3"]), np.linalg.norm(offsets["T12"])
    share = float(length_L3 / (length_L5 + length_L3))
    spine1 = R["L5"] @ exp(share * log(transpose(R["L5"]) @ R["L3"]))
    bones = [spine1 if name == "spine1" else R[BONE_SEGMENTS[name]] for name in JOINT_NAMES]
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
    return re.search("<mvnx[ >]", peek(path)) is not None


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
    known_bones = None  # all, where every limb has a sensor
    if placement is not None and not document.is_full_body:
        # Bones that carry a sensor, and those between such bones.
        worn = {site.bone_index for site in placement.sites}
        above = {joint for sensor in worn for joint in ancestors(sensor)}
        known_bones = frozenset(JOINT_NAMES[joint] for joint in above if worn & set(ancestors(joint)))
    sites = {name: SENSOR_SITES[name] for name in imus if name in SENSOR_SITES}
    notes += [f"sensor {name} has no usual place on the body" for name in imus if name not in sites]
    start = document.samples[0].attributes.get("ms", "")
    return ImportedLog(
        format=FORMAT,
        imus=imus,
        default_sites=sites,
        placement=placement,
        truth_motion=motion,
        truth_bones=known_bones,
        stature_m=motion.skeleton.stature if motion is not None and has_stature else None,
        start_ns=int(start) * 1_000_000 if start.isdigit() and int(start) > UTC_YEAR_2000_MS else 0,
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
