"""Normal equations of a stretch of frames, slice by slice; what they are about is not known.

A slice is a quadratic in its frame, the two after it, and what all frames share.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg.blas import dsymv

from vip_factors.compiled import kernels
from vip_factors.geometry.rotations import Array

REACH = 2  # frames that a factor sees after its first one


@dataclass(frozen=True)
class Blocks:
    """Where the blocks of factors go, by a factor's first frame, in views of what they are summed in.

    Attributes:
        frames: ``(T, 3, w, 3w)`` of three frames with one another; those on and above the diagonal are used.
        coupling: ``(T, 3, w, s)`` of them with what all frames share.
        gradient: ``(T, 3, w)`` of them.
        static, static_gradient: ``(T, s, s)`` and ``(T, s)``; or a single one, of all frames.
        target: of compiled sums.
    """

    frames: Array
    coupling: Array
    gradient: Array
    static: Array
    static_gradient: Array
    target: Any


class Slices:
    """The slices of a stretch.

    Args:
        frame, static: widths of a frame, and of what all frames share.
        frames: how many slices.
        far: which columns of a frame the frame two before it sees; None for all.

    Attributes:
        hessian, gradient: ``(T, n, n)`` and ``(T, n)``; columns of the frame, the next, the one after, and of what all
            frames share. Of the Hessian what lies on and above the diagonal counts.
    """

    def __init__(self, frame: int, static: int, frames: int, far: np.ndarray | None = None) -> None:
        self.frame, self.static, self.far = frame, static, np.arange(frame) if far is None else far
        self._seen = np.concatenate([np.arange(REACH * frame), REACH * frame + self.far])
        self.hessian = np.zeros((frames, self.width, self.width))
        self.gradient = np.zeros((frames, self.width))
        self._filled = set[int]()  # that are not zero

    @property
    def width(self) -> int:
        """Number of all columns."""
        return (REACH + 1) * self.frame + self.static

    def blocks(self, frames: int) -> Blocks:
        """Where the blocks of the factors of so many frames go."""
        H, g, w = self.hessian[:frames], self.gradient[:frames], self.frame
        end = (REACH + 1) * w
        rows = H[:, :end].reshape(frames, REACH + 1, w, self.width)
        target = None if kernels is None else kernels.Target(H, g)
        of_frames = g[:, :end].reshape(frames, REACH + 1, w)
        return Blocks(rows[..., :end], rows[..., end:], of_frames, H[:, end:, end:], g[:, end:], target)

    def emptied(self, frames: int) -> "Slices":
        """Of so many frames, all zero; in the same memory, if it is enough: new pages cost more than zeros."""
        found = Slices(self.frame, self.static, frames, self.far) if frames > len(self.hessian) else self
        for t in found._filled:
            found.hessian[t] = found.gradient[t] = 0.0
        found._filled = set(range(frames))
        return found

    def in_coordinates(self, t: int, frames: Array, shared: Array) -> tuple[Array, Array]:
        """One slice as ``½ xᵀ H x − vectorᵀ x`` of coordinates: ``H`` ``(n, n)``, ``vector`` ``(n,)``; it is taken out.

        The slice is a quadratic in steps from the coordinates ``(f, w)`` of its frame and of those of the next two that
        are there, of the last of three only the far ones, and ``(s,)`` of what all frames share. Of ``H`` what lies on
        and above the diagonal counts.
        """
        seen = self._seen[: frames.size]
        value = np.concatenate([frames.ravel()[seen], shared])
        columns = np.concatenate([seen, np.arange(self.width - self.static, self.width)])
        if kernels is not None:
            information, vector = np.empty((len(value), len(value))), np.empty(len(value))
            kernels.slice_in_coordinates(self.hessian[t], self.gradient[t], value, columns, information, vector)
            self._filled.discard(t)
            return information, vector
        H, gradient = self.hessian[t][np.ix_(columns, columns)], self.gradient[t][columns]  # copies: both are kept
        return H, dsymv(1.0, H.T, value, lower=1) - gradient  # the triangle above the diagonal, transposed
