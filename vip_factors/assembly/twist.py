"""From what factors say of the twists of bones to normal equations of the joints that turn them.

A factor that sees a bone has a Jacobian of few rows by that twist, and the twist is the sum of the screws of the
joints above it. So its ``JᵀJ`` is first a 6×6 block of its bone; blocks of bones beyond the same joint are added up,
and only the sums meet the screws: the composite inertias of rigid body dynamics (Featherstone, "Rigid Body Dynamics
Algorithms", 6.2). Frames with a hundred rows cost hardly more than frames with one.
"""

from functools import cache

import numpy as np

from vip_factors.body.kinematics import MOVES
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import FRAME

# Whether the joint of a row is one that moves the joint of a column, or is it; the root's translation moves all.
_above = np.column_stack([MOVES, np.eye(JOINT_COUNT + 1)[:, -1]])
_ABOVE = np.kron(_above, np.ones((3, 3)))
_BELOW = np.kron(_above.T - np.eye(JOINT_COUNT + 1), np.ones((3, 3)))
_HALF = np.kron(_above - 0.5 * np.eye(JOINT_COUNT + 1), np.ones((3, 3)))  # a half that gives the whole with its mirror


@cache
def _movers(bones: tuple[int, ...]) -> Array:
    """Of each joint, which of these bones it moves: ``(25, n)``."""
    return np.asarray(MOVES[:, list(bones)], dtype=float, order="C")


@cache
def _moved_columns(bones: tuple[int, ...], columns: int) -> Array:
    """Of each column of a frame, which of these bones it moves, each repeated: ``(75, n · columns)``."""
    return np.asarray(np.kron(_movers(bones), np.ones((3, columns))), dtype=float)


def carried(bones: tuple[int, ...], blocks: Array) -> Array:
    """Sums ``(T, 25, …)`` of what is known of bones ``(T, n, …)``, over all that each joint moves."""
    T, n, *shape = blocks.shape
    return (_movers(bones) @ blocks.reshape(T, n, -1)).reshape(T, -1, *shape)


def hessian(screws: Array, information: Array) -> Array:
    """``(T, 75, 75)`` of symmetric information ``(T, 25, 6, 6)`` on twists, as :func:`carried` sums it."""
    half = _transposed(screws) @ _flat(information @ screws)
    half *= _HALF
    return half + half.swapaxes(1, 2)


def hessian_between(screws: Array, information: Array, screws_after: Array) -> Array:
    """``(T, 75, 75)`` of information ``(T, 25, 6, 6)`` between the twists in a frame and those in another.

    Two joints meet in what the lower of them moves; those on different limbs do not.
    """
    H = _transposed(screws) @ _flat(information @ screws_after)
    H *= _ABOVE
    below = _transposed(information.swapaxes(2, 3) @ screws) @ _flat(screws_after)
    below *= _BELOW
    H += below
    return H


def gradient(screws: Array, force: Array) -> Array:
    """``(T, 75)`` of forces on twists ``(T, 25, 6)``, as :func:`carried` sums them."""
    return coupling(screws, force[..., None])[..., 0]


def coupling(screws: Array, blocks: Array) -> Array:
    """``(T, 75, c)`` of blocks ``(T, 25, 6, c)`` between twists and other variables, as :func:`carried` sums them."""
    return (screws.swapaxes(2, 3) @ blocks).reshape(len(screws), FRAME, -1)


def coupling_of_each(screws: Array, bones: tuple[int, ...], blocks: Array) -> Array:
    """``(T, 75, n · c)`` of blocks ``(T, n, 6, c)`` between the twist of each bone and variables of its own."""
    T, n, _, c = blocks.shape
    block = _transposed(screws) @ blocks.swapaxes(1, 2).reshape(T, 6, n * c)
    block *= _moved_columns(bones, c)
    return block


def _flat(screws: Array) -> Array:
    """Side by side: ``(T, 6, 75)``."""
    return screws.swapaxes(1, 2).reshape(len(screws), 6, FRAME)


def _transposed(screws: Array) -> Array:
    """One below the other: ``(T, 75, 6)``."""
    return screws.swapaxes(2, 3).reshape(len(screws), FRAME, 6)
