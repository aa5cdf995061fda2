"""Factors over three frames: what they say of a frame, and of a frame with the next two."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.graph.residuals import MotionResiduals

BEFORE, NOW, AFTER = range(3)


@dataclass(frozen=True)
class MotionInformation:
    """Blocks between the tangents ``(k)`` of what carries each of ``n`` points, in ``t`` frames.

    Attributes:
        own: ``(t, n, k, k)`` of each frame.
        ahead: ``(t', n, k, k)`` with the next frame and with the one after; shorter at the end of the recording.
        force: ``(t, n, k)`` gradient.
        by_heading: three ``(t, h, k)`` with the headings of sensors: of the next frame, its own, of the one before.
        heading, heading_force: ``(t, h)`` of the headings with themselves, and their gradient.
    """

    own: Array
    ahead: tuple[Array, Array]
    force: Array
    by_heading: tuple[Array, Array, Array]
    heading: Array
    heading_force: Array


class MotionFactors:
    """All factors over three frames of a recording, ready to be asked about stretches of it.

    Each sees one point at three frames, with fixed coefficients ``c``: between frames ``i`` and ``j`` its Hessian is
    ``J_iᵀ (Σ w c_i c_j) J_j``, summed over the centres that see both.
    """

    def __init__(self, terms: Sequence[MotionResiduals], frames: int) -> None:
        points = sum(term.residual.shape[1] for term in terms)
        headings = sum(term.residual.shape[1] for term in terms if term.by_heading is not None)
        self.frames = frames
        # One frame of zeros at either end, on which no factor is centred. Terms with headings come first.
        self._weights = np.zeros((frames + 2, points))
        self._residuals = np.zeros((frames + 2, points, 3))
        self._by_heading = np.zeros((frames + 2, headings, 3))
        self._coefficients = np.zeros((3, points))
        for term in terms:
            first, count = term.start + 1, len(term.residual)
            here = np.s_[first : first + count, term.sites]
            self._weights[here], self._residuals[here] = term.weight, term.residual
            self._coefficients[:, term.sites] = term.coefficients[:, None]
            if term.by_heading is not None:
                self._by_heading[here] = term.by_heading

    def information(self, frames: slice, jacobian: Array) -> MotionInformation:
        """Blocks of a stretch.

        Args:
            frames: the stretch.
            jacobian: ``(t', n, 3, k)`` of the points in the stretch and the two frames after it.
        """
        count, h = frames.stop - frames.start, self._by_heading.shape[1]
        # This frame is the first, the middle, the last of the three.
        centres = [slice(frames.start + 1 + offset, frames.stop + 1 + offset) for offset in (1, 0, -1)]
        c = self._coefficients
        weighted = [self._weights[centre] * c[place] for place, centre in enumerate(centres)]  # w c_i
        before, now, _ = weighted
        same = sum(w * c[place] for place, w in enumerate(weighted))
        now_with_next, now_with_last = before * c[NOW] + now * c[AFTER], before * c[AFTER]
        transposed = jacobian[:count].swapaxes(2, 3)

        def with_frame(ahead: int, scale: Array) -> Array:
            there = jacobian[ahead : ahead + count]
            return (transposed[: len(there)] * scale[: len(there), :, None, None]) @ there

        def turned(vectors: Array, points: int) -> Array:
            return (transposed[:, :points] @ vectors[..., None])[..., 0]

        forces = [w[..., None] * self._residuals[centre] for w, centre in zip(weighted, centres, strict=True)]
        by_heading = [
            turned(w[:, :h, None] * self._by_heading[centre], h) for w, centre in zip(weighted, centres, strict=True)
        ]
        own_heading = self._weights[centres[NOW], :h, None] * self._by_heading[centres[NOW]]
        return MotionInformation(
            with_frame(0, same),
            (with_frame(1, now_with_next), with_frame(2, now_with_last)),
            turned(forces[BEFORE] + forces[NOW] + forces[AFTER], jacobian.shape[1]),
            (by_heading[BEFORE], by_heading[NOW], by_heading[AFTER]),
            np.einsum("tni,tni->tn", own_heading, self._by_heading[centres[NOW]]),
            np.einsum("tni,tni->tn", own_heading, self._residuals[centres[NOW], :h]),
        )
