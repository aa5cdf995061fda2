"""The sensors as a tree of links across joints: what linked sensors say of one another, and the best choice of all.

A pair of linked sensors tells of their headings and mountings by the joint between them: two bones bend against one
another as people's do, and the point that they share is accelerated alike whichever of the two sensors tells: its own
specific force, carried along its bone. Low-passed accelerations suppose that a standing foot shares the pelvis's; here
the body is in between. Only where a limb without a sensor lies between two sensors do their slow accelerations stand
for it, and how differently they run says how little they tell. The best choice of headings and mountings of all sensors
together is exact: least costs are passed along the tree.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.body.pose_prior import JointLimits, PosePrior
from vip_factors.body.skeleton import Skeleton, ancestors, joint_index
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, rotation_z, transpose
from vip_factors.initialise.start_candidates import Candidates
from vip_factors.sensors.frames import ImuFrames

# Joints that barely move: what is not instrumented between two bones may be taken to ride along with them.
RIGID_JOINTS = tuple(
    joint_index(name)
    for name in ("spine1", "spine2", "spine3", "neck", "head", "left_collar", "right_collar", "left_foot", "right_foot")
)


@dataclass(frozen=True)
class Link:
    """Two sensors whose bones are joined, with no other instrumented bone between them.

    Attributes:
        parent, child: numbers of the sensors.
        mean, lower, upper: ``(3,)`` radians, of the rotation vector from the parent's bone to the child's: of all
            joints between them, added up.
        information: ``(3, 3)`` per rad², the inverse of the scatter that the pose prior expects.
        joints: how many of the joints between them move freely, one at least.
        p_parent, p_child: ``(3,)`` metres, from each sensor to a point that both bones share, in the bones' axes at
            rest; None where a free limb lies between them.
    """

    parent: int
    child: int
    mean: Array
    lower: Array
    upper: Array
    information: Array
    joints: int
    p_parent: Array | None
    p_child: Array | None


def sensor_tree(
    bones: Sequence[int], p_bone_sensor: Array, skeleton: Skeleton, prior: PosePrior, limits: JointLimits, sigma: float
) -> tuple[Link, ...]:
    """The links, each after the one that its parent hangs on; the first one's parent is the root.

    Args:
        bones: of the ``S`` sensors.
        p_bone_sensor: ``(S, 3)`` metres.
        skeleton, prior, limits: the body.
        sigma: radians, of what lies between a sensor's mounting and the bone itself.
    """
    order = sorted(range(len(bones)), key=lambda s: (len(ancestors(bones[s])), s))
    links = []
    for place, child in enumerate(order[1:], 1):
        above = [s for s in order[:place] if bones[s] in ancestors(bones[child])]
        deepest = max((len(ancestors(bones[s])) for s in above), default=0)
        parent = next((s for s in above if len(ancestors(bones[s])) == deepest), order[0])
        links.append(_link(parent, child, bones, p_bone_sensor, skeleton, prior, limits, sigma))
    return tuple(links)


def _link(
    parent: int, child: int, bones: Sequence[int], p_bone_sensor: Array, skeleton: Skeleton, prior: PosePrior,
    limits: JointLimits, sigma: float,
) -> Link:  # fmt: skip
    over, under = ancestors(bones[parent]), ancestors(bones[child])
    signs = {joint: -1.0 for joint in over if joint not in under} | {j: 1.0 for j in under if j not in over}
    mean, lower, upper = np.zeros((3, 3))
    weights = np.zeros((3, len(prior.mean)))
    for joint, sign in signs.items():
        rows = slice(3 * (joint - 1), 3 * joint)
        mean, weights[:, rows] = mean + sign * prior.mean[rows], sign * np.eye(3)
        ends = np.stack([sign * limits.lower[rows], sign * limits.upper[rows]])
        lower, upper = lower + ends.min(axis=0), upper + ends.max(axis=0)
    scatter = weights @ np.linalg.solve(prior.information, weights.T) + 2 * sigma**2 * np.eye(3)
    at = skeleton.p_pelvis_joint
    p_parent = p_child = None
    free = [joint for joint in signs if joint not in RIGID_JOINTS]
    if all(joint in under for joint in over) and len(free) <= 1:
        meet = at[free[0]] if free else (at[bones[parent]] + at[bones[child]]) / 2
        p_parent, p_child = (meet - at[bones[s]] - p_bone_sensor[s] for s in (parent, child))
    information = np.asarray(np.linalg.inv(scatter), float)
    return Link(parent, child, mean, lower, upper, information, max(len(free), 1), p_parent, p_child)


Choice = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class TreeMinimum:
    """The minimum of a sum of costs over a tree (min-sum, Viterbi 1967).

    Attributes:
        cost: the least.
        choice: candidate ``(heading, mounting)`` of every sensor that has it.
        marginals: by sensor ``(K, M)``, the least cost with each of its candidates, the others at their best.
    """

    cost: float
    choice: Choice
    marginals: tuple[Array, ...]


def least_cost(unary: Sequence[Array], links: Sequence[Link], pairs: Mapping[int, Array]) -> TreeMinimum:
    """The minimum of costs of sensors ``(K, M)`` each, and of links, by the child's number, ``(K, M, K, M)``.

    Links come parents first, and make one tree of all sensors. Where costs of sensors are ``(C, K, M)``, for ``C``
    hypotheses, it is the least of them all, and so are the marginals.
    """
    whole = [cost.reshape(-1, *cost.shape[-2:]).astype(float) for cost in unary]
    chosen: dict[int, Array] = {}
    messages: dict[int, Array] = {}
    for link in reversed(links):
        total = pairs[link.child] + whole[link.child][:, None, None]
        flat = total.reshape(*total.shape[:3], -1)
        chosen[link.child], messages[link.child] = flat.argmin(axis=-1), flat.min(axis=-1)
        whole[link.parent] = whole[link.parent] + messages[link.child]
    root = links[0].parent if links else 0
    least = whole[root].min(axis=(1, 2))
    best = int(least.argmin())
    marginals, choice = list(whole), [(0, 0)] * len(whole)
    choice[root] = _index(int(whole[root][best].argmin()), whole[root])
    for link in links:
        choice[link.child] = _index(int(chosen[link.child][(best, *choice[link.parent])]), whole[link.child])
        others = marginals[link.parent] - messages[link.child]
        marginals[link.child] = whole[link.child] + (pairs[link.child] + others[..., None, None]).min(axis=(1, 2))
    return TreeMinimum(float(least[best]), tuple(choice), tuple(cost.min(axis=0) for cost in marginals))


def _index(flat: int, cost: Array) -> tuple[int, int]:
    heading, mounting = divmod(flat, cost.shape[-1])
    return heading, mounting


LIMIT_SIGMA = np.deg2rad(10.0)  # how far beyond a joint's limits is as odd as one sigma of the pose prior
FREEDOM = 4.0  # of a Student t: some frames may be odd, and a pose prior's tails are not Gaussian
# New looks per second: a pose lasts for two, a limb's swing and the wobble of its strap for one.
POSES_PER_SECOND, SWINGS_PER_SECOND = 0.5, 1.0
MOST_LOOKS = 20.0  # what is wrong in the same way in every frame does not count more the longer one looks
# Frames looked at: more are alike; fewer do where candidates are free, and fewest with several mountings each.
POSTURES, WANDERING_POSTURES, FEWEST_POSTURES = 40, 20, 12
# m/s², least misfit of two accelerations that ought to agree: sensor places, soft tissue and the joint's own centre.
LEAST_MISFIT = 1.5
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])  # signs of the inverse of a unit quaternion, scalar part first
# The matrix that multiplies a quaternion from the left is linear in its four numbers.
FROM_LEFT = np.array(
    [
        [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0],
        [0, 0, -1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, -1, 0, 0],
        [0, 0, 0, -1, 0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0],
    ],
    float,
)
SLOW, LEAST_SLOW_MISFIT = 2.0, 0.3  # s that whatever lies between two sensors is averaged over; m/s²


def posture_cost(link: Link, candidates: Candidates, frames: ImuFrames) -> Array:
    """How unlike people's a joint bends, ``(K, M, K, M)`` nats: heading and mounting of parent, then child."""
    rows = np.flatnonzero(frames.orientation_valid[:, link.parent] & frames.orientation_valid[:, link.child])
    above, below = (candidates.R_bone_sensor[s] for s in (link.parent, link.child))
    if not len(rows):
        return np.zeros((*above.shape[:2], *below.shape[:2]))
    looked = rows[np.unique(np.linspace(0, len(rows) - 1, _postures(candidates)).astype(int))]
    parent, child = (
        _bones(candidates.headings[s, k], candidates.R_bone_sensor[s][k], frames.R_inertial_sensor[looked, s])
        for s, k in ((link.parent, _parents(candidates)), (link.child, slice(None)))
    )
    x = _bends(parent.reshape(-1, *parent.shape[2:]), child.reshape(-1, *child.shape[2:]))
    flat = x.reshape(3, -1)
    off = np.linalg.cholesky(link.information).T @ (flat - link.mean[:, None])
    beyond = (flat - np.clip(flat, link.lower[:, None], link.upper[:, None])) / LIMIT_SIGMA
    square = (_square(off) + _square(beyond)).reshape(x.shape[1:])
    cost = np.mean((FREEDOM + 3) / 2 * np.log(square / FREEDOM + 1.0), axis=0)
    cost = cost.reshape(*parent.shape[:2], *child.shape[:2])
    # Rotation vectors of several joints add up roughly only: the more of them, the less what they say counts.
    return _looks(frames, rows, POSES_PER_SECOND) / link.joints * _for_all_parents(cost, candidates)


def acceleration_cost(link: Link, candidates: Candidates, frames: ImuFrames) -> Array | float:
    """How differently what two bones share is accelerated, ``(K, M, K, M)`` nats; nought where nothing tells.

    The misfit's own size is unknown, so it is the logarithm of its mean square that counts: where the best choice
    leaves much, it is not much better than another.
    """
    near = link.p_parent is not None and link.p_child is not None
    arms = (link.p_parent, link.p_child) if near else (None, None)
    ends = [_carried(candidates, frames, s, p) for s, p in zip((link.parent, link.child), arms, strict=True)]
    rows = np.flatnonzero(ends[0][1] & ends[1][1])
    smooth = 1 if near else max(1, round(SLOW / frames.step))
    if len(rows) < 2 * smooth + 1:
        return 0.0
    above, below = ends[0][0][_parents(candidates)][:, :, rows], ends[1][0][:, :, rows]
    looks, least = _looks(frames, rows, SWINGS_PER_SECOND), LEAST_MISFIT
    if not near:
        above, below = (_slow(one, smooth) for one in (above, below))
        looks, least = looks / SLOW, LEAST_SLOW_MISFIT
    size = [np.mean(np.sum(one**2, axis=-1), axis=-1) for one in (above, below)]
    flat = [one.reshape(one.shape[0] * one.shape[1], -1) for one in (above, below)]
    product = (flat[0] @ flat[1].T).reshape(*above.shape[:2], *below.shape[:2]) / above.shape[2]
    square = np.maximum(size[0][:, :, None, None] + size[1][None, None] - 2 * product, 0.0) / 3
    return 1.5 * looks * _for_all_parents(np.log(square / least**2 + 1.0), candidates)


def _postures(candidates: Candidates) -> int:
    if candidates.relative:
        return FEWEST_POSTURES
    return POSTURES if candidates.declared else WANDERING_POSTURES


def _looks(frames: ImuFrames, rows: np.ndarray, per_second: float) -> float:
    return min(max(len(rows) * frames.step * per_second, 1.0), MOST_LOOKS)


def _parents(candidates: Candidates) -> slice:
    return slice(0, 1) if candidates.relative else slice(None)


def _for_all_parents(cost: Array, candidates: Candidates) -> Array:
    """Where only differences matter, of the parent's first heading: of all of them."""
    if not candidates.relative:
        return cost
    return np.stack([np.roll(cost[0], k, axis=1) for k in range(cost.shape[2])])


def _bones(headings: Array, R_bone_sensor: Array, R_inertial_sensor: Array) -> Array:
    """Unit quaternions ``(K, M, T, 4)``, scalar part first, of ``R_world_bone``."""
    about = np.zeros((len(headings), 4))
    about[:, 0], about[:, 3] = np.cos(headings / 2), np.sin(headings / 2)
    mounting, turned = (quaternion_from_matrix(R, Order.WXYZ) for R in (R_bone_sensor, R_inertial_sensor))
    product = _from_left(about)[:, None] @ _from_left(turned)
    K, T = product.shape[:2]
    bones = (mounting * CONJUGATE) @ np.moveaxis(product, 3, 1).reshape(K, 4, T * 4)
    return bones.reshape(K, -1, T, 4)


def _bends(parent: Array, child: Array) -> Array:
    """Rotation vectors ``(3, T, N, M)`` from the one bones ``(N, T, 4)`` to the other ones ``(M, T, 4)``."""
    inverse = np.ascontiguousarray(_from_left(parent * CONJUGATE).transpose(2, 1, 0, 3))
    q = inverse @ np.ascontiguousarray(child.transpose(1, 2, 0))
    scalar, vector = q[0], q[1:]
    sine = np.sqrt(_square(vector))
    scale = 2 * np.arctan2(sine, np.abs(scalar)) / np.maximum(sine, 1e-150)  # of no turn at all nought is left
    return np.asarray(vector * np.copysign(scale, scalar))


def _from_left(q: Array) -> Array:
    """Matrices ``(..., 4, 4)`` that multiply a quaternion by these ``(..., 4)`` from the left."""
    return (q @ FROM_LEFT).reshape(*q.shape, 4)


def _square(v: Array) -> Array:
    """Squared length ``(...)`` of vectors ``(3, ...)``: the axis stands first, where sums over it are quick."""
    return np.asarray(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)


def _carried(
    candidates: Candidates, frames: ImuFrames, s: int, p_sensor_point: Array | None
) -> tuple[Array, np.ndarray]:
    """Acceleration ``(K, M, T − 2, 3)`` of a point of the sensor's bone, gravity still in it, and where it is known.

    ``p_sensor_point`` ``(3,)`` metres is in the bone's axes; None stands for the sensor itself.
    """
    R, seen = frames.R_inertial_sensor[:, s], frames.orientation_valid[:, s]
    known = seen[:-2] & seen[1:-1] & seen[2:] & frames.acceleration_valid[1:-1, s]
    mountings = candidates.R_bone_sensor[s]
    force = np.broadcast_to(frames.specific_force_inertial[1:-1, s], (*mountings.shape[:2], len(R) - 2, 3))
    if p_sensor_point is not None:
        bend = (R[:-2] - 2 * R[1:-1] + R[2:]) / frames.step**2
        arms = (transpose(mountings) @ p_sensor_point).reshape(-1, 3)
        force = force + (arms @ bend.reshape(-1, 3).T).reshape(force.shape)
    return force @ transpose(rotation_z(candidates.headings[s]))[:, None], known


def _slow(force: Array, frames: int) -> Array:
    """Averaged over a few frames, whole windows only; constant parts are gravity and bias, and say nothing."""
    smooth = uniform_filter1d(force, frames, axis=2)[:, :, frames // 2 : force.shape[2] - frames // 2]
    return smooth - smooth.mean(axis=2, keepdims=True)
