"""Which sensor hangs on which: the body as seen by its sensors, a tree of links across one or more joints."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.joint_limits import JointLimits
from vip_factors.body.pose_prior import PosePrior
from vip_factors.body.skeleton import Skeleton, ancestors, joint_index
from vip_factors.geometry.rotations import Array

# Joints that barely move: what is not instrumented between two bones may be taken to ride along with them.
STIFF = tuple(
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
    free = [joint for joint in signs if joint not in STIFF]
    if all(joint in under for joint in over) and len(free) <= 1:
        meet = at[free[0]] if free else (at[bones[parent]] + at[bones[child]]) / 2
        p_parent, p_child = (meet - at[bones[s]] - p_bone_sensor[s] for s in (parent, child))
    information = np.asarray(np.linalg.inv(scatter), float)
    return Link(parent, child, mean, lower, upper, information, max(len(free), 1), p_parent, p_child)
