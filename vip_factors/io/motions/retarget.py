"""Retargeting from a foreign skeleton to ours.

Each bone keeps the world direction it has in the source: with ``C`` the constant rotation that takes our T-pose
direction of a bone onto the source's rest direction, ``R_world_bone = R_world_node C``. Our skeleton gets the
source's own offsets, which keeps the joints' positions. Where a source's rest pose stands for straight limbs without
having them (``SkeletonMap.straight``) the joint angles are kept instead: one ``C`` for all bones of a limb, straight
limbs in our skeleton, and elbows, knees and the joints below some centimetres from the figure's. A bone's turn about
itself follows from its hinge: ours bend elbows about y.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, angle_between, rotation_between, rotation_x
from vip_factors.io.motions.skeleton_maps import SkeletonMap, SourceClip, find_map

# Units of files in metres, and the range of statures that distinguishes them.
UNITS_M = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}
PLAUSIBLE_STATURE_M = (1.2, 2.2)

# Fractions of stature that files' skeletons are sized by (Drillis & Contini 1966): their makers used such tables too.
LIMB_LENGTHS = {
    ("hip", "knee"): 0.245,
    ("knee", "ankle"): 0.246,
    ("shoulder", "elbow"): 0.186,
    ("elbow", "wrist"): 0.146,
}
TRUNK_LENGTH = 0.318  # mid hip to neck

# T-pose directions of the long bones: bone → (joint at its far end, direction in body axes).
DOWN = (0.0, -1.0, 0.0)
AIMS: dict[str, tuple[str, tuple[float, float, float]]] = {}
for _side, _x in (("left", 1.0), ("right", -1.0)):
    AIMS |= {f"{_side}_hip": (f"{_side}_knee", DOWN), f"{_side}_knee": (f"{_side}_ankle", DOWN)}
    AIMS |= {
        f"{_side}_{bone}": (f"{_side}_{end}", (_x, 0.0, 0.0))
        for bone, end in (("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "hand"))
    }

OPPOSITE = 1e-6  # of 1 + the cosine: 0.08° from the opposite direction, no axis is determined
STRANGE_HAND = np.radians(45.0)  # a hand further than this from its forearm at rest is an exporter's dummy end

# A rest pose before the take: this near to the T-pose, and left faster than any joint turns.
REST_TOLERANCE = np.radians(15.0)  # exporters' rest poses bend the forearms a little
IMPOSSIBLE_SPEED = 10.0  # rad/s: a person who stands in a T-pose does not leave it like a pitcher's arm


def retarget(clip: SourceClip) -> Motion:
    """A clip on our 24-joint skeleton, Z up, metres; at rest the wearer faces −y. The stature determines the unit.

    Raises:
        InputError: for an unknown skeleton, an implausible size, or a rest pose that is not an upright body.
    """
    clip, table = _stand_on_floor(clip, find_map(clip.names, clip.path))
    p_rest = {joint: clip.rest(node) for joint, node in table.joints.items()}
    trunk = p_rest["neck"] - (p_rest["left_hip"] + p_rest["right_hip"]) / 2
    A = _body_from_source_axes(trunk, p_rest["left_hip"] - p_rest["right_hip"], clip.path)
    stature = _stature(p_rest, trunk)
    unit = _unit_of(stature, clip.path)
    stature *= unit
    world = rotation_x(np.pi / 2) @ A  # body axes' y, up at rest, becomes the world's z
    clip = replace(
        clip,
        p_rest=unit * clip.p_rest @ A.T,
        R_world_node=world @ clip.R_world_node @ A.T,
        p_world_node=unit * clip.p_world_node @ world.T,
    )
    C = _rest_corrections(clip, table)
    R_world_bone, p_world_joint = _world_poses(clip, table, C, stature)
    skeleton = _skeleton(clip, table, C, R_world_bone, p_world_joint, stature)
    return Motion(skeleton, local_rotations(R_world_bone), p_world_joint[:, 0], clip.rate, name=clip.name)


def without_rest_frames(clip: SourceClip) -> SourceClip:
    """The clip without the rest pose that its exporter put before the take, if there is one."""
    table = find_map(clip.names, clip.path)
    if len(clip) < 3 or table.exact:
        return clip
    nodes = [clip.node(node) for joint, node in table.joints.items() if joint in AIMS or joint == "pelvis"]
    R = clip.R_world_node[:2, nodes]
    from_rest = angle_between(R[0, 0], R[0])  # all bones turned as the pelvis: the rest pose
    speed = angle_between(R[0], R[1]) * clip.rate
    if from_rest.max() > REST_TOLERANCE or speed.max() < IMPOSSIBLE_SPEED:
        return clip
    start = min(max(1, round(table.settle_s * clip.rate)), len(clip) - 1)
    return replace(clip, R_world_node=clip.R_world_node[start:], p_world_node=clip.p_world_node[start:])


def _stand_on_floor(clip: SourceClip, table: SkeletonMap) -> tuple[SourceClip, SkeletonMap]:
    """The clip with our joints for nodes and a person who stands as its rest pose, if its bones hang down at rest."""
    if not table.directions:
        return clip, table
    directions = [table.directions.get(name.upper(), DOWN) for name in clip.names]
    R_stand_hang = rotation_between(DOWN, directions)
    p_rest = clip.p_rest.copy()
    for node, parent in enumerate(clip.parents):
        if parent >= 0:
            p_rest[node] = p_rest[parent] + R_stand_hang[parent] @ (clip.p_rest[node] - clip.p_rest[parent])
    index = {name.upper(): node for node, name in enumerate(clip.names)}
    places = {joint: clip.node(node) for joint, node in table.joints.items()}
    bones = [index.get(table.bones.get(joint, ""), place) for joint, place in places.items()]
    standing = replace(
        clip,
        names=tuple(places),
        parents=(),
        p_rest=p_rest[list(places.values())],
        R_world_node=(clip.R_world_node @ R_stand_hang.swapaxes(-1, -2))[:, bones],
        p_world_node=clip.p_world_node[:, list(places.values())],
    )
    return standing, replace(table, joints={joint: joint for joint in table.joints})


def _nearest_axis(vector: Array) -> Array:
    return np.sign(vector) * (np.arange(3) == np.argmax(np.abs(vector)))


def _body_from_source_axes(trunk: Array, hips: Array, path: str) -> Array:
    """The signed permutation ``(3, 3)`` that takes the source's axes to ours: x left, y up, z forward.

    At rest the trunk points up, and the hips' line from right to left.
    """
    up, left_axis = _nearest_axis(trunk), _nearest_axis(hips)
    if abs(up @ left_axis) > 0.5 or not up.any() or not left_axis.any():
        raise InputError(
            f"{path}: at rest the neck is not above the hips, or the hips are not side by side: expected a "
            "rest pose (OFFSETs) of an upright body"
        )
    return np.stack([left_axis, up, np.cross(left_axis, up)])


def _stature(p_rest: dict[str, Array], trunk: Array) -> float:
    """Stature in the source's unit, from the rest lengths of legs, arms and trunk and their published proportions."""
    limbs = sum(
        float(np.linalg.norm(p_rest[f"{side}_{end}"] - p_rest[f"{side}_{start}"]))
        for side in ("left", "right")
        for start, end in LIMB_LENGTHS
    )
    return (limbs / 2 + float(np.linalg.norm(trunk))) / (sum(LIMB_LENGTHS.values()) + TRUNK_LENGTH)


def _unit_of(stature: float, path: str) -> float:
    low, high = PLAUSIBLE_STATURE_M
    for unit in UNITS_M.values():
        if low <= stature * unit <= high:
            return unit
    raise InputError(
        f"{path}: the skeleton's stature is about {stature:.3g} of the file's units, which is no adult in "
        f"{', '.join(UNITS_M)}: scale the file to metres"
    )


def _turn_between(start: ArrayLike, end: ArrayLike) -> Array:
    """The smallest rotation that takes a direction onto another; the identity for opposite ones, and for zero."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = np.linalg.norm(a) * np.linalg.norm(b)
    return rotation_between(a, b) if a @ b > (OPPOSITE - 1) * length else np.eye(3)


def _rest_corrections(clip: SourceClip, table: SkeletonMap) -> Array:
    """``C`` ``(24, 3, 3)`` of each bone: from our T-pose to the source's rest pose."""
    C = np.broadcast_to(np.eye(3), (JOINT_COUNT, 3, 3)).copy()
    if table.exact:
        return C
    nodes = dict(table.joints)
    for side in ("left", "right"):  # the hand points to its knuckles, or else to its fingertips
        if f"{side}_hand" not in nodes and f"{side}_fingertip" in table.landmarks:
            nodes[f"{side}_hand"] = table.landmarks[f"{side}_fingertip"]
    for joint, name in enumerate(JOINT_NAMES):
        end, direction = AIMS.get(name, ("", DOWN))
        start = name
        if table.straight and end in nodes:  # one direction for the whole limb
            limb = name.partition("_")[0] + ("_knee" if direction == DOWN else "_shoulder")
            start, end = limb, AIMS[limb][0]
        if end in nodes and start in nodes:
            bone = clip.rest(nodes[end]) - clip.rest(nodes[start])
            C[joint] = _turn_between(direction, bone) if np.linalg.norm(bone) > 0 else C[PARENTS[joint]]
            if name.endswith("_wrist") and angle_between(C[joint], C[PARENTS[joint]]) > STRANGE_HAND:
                C[joint] = C[PARENTS[joint]]
        elif name.endswith("_ankle") and f"{name[:-6]}_foot" in nodes and not table.straight:
            # The foot stands flat on the floor at rest, so its slope is its shape; only its toeing-out is a turn.
            foot = clip.rest(nodes[f"{name[:-6]}_foot"]) - clip.rest(nodes[name])
            C[joint] = _turn_between((0.0, 0.0, 1.0), (foot[0], 0.0, foot[2]))
        elif name.endswith(("_wrist", "_hand", "_foot")):
            C[joint] = C[PARENTS[joint]]
    arms = [
        joint for joint, name in enumerate(JOINT_NAMES) if name.endswith(("_shoulder", "_elbow", "_wrist", "_hand"))
    ]
    C[arms] = C[arms] @ rotation_x(np.radians(table.arms_turned_deg))
    return C


def _world_poses(clip: SourceClip, table: SkeletonMap, C: Array, stature: float) -> tuple[Array, Array]:
    """World rotations and positions of all 24 joints; those the source lacks hang rigidly on their parents."""
    p_rest = {joint: clip.rest(node) for joint, node in table.joints.items()}
    R_world_bone = np.empty((len(clip), JOINT_COUNT, 3, 3))
    p_world_joint = np.empty((len(clip), JOINT_COUNT, 3))
    template = skeleton_from_stature(stature)
    for joint, name in enumerate(JOINT_NAMES):
        parent = PARENTS[joint]
        if name in table.joints:
            node = clip.node(table.joints[name])
            p_world_joint[:, joint] = clip.p_world_node[:, node]
        else:
            offset = _missing_offset(joint, p_rest, template, C[parent])
            p_world_joint[:, joint] = p_world_joint[:, parent] + R_world_bone[:, parent] @ offset
        # The hand bone is rigid with the wrist: a finger's joint is not the palm's.
        if name in table.joints and (table.exact or not name.endswith("_hand")):
            R_world_bone[:, joint] = clip.R_world_node[:, node] @ C[joint]
        else:
            R_world_bone[:, joint] = R_world_bone[:, parent]
    return R_world_bone, p_world_joint


def _missing_offset(joint: int, p_rest: dict[str, Array], template: Skeleton, C_parent: Array) -> Array:
    """Offset from its parent of a joint that the source lacks: towards the spine's next joint, or else as usual.

    The joint is added to ``p_rest``.
    """
    name, parent = JOINT_NAMES[joint], JOINT_NAMES[PARENTS[joint]]
    spine = ("spine1", "spine2", "spine3", "neck")
    offset = template.p_parent_joint[joint]
    if name in spine:
        chain = spine[spine.index(name) :]
        steps = next((number for number, joint_name in enumerate(chain) if joint_name in p_rest), 0)
        if steps:
            lengths = [template.bone_length(joint_name) for joint_name in chain[: steps + 1]]
            offset = C_parent.T @ (p_rest[chain[steps]] - p_rest[parent]) * (lengths[0] / sum(lengths))
    p_rest[name] = p_rest[parent] + C_parent @ offset
    return offset


def _skeleton(
    clip: SourceClip, table: SkeletonMap, C: Array, R_world_bone: Array, p_world_joint: Array, stature: float
) -> Skeleton:
    """The source's own bones: each joint's mean place on its parent (constant unless the source bends in between)."""
    parents = np.array(PARENTS)
    arms = p_world_joint[:, 1:] - p_world_joint[:, parents[1:]]
    offsets = np.zeros((JOINT_COUNT, 3))
    offsets[1:] = np.einsum("tjba,tjb->ja", R_world_bone[:, parents[1:]], arms) / len(clip)
    if table.straight:
        for end, direction in AIMS.values():
            offsets[joint_index(end)] = np.linalg.norm(offsets[joint_index(end)]) * np.array(direction)
    landmarks = dict(skeleton_from_stature(stature).landmarks)
    for name, node in table.landmarks.items():
        bone = landmarks[name].bone
        holder = table.joints.get(JOINT_NAMES[bone], "")
        if holder:
            landmarks[name] = Landmark(bone, C[bone].T @ (clip.rest(node) - clip.rest(holder)))
        elif name.endswith("_fingertip"):  # from the wrist, where the source has no knuckles
            wrist = table.joints[JOINT_NAMES[PARENTS[bone]]]
            landmarks[name] = Landmark(bone, C[bone].T @ (clip.rest(node) - clip.rest(wrist)) - offsets[bone])
    for side in ("left", "right"):
        _level_heel(landmarks, offsets, side, f"{side}_toe_tip" in table.landmarks)
    return Skeleton(offsets, landmarks, f"{clip.name}, {table.name} skeleton, stature about {stature:.2f} m")


def _level_heel(landmarks: dict[str, Landmark], offsets: Array, side: str, toe_known: bool) -> None:
    """At rest the foot stands flat: the heel is as high as the tip of the toes, whichever of the two is known."""
    heel, toe = landmarks[f"{side}_heel"], landmarks[f"{side}_toe_tip"]
    ball_y = offsets[joint_index(f"{side}_foot"), 1]
    heel_point, toe_point = heel.p_bone_point.copy(), toe.p_bone_point.copy()
    if toe_known:
        heel_point[1] = ball_y + toe_point[1]
    else:
        toe_point[1] = min(heel_point[1] - ball_y, 0.0)
    landmarks[f"{side}_heel"] = Landmark(heel.bone, heel_point)
    landmarks[f"{side}_toe_tip"] = Landmark(toe.bone, toe_point)
