"""Equations summed into slices: of a stretch of frames, each holds the factors whose first frame is its own.

A smoother that goes on where it left off needs them apart: what is left behind an eliminated frame then holds every
factor that touches it, and a later linearisation holds all the others.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from vip_factors.assembly.accumulator import Accumulator
from vip_factors.assembly.charts import Charts
from vip_factors.assembly.scatter import Slot
from vip_factors.body.kinematics import BodyState
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.problem.layout import Layout
from vip_factors.solve.slices import REACH, Slices
from vip_factors.terms.equations import KnotEquations, Residuals


class SliceAccumulator(Accumulator):
    """Sums all frames of a stretch into slices.

    Args:
        layout: where columns are.
        slices: all zero; only blocks on and over the diagonal are filled.
        frames: how many.
        charts: of the coordinates that slices are in.
    """

    def __init__(self, layout: Layout, slices: Slices, frames: int, charts: Charts | None) -> None:
        super().__init__(layout, 0, frames, charts)
        self._hessian, self._gradient = slices.hessian[:frames], slices.gradient[:frames]
        self._width, self._static = layout.frame_width, (REACH + 1) * layout.frame_width

    def slot(self, i: int, j: int) -> tuple[Slot, int]:
        """Counted from the first frame of the slice."""
        return (i, j), 0

    def _columns(self, chain: int, i: int) -> slice:
        own = self.layout.chain_columns[chain]
        return slice(i * self._width + own.start, i * self._width + own.stop)

    def frame_frame(self, chain: int, i: int, other: int, j: int) -> Array:
        """See the base."""
        return self._hessian[:, self._columns(chain, i), self._columns(other, j)]

    def frame_static(self, chain: int, i: int, columns: slice) -> Array:
        """See the base."""
        return self._hessian[
            :, self._columns(chain, i), slice(self._static + columns.start, self._static + columns.stop)
        ]

    def frame_gradient(self, chain: int, i: int) -> Array:
        """See the base."""
        return self._gradient[:, self._columns(chain, i)]

    def add_static(self, rows: np.ndarray, columns: np.ndarray, block: Array, at: Residuals, mirror: bool) -> None:
        """See the base."""
        source, target = self.static_rows(at)
        into, rows, columns = self._hessian[target], self._static + rows, self._static + columns
        into[:, rows[:, :, None], columns[:, None, :]] += block[source]
        if mirror:
            into[:, columns[:, :, None], rows[:, None, :]] += block[source].swapaxes(2, 3)

    def add_static_gradient(self, columns: np.ndarray, vector: Array, at: Residuals) -> None:
        """See the base."""
        source, target = self.static_rows(at)
        into = self._gradient[target]
        into[:, self._static + columns] += vector[source]

    def add_knots(self, equations: KnotEquations) -> None:
        """See the base."""
        raise NotImplementedError("headings of a stream walk from step to step, not between knots")

    def finish(self, bodies: Sequence[BodyState]) -> None:
        """Also fill what lies below the diagonal within a frame: what a body has in common with a camera."""
        super().finish(bodies)
        H, parts = self._hessian, range(len(self.layout.chains))
        for i in range(REACH + 1):
            for p, q in combinations(parts, 2):
                here, there = self._columns(p, i), self._columns(q, i)
                H[:, there, here] = transpose(H[:, here, there])
