"""Tree of sensors linked across joints: costs of headings and mountings, and their joint minimum.

Two linked sensors constrain their headings and mountings in two ways: the joint between their bones has a likely
rotation, and their common point has one acceleration, which each sensor measures as its specific force plus that of
its arm. If a limb without a sensor lies between them, their slow accelerations are compared instead. The minimum over
headings and mountings of all sensors is exact: costs are passed along the tree.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from vip_factors.body.joint_priors import JointLimits, PosePrior
from vip_factors.body.skeleton import Skeleton, ancestors, joint_index
from vip_factors.compiled import Kernels, kernels
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.start_candidates import Candidates
from vip_factors.sensors.frames import ImuFrames

# Joints that barely move: bones between two instrumented ones count as rigid.
RIGID_JOINTS = tuple(
    joint_index(name)
    for name in ("spine1", "spine2", "spine3", "neck", "head", "left_collar", "right_collar", "left_foot", "right_foot")
)


@dataclass(frozen=True)
class Link:
    """Two sensors without another instrumented bone between their bones.

    Attributes:
        parent, child: numbers of the sensors.
        mean, lower, upper: ``(3,)`` radians, prior mean and limits of the rotation vector from the parent's bone to
            the child's, summed over the joints between them.
        whitening: ``(3, 3)`` per radian, upper triangular, of deviations from the mean under the pose prior.
        joints: number of free joints between them, at least 1.
        p_parent, p_child: ``(3,)`` metres, from each sensor to a common point of both bones, in bone axes at rest; None
            if a free limb lies between them.
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
    """Build the links, parents first; the first one's parent is the root.

    ``p_bone_sensor`` is ``(S, 3)`` metres, ``sigma`` the uncertainty of a sensor's mounting on its bone in radians.
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
    parent: int,
    child: int,
    bones: Sequence[int],
    p_bone_sensor: Array,
    skeleton: Skeleton,
    prior_mean: Array,
    covariance: Array,
    limits: JointLimits,
    sigma: float,
) -> Link:
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
    p_joint = skeleton.p_pelvis_joint
    p_parent = p_child = None
    free = [joint for joint in signs if joint not in RIGID_JOINTS]
    if all(joint in under for joint in over) and len(free) <= 1:
        meet = p_joint[free[0]] if free else (p_joint[bones[parent]] + p_joint[bones[child]]) / 2
        p_parent, p_child = (meet - p_joint[bones[s]] - p_bone_sensor[s] for s in (parent, child))
    whitening = np.ascontiguousarray(np.linalg.cholesky(np.linalg.inv(scatter)).T)
    return Link(parent, child, mean, lower, upper, whitening, max(len(free), 1), p_parent, p_child)


Choice = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class TreeMinimum:
    """Minimum of a sum of costs over a tree (min-sum, Viterbi 1967).

    Attributes:
        cost: least cost.
        choice: candidate ``(heading, mounting)`` of every sensor at the minimum.
        marginals: by sensor ``(K, M)``, the least cost with each of its candidates; empty if not requested.
    """

    cost: float
    choice: Choice
    marginals: tuple[Array, ...]


def least_cost(
    unary: Sequence[Array], links: Sequence[Link], pairs: Mapping[int, Array], marginals: bool = True
) -> TreeMinimum:
    """Minimise the costs of sensors ``(K, M)`` each, and of links, by the child's number, ``(K, M, K, M)``.

    Links are one tree of all sensors, parents first. With costs ``(C, K, M)`` for ``C`` hypotheses, minimum and
    marginals are taken over all of them.
    """
    totals = [cost.reshape(-1, *cost.shape[-2:]).astype(float) for cost in unary]
    messages: dict[int, Array] = {}
    for link in reversed(links):
        total = pairs[link.child] + totals[link.child][:, None, None]
        messages[link.child] = total.reshape(*total.shape[:3], -1).min(axis=-1)
        totals[link.parent] = totals[link.parent] + messages[link.child]
    root = links[0].parent if links else 0
    least = totals[root].min(axis=(1, 2))
    hypothesis = int(least.argmin())
    choice = [(0, 0)] * len(totals)
    choice[root] = _index(totals[root][hypothesis])
    for link in links:
        choice[link.child] = _index(pairs[link.child][choice[link.parent]] + totals[link.child][hypothesis])
    if marginals:
        for link in links:  # totals of all sensors, not only of the subtree
            rest_cost = totals[link.parent] - messages[link.child]
            totals[link.child] = totals[link.child] + (pairs[link.child] + rest_cost[..., None, None]).min(axis=(1, 2))
    return TreeMinimum(
        float(least[hypothesis]), tuple(choice), tuple(cost.min(axis=0) for cost in totals) if marginals else ()
    )


def _index(cost: Array) -> tuple[int, int]:
    heading, mounting = divmod(int(cost.argmin()), cost.shape[-1])
    return heading, mounting


POSES_PER_SECOND, SWINGS_PER_SECOND = 0.5, 1.0  # independent observations of poses and of accelerations
MOST_LOOKS = 20.0  # independent observations at most: systematic errors do not average out
LEAST_MISFIT = 1.5  # m/s², of two accelerations of one point: sensor positions, soft tissue, joint centre
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])  # signs of the inverse of a unit quaternion, scalar part first
# Linear map from a quaternion to its left-multiplication matrix.
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
    """Costs of headings and mountings by links, from evenly spaced frames."""

    links: tuple[Link, ...]
    frames: ImuFrames

    def of(self, candidates: Candidates) -> dict[int, Array]:
        """Costs in nats by the child's number, ``(K, M, K, M)``: heading and mounting of parent, then child."""
        # number of frames: fewer for free candidates, fewest with several mountings each
        postures = 12 if candidates.relative else 40 if candidates.declared else 20
        costs, (rotations, mountings) = {}, _quaternions(candidates)
        of_parent = slice(0, 1) if candidates.relative else slice(None)  # only differences of headings matter
        for link, accelerations in zip(self.links, self._accelerations, strict=True):
            sides = ((link.parent, of_parent), (link.child, slice(None)))
            R_parent, R_child = (candidates.R_bone_sensor[s][selection] for s, selection in sides)
            cost = np.zeros((*R_parent.shape[:2], *R_child.shape[:2]))
            rows = np.flatnonzero(self.frames.orientation_valid[:, [link.parent, link.child]].all(axis=1))
            if len(rows):
                looked = rows[np.unique(np.linspace(0, len(rows) - 1, postures).astype(int))]
                ends = [
                    (rotations[s, selection], mountings[s][selection], self._turned[s][looked])
                    for s, selection in sides
                ]
                # the sum of several joints' rotation vectors is approximate: less weight
                weight = _looks(self.frames, rows, POSES_PER_SECOND) / link.joints
                cost = weight * bend_cost(link, ends[0], ends[1]).reshape(cost.shape)
            if accelerations is not None:
                headings = candidates.headings[link.child] - candidates.headings[link.parent, of_parent, None]
                cost += accelerations.cost(headings, R_parent, R_child)
            if candidates.relative:  # computed for the parent's first heading only
                cost = np.stack([np.roll(cost[0], k, axis=1) for k in range(cost.shape[2])])
            costs[link.child] = cost
        return costs

    @cached_property
    def _turned(self) -> Array:
        """Unit quaternions ``(S, T, 4)`` of the orientations."""
        return quaternion_from_matrix(self.frames.R_inertial_sensor.swapaxes(0, 1), Order.WXYZ)

    @cached_property
    def _accelerations(self) -> list["_Accelerations | None"]:
        """Acceleration costs by link; None without data.

        The specific force of points on each sensor's bone is a linear function of the arm, ``(S, T − 2, 3, 4)``: a
        column for the sensor's own and three that multiply the arm.
        """
        frames, R, is_oriented = self.frames, self.frames.R_inertial_sensor, self.frames.orientation_valid
        bend = (R[:-2] - 2 * R[1:-1] + R[2:]) / frames.step**2
        carried = np.concatenate([frames.specific_force_inertial[1:-1, ..., None], bend], axis=-1).swapaxes(0, 1)
        is_known = is_oriented[:-2] & is_oriented[1:-1] & is_oriented[2:] & frames.acceleration_valid[1:-1]
        return [_accelerations(link, frames, carried, is_known.T) for link in self.links]


def _quaternions(candidates: Candidates) -> tuple[Array, list[Array]]:
    """Unit quaternions of headings ``(S, K, 4)``, and by sensor of mountings ``(K, M, 4)``."""
    rotations = np.zeros((*candidates.headings.shape, 4))
    rotations[..., 0], rotations[..., 3] = np.cos(candidates.headings / 2), np.sin(candidates.headings / 2)
    ends = np.cumsum([R.shape[1] for R in candidates.R_bone_sensor])
    mountings = quaternion_from_matrix(np.concatenate(candidates.R_bone_sensor, axis=1), Order.WXYZ)
    return rotations, [np.ascontiguousarray(mounting) for mounting in np.split(mountings, ends[:-1], axis=1)]


def bend_cost(link: Link, parent: End, child: End, kernels: Kernels = kernels) -> Array:
    """Cost ``(N, M)`` of a joint's rotation in nats per observation, for all candidates of parent and child."""
    freedom = 4.0  # of a Student t: heavier tails than the pose prior's
    limit_sigma = np.deg2rad(10.0)  # beyond a joint's limits
    if kernels is not None:
        costs = np.empty(tuple(mountings.shape[0] * mountings.shape[1] for _, mountings, _ in (parent, child)))
        kernels.bend_cost(*parent, *child, np.stack([link.mean, link.lower, link.upper]), link.whitening, costs)
        return costs
    x = _bends(_bones(*parent), _bones(*child))
    flat = x.reshape(3, -1)
    off = link.whitening @ (flat - link.mean[:, None])
    excess = (flat - np.clip(flat, link.lower[:, None], link.upper[:, None])) / limit_sigma
    square = (_square(off) + _square(excess)).reshape(x.shape[1:])
    return np.asarray(np.mean((freedom + 3) / 2 * np.log(square / freedom + 1.0), axis=0))


@dataclass(frozen=True)
class _Accelerations:
    """Cost of the disagreement about the acceleration of a common point, from products summed over frames.

    The scale of the misfit is unknown, so the cost is the logarithm of its mean square.

    Attributes:
        arms: ``(3,)`` metres, from either sensor to the common point, in its bone's axes.
        products: ``(5, 4, 4)`` of :func:`joint_products`, mean over frames.
        looks: number of independent observations.
        least: m/s², expected misfit.
    """

    arms: tuple[Array, Array]
    products: Array
    looks: float
    least: float

    def cost(self, headings: Array, R_parent: Array, R_child: Array) -> Array:
        """Cost ``(K, M, K, M)`` in nats of headings ``(K, K)``, child minus parent, and mountings ``(K, M, 3, 3)``."""
        sides, shape = [], (*R_parent.shape[:2], *R_child.shape[:2])
        for R, arm in zip((R_parent, R_child), self.arms, strict=True):
            arms = (arm @ R).reshape(-1, 3)  # in the sensor's axes
            sides.append(np.concatenate([np.ones((len(arms), 1)), arms], axis=1))
        above, below = (
            np.sum(side @ product_matrix * side, axis=1)
            for side, product_matrix in zip(sides, self.products[:2], strict=True)
        )
        cosine, sine, vertical = (sides[0] @ self.products[2:] @ sides[1].T).reshape(3, *shape)
        angles = headings[:, None, :, None]
        product = np.cos(angles) * cosine + np.sin(angles) * sine + vertical
        square = np.maximum((above[:, None] + below).reshape(shape) - 2 * product, 0.0) / 3
        return 1.5 * self.looks * np.log(square / self.least**2 + 1.0)


def joint_products(above: Array, below: Array) -> Array:
    """Products ``(5, 4, 4)`` of columns ``(T, 3, 4)``, summed over frames.

    Those of ``above`` and of ``below`` with themselves, and the coefficients of the cosine and the sine of the relative
    heading and the constant in their mixed products.
    """
    squares = (np.tensordot(columns, columns, ((0, 1), (0, 1))) for columns in (above, below))
    shared = np.tensordot(above, below, (0, 0))
    across = shared[1, :, 0] - shared[0, :, 1]
    return np.stack([*squares, shared[0, :, 0] + shared[1, :, 1], across, shared[2, :, 2]])


def _accelerations(link: Link, frames: ImuFrames, carried: Array, is_known: np.ndarray) -> _Accelerations | None:
    slow, least_slow_misfit = 2.0, 0.3  # s, averaging window; m/s²
    sensors = [link.parent, link.child]
    rows = np.flatnonzero(is_known[sensors].all(axis=0))
    accelerations, looks = carried[sensors][:, rows], _looks(frames, rows, SWINGS_PER_SECOND)
    if link.p_parent is not None and link.p_child is not None:
        if len(rows) < 3:
            return None
        products = joint_products(*accelerations) / len(rows)
        return _Accelerations((link.p_parent, link.p_child), products, looks, LEAST_MISFIT)
    window = max(1, round(slow / frames.step))
    if len(rows) < 2 * window + 1:
        return None
    smooth = scipy.ndimage.uniform_filter1d(accelerations, window, axis=1)[:, window // 2 : len(rows) - window // 2]
    smooth = smooth - smooth.mean(axis=1, keepdims=True)  # without gravity and bias
    products = joint_products(*smooth) / smooth.shape[1]
    return _Accelerations((np.zeros(3),) * 2, products, looks / slow, least_slow_misfit)


def _looks(frames: ImuFrames, rows: np.ndarray, per_second: float) -> float:
    return min(max(len(rows) * frames.step * per_second, 1.0), MOST_LOOKS)


def _bones(rotations: Array, mountings: Array, turned: Array) -> Array:
    """Unit quaternions ``(K * M, T, 4)`` of ``R_world_bone`` for all candidates."""
    product = _from_left(rotations)[:, None] @ _from_left(turned)
    K, T = product.shape[:2]
    bones = (mountings * CONJUGATE) @ np.moveaxis(product, 3, 1).reshape(K, 4, T * 4)
    return bones.reshape(-1, T, 4)


def _bends(parent: Array, child: Array) -> Array:
    """Rotation vectors ``(3, T, N, M)`` from bones ``(N, T, 4)`` to bones ``(M, T, 4)``."""
    inverse = np.ascontiguousarray(_from_left(parent * CONJUGATE).transpose(2, 1, 0, 3))
    q = inverse @ np.ascontiguousarray(child.transpose(1, 2, 0))
    scalar, vector = q[0], q[1:]
    sine = np.sqrt(_square(vector))
    scale = 2 * np.arctan2(sine, np.abs(scalar)) / np.maximum(sine, 1e-150)  # zero rotation stays zero
    return np.asarray(vector * np.copysign(scale, scalar))


def _from_left(q: Array) -> Array:
    """Left-multiplication matrices ``(..., 4, 4)`` of quaternions ``(..., 4)``."""
    return (q @ FROM_LEFT).reshape(*q.shape, 4)


def _square(v: Array) -> Array:
    """Squared length ``(...)`` of vectors ``(3, ...)``; the axis comes first for speed."""
    return np.asarray(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
