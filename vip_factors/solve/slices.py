"""Normal equations of a stretch of frames slice by slice, as GTSAM Hessian factors; what they are about is not known.

A slice is a quadratic in its frame, the two after it, and what all frames share.
"""

from collections.abc import Sequence

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import coupling_factor

REACH = 2  # frames that a factor reaches ahead of its first one


def slice_key(frame: int) -> int:
    """Key of all variables of one frame, as one vector."""
    return int(gtsam.symbol("x", frame))


def shared_key(epoch: int) -> int:
    """Key of all variables that frames share, as one vector; those of the next epoch have wandered from it."""
    return int(gtsam.symbol("z", epoch))


def step_factor(before: int, after: int, sigmas: Array) -> gtsam.JacobianFactor:
    """Between the shared variables of two epochs: they stay where they are, but for ``sigmas`` ``(s,)``."""
    one, none = np.diag(1 / sigmas), np.zeros(len(sigmas))
    return gtsam.JacobianFactor(before, -one, after, one, none, gtsam.noiseModel.Unit.Create(len(sigmas)))


def information_factor(key: int, information: Array) -> gtsam.HessianFactor:
    """On the shared variables of an epoch: ``information`` ``(s, s)`` that their coordinates are zero."""
    return gtsam.HessianFactor(key, information, np.zeros(len(information)), 0.0)


class Slices:
    """The slices of a stretch.

    Args:
        frame, static: widths of a frame, and of what all frames share.
        frames: how many slices.

    Attributes:
        hessian, gradient: ``(T, n, n)`` and ``(T, n)``; columns of the frame, the next, the one after, and of what all
            frames share. Of the Hessian the blocks below the diagonal are left zero.
    """

    def __init__(self, frame: int, static: int, frames: int) -> None:
        self.frame, self.static = frame, static
        self.hessian = np.zeros((frames, self.width, self.width))
        self.gradient = np.zeros((frames, self.width))

    @property
    def width(self) -> int:
        """Number of all columns."""
        return (REACH + 1) * self.frame + self.static

    def emptied(self, frames: int) -> "Slices":
        """Of so many frames, all zero; in the same memory, if it is enough: new pages cost more than zeros."""
        if frames > len(self.hessian):
            return Slices(self.frame, self.static, frames)
        self.hessian[:frames], self.gradient[:frames] = 0.0, 0.0
        return self

    def _times(self, H: Array, value: Array) -> Array:
        """The whole symmetric matrix times a vector, from the blocks on and above its diagonal."""
        product = H @ value + value @ H
        for part in self._parts():
            product[part] -= H[part, part] @ value[part]
        return product

    def _parts(self) -> list[slice]:
        w = self.frame
        return [*(slice(ahead * w, (ahead + 1) * w) for ahead in range(REACH + 1)), slice((REACH + 1) * w, None)]

    def factors(self, t: int, keys: Sequence[int], shared_key: int, value: Array) -> gtsam.GaussianFactorGraph:
        """One slice as factors on its frame, the two after it (``keys``) and the shared variables.

        The slice is a quadratic in steps from the coordinates ``value`` ``(n,)``; the factors are in the coordinates.
        """
        H = self.hessian[t]
        now, after, last, shared = parts = self._parts()
        g = self.gradient[t] - self._times(H, value)
        graph = gtsam.GaussianFactorGraph()
        reach = [bool(H[part].any()) for part in (after, last)]
        if not any(reach):
            graph.push_back(gtsam.HessianFactor(keys[0], H[now, now], -g[now], 0.0))
        elif not reach[1]:
            graph.push_back(
                gtsam.HessianFactor(
                    keys[0], keys[1], H[now, now], H[now, after], -g[now], H[after, after], -g[after], 0.0
                )
            )
        else:
            graph.push_back(
                gtsam.HessianFactor(
                    keys[0], keys[1], keys[2], H[now, now], H[now, after], H[now, last], -g[now],
                    H[after, after], H[after, last], -g[after], H[last, last], -g[last], 0.0,
                )
            )  # fmt: skip
        if self.static:
            graph.push_back(gtsam.HessianFactor(shared_key, H[shared, shared], -g[shared], 0.0))
            for key, part, there in zip(keys, parts, (True, *reach), strict=False):
                if there and H[part, shared].any():
                    graph.push_back(coupling_factor(key, shared_key, H[part, shared]))
        return graph
