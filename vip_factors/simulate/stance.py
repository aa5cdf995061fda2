"""Standing on the floor: what the feet do to the root, and a held calibration pose before a motion."""

from dataclasses import replace

import numpy as np

from vip_factors.body.calibration_pose import calibration_pose
from vip_factors.body.kinematics import BodyState, Motion, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp, log, rotation_z, transpose

SOLE = ("left_heel", "left_toe_tip", "right_heel", "right_toe_tip")
SOFTNESS_M = 0.008  # of the smooth minimum: the weight passes between feet without a jolt


def floor_height(skeleton: Skeleton, state: BodyState) -> Array:
    """Height ``(T,)`` of the lowest point of the soles, as a smooth minimum, so that it can be differentiated."""
    return _lowest(_soles(skeleton, state)[..., 2])[0]


def path_of_standing_feet(skeleton: Skeleton, state: BodyState) -> Array:
    """Root path ``(T, 3)`` on which the lowest points of the soles stand still on the floor z = 0.

    Args:
        skeleton: whose feet.
        state: the motion with its root held at the origin.
    """
    soles = _soles(skeleton, state)
    lowest, weight = _lowest(soles[..., 2])
    between = (weight[1:] + weight[:-1]) / 2
    steps = -np.sum(between[..., None] * np.diff(soles, axis=0), axis=1)
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    path[:, 2] = -lowest
    return path


def _soles(skeleton: Skeleton, state: BodyState) -> Array:
    """Points ``(T, n, 3)`` under the feet."""
    points = [skeleton.landmarks[name] for name in SOLE if name in skeleton.landmarks]
    if not points:  # a skeleton without landmarks: the balls of the feet
        return state.p_world_joint[:, [joint_index("left_foot"), joint_index("right_foot")]]
    return np.stack([state.point(point.bone, point.p_bone_point) for point in points], axis=1)


def _lowest(heights: Array) -> tuple[Array, Array]:
    """Smooth minimum ``(T,)`` of heights ``(T, n)``, and each one's share ``(T, n)`` in it."""
    least = heights.min(axis=1, keepdims=True)
    shares = np.exp(-(heights - least) / SOFTNESS_M)
    smooth = least[:, 0] - SOFTNESS_M * np.log(shares.mean(axis=1))
    return smooth, shares / shares.sum(axis=1, keepdims=True)


def with_initial_pose(
    motion: Motion, pose: str = "n-pose", hold_s: float = 2.0, blend_s: float = 1.0, pose_error_deg: float = 0.0,
    seed: int = 0,
) -> Motion:  # fmt: skip
    """The motion after a held calibration pose; it starts ``hold_s`` later and its first ``blend_s`` are blended.

    The wearer stands where the first frame stands, with its heading. The blend is a slerp of every joint with a
    fifth-order step, so that velocity and acceleration stay continuous.

    Args:
        motion: what follows.
        pose: ``"n-pose"`` or ``"t-pose"``.
        hold_s, blend_s: seconds.
        pose_error_deg: how imperfectly the pose is held: sigma of a fixed random rotation of every joint, per axis
            (5–10 for somebody told to stand straight).
        seed: of that rotation.

    Raises:
        InputError: for another pose, or a motion shorter than the blend.
    """
    blended, held = round(blend_s * motion.rate), round(hold_s * motion.rate)
    if blended >= len(motion):
        raise InputError(f"motion '{motion.name}' is shorter than the blend of {blend_s:g} s: shorten the blend")
    R_held, p_held = _held_pose(motion, pose, pose_error_deg, seed)
    phase = np.arange(blended) / max(blended, 1)
    weight = phase**3 * (10 - 15 * phase + 6 * phase**2)
    R, p = motion.R_parent_child.copy(), motion.p_world_pelvis.copy()
    turn = log(transpose(R_held) @ R[:blended])
    R[:blended] = R_held @ exp(weight[:, None, None] * turn)
    p[:blended] = p_held + weight[:, None] * (p[:blended] - p_held)
    p[:blended, 2] += _lift(motion, R[:blended], p[:blended], p_held, R_held, weight)
    R = np.concatenate([np.repeat(R_held[None], held, axis=0), R])
    p = np.concatenate([np.repeat(p_held[None], held, axis=0), p])
    return replace(motion, R_parent_child=R, p_world_pelvis=p)


def _lift(motion: Motion, R: Array, p: Array, p_held: Array, R_held: Array, weight: Array) -> Array:
    """How far to raise the root of blended frames ``(B,)``: between two stances the feet must not dip or float."""
    skeleton, B = motion.skeleton, len(R)
    before = floor_height(skeleton, forward_kinematics(skeleton, R_held[None], p_held[None]))
    after = floor_height(skeleton, motion.frames(slice(0, max(B, 1))).state)[:B]
    return before + weight * (after - before) - floor_height(skeleton, forward_kinematics(skeleton, R, p))


def _held_pose(motion: Motion, pose: str, pose_error_deg: float, seed: int) -> tuple[Array, Array]:
    """Joint rotations and root of the pose as this wearer holds it, on the floor of the motion."""
    forward = motion.R_parent_child[0, 0, :, 2]
    R = calibration_pose(pose)
    R[0] = rotation_z(np.arctan2(forward[1], forward[0])) @ R[0]
    errors = np.random.default_rng(seed).standard_normal((JOINT_COUNT, 3))
    R = R @ exp(np.deg2rad(pose_error_deg) * errors)
    standing = forward_kinematics(motion.skeleton, R[None], np.zeros((1, 3)))
    # A low quantile: a single bad frame of capture must not lower the floor.
    floor = np.quantile(floor_height(motion.skeleton, motion.state), 0.05)
    height = floor - floor_height(motion.skeleton, standing)[0]
    return R, np.array([*motion.p_world_pelvis[0, :2], height])
