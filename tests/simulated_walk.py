"""Somebody who walks, turns and walks back, by construction: when feet strike and leave, and how long strides are."""

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.skeleton import JOINT_COUNT, joint_index
from vip_factors.geometry.rotations import Array

RATE, STRIDE_S, STRIDE_M, STANCE, WIDTH_M = 100.0, 1.1, 1.3, 0.62, 0.16
STRIKE_DEG, OFF_DEG, LANDING_S, FLAT = 20.0, -55.0, 0.09, 0.36  # toes up; until which share of the cycle soles are flat
TURN_S = 1.4  # that half a turn takes
PHASE = {"left": 0.0, "right": 0.5}  # of a cycle


def strikes(side: str, seconds: float) -> Array:
    """When a foot strikes, seconds, within the motion."""
    return np.arange(0, seconds / STRIDE_S + 1) * STRIDE_S + PHASE[side] * STRIDE_S


def walk(
    seconds: float = 9.0, turn_at: float | None = None, treadmill: bool = False, strike_deg: float = STRIKE_DEG,
    stop_at: float = np.inf,
) -> Motion:  # fmt: skip
    """A motion at 100 Hz; half a turn begins at a second of it, and at another the walker is where they stop, after a
    half step; on a treadmill the world goes with the belt."""
    time = np.arange(round(seconds * RATE)) / RATE
    skeleton = skeleton_from_stature(1.75)
    heading = np.zeros_like(time) if turn_at is None else np.pi * np.clip((time - turn_at) / TURN_S, 0, 1)
    speed = STRIDE_M / STRIDE_S * (1 if turn_at is None else 1 - 0.6 * ((heading > 0) & (heading < np.pi)))
    speed = speed * (time < stop_at)
    ways = speed * np.stack([np.cos(heading), np.sin(heading)]) / RATE
    pelvis = np.concatenate([np.cumsum(ways, axis=1), np.full((1, len(time)), 0.92 * _leg(skeleton))]).T
    R = np.tile(_upright(heading)[:, None], (1, JOINT_COUNT, 1, 1))
    for side in PHASE:
        _pose_leg(R, skeleton, time, pelvis, heading, side, strike_deg)
    if treadmill:
        pelvis[:, 0] -= STRIDE_M / STRIDE_S * time
    return Motion(skeleton, local_rotations(R), pelvis, RATE, name="walker")


def _leg(skeleton) -> float:
    return -float(skeleton.p_pelvis_joint[joint_index("left_foot"), 1])


def _upright(heading: Array, pitch: Array | float = 0.0) -> Array:
    """Left, up, forward as columns ``(T, 3, 3)``; ``pitch`` is how far forward points up."""
    c, s, up = np.cos(heading), np.sin(heading), np.broadcast_to(pitch, heading.shape)
    forward = np.stack([np.cos(up) * c, np.cos(up) * s, np.sin(up)], axis=-1)
    left = np.stack([-s, c, 0 * c], axis=-1)
    return np.stack([left, np.cross(forward, left), forward], axis=-1)


def _smooth(u: Array) -> Array:
    u = np.clip(u, 0, 1)
    return u**3 * (10 - 15 * u + 6 * u**2)


def _pitch(cycle: Array, strike_deg: float) -> Array:
    """Radians by the share of the cycle from strike."""
    landing = LANDING_S / STRIDE_S
    angle = strike_deg * (1 - _smooth(cycle / landing)) + OFF_DEG * np.clip((cycle - FLAT) / (STANCE - FLAT), 0, 1) ** 2
    swing = OFF_DEG + (strike_deg - OFF_DEG) * _smooth((cycle - STANCE) / (0.97 - STANCE))
    return np.deg2rad(np.where(cycle < STANCE, angle, swing))


def _pose_leg(R: Array, skeleton, time: Array, pelvis: Array, heading: Array, side: str, strike_deg: float) -> None:
    sign = 1.0 if side == "left" else -1.0
    number = np.floor(time / STRIDE_S - PHASE[side])
    cycle = time / STRIDE_S - PHASE[side] - number
    middle = (number + PHASE[side] + 0.5 * STANCE) * STRIDE_S  # of its stance

    def place(at: Array) -> tuple[Array, Array]:
        """Where the foot stands, and which way, when the pelvis is beside it at some times."""
        yaw = np.interp(at, time, heading)
        out = [np.interp(at, time, axis) for axis in pelvis.T[:2]]
        beyond = np.where(at < time[0], at - time[0], np.where(at > time[-1], at - time[-1], 0.0)) * STRIDE_M / STRIDE_S
        base = np.stack([out[0] + np.cos(yaw) * beyond, out[1] + np.sin(yaw) * beyond], axis=-1)
        return base + sign * WIDTH_M / 2 * np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1), yaw

    (now, yaw), (then, yaw_then) = place(middle), place(middle + STRIDE_S)
    share = _smooth((cycle - STANCE) / (1 - STANCE))
    foot_yaw = yaw + share * (yaw_then - yaw)
    pitch = _pitch(cycle, strike_deg)
    R_foot = _upright(foot_yaw, pitch)
    heel = skeleton.landmarks[f"{side}_heel"].p_bone_point
    ball = skeleton.p_parent_joint[joint_index(f"{side}_foot")]
    flat = np.concatenate([now + share[:, None] * (then - now), np.full((len(time), 1), -ball[1])], axis=1)
    pivot = np.where(pitch[:, None] > 0, heel, ball)  # on which the foot turns
    level = _upright(foot_yaw)
    ankle = flat + np.einsum("tij,tj->ti", level - R_foot, pivot)
    ankle[:, 2] += 0.03 * np.sin(np.pi * share)
    R_pelvis, hip = R[:, 0], skeleton.p_parent_joint[joint_index(f"{side}_hip")]
    p_hip = pelvis + R_pelvis @ hip
    thigh, shank = (skeleton.bone_length(f"{side}_{one}") for one in ("knee", "ankle"))
    reach = np.minimum(np.linalg.norm(ankle - p_hip, axis=1), 0.999 * (thigh + shank))
    along = (ankle - p_hip) / np.linalg.norm(ankle - p_hip, axis=1, keepdims=True)
    at_hip = np.arccos((thigh**2 + reach**2 - shank**2) / (2 * thigh * reach))
    ahead = np.cross(R_pelvis[..., 0], -along)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    knee = p_hip + thigh * (np.cos(at_hip)[:, None] * along + np.sin(at_hip)[:, None] * ahead)
    for bone, top, end in (("hip", p_hip, knee), ("knee", knee, p_hip + reach[:, None] * along)):
        up = (top - end) / np.linalg.norm(top - end, axis=1, keepdims=True)
        forward = np.cross(R_pelvis[..., 0], up)
        forward /= np.linalg.norm(forward, axis=1, keepdims=True)
        R[:, joint_index(f"{side}_{bone}")] = np.stack([np.cross(up, forward), up, forward], axis=-1)
    R[:, joint_index(f"{side}_ankle")] = R[:, joint_index(f"{side}_foot")] = R_foot
