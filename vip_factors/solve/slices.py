"""Normal equations of a stretch of frames as one dense quadratic for each frame.

A slice is a quadratic in its frame, the next two and the shared (static) columns.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg.blas import dsymv

from vip_factors.compiled import kernels
from vip_factors.geometry.rotations import Array

REACH = 2  # frames after its first one that a factor may connect


@dataclass(frozen=True)
class Blocks:
    """Views into which factor blocks are summed, indexed by a factor's first frame.

    Attributes:
        frames: ``(T, 3, w, 3w)``, three frames with one another; blocks on and above the diagonal are used.
        coupling: ``(T, 3, w, s)``, frames with the shared columns.
        gradient: ``(T, 3, w)``.
        static, static_gradient: ``(T, s, s)`` and ``(T, s)`` of the shared columns, or length 1 for all frames.
        target: the same arrays for the compiled kernels.
    """

    frames: Array
    coupling: Array
    gradient: Array
    static: Array
    static_gradient: Array
    target: Any


class Slices:
    """Slices of a stretch.

    Args:
        frame, static: widths of a frame and of the shared columns.
        frames: number of slices.
        far: columns of a frame that factors connect with the frame two before it; None for all.

    Attributes:
        hessian, gradient: ``(T, n, n)`` (upper triangle) and ``(T, n)``; columns of the frame, the next two, and the
            shared ones.
    """

    def __init__(self, frame: int, static: int, frames: int, far: np.ndarray | None = None) -> None:
        self.frame, self.static, self.far = frame, static, np.arange(frame) if far is None else far
        self._connected = np.concatenate([np.arange(REACH * frame), REACH * frame + self.far])
        self.hessian = np.zeros((frames, self.width, self.width))
        self.gradient = np.zeros((frames, self.width))
        self._filled = set[int]()  # indices of slices that are not zero

    @property
    def width(self) -> int:
        """Number of columns of a slice."""
        return (REACH + 1) * self.frame + self.static

    def blocks(self, frames: int) -> Blocks:
        """Return views for the factors of the first ``frames`` slices."""
        H, g, w = self.hessian[:frames], self.gradient[:frames], self.frame
        end = (REACH + 1) * w
        rows = H[:, :end].reshape(frames, REACH + 1, w, self.width)
        target = None if kernels is None else kernels.Target(H, g)
        of_frames = g[:, :end].reshape(frames, REACH + 1, w)
        return Blocks(rows[..., :end], rows[..., end:], of_frames, H[:, end:, end:], g[:, end:], target)

    def emptied(self, frames: int) -> "Slices":
        """Return zeroed slices of ``frames`` frames, in the same memory if it suffices: allocation is slower."""
        slices = Slices(self.frame, self.static, frames, self.far) if frames > len(self.hessian) else self
        for t in slices._filled:
            slices.hessian[t] = slices.gradient[t] = 0.0
        slices._filled = set(range(frames))
        return slices

    def in_coordinates(self, t: int, frames: Array, shared: Array) -> tuple[Array, Array]:
        """Express slice ``t`` in coordinates instead of steps: ``½ xᵀ H x − vᵀ x``; returns ``H`` and ``v``.

        Args:
            t: index of the slice; the kernels overwrite it.
            frames: ``(f, w)`` linearisation point of the frame and the following ones (at most two).
            shared: ``(s,)`` linearisation point of the shared columns.
        """
        connected = self._connected[: frames.size]
        value = np.concatenate([frames.ravel()[connected], shared])
        columns = np.concatenate([connected, np.arange(self.width - self.static, self.width)])
        if kernels is not None:
            information, vector = np.empty((len(value), len(value))), np.empty(len(value))
            kernels.slice_in_coordinates(self.hessian[t], self.gradient[t], value, columns, information, vector)
            self._filled.discard(t)
            return information, vector
        H, gradient = self.hessian[t][np.ix_(columns, columns)], self.gradient[t][columns]  # copies
        return H, dsymv(1.0, H.T, value, lower=1) - gradient  # the triangle above the diagonal, transposed
