"""Chains that meet one more in every frame, as people before a moving camera have its pose, each eliminated by itself.

Side by side they would be cubic in their number. Within a stretch each chain's frames go by themselves: behind them
stand its first two frames there, all that it meets in the stretch, and the border. Then what is left of the stretch
goes as one: the first two frames of all chains, and what they meet (nested dissection, George 1973).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.compiled import Kernels, kernels
from vip_factors.geometry.rotations import Array
from vip_factors.solve.band import Band, BandElimination, Shape
from vip_factors.solve.elimination import Conditional, add_at, eliminate, reordered
from vip_factors.solve.slices import REACH


@dataclass(frozen=True)
class Chain:
    """Columns of a chain's bands in a frame, last of which is what it meets, and of the border those that it sees."""

    frame: np.ndarray
    border: np.ndarray


@dataclass(frozen=True)
class _Kept:
    """Of a stretch what goes last, given all that is left, and the eliminations of chains."""

    last: Conditional
    chains: list[BandElimination]


class EliminationApart(BandElimination):
    """Frames of such chains eliminated, stretch by stretch, each of which has a band of every chain.

    Args:
        shape, damping, memory, kernels: as of the base.
        chains: that have nothing in common but what they meet.
        met: how many columns that is: the last of a frame.
    """

    def __init__(
        self, shape: Shape, damping: Array, memory: BandElimination | None, chains: Sequence[Chain], met: int,
        kernels: Kernels = kernels,
    ) -> None:  # fmt: skip
        super().__init__(shape, damping, memory, kernels)
        self._chains, self._meeting, self._apart = chains, met, dict[int, _Kept]()
        self._earlier = memory._apart if isinstance(memory, EliminationApart) else {}

    def eliminate(self, *bands: Band) -> None:
        """See the base."""
        L, w, far, c, number = bands[0].frames, self.shape.frame, self.shape.far, self._meeting, len(self._kept)
        if L <= 2 * REACH:
            super().eliminate(self._side_by_side(bands))
            return
        n = REACH * w + (L - REACH) * c  # what goes last of the stretch; behind it what is left
        frames = [np.arange(w), w + np.arange(w), n + np.arange(w), n + w + np.arange(len(far))]
        met = [one[-c:] for one in (*frames[:2], *np.arange(REACH * w, n).reshape(-1, c), *frames[2:])]
        border = n + self.shape.ahead + np.arange(self.shape.static)
        size = n + self.shape.rest
        H, v = np.zeros((size, size)), np.zeros(size)
        self._add(self.information, self.vector, np.concatenate([frames[0], frames[1][far], border]), H, v)
        diagonal = np.concatenate([self._damping, self._damping, np.tile(self._damping[-c:], L - REACH)])
        H[np.arange(n), np.arange(n)] += diagonal
        eliminations = list[BandElimination]()
        earlier = self._earlier.pop(number, None)
        memories = [None] * len(bands) if earlier is None else earlier.chains
        for chain, band, memory in zip(self._chains, bands, memories, strict=True):
            own, every = chain.frame[:-c], [frames[t][chain.frame] for t in range(REACH)]
            self._add_first(band, every, border[chain.border], H, v)
            self._add_met(band, met, border[chain.border], H, v)
            elimination = self._eliminated(chain, band, memory)
            after = [frames[2][own], frames[3][np.searchsorted(far, own[elimination.shape.far])]]
            places = [*after, border[chain.border], frames[0][own], frames[1][own], np.arange(REACH * w, n)]
            self._add(elimination.information, elimination.vector, np.concatenate(places), H, v)
            eliminations.append(elimination)
        eliminate(H, v, 0, n, self._kernels)
        self._apart[number] = _Kept(Conditional(H[:n].copy(), v[:n].copy()), eliminations)
        self._kept.append((np.zeros((0, 0, 0)), np.zeros((L, w))))
        self.information[:], self.vector[:] = H[n:, n:], v[n:]

    def _add(self, information: Array, vector: Array, places: np.ndarray, H: Array, v: Array) -> None:
        """Add a quadratic in columns at some places, of which the upper triangle counts."""
        order = np.argsort(places)
        add_at(*reordered(information, vector, order, self._kernels), places[order], H, v, self._kernels)

    def _add_first(self, band: Band, frames: list[np.ndarray], border: np.ndarray, H: Array, v: Array) -> None:
        """Add what the first two frames of a stretch say of each other and of the border."""
        w = len(frames[0])
        for t, places in enumerate(frames):
            for ahead, others in enumerate(frames[t:]):
                H[np.ix_(places, others)] += band.rows[t, :, ahead * w : (ahead + 1) * w]
            H[np.ix_(places, border)] += band.rows[t, :, (REACH + 1) * w :]
            v[places] -= band.gradient[t]

    def _add_met(self, band: Band, met: list[np.ndarray], border: np.ndarray, H: Array, v: Array) -> None:
        """Add what is said of what is met in the frames behind the first two, and of these with them."""
        w, c = band.shape.frame, self._meeting
        for t, places in enumerate(met):
            rows = band.rows[t, w - c :]
            for ahead in range(REACH + 1):
                if REACH <= t + ahead < len(met):
                    others = met[t + ahead]
                    H[places[0] : places[-1] + 1, others[0] : others[-1] + 1] += rows[:, (ahead + 1) * w - c :][:, :c]
            if t >= REACH:
                H[places[:, None], border] += rows[:, (REACH + 1) * w :]
                v[places] -= band.gradient[t, w - c :]

    def _eliminated(self, chain: Chain, band: Band, memory: BandElimination | None) -> BandElimination:
        """A chain's frames behind the first two of a stretch, with these and all that is met there in its border."""
        own, w, L, c = chain.frame[: -self._meeting], len(chain.frame), band.frames, self._meeting
        k, s, far = len(own), len(chain.border), np.flatnonzero(np.isin(own, self.shape.far))
        shape = Shape(k, s + REACH * k + (L - REACH) * c, far)
        elimination = BandElimination(shape, self._damping[own], memory, self._kernels)
        first, second = (shape.ahead + s + np.arange(t * k, (t + 1) * k) for t in range(REACH))
        elimination.information[:k, first] = band.rows[0, :k, 2 * w : 2 * w + k].T
        elimination.information[:k, second] = band.rows[1, :k, w : w + k].T
        elimination.information[k : shape.ahead, second] = band.rows[1][:k, 2 * w + far].T
        elimination.eliminate(band.behind(REACH))
        return elimination

    def _side_by_side(self, bands: Sequence[Band]) -> Band:
        """All chains in one band."""
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
        """See the base."""
        if number not in self._apart:
            return super().substituted(number, behind, border)
        kept, steps, w, c = self._apart[number], self._kept[number][1], self.shape.frame, self._meeting
        x = kept.last.given(np.concatenate([behind[0], behind[1, self.shape.far], border]))
        steps[:REACH] = x[: REACH * w].reshape(REACH, w)
        steps[REACH:, w - c :] = x[REACH * w :].reshape(-1, c)
        for chain, elimination in zip(self._chains, kept.chains, strict=True):
            own = chain.frame[:-c]
            values = np.concatenate([border[chain.border], steps[0, own], steps[1, own], x[REACH * w :]])
            steps[REACH:, own] = elimination.substituted(0, behind[:, own], values)
        return steps
