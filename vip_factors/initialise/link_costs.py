"""What a pair of linked sensors says of their headings and mountings: the joint between them, and where they meet.

Two bones bend against one another as people's do, and the point that they share is accelerated alike whichever of the
two sensors tells: its own specific force, carried along its bone. Low-passed accelerations suppose that a standing foot
shares the pelvis's; here the body is in between. Only where a limb without a sensor lies between two sensors
do their slow accelerations stand for it, and how differently they run says how little they tell.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, rotation_z, transpose
from vip_factors.initialise.sensor_tree import Link
from vip_factors.initialise.start_candidates import Candidates
from vip_factors.sensors.frames import ImuFrames

LIMIT_SIGMA = np.deg2rad(10.0)  # how far beyond a joint's limits is as odd as one sigma of the pose prior
FREEDOM = 4.0  # of a Student t: some frames may be odd, and a pose prior's tails are not Gaussian
# New looks per second: a pose lasts for two, a limb's swing and the wobble of its strap for one.
POSES_PER_SECOND, SWINGS_PER_SECOND = 0.5, 1.0
MOST_LOOKS = 20.0  # what is wrong in the same way in every frame does not count more the longer one looks
# Frames looked at: more are alike; fewer do where candidates wander, and fewest with several mountings each.
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


def meeting_cost(link: Link, candidates: Candidates, frames: ImuFrames) -> Array | float:
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
