"""Exercises whose figures are known, of a body without errors: squats, lunges, jumps and curls one after the other."""

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT, R_WORLD_FACING_X, calibration_pose, joint_index
from vip_factors.geometry.rotations import Array, rotation_x, rotation_y

RATE = 60.0
BEGIN, CYCLE = 1.0, 3.0  # seconds: of standing, and of a repetition with the rest after it
KINDS = ("squat",) * 3 + ("lunge",) * 2 + ("jump",) * 2 + ("curl",) * 3
KNEE_DEG, CURL_DEG, JUMP_M = 100.0, 120.0, 0.30
GRAVITY = 9.81


def _rise(u: Array) -> Array:
    u = np.clip(u, 0, 1)
    return np.asarray(u * u * u * (10 - 15 * u + 6 * u * u))


def _bend(time: Array, start: float, down: float = 0.8, hold: float = 0.3, up: float = 0.8) -> Array:
    """0, 1 while held, and 0 again."""
    return _rise((time - start) / down) - _rise((time - start - down - hold) / up)


def exercises(kinds: tuple[str, ...] = KINDS) -> Motion:
    """Each lasts for :data:`CYCLE`; knees bend to :data:`KNEE_DEG`, in lunges, left leg in front, to 90."""
    skeleton = skeleton_from_stature(1.75)
    time = np.arange(round((BEGIN + CYCLE * len(kinds) + 1) * RATE)) / RATE
    knee, hip = (dict.fromkeys(("left", "right"), np.zeros(len(time))) for _ in range(2))
    elbow, flight = np.zeros(len(time)), np.zeros(len(time))
    for number, kind in enumerate(kinds):
        start = BEGIN + number * CYCLE
        low = _bend(time, start)
        if kind == "curl":
            elbow = elbow + np.deg2rad(CURL_DEG) * low
            continue
        if kind == "jump":  # down and up quickly, then free fall
            low = _bend(time, start, 0.5, 0.0, 0.3) + 0.5 * _bend(time, start + 1.3, 0.3, 0.0, 0.5)
            half = np.sqrt(2 * JUMP_M / GRAVITY)
            flight = flight + np.maximum(JUMP_M - GRAVITY / 2 * (time - start - 0.8 - half) ** 2, 0)
        bend, front, rear = (90, 90, 0) if kind == "lunge" else (KNEE_DEG, 0.6 * KNEE_DEG, 0.6 * KNEE_DEG)
        for side, lift in (("left", front), ("right", rear)):
            knee[side] = knee[side] + np.deg2rad(bend) * low
            hip[side] = hip[side] + np.deg2rad(lift) * low
    R = np.tile(calibration_pose("n-pose"), (len(time), 1, 1, 1))
    R[:, 0] = R_WORLD_FACING_X
    for side, sign in (("left", 1.0), ("right", -1.0)):
        R[:, joint_index(f"{side}_hip")] = rotation_x(-hip[side])
        R[:, joint_index(f"{side}_knee")] = rotation_x(knee[side])
        R[:, joint_index(f"{side}_ankle")] = rotation_x(hip[side] - knee[side])
        R[:, joint_index(f"{side}_elbow")] = rotation_y(-sign * elbow)
    assert R.shape[1] == JOINT_COUNT
    p = forward_kinematics(skeleton, R, np.zeros((len(time), 3))).p_world_joint
    lower = np.minimum(p[:, joint_index("left_foot"), 2], p[:, joint_index("right_foot"), 2])
    root = np.stack([0 * time, 0 * time, flight - lower], axis=1)
    return Motion(skeleton, R, root, RATE, 0.0, "exercises")
