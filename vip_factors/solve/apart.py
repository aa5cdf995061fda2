"""Chains that meet one more in every frame, as people before a moving camera have its pose, each eliminated by itself.

Side by side they would be cubic in their number. Within a stretch each chain's frames go by themselves: behind them
stand its first two frames there, all that it meets in the stretch, and the border. Then what is left of the stretch
goes as one: the first two frames of all chains, and what they meet (nested dissection, George 1973).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dtrsv

from vip_factors.compiled import Kernels, kernels
from vip_factors.geometry.rotations import Array
from vip_factors.solve.band import Band, BandElimination, Shape
from vip_factors.solve.fixed_lag import eliminate
from vip_factors.solve.slices import REACH


@dataclass(frozen=True)
class Chain:
    """Columns of a chain in a frame, and of the border those that it sees."""

    frame: np.ndarray
    border: np.ndarray


@dataclass(frozen=True)
class _Kept:
    """Of a stretch ``R x + S y = d`` of what goes last, and the eliminations of chains."""

    rows: Array
    d: Array
    chains: list[BandElimination]


class EliminationApart(BandElimination):
    """Frames of such chains eliminated, stretch by stretch.

    Args:
        shape, damping, kernels: as of the base.
        chains: that have nothing in common but what they meet.
        met: columns in a frame of what all meet.
    """

    def __init__(
        self, shape: Shape, damping: Array, chains: list[Chain], met: np.ndarray, kernels: Kernels = kernels
    ) -> None:
        super().__init__(shape, damping, kernels=kernels)
        self._chains, self._met, self._apart = chains, met, dict[int, _Kept]()

    def eliminate(self, band: Band) -> None:
        """See the base."""
        L, w, s, shape, met = band.frames, self.shape.frame, self.shape.static, self.shape, self._met
        if L <= 2 * REACH:
            super().eliminate(band)
            return
        c, rows = len(met), band.rows
        n = REACH * w + (L - REACH) * c  # what goes last of the stretch; behind it what is left
        frames = [np.arange(w), w + np.arange(w), n + np.arange(w), n + w + np.arange(len(shape.far))]
        border = n + shape.ahead + np.arange(s)
        at = [frames[0][met], frames[1][met], *(REACH * w + np.arange((L - REACH) * c).reshape(-1, c))]
        at += [frames[2][met], frames[3][np.searchsorted(shape.far, met)]]  # what is met in each frame
        H, v = np.zeros((len(border) + border[0],) * 2), np.zeros(len(border) + border[0])

        def add(places: np.ndarray, others: np.ndarray, block: Array) -> None:  # each of columns side by side
            if block.size:
                H[places[0] : places[-1] + 1, others[0] : others[-1] + 1] += block

        before = np.concatenate([frames[0], frames[1][shape.far], border])
        self._add(self.information, self.vector, before, H, v)
        for t, places, columns in (
            (0, frames[0], np.arange(w)), (1, frames[1], np.arange(w)),
            (L, frames[2], np.arange(w)), (L + 1, frames[3], shape.far),
        ):  # fmt: skip
            add(places, places, rows[t][np.ix_(columns, columns)])
            add(places, border, rows[t][columns, (REACH + 1) * w :])
            v[places] -= band.gradient[t, columns]
        add(frames[0], frames[1], rows[0][:, w : 2 * w])
        add(frames[2], frames[3], rows[L][:, w + shape.far])
        for t in range(L):
            for ahead in range(3):
                if t + ahead >= REACH and (t >= REACH or ahead):
                    add(at[t], at[t + ahead], rows[t][np.ix_(met, ahead * w + met)])
            if t >= REACH:
                add(at[t], border, rows[t][met, (REACH + 1) * w :])
                v[at[t]] -= band.gradient[t, met]
        add(border, border, band.static)
        v[border] -= band.static_gradient
        diagonal = np.concatenate([self._damping, self._damping, np.tile(self._damping[met], L - REACH)])
        H[np.arange(n), np.arange(n)] += diagonal
        eliminations = [self._eliminated(chain, band) for chain in self._chains]
        for chain, elimination in zip(self._chains, eliminations, strict=True):
            own, far = chain.frame, np.searchsorted(shape.far, chain.frame[elimination.shape.far])
            every = np.concatenate(
                [
                    frames[2][own],
                    frames[3][far],
                    frames[0][own],
                    frames[1][own],
                    np.arange(REACH * w, n),
                    border[chain.border],
                ]
            )
            self._add(elimination.information, elimination.vector, every, H, v)
        eliminate(H, v, 0, n)
        self._apart[len(self._kept)] = _Kept(H[:n].copy(), v[:n].copy(), eliminations)
        self._kept.append((np.zeros((0, 0, 0)), np.zeros((L, w))))
        self.information[:], self.vector[:] = H[n:, n:], v[n:]

    def _add(self, information: Array, vector: Array, places: np.ndarray, H: Array, v: Array) -> None:
        """Add a quadratic in columns at some places, of which the upper triangle counts."""
        if self._kernels is None:
            H[np.ix_(places, places)] += np.triu(information) + np.triu(information, 1).T
            v[places] += vector
            return
        order, ordered, in_order = np.argsort(places), np.empty_like(information), np.empty_like(vector)
        self._kernels.reorder(information, vector, order, ordered, in_order)
        self._kernels.add_before(ordered, in_order, places[order], H, v)

    def _eliminated(self, chain: Chain, band: Band) -> BandElimination:
        """A chain's frames behind the first two of a stretch, with these and all that is met there in its border."""
        own, w, L, c = chain.frame, self.shape.frame, band.frames, len(self._met)
        k, start = len(own), REACH * len(own)
        far = np.flatnonzero(np.isin(own, self.shape.far))
        of_chain = Band(Shape(k, start + (L - REACH) * c + len(chain.border), far), L - REACH, self._kernels)
        rows, border = of_chain.rows, (REACH + 1) * k
        for t in range(REACH, L):
            into, source = rows[t - REACH], band.rows[t][own]
            for ahead in range(REACH + 1):
                into[:, ahead * k : (ahead + 1) * k] = source[:, ahead * w + own]
            at = border + start + (t - REACH) * c
            into[:, at : at + c] = source[:, self._met]
            into[:, rows.shape[2] - len(chain.border) :] = source[:, (REACH + 1) * w + chain.border]
        of_chain.gradient[: L - REACH] = band.gradient[REACH:L, own]
        rows[0][:, border : border + k] = band.rows[0][np.ix_(own, 2 * w + own)].T
        rows[0][:, border + k : border + 2 * k] = band.rows[1][np.ix_(own, w + own)].T
        rows[1][:, border + k : border + 2 * k] = band.rows[1][np.ix_(own, 2 * w + own)].T
        elimination = BandElimination(of_chain.shape, self._damping[own], kernels=self._kernels)
        elimination.eliminate(of_chain)
        return elimination

    def substituted(self, number: int, behind: Array, border: Array) -> Array:
        """See the base."""
        if number not in self._apart:
            return super().substituted(number, behind, border)
        kept, steps, w = self._apart[number], self._kept[number][1], self.shape.frame
        ahead = np.concatenate([behind[0], behind[1, self.shape.far], border])
        n = len(kept.d)
        x = dtrsv(kept.rows[:, :n], kept.d - kept.rows[:, n:] @ ahead)
        steps[:REACH] = x[: REACH * w].reshape(REACH, w)
        steps[REACH:, self._met] = x[REACH * w :].reshape(-1, len(self._met))
        for chain, elimination in zip(self._chains, kept.chains, strict=True):
            own = chain.frame
            known = np.concatenate([steps[0, own], steps[1, own], x[REACH * w :], border[chain.border]])
            steps[REACH:, own] = elimination.substituted(0, behind[:, own], known)
        return steps
