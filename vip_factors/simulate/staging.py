"""People on the floor of one world: standing feet, held calibration poses, clips placed, lengthened, started late."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.body.kinematics import BodyState, Motion, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton, calibration_pose, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp, log, rotation_z, transpose, wrap_angle, yaw_of

SOLE = ("left_heel", "left_toe_tip", "right_heel", "right_toe_tip")


def floor_height(skeleton: Skeleton, state: BodyState) -> Array:
    """Height ``(T,)`` of the lowest point of the soles, as a smooth minimum, so that it can be differentiated."""
    return _lowest(_soles(skeleton, state)[..., 2])[0]


def path_of_standing_feet(skeleton: Skeleton, state: BodyState) -> Array:
    """Root path ``(T, 3)`` on which the lowest points of the soles stand still on the floor z = 0, of a motion whose
    root is held at the origin.
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
    softness_m = 0.008  # of the smooth minimum: the weight passes between feet without a jolt
    least = heights.min(axis=1, keepdims=True)
    shares = np.exp(-(heights - least) / softness_m)
    smooth = least[:, 0] - softness_m * np.log(shares.mean(axis=1))
    return smooth, shares / shares.sum(axis=1, keepdims=True)


def with_initial_pose(
    motion: Motion,
    pose: str = "n-pose",
    hold_s: float = 2.0,
    blend_s: float = 1.0,
    pose_error_deg: float = 0.0,
    seed: int = 0,
) -> Motion:
    """The motion after a held calibration pose; it starts ``hold_s`` later and its first ``blend_s`` are blended.

    The wearer stands where the first frame stands, with its heading. The blend is a slerp of every joint with a
    fifth-order step, so that velocity and acceleration stay continuous. ``pose_error_deg`` says how imperfectly the
    pose is held: sigma of a fixed random rotation of every joint, per axis (5–10 for somebody told to stand straight).

    Raises:
        InputError: for another pose, or a motion shorter than the blend.
    """
    blended, hold_frames = round(blend_s * motion.rate), round(hold_s * motion.rate)
    if blended >= len(motion):
        raise InputError(f"motion '{motion.name}' is shorter than the blend of {blend_s:g} s: shorten the blend")
    R_held, p_held = _held_pose(motion, pose, pose_error_deg, seed)
    R, p = motion.R_parent_child, motion.p_world_pelvis
    R_blended, p_blended = _blended(motion, (R_held[None], p_held[None]), (R[:blended], p[:blended]))
    R = np.concatenate([np.repeat(R_held[None], hold_frames, axis=0), R_blended, R[blended:]])
    p = np.concatenate([np.repeat(p_held[None], hold_frames, axis=0), p_blended, p[blended:]])
    return replace(motion, R_parent_child=R, p_world_pelvis=p)


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


BLEND_S = 0.8  # from the end of a clip into its next repetition
LEAST_S = 1.0  # of a clip to be repeated
TURN_RAD_S = np.deg2rad(120.0)  # at most, of a blend: people who turn about; four repetitions lead round and back
STAGE_M = 1.8  # how far from the stage's middle the middles of paths are: people cross, and hide each other
APART_M = 0.6  # of two people's pelves who pass each other without touching
TRIES = 30  # of places, before people come nearer than that


def placed(motion: Motion, yaw: float = 0.0, middle: Sequence[float] = (0.0, 0.0)) -> Motion:
    """The motion turned about the vertical, with the middle of its ground path at ``middle`` (metres)."""
    R = rotation_z(yaw)
    ground = motion.p_world_pelvis[:, :2]
    centre = np.array([*((ground.min(axis=0) + ground.max(axis=0)) / 2), 0.0])
    p = (motion.p_world_pelvis - centre) @ R.T + np.array([*middle, 0.0])
    turned = motion.R_parent_child.copy()
    turned[:, 0] = R @ turned[:, 0]
    return replace(motion, R_parent_child=turned, p_world_pelvis=p)


def lasting(motion: Motion, seconds: float) -> Motion:
    """The motion cut or repeated to a length.

    Each repetition starts where the one before ended, turned so that it leads back towards the first one's middle; a
    blend of 0.8 s (a third of a short clip) joins them (feet slide there, as the price).

    Raises:
        InputError: for a clip that is too short to be repeated.
    """
    frames = round(seconds * motion.rate) + 1
    blend = min(round(BLEND_S * motion.rate), len(motion) // 3)
    if frames <= len(motion):
        return motion.frames(slice(0, frames))
    if len(motion) < LEAST_S * motion.rate:
        raise InputError(
            f"motion '{motion.name}' lasts {len(motion) / motion.rate:g} s: expected at least {LEAST_S:g} s to "
            "repeat it"
        )
    R, p = motion.R_parent_child, motion.p_world_pelvis
    home = (p[:, :2].min(axis=0) + p[:, :2].max(axis=0)) / 2
    while len(p) < frames:
        R_next, p_next = _turned_home(motion, R[-blend:], p[-blend:], home)
        R_blended, p_blended = _blended(motion, (R[-blend:], p[-blend:]), (R_next[:blend], p_next[:blend]))
        R = np.concatenate([R[:-blend], R_blended, R_next[blend:]])
        p = np.concatenate([p[:-blend], p_blended, p_next[blend:]])
    return replace(motion, R_parent_child=R[:frames], p_world_pelvis=p[:frames])


def _turned_home(motion: Motion, R_end: Array, p_end: Array, home: Array) -> tuple[Array, Array]:
    """The clip once more, from the end's middle on; its net way turned towards home, as far as people turn."""
    walks_m = 0.4  # net way of a clip that leads somewhere
    count = len(p_end)
    start = motion.p_world_pelvis[:count].mean(axis=0)
    direction = motion.p_world_pelvis[-count:].mean(axis=0) - start
    back = home - p_end[-1, :2]
    turn = float(yaw_of(R_end[count // 2, 0] @ transpose(motion.R_parent_child[count // 2, 0])))  # straight on
    if np.linalg.norm(direction[:2]) > walks_m and np.linalg.norm(back) > walks_m:
        homeward = np.arctan2(back[1], back[0]) - np.arctan2(direction[1], direction[0])
        max_turn = TURN_RAD_S * count / motion.rate
        turn += float(np.clip(wrap_angle(homeward - turn), -max_turn, max_turn))
    R_turn = rotation_z(turn)
    shift = np.array([*(p_end.mean(axis=0) - R_turn @ start)[:2], 0.0])
    R = motion.R_parent_child.copy()
    R[:, 0] = R_turn @ R[:, 0]
    return R, motion.p_world_pelvis @ R_turn.T + shift


def _blended(
    motion: Motion, poses_before: tuple[Array, Array], poses_after: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Joint rotations ``(B, 24, 3, 3)`` and roots ``(B, 3)`` from one stretch (or pose) to another of B frames.

    A slerp of every joint, with the root raised so that the feet neither dip nor float.
    """
    (R_before, p_before), (R_after, p_after) = poses_before, poses_after
    phase = np.arange(len(R_after)) / max(len(R_after), 1)
    weight = phase**3 * (10 - 15 * phase + 6 * phase**2)  # first and second derivatives vanish at both ends
    R = R_before @ exp(weight[:, None, None] * log(transpose(R_before) @ R_after))
    p = p_before + weight[:, None] * (p_after - p_before)
    before, after, blended = (
        floor_height(motion.skeleton, forward_kinematics(motion.skeleton, *poses))
        for poses in (poses_before, poses_after, (R, p))
    )
    p[:, 2] += before * (1 - weight) + after * weight - blended
    return R, p


def from_time(motion: Motion, seconds: float) -> Motion:
    """The motion from a moment on, starting at time zero: people who do the same thing should not do it in step."""
    return replace(motion.frames(slice(round(seconds * motion.rate), None)), start=0.0)


def staged(
    motions: Sequence[Motion], seed: int = 0, neighbours: Sequence[Motion] = (), reach_m: float = STAGE_M
) -> tuple[Motion, ...]:
    """Motions of several people in one world, turned and placed at random so that they cross but do not collide.

    All are on the clock of the scene; ``neighbours`` are in that world already; ``reach_m`` is how far from the origin
    the middles of their paths may be. A person alone is in the middle.
    """
    random = np.random.default_rng([seed, 0x57A6E])
    people = list(neighbours)
    for motion in motions:
        chosen, room = None, -1.0
        for _ in range(TRIES if people else 1):
            angle, yaw = random.uniform(-np.pi, np.pi, 2)
            radius = reach_m * np.sqrt(random.random()) if people else 0.0
            candidate = placed(motion, yaw, (radius * np.cos(angle), radius * np.sin(angle)))
            free = min((_nearest(candidate, person) for person in people), default=np.inf)
            if free > room:
                chosen, room = candidate, free
            if free > APART_M:
                break
        assert chosen is not None
        people.append(chosen)
    return tuple(people[len(neighbours) :])


def _nearest(motion: Motion, neighbour: Motion) -> float:
    """Least distance in metres of two people's pelves, on the ground, at common times."""
    start, end = max(motion.start, neighbour.start), min(motion.time[-1], neighbour.time[-1])
    time = np.arange(start, end, 0.1)
    if not len(time):
        return np.inf
    offsets = [
        np.interp(time, motion.time, motion.p_world_pelvis[:, axis])
        - np.interp(time, neighbour.time, neighbour.p_world_pelvis[:, axis])
        for axis in (0, 1)
    ]
    return float(np.hypot(*offsets).min())
