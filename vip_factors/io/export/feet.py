"""Planted feet: stance phases of a motion, and legs that follow by inverse kinematics."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_closing, binary_opening, label

from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.skeleton import contact_points, joint_index
from vip_factors.geometry.rotations import Array, rotation_between

SPEED_MPS = 0.4  # of a ball on the floor: an estimate's feet creep at 0.1 to 0.2, a swinging one passes at 2 or more
HEIGHT_M = 0.06  # of a ball over where it stands
SHORTEST_S = 0.15  # of a stance: a walk's lasts 0.6 s
STRAIGHT = 0.9995  # of a leg's length: beyond, a knee turns by degrees for a millimetre


def planted(motion: Motion) -> Motion:
    """The motion with feet that neither slide nor float while they stand.

    A stance is where the ball of a foot is slow and low. The ball is moved to its median place of the stance, at one
    height for all stances, and between two stances gradually from one's shift to the next's. The pelvis moves by the
    mean of both feet's shifts, and down with the lower one: a straight leg cannot grow. Hips and knees take what is
    left; feet keep their orientations.
    """
    if len(motion) < 3:
        return motion
    _, left_ball, _, right_ball = contact_points(motion.skeleton)
    balls = np.stack([motion.state.point(bone, p) for bone, p in (left_ball, right_ball)])
    low = np.percentile(balls[..., 2], 5)
    speed = np.linalg.norm(np.gradient(balls, 1 / motion.rate, axis=1), axis=-1)
    shifts = np.zeros_like(balls)
    is_slow_and_low = (speed < SPEED_MPS) & (balls[..., 2] < low + HEIGHT_M)
    standing = [_stances(is_standing, motion.rate) for is_standing in is_slow_and_low]
    heights = [balls[foot, stance, 2] for foot, stances in enumerate(standing) for stance in stances]
    if not heights:
        return motion
    floor = np.median(np.concatenate(heights))
    for foot, stances in enumerate(standing):
        if stances:
            rows = np.concatenate(stances)
            places = [[*np.median(balls[foot, stance, :2], axis=0), floor] for stance in stances]
            fixed = np.repeat(places, [len(stance) for stance in stances], axis=0) - balls[foot, rows]
            for axis in range(3):
                shifts[foot, :, axis] = np.interp(np.arange(len(motion)), rows, fixed[:, axis])
    return _with_feet_moved(motion, shifts)


def _stances(is_standing: np.ndarray, rate: float) -> list[np.ndarray]:
    """Frames of each stance; short gaps are closed, and short stances left out."""
    frames = np.ones(max(round(SHORTEST_S * rate), 1), bool)
    padded = np.pad(is_standing, len(frames), mode="edge")
    steady = binary_opening(binary_closing(padded, frames), frames)[len(frames) : -len(frames)]
    numbers, count = label(steady)
    return [np.flatnonzero(numbers == number) for number in range(1, count + 1)]


def _with_feet_moved(motion: Motion, shifts: Array) -> Motion:
    """Both feet moved by ``shifts`` ``(2, T, 3)`` metres in the world, and the pelvis with them."""
    state, moved = motion.state, np.column_stack([shifts[..., :2].mean(axis=0), shifts[..., 2].min(axis=0)])
    R = state.R_world_bone.copy()
    for shift, side in zip(shifts, ("left", "right"), strict=True):
        hip, knee, ankle = (joint_index(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
        p_hip, p_knee, p_ankle = (state.p_world_joint[:, joint] for joint in (hip, knee, ankle))
        reach = p_ankle + shift - p_hip - moved
        thigh, shank = _bent(p_knee - p_hip, p_ankle - p_knee, reach, R[:, hip, :, 2])
        R[:, hip] = thigh @ R[:, hip]
        R[:, knee] = shank @ R[:, knee]
    return replace(motion, R_parent_child=local_rotations(R), p_world_pelvis=motion.p_world_pelvis + moved)


def _bent(thigh: Array, shank: Array, reach: Array, front: Array) -> tuple[Array, Array]:
    """Rotations ``(T, 3, 3)`` in the world that make thighs and shanks ``(T, 3)`` end at ``reach`` ``(T, 3)``.

    The knee bends in its plane, which the front ``(T, 3)`` of the thigh gives where it is straight. A leg that is too
    short ends as near as it can.
    """
    a, b, d, leg = (np.linalg.norm(v, axis=1, keepdims=True) for v in (thigh, shank, reach, thigh + shank))
    R_whole = rotation_between(thigh + shank, reach)
    along = reach / d
    # The front decides where the knee is nearly straight, or beyond.
    side, thigh, shank = np.moveaxis(R_whole @ np.stack([thigh + 0.1 * a * front, thigh, shank], axis=2), 2, 0)
    side -= np.sum(side * along, axis=1, keepdims=True) * along
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    distance = np.clip(d, np.abs(a - b) + 1e-6, np.maximum(STRAIGHT * (a + b), leg))
    cosine = (a**2 + distance**2 - b**2) / (2 * a * distance)
    p_knee = a * (cosine * along + np.sqrt(np.maximum(1 - cosine**2, 0.0)) * side)
    R_thigh = rotation_between(thigh, p_knee) @ R_whole
    return R_thigh, rotation_between(shank, distance * along - p_knee) @ R_whole
