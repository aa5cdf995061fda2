"""A stretch of frames as normal equations, slice by slice: each holds the factors whose first frame is its own.

A smoother that goes on where it left off needs them apart: what is left behind an eliminated frame then holds every
factor that touches it, and a later linearisation holds all the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array, transpose
from vip_factors.graph.batch import BatchObjective
from vip_factors.graph.camera_batch import CameraObjective
from vip_factors.graph.hessian import coupling_factor
from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import CAMERA
from vip_factors.graph.terms import FRAME

REACH = 2  # frames that a factor reaches ahead of its first one


def slice_key(frame: int) -> int:
    """Key of all variables of one frame, as one vector."""
    return gtsam.symbol("x", frame)


def shared_key(epoch: int) -> int:
    """Key of all variables that frames share, as one vector; those of the next epoch have wandered from it."""
    return gtsam.symbol("z", epoch)


def step_factor(before: int, after: int, sigmas: Array) -> gtsam.JacobianFactor:
    """Between the shared variables of two epochs: they stay where they are, but for ``sigmas`` ``(s,)``."""
    one, none = np.diag(1 / sigmas), np.zeros(len(sigmas))
    return gtsam.JacobianFactor(before, -one, after, one, none, gtsam.noiseModel.Unit.Create(len(sigmas)))


@dataclass(frozen=True)
class SliceColumns:
    """Which columns of a slice are whose: those of a frame, of the next and of the one after, then of all frames.

    Attributes:
        frame: width of a frame: 75 for each wearer, 6 for a moving camera.
        static: width of what all frames share.
        wearers: of each wearer, its free columns (see :mod:`vip_factors.graph.terms`) in the slice.
        camera: ``(11,)`` of the camera's columns in the slice; −1 where it is not free.
    """

    frame: int
    static: int
    wearers: tuple[np.ndarray, ...]
    camera: np.ndarray

    @classmethod
    def of(cls, model: SceneModel) -> "SliceColumns":
        """The columns of a scene's problem."""
        statics = [len(BatchObjective(wearer).static_columns) for wearer in model.wearers]
        objective = CameraObjective(model.camera, 1, 1.0)
        frame, camera = FRAME * len(statics) + objective.frame_width, np.full(CAMERA, -1)
        wearers, place = [], 3 * frame
        for number, count in enumerate(statics):
            own = np.arange(FRAME) + FRAME * number
            wearers.append(np.concatenate([own, np.arange(place, place + count)]))
            place += count
        moving, shared = np.split(objective.columns, [objective.frame_width])
        camera[moving] = frame - objective.frame_width + np.arange(len(moving))
        camera[shared] = place + np.arange(len(shared))
        return cls(frame, place + len(shared) - 3 * frame, tuple(wearers), camera)

    @property
    def width(self) -> int:
        """Number of all columns."""
        return 3 * self.frame + self.static


class Slices:
    """The slices of a stretch.

    Attributes:
        columns: whose columns are where.
        hessian, gradient: ``(T, n, n)`` and ``(T, n)``.
    """

    def __init__(self, columns: SliceColumns, frames: int) -> None:
        self.columns = columns
        self.hessian = np.zeros((frames, columns.width, columns.width))
        self.gradient = np.zeros((frames, columns.width))

    def emptied(self, frames: int) -> "Slices":
        """Of so many frames, all zero; in the same memory, if it is enough: new pages cost more than zeros."""
        if frames > len(self.hessian):
            return Slices(self.columns, frames)
        self.hessian[:frames], self.gradient[:frames] = 0.0, 0.0
        return self

    def add(self, first: slice, place: np.ndarray, hessian: Array, gradient: Array) -> None:
        """Add ``(t, k, k)`` and ``(t, k)`` at ``k`` columns of a stretch of slices; columns below zero are left out."""
        runs = _runs(place)
        for here, there in runs:
            self.gradient[first, there] += gradient[:, here]
            for other, beside in runs:
                self.hessian[first, there, beside] += hessian[:, here, other]

    def add_between(self, first: slice, rows: np.ndarray, columns: np.ndarray, block: Array) -> None:
        """Add blocks ``(t, k, l)`` off the diagonal, and their mirror images."""
        for here, there in _runs(rows):
            for other, beside in _runs(columns):
                part = block[:, here, other]
                self.hessian[first, there, beside] += part
                self.hessian[first, beside, there] += transpose(part)

    def add_rows(self, first: slice, place: np.ndarray, jacobian: Array, residual: Array) -> None:
        """Add weighted rows ``(t, m, k)`` with residuals ``(t, m)``."""
        transposed = transpose(jacobian)
        self.add(first, place, transposed @ jacobian, (transposed @ residual[..., None])[..., 0])

    def factors(self, t: int, keys: Sequence[int], shared_key: int, value: Array) -> gtsam.GaussianFactorGraph:
        """One slice as factors on its frame, the two after it (``keys``) and the shared variables.

        The slice is a quadratic in steps from the coordinates ``value`` ``(n,)``; the factors are in the coordinates.
        """
        H = self.hessian[t]
        g = self.gradient[t] - H @ value
        w = self.columns.frame
        parts = [slice(0, w), slice(w, 2 * w), slice(2 * w, 3 * w), slice(3 * w, None)]
        now, after, last, shared = parts
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
        if self.columns.static:
            graph.push_back(gtsam.HessianFactor(shared_key, H[shared, shared], -g[shared], 0.0))
            for key, part, there in zip(keys, parts, (True, *reach), strict=False):
                if there and H[part, shared].any():
                    graph.push_back(coupling_factor(key, shared_key, H[part, shared]))
        return graph


def _runs(place: np.ndarray) -> tuple[tuple[slice, slice], ...]:
    """Stretches of columns that follow one another, as they are numbered in a block and in a slice.

    NumPy moves whole stretches at once; picked columns it moves number by number.
    """
    return _runs_of(place.astype(np.int64).tobytes())


@cache
def _runs_of(place: bytes) -> tuple[tuple[slice, slice], ...]:
    columns = np.frombuffer(place, np.int64)
    starts = [0, *(np.flatnonzero(np.diff(columns) != 1) + 1).tolist(), len(columns)]
    return tuple(
        (slice(start, stop), slice(int(columns[start]), int(columns[start]) + stop - start))
        for start, stop in pairwise(starts)
        if stop > start and columns[start] >= 0
    )
