"""Nested dissection (George 1973) of chains that share columns in every frame, as people share a moving camera's pose.

The cost of one joint chain is cubic in the number of people. Here each chain's frames of a stretch are eliminated
separately, conditioned on the first two frames of the stretch, the common columns and the border. One joint step
then eliminates the first two frames of all chains and the common columns.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.compiled import Kernels, kernels
from vip_factors.geometry.rotations import Array
from vip_factors.solve.band import Band, BandElimination, Shape
from vip_factors.solve.elimination import Conditional, add_at, eliminate, reordered
from vip_factors.solve.slices import REACH


@dataclass(frozen=True)
class Chain:
    """Columns of one chain: those in a frame, the common ones last, and those in the border."""

    frame: np.ndarray
    border: np.ndarray


@dataclass(frozen=True)
class _Stretch:
    """Eliminated stretch: the joint conditional that is eliminated last, and the elimination of each chain."""

    joint: Conditional
    chains: list[BandElimination]


class NestedElimination(BandElimination):
    """Elimination of several chains, stretch by stretch; a stretch has one band for each chain.

    Args:
        shape, damping, memory, kernels: see :class:`BandElimination`.
        chains: columns of each chain; they share only the common columns and the border.
        common: number of common columns; they are the last of a frame.
    """

    def __init__(
        self,
        shape: Shape,
        damping: Array,
        memory: BandElimination | None,
        chains: Sequence[Chain],
        common: int,
        kernels: Kernels = kernels,
    ) -> None:
        super().__init__(shape, damping, memory, kernels)
        self._chains, self._common, self._stretches = chains, common, dict[int, _Stretch]()
        self._previous = memory._stretches if isinstance(memory, NestedElimination) else {}

    def eliminate(self, *bands: Band) -> None:
        """Eliminate the frames of the next stretch; takes one band for each chain."""
        L, w, c, number = bands[0].frames, self.shape.frame, self._common, len(self._conditionals)
        if L <= 2 * REACH:
            super().eliminate(self._joined(bands))
            return
        n = REACH * w + (L - REACH) * c  # columns of the joint step; the remaining ones follow
        frames, border = self._columns(n)
        common = [columns[-c:] for columns in (*frames[:2], *np.arange(REACH * w, n).reshape(-1, c), *frames[2:])]
        size = n + self.shape.rest
        H, v = np.zeros((size, size)), np.zeros(size)
        self._add(self.information, self.vector, np.concatenate([frames[0], frames[1][self.shape.far], border]), H, v)
        diagonal = np.concatenate([self._damping, self._damping, np.tile(self._damping[-c:], L - REACH)])
        H[np.arange(n), np.arange(n)] += diagonal
        eliminations = list[BandElimination]()
        previous = self._previous.pop(number, None)
        memories = [None] * len(bands) if previous is None else previous.chains
        for chain, band, memory in zip(self._chains, bands, memories, strict=True):
            every = [frames[t][chain.frame] for t in range(REACH)]
            self._add_first(band, every, border[chain.border], H, v)
            self._add_common(band, common, border[chain.border], H, v)
            elimination = self._eliminated(chain, band, memory)
            self._add(elimination.information, elimination.vector, self._places(chain, elimination.shape, n), H, v)
            eliminations.append(elimination)
        eliminate(H, v, 0, n, self._kernels)
        self._stretches[number] = _Stretch(Conditional(H[:n].copy(), v[:n].copy()), eliminations)
        self._conditionals.append((np.zeros((0, 0, 0)), np.zeros((L, w))))
        self.information[:], self.vector[:] = H[n:, n:], v[n:]

    def _columns(self, n: int) -> tuple[list[np.ndarray], np.ndarray]:
        """Columns, in a joint step that eliminates ``n``, of the first two and the next two frames, and of the border.

        The last frame has its far columns only.
        """
        starts, w = (0, self.shape.frame, n, n + self.shape.frame), self.shape.frame
        frames = [start + np.arange(width) for start, width in zip(starts, (w, w, w, len(self.shape.far)), strict=True)]
        return frames, n + self.shape.ahead + np.arange(self.shape.static)

    def _places(self, chain: Chain, shape: Shape, n: int) -> np.ndarray:
        """Columns, in a joint step that eliminates ``n``, that remain after the elimination of a chain."""
        private, (frames, border) = chain.frame[: -self._common], self._columns(n)
        next_frames = frames[2][private], frames[3][np.searchsorted(self.shape.far, private[shape.far])]
        first_frames = frames[0][private], frames[1][private]
        common = np.arange(REACH * self.shape.frame, n)
        return np.concatenate([*next_frames, border[chain.border], *first_frames, common])

    def _add(self, information: Array, vector: Array, places: np.ndarray, H: Array, v: Array) -> None:
        """Add a quadratic at the given places; only its upper triangle is used."""
        order = np.argsort(places)
        add_at(*reordered(information, vector, order, self._kernels), places[order], H, v, self._kernels)

    def _add_first(self, band: Band, frames: list[np.ndarray], border: np.ndarray, H: Array, v: Array) -> None:
        """Add the blocks of a stretch's first two frames with each other and with the border."""
        w = len(frames[0])
        for t, places in enumerate(frames):
            for ahead, later_columns in enumerate(frames[t:]):
                H[np.ix_(places, later_columns)] += band.rows[t, :, ahead * w : (ahead + 1) * w]
            H[np.ix_(places, border)] += band.rows[t, :, (REACH + 1) * w :]
            v[places] -= band.gradient[t]

    def _add_common(self, band: Band, common: list[np.ndarray], border: np.ndarray, H: Array, v: Array) -> None:
        """Add the blocks of the common columns of later frames, also those with the first two frames."""
        w, c = band.shape.frame, self._common
        for t, places in enumerate(common):
            rows = band.rows[t, w - c :]
            for ahead in range(REACH + 1):
                if REACH <= t + ahead < len(common):
                    later_columns = common[t + ahead]
                    H[places[0] : places[-1] + 1, later_columns[0] : later_columns[-1] + 1] += rows[
                        :, (ahead + 1) * w - c :
                    ][:, :c]
            if t >= REACH:
                H[places[:, None], border] += rows[:, (REACH + 1) * w :]
                v[places] -= band.gradient[t, w - c :]

    def _eliminated(self, chain: Chain, band: Band, memory: BandElimination | None) -> BandElimination:
        """Eliminate a chain's frames after the first two; these and the common columns belong to its border."""
        private, w, L, c = chain.frame[: -self._common], len(chain.frame), band.frames, self._common
        k, s, far = len(private), len(chain.border), np.flatnonzero(np.isin(private, self.shape.far))
        shape = Shape(k, s + REACH * k + (L - REACH) * c, far)
        elimination = BandElimination(shape, self._damping[private], memory, self._kernels)
        first_frame, second = (shape.ahead + s + np.arange(t * k, (t + 1) * k) for t in range(REACH))
        elimination.information[:k, first_frame] = band.rows[0, :k, 2 * w : 2 * w + k].T
        elimination.information[:k, second] = band.rows[1, :k, w : w + k].T
        elimination.information[k : shape.ahead, second] = band.rows[1][:k, 2 * w + far].T
        elimination.eliminate(band.behind(REACH))
        return elimination

    def _joined(self, bands: Sequence[Band]) -> Band:
        """Sum the bands of all chains in one band."""
        w, joined = self.shape.frame, Band(self.shape, bands[0].frames, self._kernels)
        for chain, band in zip(self._chains, bands, strict=True):
            frames, border = [i * w + chain.frame for i in range(REACH + 1)], chain.border
            columns = np.concatenate([*frames, (REACH + 1) * w + border])
            joined.rows[:, chain.frame[:, None], columns] += band.rows
            joined.gradient[:, chain.frame] += band.gradient
            joined.static[border[:, None], border] += band.static
            joined.static_gradient[border] += band.static_gradient
        return joined

    def substituted(self, number: int, behind: Array, border: Array) -> Array:
        """Solve for the steps ``(T, w)`` of a stretch; see :meth:`BandElimination.substituted`."""
        if number not in self._stretches:
            return super().substituted(number, behind, border)
        stretch, steps, w, c = self._stretches[number], self._conditionals[number][1], self.shape.frame, self._common
        x = stretch.joint.given(np.concatenate([behind[0], behind[1, self.shape.far], border]))
        steps[:REACH] = x[: REACH * w].reshape(REACH, w)
        steps[REACH:, w - c :] = x[REACH * w :].reshape(-1, c)
        for chain, elimination in zip(self._chains, stretch.chains, strict=True):
            private = chain.frame[:-c]
            values = np.concatenate([border[chain.border], steps[0, private], steps[1, private], x[REACH * w :]])
            steps[REACH:, private] = elimination.substituted(0, behind[:, private], values)
        return steps

    def covariances(self, number: int, joint: Array) -> Iterator[Array]:
        """Yield the marginal covariances of a stretch's frames backwards; see :meth:`BandElimination.covariances`.

        Covariances between the private columns of two chains are computed in the first two frames of a stretch only;
        elsewhere they are zero.
        """
        if number not in self._stretches:
            yield from super().covariances(number, joint)
            return
        stretch, (frames, w), c = self._stretches[number], self._conditionals[number][1].shape, self._common
        first, across = stretch.joint.covariance(joint)
        n, every = len(first), np.block([[first, across], [across.T, joint]])
        covariances = np.zeros((frames, w, w))
        for t in range(REACH):
            covariances[t] = first[t * w : (t + 1) * w, t * w : (t + 1) * w]
        for t in range(REACH, frames):
            common = slice(REACH * w + (t - REACH) * c, REACH * w + (t - REACH + 1) * c)
            covariances[t, w - c :, w - c :] = first[common, common]
        for chain, elimination in zip(self._chains, stretch.chains, strict=True):
            places, private = self._places(chain, elimination.shape, n), np.ix_(chain.frame[:-c], chain.frame[:-c])
            backwards = elimination.covariances(0, every[np.ix_(places, places)])
            for t, covariance in zip(range(frames - 1, REACH - 1, -1), backwards, strict=True):
                covariances[t][private] = covariance
        (frame, second, *_), border = self._columns(n)
        remaining = np.concatenate([frame, second[self.shape.far], border])
        joint[:] = every[np.ix_(remaining, remaining)]
        yield from covariances[::-1]
