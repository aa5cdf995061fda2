"""A synthetic motion without any file: walking a small circle with swinging arms, gestures and a swaying trunk.

All angles are sums of sines (and their squares) of time, and the root follows from the feet that stand on the floor
by smooth weights, so the motion is smooth. Anatomical signs in our axes (x left, y up, z forward): flexion of hip,
shoulder and elbow raises the limb forward, a rotation about −x; flexion of the knee takes the shank back, about +x.
"""

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT, R_WORLD_FACING_X, Skeleton, joint_index
from vip_factors.geometry.rotations import Array, rotation_x, rotation_y, rotation_z
from vip_factors.simulate.staging import path_of_standing_feet

STEP_HZ = 0.85  # full gait cycles per second: a relaxed pace is 0.9


def gestures(
    seconds: float = 20.0, rate: float = 120.0, skeleton: Skeleton | None = None, straight: bool = False
) -> Motion:
    """Walking a circle, arms swinging and rising sideways in turn, trunk and head swaying; ``rate`` frames per second.

    It starts near the origin, feet on the floor z = 0. A person of 1.75 m, if no skeleton is given. If ``straight``,
    the way is, with longer steps and feet that roll from heel to toes: of a circle gait counts no stride.
    """
    walk_stride, walk_roll = 0.3, 0.35  # rad, of hip and foot: 0.7 m/s
    turn_rad_s = 0.4  # of the walker: a circle of about 1.1 m radius, so that every direction is faced
    stride = 0.15  # rad that the hip swings to either side: a slow walk of about 0.45 m/s
    skeleton = skeleton or skeleton_from_stature(1.75)
    time = np.arange(round(seconds * rate) + 1) / rate
    R = np.broadcast_to(np.eye(3), (len(time), JOINT_COUNT, 3, 3)).copy()
    _trunk(R, time, 0.0 if straight else turn_rad_s)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        _leg(R, time, side, sign, *((walk_stride, walk_roll) if straight else (stride, 0.0)))
        _arm(R, time, side, sign)
    hanging = forward_kinematics(skeleton, R, np.zeros((len(time), 3)))
    path, name = path_of_standing_feet(skeleton, hanging), "walk" if straight else "gestures"
    return Motion(skeleton, R, path, rate, 0.0, name)


def _wave(time: Array, frequency: float, phase: float = 0.0) -> Array:
    return np.sin(2 * np.pi * frequency * time + phase)


def _trunk(R: Array, time: Array, turn_rad_s: float) -> None:
    turn = turn_rad_s * time + 0.06 * _wave(time, STEP_HZ)
    tilt = 0.03 * _wave(time, 2 * STEP_HZ) + 0.05
    R[:, 0] = rotation_z(turn) @ R_WORLD_FACING_X @ rotation_x(tilt) @ rotation_z(0.04 * _wave(time, STEP_HZ, 0.4))
    for name in ("spine1", "spine2", "spine3"):
        R[:, joint_index(name)] = rotation_y(-0.04 * _wave(time, STEP_HZ)) @ rotation_x(0.06 * _wave(time, 0.13) + 0.02)
    nod, look = 0.15 * _wave(time, 0.31), 0.35 * _wave(time, 0.19, 0.7)
    R[:, joint_index("head")] = rotation_y(look) @ rotation_x(nod)


def _leg(R: Array, time: Array, side: str, sign: float, amplitude: float, rolling: float) -> None:
    phase = 0.0 if sign > 0 else np.pi
    lift = (0.5 + 0.5 * _wave(time, STEP_HZ, phase)) ** 2  # 0 while standing, 1 with the knee up
    roll = rolling * np.sqrt(lift) * _wave(time, STEP_HZ, phase + np.pi / 2)  # toes down when lifted, up when set down
    stride = amplitude * _wave(time, STEP_HZ, phase - np.pi / 2)  # forward while lifted
    hip, knee = 0.10 + stride + 0.45 * lift, 0.18 + 0.80 * lift
    R[:, joint_index(f"{side}_hip")] = rotation_z(sign * 0.04) @ rotation_x(-hip)
    R[:, joint_index(f"{side}_knee")] = rotation_x(knee)
    R[:, joint_index(f"{side}_ankle")] = rotation_x(hip - knee + 0.25 * lift + 0.03 + roll)  # level while it stands
    R[:, joint_index(f"{side}_foot")] = rotation_x(-0.1 * lift)


def _arm(R: Array, time: Array, side: str, sign: float) -> None:
    gesture_hz = 0.23  # of raising the arms sideways
    swing = 0.45 * _wave(time, STEP_HZ, np.pi if sign > 0 else 0.0)  # against the leg of the same side
    raised = (0.5 + 0.5 * _wave(time, gesture_hz, -np.pi / 2 - (0.0 if sign > 0 else 1.3))) ** 2
    down = 1.35 - 0.95 * raised  # from the T-pose towards hanging
    elbow = 0.45 + 0.25 * _wave(time, STEP_HZ, 0.4) + 0.6 * raised
    R[:, joint_index(f"{side}_collar")] = rotation_z(sign * 0.12 * raised)
    R[:, joint_index(f"{side}_shoulder")] = rotation_x(-0.1 - swing) @ rotation_z(-sign * down)
    R[:, joint_index(f"{side}_elbow")] = rotation_y(-sign * elbow)  # the forearm comes forward
    R[:, joint_index(f"{side}_wrist")] = rotation_z(sign * 0.2 * _wave(time, 0.53))
