"""Normal equations of a scene: a chain for each wearer, one for the camera, and what ties them together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.graph.hessian import coupling_factor
from vip_factors.graph.system import STRETCH, ChainSystem


@dataclass
class SceneSystem:
    """A linearisation.

    Attributes:
        wearers, camera: their chains.
        couplings: of each wearer ``(T, 75, n)`` with the camera's free columns.
        seen: of each wearer ``(T,)``, whether it has a coupling there.
    """

    wearers: Sequence[ChainSystem]
    camera: ChainSystem
    couplings: Sequence[Array]
    seen: Sequence[np.ndarray]

    def stretches(self, damping: float) -> Iterator[tuple[gtsam.GaussianFactorGraph, gtsam.Ordering]]:
        """The factors with ``damping`` units on the diagonal, with the keys to eliminate, stretch by stretch.

        In time order, all static variables last: the camera's pose connects the wearers of its frame.
        """
        chains, T = [*self.wearers, self.camera], len(self.camera.frame_keys)
        for start in range(0, T, STRETCH):
            graph, ordering = gtsam.GaussianFactorGraph(), gtsam.Ordering()
            stop = min(start + STRETCH, T)
            for chain in chains:
                chain.append_frames(graph, start, stop, damping)
            self._append_couplings(graph, start, stop)
            for t in range(start, stop):
                for chain in chains:
                    if chain.frame_width:
                        ordering.push_back(chain.frame_keys[t])
            for chain in chains:
                for key in chain.append_passed(graph, start, stop, damping):
                    ordering.push_back(key)
            for chain in chains:
                if stop == T and chain.static_width:
                    chain.append_static(graph, damping)
                    ordering.push_back(chain.static_key)
            yield graph, ordering

    def _append_couplings(self, graph: gtsam.GaussianFactorGraph, start: int, stop: int) -> None:
        camera, w = self.camera, self.camera.frame_width
        for chain, couplings, seen in zip(self.wearers, self.couplings, self.seen, strict=True):
            for t in range(start, stop):
                if not seen[t]:
                    continue
                if w:
                    graph.push_back(coupling_factor(chain.frame_keys[t], camera.frame_keys[t], couplings[t, :, :w]))
                if camera.static_width and couplings[t, :, w:].any():
                    graph.push_back(coupling_factor(chain.frame_keys[t], camera.static_key, couplings[t, :, w:]))
