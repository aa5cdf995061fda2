"""Poses of animations: the rest poses and bone axes that programs expect, and planted feet."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_closing, binary_opening, label

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion, forward_kinematics, local_rotations
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Skeleton, contact_points, joint_index
from vip_factors.geometry.rotations import Array, exp, rotation_between
from vip_factors.io.settings import BoneNames

# The landmark at the free end of each last bone. The heels have none: they lie on bones that go on.
END_SITES = {
    "head": "head_top",
    **{
        f"{side}_{bone}": f"{side}_{end}"
        for side in ("left", "right")
        for bone, end in (("hand", "fingertip"), ("foot", "toe_tip"))
    },
}
_NEXT = {"pelvis": "spine1", "spine3": "neck"}  # of bones with several below, the one that they lead to
_DIRECTIONS = {"L": (1, 0, 0), "R": (-1, 0, 0), "U": (0, 1, 0), "D": (0, -1, 0), "F": (0, 0, 1), "B": (0, 0, -1)}
_MIRROR = np.diag([-1.0, 1.0, 1.0])

# Where x, y and z of left bones and the trunk's point in the T-pose: left, up, forward, or right, down, back.
_ARM = ("collar", "shoulder", "elbow", "wrist", "hand")
_MIXAMO = {"hip": "RDF", "knee": "RDF", "ankle": "RFU", "foot": "RFU"} | dict.fromkeys(_ARM, "BLD")  # of its X Bot
_UNREAL = dict.fromkeys(_ARM, "LBU") | {"wrist": "LDB", "hand": "LDB", "foot": "FUR"}  # of version 4's mannequin
# Rotation vectors in degrees from there to the mannequin's reference pose, an A-pose.
_UNREAL_TURNS = {
    "spine1": (7.4, 0, 0), "spine2": (-6.7, 0, 0), "spine3": (-9.5, 0, 0), "neck": (14.0, 0, 0),
    "collar": (-2.3, 26.5, -9.6), "shoulder": (0.3, 4.6, -49.6), "elbow": (-18.2, -21.1, -38.9),
    "wrist": (-5.0, -26.6, -38.2), "hand": (-5.0, -26.6, -38.2), "hip": (1.2, 8.4, 7.1), "knee": (8.9, 3.3, 4.4),
    "ankle": (0.7, 2.6, 0.9), "foot": (2.6, 2.6, 0.8),
}  # fmt: skip
_LIMBS = ("shoulder", "elbow", "wrist", "hand", "hip", "knee")


@dataclass(frozen=True)
class RestPose:
    """A skeleton at rest, in body axes: x to the left, y up, z forward.

    Attributes:
        R_body_bone: our bones ``(24, 3, 3)``: identity in the T-pose.
        p_body_joint: ``(24, 3)`` metres, the pelvis at the origin.
        R_bone_axes: the program's axes of each bone in ours ``(24, 3, 3)``.
    """

    R_body_bone: Array
    p_body_joint: Array
    R_bone_axes: Array


def rest_pose(skeleton: Skeleton, names: BoneNames) -> RestPose:
    """The rest pose of the program whose bones have these names.

    Unreal's mannequin rests in an A-pose, and x points along its bones. All others rest in a T-pose, and y points along
    each bone, turned about it as Mixamo's; Mixamo's trunk is upright. What differs between the mannequin's trunk,
    collars and feet and a wearer's is shape, which its axes take up; differences between limbs are the pose.
    """
    is_unreal, is_trunk_upright = names is BoneNames.UNREAL, names in (BoneNames.HUMANIK, BoneNames.MIXAMO)
    R, axes = np.tile(np.eye(3), (2, JOINT_COUNT, 1, 1))
    for joint, name in enumerate(JOINT_NAMES):
        side, _, kind = name.rpartition("_")
        letters = _UNREAL.get(kind, "UBR") if is_unreal else _MIXAMO.get(kind, "LUF")
        directions = np.transpose([_DIRECTIONS[letter] for letter in letters])
        turn = exp(np.deg2rad(_UNREAL_TURNS.get(kind, (0.0, 0.0, 0.0)))) if is_unreal else np.eye(3)
        if side == "right":
            directions = -_MIRROR @ directions if is_unreal else _MIRROR @ directions @ _MIRROR
            turn = _MIRROR @ turn @ _MIRROR
        if kind in _LIMBS:
            R[joint], axes[joint] = turn, directions
        else:
            axes[joint] = turn @ directions
        if not is_unreal and (side or not is_trunk_upright):
            axes[joint] = rotation_between(directions[:, 1], _end(skeleton, joint)) @ directions
    state = forward_kinematics(skeleton, local_rotations(R[None]), np.zeros((1, 3)))
    return RestPose(R, state.p_world_joint[0], axes)


def _end(skeleton: Skeleton, joint: int) -> Array:
    """The far end of a bone ``(3,)``, from its joint."""
    name = JOINT_NAMES[joint]
    if name in END_SITES:
        return end_site(skeleton, name)
    return skeleton.p_parent_joint[JOINT_NAMES.index(_NEXT[name]) if name in _NEXT else PARENTS.index(joint)]


def end_site(skeleton: Skeleton, name: str) -> Array:
    """The free end of a last bone ``(3,)``; of a skeleton without that landmark, as with people of that stature."""
    landmark = END_SITES[name]
    point = skeleton.landmarks.get(landmark) or skeleton_from_stature(stature_of(skeleton)).landmarks[landmark]
    return point.p_bone_point


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
