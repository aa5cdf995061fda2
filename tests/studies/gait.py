"""How somebody moved as others measured it, and how far ours is from it: angles, joint centres, a video.

A video is no reference: what a monocular one takes for the depth of a wrist is off by decimetres.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from tests.studies.marker_body import ARMS, LEGS, SHOULDERS, SIDES, MarkerBody, marker_columns
from vip_factors.body.joint_angles import R_BODY_ISB, joint_angles
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError
from vip_factors.geometry.poses import align_rigid
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, transpose

OPENSIM_NAMES = {"knee": "knee_angle", "hip": "hip_flexion", "elbow": "elbow_flex"}
TRIAL = "S02-Trial-Walk-1"
VICON_HZ = 100.0
FIRST_PACKET = 1120  # of the raw export, at the first row of the Vicon file
# Vicon's name of our joints.
CENTRES = {f"{side}_{joint}": f"{side[0].upper()}{name}" for joint, name in
           (("hip", "FEP"), ("knee", "FEO"), ("ankle", "TIO")) for side in SIDES}  # fmt: skip
# Vicon's segment axes (x forward, y left, z up) as columns of ours (x left, y up, z forward).
R_VICON_BONE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
JOINTS = ("hip", "knee", "ankle")
VIDEO_HZ = 30.0  # of VIDIMU's camera
BENDS = {"knee": ("hip", "knee", "ankle"), "elbow": ("shoulder", "elbow", "wrist")}
MOST_LAG_S, STEP_S = 1.5, 1 / 60  # both were started by hand within a second
LEAST_BEND_DEG = 10.0  # standard deviation in the video: a joint that hardly moves tells of no lag
LEAST_CORRELATION = 0.4  # the best of all lags of two unrelated motions is about 0.2


@dataclass(frozen=True)
class GaitMotion:
    """How somebody walks.

    Attributes:
        time: ``(T,)`` seconds.
        flexion: degrees ``(T,)`` of joints by name (``left_knee``, …), and how far the ``trunk`` (from hips to
            shoulders) and the ``thorax`` (its own axis) lean forward.
        p_world_joint: ``(T, 3)`` metres of joint centres by name, where they are known.
    """

    time: Array
    flexion: Mapping[str, Array]
    p_world_joint: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class AngleError:
    """Degrees: RMSE, and RMSE once the mean difference is removed."""

    rmse: float
    without_offset: float


def rmse_without_offset(estimate: Array, truth: Array) -> float:
    """Root mean square difference once its mean is removed: two laboratories' zero angles seldom agree."""
    difference = np.asarray(estimate) - np.asarray(truth)
    return float(np.sqrt(np.nanmean((difference - np.nanmean(difference)) ** 2)))


def vicon_angles(folder: Path) -> GaitMotion:
    """Of ``xsens_vicon_walk``: segments and joint centres by optical markers, from the first raw packet on.

    The export is comma-separated: ``//`` comments, a header, then joint centres (``NAME_1…3``) and ``qNAME_1…4``.
    """
    path = folder / "vicon" / f"{TRIAL}.csv"
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("//")]
    names, table = lines[0].strip().split(","), np.loadtxt(lines[1:], delimiter=",", ndmin=2)

    def columns(name: str, count: int) -> Array:
        wanted = [f"{name}_{number}" for number in range(1, count + 1)]
        missing = [one for one in wanted if one not in names]
        if missing:
            raise FileFormatError(f"{path}: no column '{missing[0]}'; expected Vicon's joint centres and segments")
        return table[:, [names.index(one) for one in wanted]]

    def bone(segment: str) -> Array:
        return matrix_from_quaternion(columns(f"q{segment}", 4), Order.WXYZ) @ R_VICON_BONE

    centres, flexion = {name: columns(own, 3) for name, own in CENTRES.items()}, dict[str, Array]()
    for side in SIDES:
        thigh, shank = (bone(f"{side[0].upper()}{segment}") for segment in ("TH", "SK"))
        flexion[f"{side}_knee"] = knee_flexion_deg(thigh, shank)
        flexion[f"{side}_hip"] = hip_flexion_deg(bone("RPV"), thigh)
    return GaitMotion((FIRST_PACKET + np.arange(len(table))) / VICON_HZ, flexion, centres)


def optical_angles(path: Path) -> GaitMotion:
    """Of ``optical_joint_centres.csv``: segments in OpenSim's axes and joint centres, by inverse kinematics."""
    table = np.genfromtxt(path, delimiter=",", names=True)

    def bone(segment: str) -> Array:
        quaternions = marker_columns(table, [f"{segment}_q{letter}" for letter in "wxyz"], path)
        return matrix_from_quaternion(quaternions, Order.WXYZ) @ R_BODY_ISB.T  # OpenSim's segments have ISB's axes

    flexion, centres = dict[str, Array](), dict[str, Array]()
    for side in SIDES:
        thigh, shank = bone(f"femur_{side[0]}"), bone(f"tibia_{side[0]}")
        flexion[f"{side}_knee"] = knee_flexion_deg(thigh, shank)
        flexion[f"{side}_hip"] = hip_flexion_deg(bone("pelvis"), thigh)
        for joint in JOINTS:
            centres[f"{side}_{joint}"] = marker_columns(table, [f"{joint}_{side[0]}_{axis}" for axis in "xyz"], path)
    return GaitMotion(marker_columns(table, ["time_s"], path)[:, 0], flexion, centres)


def marker_motion(body: MarkerBody) -> GaitMotion:
    """Of a body from markers: angles between the lines that join its joint centres.

    Hips are bent against the pelvis of the iliac spines, which whoever stands straight tilts forward by ten degrees.
    """
    flexion, bones = dict[str, Array](), body.R_world_bone
    for side in SIDES:
        flexion[f"{side}_knee"] = bend_deg(*(body.centres[f"{side}_{joint}"] for joint in JOINTS))
        flexion[f"{side}_hip"] = hip_flexion_deg(bones["pelvis"], bones[f"{side}_hip"])
    flexion |= _inclinations(body.centres, bones["spine3"])
    return GaitMotion(body.time, flexion, body.centres)


def opensim_angles(path: Path, begins: float = 0.0, joints: tuple[str, ...] = ("knee", "hip")) -> GaitMotion:
    """Of a motion file of OpenSim, in degrees; a gait model of which knees bend by ``knee_angle_r``, ``_l``.

    ``begins`` is the second of the recording at which the file does.
    """
    lines = path.read_text(encoding="utf-8").splitlines()
    try:
        header = lines.index("endheader")
    except ValueError:
        raise FileFormatError(f"{path}: no line 'endheader'; expected a motion file of OpenSim") from None
    names, table = lines[header + 1].split(), np.loadtxt(lines[header + 2 :], ndmin=2)
    flexion = {}
    for side in SIDES:
        for joint in joints:
            name = f"{OPENSIM_NAMES[joint]}_{side[0]}"
            if name not in names:
                raise FileFormatError(f"{path}: no column '{name}'; expected joint angles of OpenSim's gait model")
            flexion[f"{side}_{joint}"] = table[:, names.index(name)]
    return GaitMotion(begins + table[:, names.index("time")], flexion)


def gait_of(motion: Motion) -> GaitMotion:
    """Of an estimate."""
    angles = joint_angles(motion)
    flexion = {f"{side}_knee": angles.of(f"{side}_knee_flexion") for side in SIDES}
    flexion |= {f"{side}_hip": hip_flexion_of(motion, side) for side in SIDES}
    p = motion.state.p_world_joint
    centres = {name: p[:, joint_index(name)] for name in (*LEGS, *SHOULDERS, *ARMS)}
    flexion |= _inclinations(centres, motion.state.R_world_bone[:, joint_index("spine3")])
    for side in SIDES:
        chain = (f"{side}_{name}" for name in ("shoulder", "elbow", "wrist"))
        flexion[f"{side}_elbow"] = bend_deg(*(p[:, joint_index(name)] for name in chain))
    return GaitMotion(motion.time, flexion, centres)


def _inclinations(centres: Mapping[str, Array], R_world_thorax: Array) -> dict[str, Array]:
    left = centres["left_hip"] - centres["right_hip"]
    hips, shoulders = (centres[f"left_{one}"] + centres[f"right_{one}"] for one in ("hip", "shoulder"))
    return {"trunk": inclination_deg(shoulders - hips, left), "thorax": inclination_deg(R_world_thorax[..., 1], left)}


def angle_errors(found: GaitMotion, reference: GaitMotion) -> dict[str, AngleError]:
    """By joint name, over the reference's time that both have."""
    both = _shared(found, reference)
    errors = {}
    for name, true in reference.flexion.items():
        ours = np.interp(reference.time[both], found.time, found.flexion[name])
        errors[name] = AngleError(rmse(ours, true[both]), rmse_without_offset(ours, true[both]))
    return errors


def centres_error_mm(found: GaitMotion, reference: GaitMotion) -> float:
    """Mean distance of hips, knees and ankles after a rigid motion of every frame; NaN where none are known."""
    return _distances_mm(found, reference, LEGS).get("legs", np.nan)


def body_errors_mm(found: GaitMotion, reference: GaitMotion) -> dict[str, float]:
    """Mean distances after a rigid motion of every frame: of the whole ``body``, its ``legs``, ``shoulders``, ``arms``.

    Empty where not all of these joint centres are known.
    """
    return _distances_mm(found, reference, (*LEGS, *SHOULDERS, *ARMS))


def _distances_mm(found: GaitMotion, reference: GaitMotion, names: tuple[str, ...]) -> dict[str, float]:
    both = _shared(found, reference)
    if not set(names) <= set(reference.p_world_joint) or not both.any():
        return {}
    time = reference.time[both]
    true = np.stack([reference.p_world_joint[name][both] for name in names], axis=1)
    ours = make_interp_spline(found.time, np.stack([found.p_world_joint[name] for name in names], axis=1), k=1)(time)
    error = dict(zip(names, 1000 * np.linalg.norm(align_rigid(ours, true).apply(ours) - true, axis=-1).T, strict=True))
    parts = {"body": names, "legs": LEGS, "shoulders": SHOULDERS, "arms": ARMS}
    return {
        part: float(np.mean([error[name] for name in members]))
        for part, members in parts.items()
        if set(members) <= set(names)
    }


def _shared(found: GaitMotion, reference: GaitMotion) -> np.ndarray:
    return (reference.time >= found.time[0]) & (reference.time <= found.time[-1])


@dataclass(frozen=True)
class Agreement:
    """Of one joint on both sides.

    Attributes:
        joint: ``knee`` or ``elbow``.
        lag_s: to add to the video's times to get the sensors'; NaN if the joint hardly moves or both do not agree.
        correlation: the highest of all lags, both sides together; their means removed.
        degrees, without_offset: RMS difference at that lag, or none, mean of both sides; the same, its mean removed.
        least, most: degrees, 1 % and 99 % of the bend by the sensors.
    """

    joint: str
    lag_s: float
    correlation: float
    degrees: float
    without_offset: float
    least: float
    most: float


def video_motion(path: Path, begins: float) -> GaitMotion:
    """Of VIDIMU's ``.csv``: joint centres that a network found in one camera's video, in the camera's axes.

    ``begins`` is the second of the recording at which both were started.
    """
    table = np.genfromtxt(path, delimiter=",", names=True, autostrip=True)
    centres = {
        f"{side}_{name}": marker_columns(table, [f"{side}_{name}_{axis}" for axis in "xyz"], path) / 1000
        for chain in BENDS.values()
        for name in chain
        for side in SIDES
    }
    time = begins + np.arange(len(table)) / VIDEO_HZ
    flexion = {
        f"{side}_{joint}": bend_deg(*(centres[f"{side}_{name}"] for name in chain))
        for joint, chain in BENDS.items()
        for side in SIDES
    }
    return GaitMotion(time, flexion, centres)


def agreement(joint: str, sensors: GaitMotion, video: GaitMotion) -> Agreement:
    """How far both agree about a joint, at the lag at which they do most."""
    names = [f"{side}_{joint}" for side in SIDES]
    own = np.stack([sensors.flexion[name] for name in names])
    least, most = np.quantile(own, [0.01, 0.99])
    moving = [name for name in names if np.std(video.flexion[name]) > LEAST_BEND_DEG]
    lags = np.arange(-MOST_LAG_S, MOST_LAG_S + STEP_S / 2, STEP_S)
    scores = [_correlation(moving, sensors, video, lag) for lag in lags] if moving else [np.nan]
    best = int(np.argmax(scores))
    lag = float(lags[best]) if scores[best] > LEAST_CORRELATION else np.nan
    pairs = [_shifted(name, sensors, video, float(np.nan_to_num(lag))) for name in names]
    return Agreement(
        joint, lag, float(scores[best]), float(np.mean([rmse(ours, theirs) for ours, theirs in pairs])),
        float(np.mean([rmse_without_offset(ours, theirs) for ours, theirs in pairs])), float(least), float(most),
    )  # fmt: skip


def _shifted(name: str, sensors: GaitMotion, video: GaitMotion, lag: float) -> tuple[Array, Array]:
    """Both at the video's instants that the sensors have too."""
    time = video.time + lag
    both = (time >= sensors.time[0]) & (time <= sensors.time[-1])
    return np.interp(time[both], sensors.time, sensors.flexion[name]), video.flexion[name][both]


def _correlation(names: list[str], sensors: GaitMotion, video: GaitMotion, lag: float) -> float:
    pairs = [_shifted(name, sensors, video, lag) for name in names]
    ours, theirs = (np.concatenate([pair[k] - np.mean(pair[k]) for pair in pairs]) for k in range(2))
    return float(ours @ theirs / max(np.linalg.norm(ours) * np.linalg.norm(theirs), 1e-9))


def hip_flexion_deg(R_world_pelvis: Array, R_world_thigh: Array) -> Array:
    """Hip flexion ``(...)`` in degrees, of pelvis and thigh orientations ``(..., 3, 3)``; forward is positive.

    The convention of :func:`knee_flexion_deg`, but flexion takes the thigh forward, which is a turn about −x.
    """
    return -knee_flexion_deg(R_world_pelvis, R_world_thigh)


def hip_flexion_of(motion: Motion, side: str) -> Array:
    """Hip flexion ``(T,)`` in degrees of the ``"left"`` or ``"right"`` hip of a motion."""
    R_world_bone = motion.state.R_world_bone
    return hip_flexion_deg(R_world_bone[:, joint_index("pelvis")], R_world_bone[:, joint_index(f"{side}_hip")])


def bend_deg(p_above: Array, p_joint: Array, p_below: Array) -> Array:
    """How far ``(...)`` degrees a knee or an elbow is from straight, of joint centres ``(..., 3)``; never negative.

    No axes of bones are needed, which no two skeletons share.
    """
    above, below = p_joint - p_above, p_below - p_joint
    cosine = np.sum(above * below, axis=-1) / np.linalg.norm(above, axis=-1) / np.linalg.norm(below, axis=-1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def inclination_deg(up: Array, left: Array) -> Array:
    """How far ``(T,)`` degrees an axis of the trunk leans forward, seen from where the person's left is.

    Args:
        up: ``(T, 3)`` along the axis, in a world with z up; from the middle of the hips to that of the shoulders, say,
            which all skeletons have, or a bone's own axis, about whose zero no two skeletons agree.
        left: ``(T, 3)`` from the right hip to the left one.
    """
    forward = np.stack([left[..., 1], -left[..., 0]], axis=-1)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    return np.rad2deg(np.arctan2(np.sum(up[..., :2] * forward, axis=-1), up[..., 2]))


def knee_flexion_deg(R_world_thigh: Array, R_world_shank: Array) -> Array:
    """Knee flexion ``(...)`` in degrees, of thigh and shank orientations ``(..., 3, 3)``; 0 is a straight leg.

    Grood & Suntay (1983), J. Biomech. Eng. 105: flexion is about the thigh's mediolateral axis (our x, to the left
    on both sides), internal rotation about the shank's long axis (our y), adduction about the floating axis between.
    So ``R_thigh_shank = Rx(flexion) Rz(adduction) Ry(rotation)``, and flexion takes the shank back (+x).
    """
    R_thigh_shank = transpose(R_world_thigh) @ R_world_shank
    return np.rad2deg(np.arctan2(R_thigh_shank[..., 2, 1], R_thigh_shank[..., 1, 1]))


def rmse(estimate: Array, truth: Array) -> float:
    """Root mean square difference, NaN samples left out."""
    return float(np.sqrt(np.nanmean((np.asarray(estimate) - np.asarray(truth)) ** 2)))
