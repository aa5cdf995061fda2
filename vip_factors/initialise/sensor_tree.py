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
from functools import cached_property

import numpy as np
import scipy

from vip_factors.body.pose_prior import JointLimits, PosePrior
from vip_factors.body.skeleton import Skeleton, ancestors, joint_index
from vip_factors.compiled import Kernels, kernels
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
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
        whitening: ``(3, 3)`` per radian, upper triangular: what makes sigmas of what is off the mean, by the scatter
            that the pose prior expects.
        joints: how many of the joints between them move freely, one at least.
        p_parent, p_child: ``(3,)`` metres, from each sensor to a point that both bones share, in the bones' axes at
            rest; None where a free limb lies between them.
    """

    parent: int
    child: int
    mean: Array
    lower: Array
    upper: Array
    whitening: Array
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
    covariance, links = np.asarray(np.linalg.inv(prior.information), float), []
    for place, child in enumerate(order[1:], 1):
        above = [s for s in order[:place] if bones[s] in ancestors(bones[child])]
        deepest = max((len(ancestors(bones[s])) for s in above), default=0)
        parent = next((s for s in above if len(ancestors(bones[s])) == deepest), order[0])
        links.append(_link(parent, child, bones, p_bone_sensor, skeleton, prior.mean, covariance, limits, sigma))
    return tuple(links)


def _link(
    parent: int, child: int, bones: Sequence[int], p_bone_sensor: Array, skeleton: Skeleton, prior_mean: Array,
    covariance: Array, limits: JointLimits, sigma: float,
) -> Link:  # fmt: skip
    over, under = ancestors(bones[parent]), ancestors(bones[child])
    signs = {joint: -1.0 for joint in over if joint not in under} | {j: 1.0 for j in under if j not in over}
    mean, lower, upper = np.zeros((3, 3))
    weights = np.zeros((3, len(prior_mean)))
    for joint, sign in signs.items():
        rows = slice(3 * (joint - 1), 3 * joint)
        mean, weights[:, rows] = mean + sign * prior_mean[rows], sign * np.eye(3)
        ends = np.stack([sign * limits.lower[rows], sign * limits.upper[rows]])
        lower, upper = lower + ends.min(axis=0), upper + ends.max(axis=0)
    scatter = weights @ covariance @ weights.T + 2 * sigma**2 * np.eye(3)
    at = skeleton.p_pelvis_joint
    p_parent = p_child = None
    free = [joint for joint in signs if joint not in RIGID_JOINTS]
    if all(joint in under for joint in over) and len(free) <= 1:
        meet = at[free[0]] if free else (at[bones[parent]] + at[bones[child]]) / 2
        p_parent, p_child = (meet - at[bones[s]] - p_bone_sensor[s] for s in (parent, child))
    whitening = np.ascontiguousarray(np.linalg.cholesky(np.linalg.inv(scatter)).T)
    return Link(parent, child, mean, lower, upper, whitening, max(len(free), 1), p_parent, p_child)


Choice = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class TreeMinimum:
    """The minimum of a sum of costs over a tree (min-sum, Viterbi 1967).

    Attributes:
        cost: the least.
        choice: candidate ``(heading, mounting)`` of every sensor that has it.
        marginals: by sensor ``(K, M)``, the least cost with each of its candidates, the others at their best; none
            where they are not asked for.
    """

    cost: float
    choice: Choice
    marginals: tuple[Array, ...]


def least_cost(
    unary: Sequence[Array], links: Sequence[Link], pairs: Mapping[int, Array], marginals: bool = True
) -> TreeMinimum:
    """The minimum of costs of sensors ``(K, M)`` each, and of links, by the child's number, ``(K, M, K, M)``.

    Links come parents first, and make one tree of all sensors. Where costs of sensors are ``(C, K, M)``, for ``C``
    hypotheses, it is the least of them all, and so are the marginals.
    """
    whole = [cost.reshape(-1, *cost.shape[-2:]).astype(float) for cost in unary]
    messages: dict[int, Array] = {}
    for link in reversed(links):
        total = pairs[link.child] + whole[link.child][:, None, None]
        messages[link.child] = total.reshape(*total.shape[:3], -1).min(axis=-1)
        whole[link.parent] = whole[link.parent] + messages[link.child]
    root = links[0].parent if links else 0
    least = whole[root].min(axis=(1, 2))
    best = int(least.argmin())
    choice = [(0, 0)] * len(whole)
    choice[root] = _index(whole[root][best])
    for link in links:
        choice[link.child] = _index(pairs[link.child][choice[link.parent]] + whole[link.child][best])
    if marginals:
        for link in links:  # from here on of all sensors, and not of the child and those below alone
            others = whole[link.parent] - messages[link.child]
            whole[link.child] = whole[link.child] + (pairs[link.child] + others[..., None, None]).min(axis=(1, 2))
    return TreeMinimum(
        float(least[best]), tuple(choice), tuple(cost.min(axis=0) for cost in whole) if marginals else ()
    )


def _index(cost: Array) -> tuple[int, int]:
    heading, mounting = divmod(int(cost.argmin()), cost.shape[-1])
    return heading, mounting


# New looks per second: a pose lasts for two, a limb's swing and the wobble of its strap for one.
POSES_PER_SECOND, SWINGS_PER_SECOND = 0.5, 1.0
MOST_LOOKS = 20.0  # what is wrong in the same way in every frame does not count more the longer one looks
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


End = tuple[Array, Array, Array]
"""Unit quaternions, scalar part first: headings ``(K, 4)``, mountings ``(K, M, 4)``, R_inertial_sensor ``(T, 4)``."""


@dataclass(frozen=True)
class LinkCosts:
    """What links say of headings and mountings, by some evenly spaced frames."""

    links: tuple[Link, ...]
    frames: ImuFrames

    def of(self, candidates: Candidates) -> dict[int, Array]:
        """By the child's number ``(K, M, K, M)`` nats: heading and mounting of parent, then child."""
        costs, (about, mountings) = {}, _quaternions(candidates)
        of_parent = slice(0, 1) if candidates.relative else slice(None)  # only differences of headings matter
        for link, accelerations in zip(self.links, self._accelerations, strict=True):
            sides = ((link.parent, of_parent), (link.child, slice(None)))
            R_parent, R_child = (candidates.R_bone_sensor[s][own] for s, own in sides)
            cost = np.zeros((*R_parent.shape[:2], *R_child.shape[:2]))
            rows = np.flatnonzero(self.frames.orientation_valid[:, [link.parent, link.child]].all(axis=1))
            if len(rows):
                looked = rows[np.unique(np.linspace(0, len(rows) - 1, _postures(candidates)).astype(int))]
                ends = [(about[s, own], mountings[s][own], self._turned[s][looked]) for s, own in sides]
                # Rotation vectors of several joints add up roughly only: the more, the less what they say counts.
                weight = _looks(self.frames, rows, POSES_PER_SECOND) / link.joints
                cost = weight * bend_cost(link, ends[0], ends[1]).reshape(cost.shape)
            if accelerations is not None:
                headings = candidates.headings[link.child] - candidates.headings[link.parent, of_parent, None]
                cost += accelerations.cost(headings, R_parent, R_child)
            if candidates.relative:  # of the parent's first heading: of all of them
                cost = np.stack([np.roll(cost[0], k, axis=1) for k in range(cost.shape[2])])
            costs[link.child] = cost
        return costs

    @cached_property
    def _turned(self) -> Array:
        """Unit quaternions ``(S, T, 4)``."""
        return quaternion_from_matrix(self.frames.R_inertial_sensor.swapaxes(0, 1), Order.WXYZ)

    @cached_property
    def _accelerations(self) -> list["_Accelerations | None"]:
        """By link, what it says; None where that is nothing."""
        carried, known = _carried(self.frames)
        return [_accelerations(link, self.frames, carried, known) for link in self.links]


def _quaternions(candidates: Candidates) -> tuple[Array, list[Array]]:
    """Of headings ``(S, K, 4)``, and by sensor of mountings ``(K, M, 4)``."""
    about = np.zeros((*candidates.headings.shape, 4))
    about[..., 0], about[..., 3] = np.cos(candidates.headings / 2), np.sin(candidates.headings / 2)
    ends = np.cumsum([R.shape[1] for R in candidates.R_bone_sensor])
    mountings = quaternion_from_matrix(np.concatenate(candidates.R_bone_sensor, axis=1), Order.WXYZ)
    return about, [np.ascontiguousarray(one) for one in np.split(mountings, ends[:-1], axis=1)]


def bend_cost(link: Link, parent: End, child: End, kernels: Kernels = kernels) -> Array:
    """How unlike people's a joint bends, nats a look: ``(N, M)``, of all headings and mountings of parent and child."""
    freedom = 4.0  # of a Student t: some frames may be odd, and a pose prior's tails are not Gaussian
    limit_sigma = np.deg2rad(10.0)  # how far beyond a joint's limits is as odd as one sigma of the pose prior
    if kernels is not None:
        found = np.empty(tuple(mountings.shape[0] * mountings.shape[1] for _, mountings, _ in (parent, child)))
        kernels.bend_cost(*parent, *child, np.stack([link.mean, link.lower, link.upper]), link.whitening, found)
        return found
    x = _bends(_bones(*parent), _bones(*child))
    flat = x.reshape(3, -1)
    off = link.whitening @ (flat - link.mean[:, None])
    beyond = (flat - np.clip(flat, link.lower[:, None], link.upper[:, None])) / limit_sigma
    square = (_square(off) + _square(beyond)).reshape(x.shape[1:])
    return np.asarray(np.mean((freedom + 3) / 2 * np.log(square / freedom + 1.0), axis=0))


@dataclass(frozen=True)
class _Accelerations:
    """How differently what two bones share is accelerated, by products summed over frames: candidates meet these alone.

    The misfit's own size is unknown, so it is the logarithm of its mean square that counts: where the best choice
    leaves much, it is not much better than another.

    Attributes:
        arms: ``(3,)`` metres, from either sensor to the shared point, in its bone's axes.
        products: ``(5, 4, 4)``, as :func:`joint_products` has them, of a frame on average.
        looks: that this counts as.
        least: m/s² of misfit that says nothing.
    """

    arms: tuple[Array, Array]
    products: Array
    looks: float
    least: float

    def cost(self, headings: Array, R_parent: Array, R_child: Array) -> Array:
        """``(K, M, K, M)`` nats of headings ``(K, K)`` of child less parent, and of mountings ``(K, M, 3, 3)``."""
        sides, shape = [], (*R_parent.shape[:2], *R_child.shape[:2])
        for R, arm in zip((R_parent, R_child), self.arms, strict=True):
            arms = (arm @ R).reshape(-1, 3)  # in the sensor's axes
            sides.append(np.concatenate([np.ones((len(arms), 1)), arms], axis=1))
        above, below = (np.sum(side @ own * side, axis=1) for side, own in zip(sides, self.products[:2], strict=True))
        cosine, sine, vertical = (sides[0] @ self.products[2:] @ sides[1].T).reshape(3, *shape)
        angles = headings[:, None, :, None]
        product = np.cos(angles) * cosine + np.sin(angles) * sine + vertical
        square = np.maximum((above[:, None] + below).reshape(shape) - 2 * product, 0.0) / 3
        return 1.5 * self.looks * np.log(square / self.least**2 + 1.0)


def joint_products(above: Array, below: Array) -> Array:
    """``(5, 4, 4)``, summed over frames: of columns ``(T, 3, 4)`` with themselves, of others, and of these with those:
    what the cosine of the heading between them is multiplied with, what the sine, and what of the vertical is left."""
    own = (np.tensordot(one, one, ((0, 1), (0, 1))) for one in (above, below))
    shared = np.tensordot(above, below, (0, 0))
    across = shared[1, :, 0] - shared[0, :, 1]
    return np.stack([*own, shared[0, :, 0] + shared[1, :, 1], across, shared[2, :, 2]])


def _carried(frames: ImuFrames) -> tuple[Array, np.ndarray]:
    """By sensor ``(S, T − 2, 3, 4)`` the acceleration, gravity still in it, of a point of its bone: a column for the
    sensor's own and three to be multiplied with the arm from it to the point; and where it is known ``(S, T − 2)``."""
    R, seen = frames.R_inertial_sensor, frames.orientation_valid
    bend = (R[:-2] - 2 * R[1:-1] + R[2:]) / frames.step**2
    known = seen[:-2] & seen[1:-1] & seen[2:] & frames.acceleration_valid[1:-1]
    return np.concatenate([frames.specific_force_inertial[1:-1, ..., None], bend], axis=-1).swapaxes(0, 1), known.T


def _accelerations(link: Link, frames: ImuFrames, carried: Array, known: np.ndarray) -> _Accelerations | None:
    slow, least_slow_misfit = 2.0, 0.3  # s that whatever lies between two sensors is averaged over; m/s²
    both = [link.parent, link.child]
    rows = np.flatnonzero(known[both].all(axis=0))
    arms = None if link.p_parent is None or link.p_child is None else (link.p_parent, link.p_child)
    smooth = 1 if arms is not None else max(1, round(slow / frames.step))
    if len(rows) < 2 * smooth + 1:
        return None
    above, below = carried[both][:, rows] if arms is not None else _slow(carried[both][:, rows], smooth)
    products = joint_products(above, below) / len(above)
    looks = _looks(frames, rows, SWINGS_PER_SECOND)
    if arms is not None:
        return _Accelerations(arms, products, looks, LEAST_MISFIT)
    return _Accelerations((np.zeros(3),) * 2, products, looks / slow, least_slow_misfit)


def _postures(candidates: Candidates) -> int:
    # Frames looked at: more are alike; fewer do where candidates are free, and fewest with several mountings each.
    postures, wandering_postures, fewest_postures = 40, 20, 12
    if candidates.relative:
        return fewest_postures
    return postures if candidates.declared else wandering_postures


def _looks(frames: ImuFrames, rows: np.ndarray, per_second: float) -> float:
    return min(max(len(rows) * frames.step * per_second, 1.0), MOST_LOOKS)


def _bones(about: Array, mountings: Array, turned: Array) -> Array:
    """Unit quaternions ``(K * M, T, 4)`` of ``R_world_bone``."""
    product = _from_left(about)[:, None] @ _from_left(turned)
    K, T = product.shape[:2]
    bones = (mountings * CONJUGATE) @ np.moveaxis(product, 3, 1).reshape(K, 4, T * 4)
    return bones.reshape(-1, T, 4)


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


def _slow(accelerations: Array, frames: int) -> Array:
    """``(2, T, 3, 4)`` averaged over a few frames, whole windows only; constant parts are gravity and bias, and say
    nothing."""
    length = accelerations.shape[1]
    smooth = scipy.ndimage.uniform_filter1d(accelerations, frames, axis=1)[:, frames // 2 : length - frames // 2]
    return np.asarray(smooth - smooth.mean(axis=1, keepdims=True))
