"""Tables of numbers: for spreadsheets and pandas (.csv), and for OpenSim markers (.trc), coordinates of the model
Rajagopal2016 (.mot) and orientations of segments (.sto); and C3D, joint angles as points of Vicon's kind ANGLES.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.atomic import check_complete
from vip_factors.body.joint_angles import R_WORLD_ISB, JointAngles, joint_angles, mirrored, segment_orientations
from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.display import one_line
from vip_factors.estimate import TABLES, Estimate
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import (
    Array,
    continuous,
    exp,
    inverse_right_jacobian,
    log,
    rotation_between,
    sequence_of_rotation,
    transpose,
)
from vip_factors.io.settings import ExportSettings


def write_csv(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's table: positions to ``walk.positions.csv``, angles to ``walk.angles.csv``, else both.

    The columns are those of :meth:`~vip_factors.estimate.Estimate.columns`.
    """
    # The file's temporary name has the words of the final one.
    named = [table for table in TABLES if table in path.name.lower().split(".")] or TABLES
    columns = estimate.columns(tables=named)
    digits = [4 if name.endswith("_deg") else 6 for name in columns]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(columns) + "\n")
        np.savetxt(file, np.column_stack(list(columns.values())), [f"%.{number}f" for number in digits], ",")


_PAIRS = "eye ear shoulder elbow wrist hip knee ankle heel big_toe small_toe"
KEYPOINT_MARKERS = {"Nose": "nose", "Head": "head_top", "Neck": "neck", "Hip": "mid_hip"} | {
    f"{side[0].upper()}{keypoint.title().replace('_', '')}": f"{side}_{keypoint}"
    for side in ("right", "left")
    for keypoint in _PAIRS.split()
}
"""Keypoints of COCO, BODY_25, BODY_25B and HALPE_26 by the names in Pose2Sim's models and set-ups."""


def markers(motion: Motion) -> Mapping[str, Array]:
    """Points ``(T, 3)`` in metres, world with z up: joint centres by the skeleton's names, keypoints by Pose2Sim's.

    Toes, heels and the top of the head are left out where the skeleton lacks them.
    """
    points = dict(zip(JOINT_NAMES, np.moveaxis(motion.state.p_world_joint, 1, 0), strict=True))
    places = KeypointSet("markers", tuple(KEYPOINT_MARKERS.values())).on_body(motion.skeleton)
    for name, place in zip(KEYPOINT_MARKERS, places, strict=True):
        if place is not None:
            points[name] = motion.state.point(place.bone, place.p_bone_point)
    return points


def write_opensim_table(path: Path, header: Iterable[str], columns: Sequence[str], rows: Iterable[str]) -> None:
    """Write a table; ``rows`` have their cells separated by tabs, time first."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        for line in (*header, "endheader", "\t".join(("time", *columns)), *rows):
            file.write(f"{line}\n")


def write_trc(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's points in metres, in OpenSim's ground (y up)."""
    motion = estimate.wearers[0].motion
    points = markers(motion)
    table = np.column_stack([p_world_point @ R_WORLD_ISB for p_world_point in points.values()])
    axes = (f"{axis}{number}" for number in range(1, len(points) + 1) for axis in "XYZ")
    keys = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
    rate, frames = f"{motion.rate:.6f}", str(len(motion))
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{one_line(estimate.name)}.trc",
        keys.replace(" ", "\t"),
        "\t".join((rate, rate, frames, str(len(points)), "m", rate, "1", frames)),
        "\t".join(("Frame#", "Time", *("\t\t".join((name, "")) for name in points))),
        "\t".join(("", "", *axes)),
        "",
    ]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(lines) + "\n")
        for number, (time, row) in enumerate(zip(motion.time, table, strict=True), 1):
            file.write("\t".join((str(number), f"{time:.6f}", *(f"{cell:.6f}" for cell in row))) + "\n")


def write_mot(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's motion in degrees and metres, in OpenSim's ground (y up)."""
    motion = estimate.wearers[0].motion
    coordinates = opensim_coordinates(motion)
    table = np.column_stack([motion.time, *coordinates.values()])
    header = (
        *("Coordinates", "version=1", f"nRows={len(table)}", f"nColumns={table.shape[1]}", "inDegrees=yes", ""),
        *("Coordinates of the model Rajagopal2016: degrees, and metres of pelvis_tx, pelvis_ty, pelvis_tz.", ""),
    )
    write_opensim_table(path, header, tuple(coordinates), ("\t".join(f"{cell:.8f}" for cell in row) for row in table))


_LEG = {"femur": "hip", "tibia": "knee", "calcn": "ankle", "toes": "foot"}
_LIMBS = _LEG | {"humerus": "shoulder", "radius": "elbow", "hand": "wrist"}
# Bodies of OpenSim's full-body models, and our bones.
BODIES = {"pelvis": "pelvis", "torso": "spine3", "head": "head"} | {
    f"{body}_{side[0]}": f"{side}_{bone}" for side in ("right", "left") for body, bone in _LIMBS.items()
}


def write_opensense(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's segments as if each had a sensor along its anatomical axes: ``femur_r_imu`` and its like.

    In OpenSim's ground (y up): no further rotation of the sensors' space into OpenSim's is needed.
    """
    motion = estimate.wearers[0].motion
    bones = [joint_index(bone) for bone in BODIES.values()]
    quaternions = quaternion_from_matrix(segment_orientations(motion)[:, bones], Order.WXYZ)
    header = (f"DataRate={motion.rate:.6f}", "DataType=Quaternion", "version=3", "OpenSimVersion=4.6")
    rows = (
        "\t".join([f"{time:.6f}", *(",".join(f"{component:.9f}" for component in wxyz) for wxyz in row)])
        for time, row in zip(motion.time, np.asarray(quaternions), strict=True)
    )
    write_opensim_table(path, header, [f"{body}_imu" for body in BODIES], rows)


# The header counts frames with 16 bits. Longer files state their length in POINT:LONG_FRAMES, which not all readers
# know, and begin at frame 1.
HEADER_FRAMES = 65_535
BLOCK = 512  # bytes, of which all parts of a file are multiples


def write_c3d(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's points in millimetres, world with z up, and angles in degrees, three to a point."""
    import ezc3d

    wearer = estimate.wearers[0]
    motion = wearer.motion
    points = {name: 1000.0 * p for name, p in markers(motion).items()}
    angles, described = _angle_points(joint_angles(motion))
    names = (*points, *angles)
    file: Any = ezc3d.c3d()
    data = np.ones((4, len(names), len(motion)))
    data[:3] = np.stack([*points.values(), *angles.values()]).transpose(2, 0, 1)
    file["data"]["points"] = data
    file["parameters"]["POINT"]["RATE"]["value"] = [motion.rate]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(names)
    file["parameters"]["POINT"]["DESCRIPTIONS"]["value"] = [described.get(name, "") for name in names]
    first_frame = round(motion.start * motion.rate)
    if first_frame < 0 or first_frame + len(motion) > HEADER_FRAMES:
        first_frame = 0
    if first_frame + len(motion) > HEADER_FRAMES:
        file.add_parameter("POINT", "LONG_FRAMES", [float(len(motion))])
    file["header"]["points"]["first_frame"] = first_frame
    for group, name, value in (
        ("POINT", "ANGLES", list(angles)),
        ("POINT", "ANGLE_UNITS", ["deg"]),
        ("POINT", "TYPE_GROUPS", ["ANGLES"]),
        ("POINT", "X_SCREEN", ["+X"]),
        ("POINT", "Y_SCREEN", ["+Z"]),  # up, for programs that draw the points
        ("POINT", "START_TIME", [f"{motion.start:.6f}"]),  # text: as a number it would have 7 digits
        ("SUBJECTS", "USED", [1]),
        ("SUBJECTS", "NAMES", [one_line(wearer.name)]),
        ("MANUFACTURER", "SOFTWARE", ["vip-factors"]),
    ):
        file.add_parameter(group, name, value)
    file.write(str(path))  # reports no error
    with path.open("rb") as written_file:
        header = written_file.read(BLOCK)
    data_start = int.from_bytes(header[16:18], "little")  # block, from 1 on; put in last, unless a write failed before
    size = path.stat().st_size if data_start > 1 else 0
    check_complete(size, BLOCK * max(data_start - 1, 1) + 4 * data.size, "bytes")


# Vicon's points have no name for the second set of a shoulder's angles, nor for these three of the middle.
_NAMES = {"pelvis": "Pelvis", "trunk": "Spine", "neck": "Neck"}


def _angle_points(angles: JointAngles) -> tuple[Mapping[str, Array], Mapping[str, str]]:
    """Triples of angles ``(T, 3)`` in degrees by label, ``LKneeAngles``, and their descriptions."""
    points, described = dict[str, Array](), dict[str, str]()
    for start in range(0, len(angles.definitions), 3):
        three = angles.definitions[start : start + 3]
        side, _, joint = three[0].joint.rpartition("_")
        label = f"{side[:1].upper()}{_NAMES.get(joint, joint.capitalize())}Angles"
        if label in points:
            label = label.replace("Angles", "FlexionAngles")
        columns = [start, start + 1, start + 2]
        if joint == "pelvis":  # sagittal plane first, as of the other joints
            columns, three = columns[::-1], three[::-1]
        points[label] = angles.degrees[:, columns]
        described[label] = ", ".join(angle.name.removeprefix(f"{angle.joint}_") for angle in three)
    return points, described


# Axes of the right side's joints in the model's bodies, all parallel where the coordinates are zero.
ANKLE_AXIS = np.array([-0.10501355, -0.17402245, 0.97912632])
SUBTALAR_AXIS = np.array([0.78717961, 0.60474746, -0.12094949])
TOES_AXIS = np.array([0.58095440, 0.0, -0.81393611])  # positive is toes down
ELBOW_AXIS = np.array([0.22604696, 0.02226900, 0.97386183])
FOREARM_AXIS = np.array([0.05639803, 0.99840646, 0.00195199])
# From the middle of the hips, x and y of the pelvis' origin over half the distance of the hips.
PELVIS_ORIGIN = np.array([0.056276, 0.07849, 0.0]) / 0.07726


# The model's elbow axis does not lie sideways in its upper arm but is turned by 13°. Ours bends about z: the model's
# upper arm is turned about itself until the axes agree, for else a bent forearm would point 13° amiss.
R_ARM_MODEL = rotation_between(ELBOW_AXIS, np.array([0.0, 0.0, 1.0]))


def opensim_coordinates(motion: Motion) -> Mapping[str, Array]:
    """Coordinates ``(T,)`` of the model Rajagopal2016 by their names: degrees, and metres of ``pelvis_tx`` …

    Rajagopal, Dembia, DeMers, Delp, Hicks, Delp (2016), "Full-body musculoskeletal model for muscle-driven simulation
    of human gait", IEEE Trans. Biomed. Eng. 63. Its bodies have x forward, y up, z to the right, and stand, with all
    coordinates zero, in the posture of :mod:`~vip_factors.body.joint_angles`. Pelvis, hips, lumbar joint and shoulders
    turn about three axes, as in the estimate. The other joints have fewer axes: ankle with subtalar, toes,
    and elbow with forearm get the coordinates whose rotation is nearest, knees their flexion and wrists flexion and
    deviation.

    The pelvis' origin, between the foremost points of the iliac crests, lies from the hips as it does in the model,
    scaled by the distance of the hips.
    """
    R = segment_orientations(motion)
    p = motion.state.p_world_joint @ R_WORLD_ISB
    p_left, p_right = p[:, joint_index("left_hip")], p[:, joint_index("right_hip")]
    half_width = np.linalg.norm(p_left - p_right, axis=-1, keepdims=True) / 2
    origin = (p_left + p_right) / 2 + half_width * (R[:, 0] @ PELVIS_ORIGIN)
    trunk = transpose(R[:, 0]) @ R[:, joint_index("spine3")]
    angles = _about_zxy(R[:, 0], "pelvis_tilt", "pelvis_list", "pelvis_rotation")
    angles |= _about_zxy(trunk, "lumbar_extension", "lumbar_bending", "lumbar_rotation")
    for side in ("right", "left"):
        angles |= {f"{name}_{side[0]}": angle for name, angle in _side(R, side).items()}
    degrees = {name: np.rad2deg(np.unwrap(angle)) for name, angle in angles.items()}
    return degrees | {f"pelvis_t{axis}": origin[:, number] for number, axis in enumerate("xyz")}


def _side(R: Array, side: str) -> dict[str, Array]:
    """Coordinates ``(T,)`` of an arm and a leg in radians, by name without its side."""

    def between(above: str, below: str) -> Array:
        R_above, R_below = (
            R[:, joint_index(name if name in ("pelvis", "spine3") else f"{side}_{name}")] for name in (above, below)
        )
        R_above_below = transpose(R_above) @ R_below
        return mirrored(R_above_below) if side == "left" else R_above_below

    elbow = R_ARM_MODEL.T @ between("shoulder", "elbow")
    wrist = sequence_of_rotation(between("elbow", "wrist"), "zxy")
    return {
        **_about_zxy(between("pelvis", "hip"), "hip_flexion", "hip_adduction", "hip_rotation"),
        "knee_angle": -sequence_of_rotation(between("hip", "knee"), "zxy")[:, 0],
        **_nearest(between("knee", "ankle"), {"ankle_angle": ANKLE_AXIS, "subtalar_angle": SUBTALAR_AXIS}),
        **_nearest(between("ankle", "foot"), {"mtp_angle": TOES_AXIS}),
        **_about_zxy(between("spine3", "shoulder") @ R_ARM_MODEL, "arm_flex", "arm_add", "arm_rot"),
        **_nearest(elbow, {"elbow_flex": ELBOW_AXIS, "pro_sup": FOREARM_AXIS}),
        "wrist_flex": wrist[:, 0],
        "wrist_dev": wrist[:, 1],
    }


def _about_zxy(R: Array, *names: str) -> dict[str, Array]:
    """Three coordinates of rotations ``(T, 3, 3)``: about z, x and y."""
    return dict(zip(names, continuous(sequence_of_rotation(R, "zxy")).T, strict=True))


def _nearest(R: Array, axes: Mapping[str, Array]) -> dict[str, Array]:
    """Angles about axes one after the other whose rotation is nearest to each of ``(T, 3, 3)``: Gauss-Newton."""
    angles = np.zeros((len(R), len(axes)))
    for _ in range(12):  # from zero to where no step is left in double precision, for all that joints can do
        turned, moves = np.broadcast_to(np.eye(3), R.shape), np.zeros((len(R), 3, len(axes)))
        for number, axis in enumerate(axes.values()):
            turn = exp(angles[:, [number]] * axis)
            turned, moves = turned @ turn, transpose(turn) @ moves
            moves[:, :, number] = axis
        missing = log(transpose(turned) @ R)
        moves = transpose(inverse_right_jacobian(missing)) @ moves  # of log(exp(-δ) exp(missing))
        normal = transpose(moves) @ moves
        angles = angles + np.linalg.solve(normal, transpose(moves) @ missing[..., None])[..., 0]
    return dict(zip(axes, angles.T, strict=True))
