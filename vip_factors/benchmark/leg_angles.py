"""Flexion of hips and knees that somebody else measured, and how far ours is from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.benchmark.walk import R_VICON_BONE, TRIAL, read_vicon
from vip_factors.body.motion import Motion
from vip_factors.errors import FileFormatError
from vip_factors.evaluate.joint_angle import hip_flexion_deg, hip_flexion_of, knee_flexion_deg, knee_flexion_of, rmse
from vip_factors.evaluate.joint_angle import rmse_without_offset as without_offset
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array

SIDES = ("left", "right")
# OpenSim's segment axes (x forward, y up, z to the right) as columns of ours (x left, y up, z forward).
R_OPENSIM_BONE = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class LegAngles:
    """Flexion in degrees ``(T,)`` of joints by name (``left_knee``, …) at times ``(T,)`` in seconds."""

    time: Array
    flexion: Mapping[str, Array]


@dataclass(frozen=True)
class AngleError:
    """Degrees: RMSE, and RMSE once the mean difference is removed."""

    rmse: float
    without_offset: float


def vicon_angles(folder: Path) -> LegAngles:
    """Of ``xsens_vicon_walk``: segments by optical markers."""
    vicon = read_vicon(folder / "vicon" / f"{TRIAL}.csv")
    bones = {name: R @ R_VICON_BONE for name, R in vicon.R_world_segment.items()}
    flexion: dict[str, Array] = {}
    for side in SIDES:
        letter = side[0].upper()
        flexion[f"{side}_knee"] = knee_flexion_deg(bones[f"{letter}TH"], bones[f"{letter}SK"])
        flexion[f"{side}_hip"] = hip_flexion_deg(bones["RPV"], bones[f"{letter}TH"])
    return LegAngles(vicon.time, flexion)


def optical_angles(path: Path) -> LegAngles:
    """Of ``optical_joint_centres.csv``: segment orientations, in OpenSim's axes, by inverse kinematics of markers.

    Raises:
        FileFormatError: if a column is missing.
    """
    table = np.genfromtxt(path, delimiter=",", names=True)
    names = table.dtype.names or ()

    def bone(segment: str) -> Array:
        columns = [f"{segment}_q{letter}" for letter in "wxyz"]
        if missing := [one for one in columns if one not in names]:
            raise FileFormatError(
                f"{path}: no column '{missing[0]}'; expected segment quaternions of an optical system"
            )
        quaternions = np.stack([table[one] for one in columns], axis=-1)
        return matrix_from_quaternion(quaternions, Order.WXYZ) @ R_OPENSIM_BONE

    flexion = {}
    for side in SIDES:
        thigh, shank = bone(f"femur_{side[0]}"), bone(f"tibia_{side[0]}")
        flexion[f"{side}_knee"], flexion[f"{side}_hip"] = (
            knee_flexion_deg(thigh, shank),
            hip_flexion_deg(bone("pelvis"), thigh),
        )
    return LegAngles(table["time_s"], flexion)


def opensim_angles(path: Path) -> LegAngles:
    """Of a motion file of OpenSim, in degrees; a gait model of which knees bend by ``knee_angle_r``, ``_l``.

    Raises:
        FileFormatError: if a column is missing, or the file has no header.
    """
    lines = path.read_text(encoding="utf-8").splitlines()
    try:
        header = lines.index("endheader")
    except ValueError:
        raise FileFormatError(f"{path}: no line 'endheader'; expected a motion file of OpenSim") from None
    names, table = lines[header + 1].split(), np.loadtxt(lines[header + 2 :], ndmin=2)
    flexion = {}
    for side in SIDES:
        for joint, name in (("knee", f"knee_angle_{side[0]}"), ("hip", f"hip_flexion_{side[0]}")):
            if name not in names:
                raise FileFormatError(f"{path}: no column '{name}'; expected joint angles of OpenSim's gait model")
            flexion[f"{side}_{joint}"] = table[:, names.index(name)]
    return LegAngles(table[:, names.index("time")], flexion)


def angles_of(motion: Motion) -> LegAngles:
    """Of an estimate."""
    flexion = {f"{side}_knee": knee_flexion_of(motion, side) for side in SIDES}
    return LegAngles(motion.time, flexion | {f"{side}_hip": hip_flexion_of(motion, side) for side in SIDES})


def angle_errors(found: LegAngles, reference: LegAngles) -> dict[str, AngleError]:
    """By joint name, over the reference's time that both have."""
    both = (reference.time >= found.time[0]) & (reference.time <= found.time[-1])
    errors = {}
    for name, true in reference.flexion.items():
        ours = np.interp(reference.time[both], found.time, found.flexion[name])
        errors[name] = AngleError(rmse(ours, true[both]), without_offset(ours, true[both]))
    return errors
