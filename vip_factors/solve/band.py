"""Normal equations of a long chain of frames, eliminated a stretch at a time.

A frame is tied to the next two and to columns that all frames share: a banded matrix with a border. Frames are
eliminated in time order, the border last, so only what a frame says of those after it is kept. The border may step
from stretch to stretch, as headings do that drift: process noise between two stretches.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dtrsv

from vip_factors.compiled import Kernels, kernels
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import Conditional, add_process_noise, eliminated
from vip_factors.solve.slices import REACH, Blocks


@dataclass(frozen=True)
class Shape:
    """What a chain of frames looks like.

    Attributes:
        frame, static: widths of a frame and of what all frames share.
        far: which columns of a frame the frame two before it sees.
        tied: whether frames see those after them at all.
    """

    frame: int
    static: int
    far: np.ndarray
    tied: bool = True

    @property
    def ahead(self) -> int:
        """Columns of later frames that a frame sees."""
        return self.frame + len(self.far) if self.tied else 0

    @property
    def rest(self) -> int:
        """Columns that are left when a frame is eliminated."""
        return self.ahead + self.static


class Band:
    """The normal equations of a stretch of frames: of all factors whose first frame is one of them.

    Attributes:
        rows: ``(T + 2, w, m)`` of each frame with itself, the next, the one after it (where frames are tied), and what
            all share; of the first the upper triangle counts. The last two are the frames behind the stretch.
        gradient: ``(T + 2, w)``.
        static, static_gradient: ``(s, s)``, of which the upper triangle counts, and ``(s,)``.
    """

    def __init__(self, shape: Shape, frames: int, kernels: Kernels = kernels) -> None:
        self.shape, self._kernels, w, s = shape, kernels, shape.frame, shape.static
        self.rows = np.zeros((frames + REACH, w, (REACH + 1 if shape.tied else 1) * w + s))
        self.gradient = np.zeros((frames + REACH, w))
        self.static, self.static_gradient = np.zeros((s, s)), np.zeros(s)

    @property
    def frames(self) -> int:
        """How many there are in the stretch."""
        return len(self.rows) - REACH

    def first(self, frames: int) -> "Band":
        """A band of so many frames, in the same memory."""
        band = copy(self)
        band.rows, band.gradient = self.rows[: frames + REACH], self.gradient[: frames + REACH]
        return band

    def behind(self, frames: int) -> "Band":
        """What factors say whose first frame is not one of the first ones, in the same memory."""
        band = copy(self)
        band.rows, band.gradient = self.rows[frames:], self.gradient[frames:]
        return band

    def empty(self) -> None:
        """Make all zero."""
        for array in (self.rows, self.gradient, self.static, self.static_gradient):
            array.fill(0.0)

    @property
    def blocks(self) -> Blocks:
        """Where the blocks of a factor go, by its first frame: they overlap."""
        w, (frame, row, item) = self.shape.frame, self.rows.strides
        triples = (self.frames, REACH + 1)
        of_frames = as_strided(
            self.rows, (*triples, w, (REACH + 1) * w), (frame, frame - w * item, row, item)
        )  # the columns of a later frame's row begin with its own
        coupling, gradient = (
            as_strided(block, (*triples, *block.shape[1:]), (block.strides[0], *block.strides))
            for block in (self.rows[:, :, self.rows.shape[2] - self.shape.static :], self.gradient)
        )
        parts = self.rows, self.gradient, self.static, self.static_gradient
        target = None if self._kernels is None else self._kernels.Target(*parts)
        return Blocks(of_frames, coupling, gradient, self.static[None], self.static_gradient[None], target)


class BandElimination:
    """The frames of a chain eliminated, stretch by stretch.

    Args:
        shape: of the chain; bands may have more columns in a frame, behind those of the chain, that only this frame
            sees. They are the last of the border then, frame after frame, and the border that bands have is the first.
        damping: ``(w,)`` added to the diagonal of each frame.
        memory: of the eliminations of an earlier linearisation, which are no more: new pages cost more than zeros.
        kernels: to eliminate with.

    Attributes:
        information, vector: what is known of the next frame, of far columns of the one after it, and of the border.
    """

    def __init__(
        self, shape: Shape, damping: Array, memory: "BandElimination | None" = None, kernels: Kernels = kernels
    ) -> None:
        self.shape, self._damping, self._kernels, self._met = shape, damping, kernels, 0
        self.information, self.vector = np.zeros((shape.rest, shape.rest)), np.zeros(shape.rest)
        self._kept = list[tuple[Array, Array]]()  # of each stretch R and S (T, w, n), and d (T, w)
        self._memory = memory._kept[::-1] if memory is not None else []
        # Columns of the border that step behind a stretch, and what is known of those of before.
        self._steps = dict[int, tuple[np.ndarray, Conditional]]()

    def eliminate(self, *bands: Band) -> None:
        """Eliminate the frames of the next stretch, of which this class has a single band.

        Raises:
            SolveError: if a variable is not determined.
        """
        (band,) = bands
        frames, w, n = band.frames, self.shape.frame, self.shape.frame + self.shape.rest
        kept, d = self._memory.pop() if self._memory else (np.zeros((0, 0, 0)), np.zeros((0, 0)))
        if kept.shape != (frames, w, n):
            kept, d = np.empty((frames, w, n)), np.empty((frames, w))
        self._kept.append((kept, d))
        self._met = band.shape.frame - w
        if self._kernels is None:
            self._eliminate_purely(band, kept, d)
            return
        parts = band.rows, band.gradient, band.static, band.static_gradient
        chain = self.shape.far, self.shape.tied, self.shape.static, self._damping
        if not self._kernels.eliminate_stretch(*parts, *chain, self.information, self.vector, kept, d):
            raise SolveError("the linear system is not determined")

    def _eliminate_purely(self, band: Band, kept: Array, d: Array) -> None:
        shape, w, c, every = self.shape, self.shape.frame, self._met, band.shape
        end = (REACH + 1 if shape.tied else 1) * w  # of frames; behind it stands the border
        columns = [i * every.frame + np.arange(w) for i in range(end // w)]
        rows = band.rows[:, :w, np.concatenate([*columns, np.arange(-every.static, 0)])]
        said, m = end + every.static, end + shape.static
        border = np.arange(end, m)
        later = np.concatenate([w + np.arange(w), 2 * w + shape.far])[: shape.ahead]
        before, later = np.concatenate([later - w, border]), np.concatenate([later, border])
        H, v = np.zeros((m, m)), np.zeros(m)
        H[np.ix_(before, before)], v[before] = np.triu(self.information), self.vector
        for t in range(band.frames):
            met = m - (band.frames - t) * c
            H[:w, :said] += rows[t]
            H[:w, met : met + c] += band.rows[t, :w, w : w + c]
            H[range(w), range(w)] += self._damping
            v[:w] -= band.gradient[t, :w]
            rest = np.ascontiguousarray(H[np.ix_(later, later)])
            R, S_transposed = eliminated(H[:w, :w], np.array(H[:w, later]), rest)
            kept[t, :, :w], kept[t, :, w:], d[t] = R, S_transposed.T, dtrsv(R, v[:w], trans=1)
            left = v[later] - S_transposed @ d[t]
            H[:], v[:] = 0.0, 0.0
            H[np.ix_(before, before)], v[before] = np.triu(rest), left
        for i in range(REACH if shape.tied else 0):
            own, of_frame = slice(i * w, (i + 1) * w), rows[band.frames + i]
            H[own, i * w : end] += of_frame[:, : end - i * w]
            H[own, end:said] += of_frame[:, end:]
            v[own] -= band.gradient[band.frames + i, :w]
        H[end:said, end:said] += band.static
        v[end:said] -= band.static_gradient
        self.information[:], self.vector[:] = H[np.ix_(before, before)], v[before]

    def step(self, columns: np.ndarray, sigmas: Array, differences: Array) -> None:
        """Let border columns step behind the last stretch: go on with new ones in their places.

        Args:
            columns: which, of the border.
            sigmas: of their steps.
            differences: by how much the new ones are more than the old ones, where both are linearised.
        """
        if not len(columns):
            return
        at = self.shape.ahead + columns
        step = add_process_noise(self.information, self.vector, at, sigmas, differences)
        self._steps[len(self._kept) - 1] = columns, step

    @property
    def border(self) -> tuple[Array, Array]:
        """What all frames say of the border: information ``(s, s)``, of which the upper triangle counts, and vector."""
        ahead = self.shape.ahead
        return self.information[ahead:, ahead:], self.vector[ahead:]

    def given(self, border: Array) -> tuple[Array, Array]:
        """Steps ``(T, w)`` of all frames of those of the border as it is last; and ``(K, s)`` of the border as it was
        up to each step of it, and last."""
        shape, behind, borders, parts = self.shape, np.zeros((REACH, self.shape.frame)), [border], list[Array]()
        for number in range(len(self._kept) - 1, -1, -1):
            if number in self._steps:
                columns, step = self._steps[number]
                ahead = np.concatenate([behind[0], behind[1, shape.far]])[: shape.ahead]
                border = borders[-1].copy()
                border[columns] = step.given(np.concatenate([ahead, borders[-1]]))
                borders.append(border)
            steps = self.substituted(number, behind, border)
            parts.append(steps)
            behind = np.concatenate([steps[:REACH], behind])[:REACH]
        return np.concatenate([np.zeros((0, shape.frame)), *parts[::-1]]), np.array(borders[::-1])

    def substituted(self, number: int, behind: Array, border: Array) -> Array:
        """Steps ``(T, w)`` of a stretch, of those ``(2, w)`` of the frames behind it and of the border then."""
        (kept, d), shape = self._kept[number], self.shape
        steps = d.copy()
        if self._kernels is not None:
            behind = np.ascontiguousarray(behind)
            self._kernels.substitute_stretch(kept, shape.far, shape.tied, self._met, behind, border, steps)
        else:
            self._substitute_purely(kept, behind, border, steps)
        return steps

    def _substitute_purely(self, kept: Array, behind: Array, border: Array, steps: Array) -> None:
        later = behind
        for t in range(len(steps) - 1, -1, -1):
            ahead = np.concatenate([later[0], later[1, self.shape.far]])[: self.shape.ahead]
            steps[t] = Conditional(kept[t], steps[t]).given(np.concatenate([ahead, border]))
            later = np.stack([steps[t], later[0]])

    def marginals(self, border: Array) -> Iterator[tuple[Array | None, Array]]:
        """Covariances, the last first, of the border's joint one ``(s, s)``: ``(w, w)`` of each frame with that of
        the border then; where the border steps, None with that of the border before.
        """
        shape, w, ahead = self.shape, self.shape.frame, self.shape.ahead
        joint = np.zeros((shape.rest, shape.rest))  # of the next frame, far columns of the one after it, and the border
        joint[ahead:, ahead:] = border
        for number in range(len(self._kept) - 1, -1, -1):
            if number in self._steps:
                columns, step = self._steps[number]
                at = ahead + columns
                own, across = step.covariance(joint)
                joint[at], joint[:, at] = across, across.T
                joint[np.ix_(at, at)] = own
                yield None, joint[ahead:, ahead:]
            for rows, d in zip(*(one[::-1] for one in self._kept[number]), strict=True):
                own, across = Conditional(rows, d).covariance(joint)
                yield own, joint[ahead:, ahead:]
                if shape.tied:
                    after, others = slice(w, ahead), slice(ahead, None)
                    joint[after, after], joint[after, others] = (
                        joint[np.ix_(shape.far, shape.far)],
                        joint[shape.far, ahead:],
                    )
                    joint[:w, :w], joint[:w, after], joint[:w, others] = own, across[:, shape.far], across[:, ahead:]
                    joint[after, :w], joint[others, :ahead] = joint[:w, after].T, joint[:ahead, others].T


@dataclass(frozen=True)
class Multipliers:
    """Last columns of a border, that are Lagrange multipliers: of rows ``A x = b`` that tie frames further apart.

    The maximum over ``λ`` of ``λᵀ(A x − b) − ½ λᵀλ`` is ``½ |A x − b|²``, so a row is a column of the border, whose
    own information is −1. They are eliminated before the columns of the border ahead of them.

    Attributes:
        coupling, inverse, vector: ``B``, ``C⁻¹`` and ``v`` of ``½ xᵀ S x + xᵀ B λ − ½ λᵀ C λ − vᵀ λ``.
    """

    coupling: Array
    inverse: Array
    vector: Array

    @classmethod
    def eliminated(cls, information: Array, vector: Array, first: int) -> tuple["Multipliers", Array, Array]:
        """Those from a column on, and what is left: information, of which the upper triangle counts, and vector."""
        own, B = information[first:, first:], information[:first, first:]
        found = cls(B, np.array(np.linalg.inv(-np.triu(own) - np.triu(own, 1).T), dtype=float), vector[first:])
        half = B @ found.inverse
        return found, np.triu(information[:first, :first] + half @ B.T), vector[:first] + half @ vector[first:]

    def given(self, border: Array) -> Array:
        """The whole border of the columns ahead."""
        return np.concatenate([border, self.inverse @ (self.coupling.T @ border - self.vector)])

    def covariance(self, border: Array) -> Array:
        """The formal covariance of the whole border, of that of the columns ahead."""
        half = self.coupling @ self.inverse
        return np.block([[border, border @ half], [half.T @ border, half.T @ border @ half - self.inverse]])


def inverse_of_square(R: Array) -> Array:
    """Of ``Rᵀ R``; inverting that itself would lose twice the digits."""
    inverse = solve_triangular(R, np.eye(len(R)), check_finite=False) if len(R) else R
    return np.asarray(inverse @ inverse.T, dtype=float)
