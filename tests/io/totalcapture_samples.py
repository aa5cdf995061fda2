"""Sequences of the form of TotalCapture, from a motion that is known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import exp, rotation_x, rotation_z

# Joints of the truth in the files' order, with the bone of ours that they are; the second vertebra is between ours.
JOINTS = {
    "Hips": "pelvis", "Spine": "spine1", "Spine1": "spine1", "Spine2": "spine2", "Spine3": "spine3",
    "Neck": "neck", "Head": "head",
    "RightShoulder": "right_collar", "RightArm": "right_shoulder", "RightForeArm": "right_elbow",
    "RightHand": "right_wrist", "LeftShoulder": "left_collar", "LeftArm": "left_shoulder",
    "LeftForeArm": "left_elbow", "LeftHand": "left_wrist", "RightUpLeg": "right_hip", "RightLeg": "right_knee",
    "RightFoot": "right_ankle", "LeftUpLeg": "left_hip", "LeftLeg": "left_knee", "LeftFoot": "left_ankle",
}  # fmt: skip
SENSORS = {
    "Head": "head", "Sternum": "spine3", "Pelvis": "pelvis", "L_UpArm": "left_shoulder", "R_UpArm": "right_shoulder",
    "L_LowArm": "left_elbow", "R_LowArm": "right_elbow", "L_UpLeg": "left_hip", "R_UpLeg": "right_hip",
    "L_LowLeg": "left_knee", "R_LowLeg": "right_knee", "L_Foot": "left_ankle", "R_Foot": "right_ankle",
}  # fmt: skip
FRAMES = 40
UP = rotation_x(-np.pi / 2)  # our z becomes their y
BODY = skeleton_from_stature(1.8)


@dataclass
class Session:
    """What the files were made from."""

    folder: Path
    R: np.ndarray
    state: BodyState
    mountings: dict[str, np.ndarray]
    streams: dict[str, np.ndarray]
    force: np.ndarray


def smooth_pose() -> np.ndarray:
    rng, t = np.random.default_rng(1), np.arange(FRAMES)[:, None, None] / 60
    base, speed, phase = (rng.normal(size=(1, 24, 3)) for _ in range(3))
    v = 0.3 * base + 0.5 * np.sin(6 * speed * t + phase)
    for name in ("left_wrist", "right_wrist", "left_ankle", "right_ankle"):  # its far end is not in the files
        v[:, joint_index(name.replace("wrist", "hand").replace("ankle", "foot"))] = 0
    R = exp(v)
    R[:, 0] = rotation_z(0.4) @ rotation_x(np.pi / 2) @ R[:, 0]
    return R


def cells(rows: np.ndarray) -> str:
    return "\t".join(" ".join(f"{value:.9g}" for value in row) for row in rows) + "\t"


def write(
    folder: Path,
    R_joint_bone: np.ndarray | None = None,
    prefix: str = "s1_walking2_",
    aux: bool = False,
    lost_head: int = 0,
) -> Session:
    """A sequence; ``lost_head`` first frames are missing in the sensors' file, as if they had started late."""
    axes = np.eye(3) if R_joint_bone is None else R_joint_bone
    rng, R = np.random.default_rng(2), smooth_pose()
    state = forward_kinematics(BODY, R, np.tile([0.3, -0.2, 1.0], (FRAMES, 1)) + np.linspace(0, 0.2, FRAMES)[:, None])
    rows = [joint_index(bone) for bone in JOINTS.values()]
    p = state.p_world_joint[:, rows] @ UP.T
    p[:, 2] = (p[:, 1] + p[:, 3]) / 2
    q = quaternion_from_matrix(UP @ state.R_world_bone[:, rows] @ axes.T, Order.XYZW)
    header = "\t".join(JOINTS) + "\t"
    for name, values in (("pos", p / 0.0254), ("ori", q)):
        lines = [header, *(cells(frame) for frame in values)]
        (folder / f"gt_skel_gbl_{name}.txt").write_text("\n".join(lines) + "\n")
    mountings, streams, force = {}, {}, rng.normal(size=(FRAMES, 13, 3)) * 0.3
    calibration = {"bone": ["13"], "ref": ["13"]}
    for k, (sensor, bone) in enumerate(SENSORS.items()):
        R_bone_sensor = exp(rng.normal(size=3))
        R_world_inertial = rotation_z(rng.uniform(-3, 3))
        streams[sensor] = R_world_inertial.T @ state.R_world_bone[:, joint_index(bone)] @ R_bone_sensor
        force[:, k] = np.einsum("tji,tj->ti", streams[sensor], force[:, k] + np.array([0, 0, 9.81]))
        mountings[sensor] = R_bone_sensor
        for kind, matrix in (("bone", axes @ R_bone_sensor), ("ref", UP @ R_world_inertial)):
            numbers = " ".join(f"{x:.9f}" for x in quaternion_from_matrix(matrix, Order.XYZW))
            calibration[kind].append(f"{sensor} {numbers}")
    for kind, lines in calibration.items():
        (folder / f"{prefix}calib_imu_{kind}.txt").write_text("\n".join(lines) + "\n")
    q_wxyz = {sensor: quaternion_from_matrix(R_t, Order.WXYZ) for sensor, R_t in streams.items()}
    lines = [f"13\t{FRAMES - lost_head}"]
    for t in range(lost_head, FRAMES):
        lines.append(str(t + 1 - lost_head))
        for k, sensor in enumerate(SENSORS):
            row = [*q_wxyz[sensor][t], *force[t, k], *([0.5] * 6 if aux else [])]
            lines.append(f"{sensor}\t" + " ".join(f"{x:.9g}" for x in row))
    (folder / f"{prefix}Xsens{'_AuxFields' if aux else ''}.sensors").write_text("\n".join(lines) + "\n")
    return Session(folder, R, state, mountings, streams, force)
