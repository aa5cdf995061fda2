"""Fixed-lag smoother of a chain: frames are eliminated in time order, shared (static) columns last.

This is the elimination of iSAM2 with keys constrained to time order and leaves marginalised. The Bayes tree of a chain
is a list of dense cliques, so a list of conditionals replaces it. Elimination can restart at any frame of the lag (to
relinearise it or to add a late measurement), and shared columns may have process noise.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import Conditional, add_at, add_process_noise, eliminate
from vip_factors.solve.slices import REACH


@dataclass(frozen=True)
class _Eliminated:
    """An eliminated frame.

    Attributes:
        frame: conditional of the frame given later ones.
        shared: conditional of the shared columns given their next values; None without process noise.
        information, vector: marginal of this and earlier frames on the next two frames and the shared columns.
    """

    frame: Conditional
    shared: Conditional | None
    information: Array
    vector: Array


class FixedLagChain:
    """The eliminated frames of the lag.

    Args:
        frame, static: widths of a frame and of the shared columns.
        far: columns of a frame that factors connect with the frame two before it; None for all.

    Attributes:
        width, static, far: the arguments.
    """

    def __init__(self, frame: int, static: int, far: np.ndarray | None = None) -> None:
        self.width, self.static, self.far = frame, static, np.arange(frame) if far is None else far
        self._frames: dict[int, _Eliminated] = {}
        self._past: _Eliminated | None = None  # newest marginalised frame

    @property
    def numbers(self) -> range:
        """Numbers of the frames in the lag."""
        return range(min(self._frames), max(self._frames) + 1) if self._frames else range(0)

    def eliminate(self, number: int, information: Array, vector: Array, sigmas: Array | None = None) -> None:
        """Eliminate a frame; it and later ones are replaced if they are in the lag already.

        Args:
            number: a frame of the lag, or the next one.
            information, vector: ``(n, n)`` and ``(n,)``, sum of all factors whose first frame this is; columns of the
                frame, the next one, the far ones of that after it (as far as they exist) and the shared ones. Both are
                overwritten.
            sigmas: ``(s,)`` of the shared columns' process noise after the frame.

        Raises:
            SolveError: if a variable is not determined, or if the number does not follow the lag.
        """
        self.begin(number, information, vector)
        self.end(number, information, vector, 0, sigmas)

    def begin(self, number: int, information: Array, vector: Array) -> None:
        """First half of :meth:`eliminate`: add the marginal of earlier frames to a frame's factors."""
        numbers = self.numbers
        if numbers and not numbers[0] <= number <= numbers[-1] + 1:
            raise SolveError(f"frame {number} does not follow one of the frames {numbers[0]} to {numbers[-1]}")
        previous = self._frames.get(number - 1, self._past)
        for later_number in range(number, numbers.stop):
            del self._frames[later_number]
        if previous is not None:
            self._add(previous, information, vector)

    def end(self, number: int, information: Array, vector: Array, already: int, sigmas: Array | None = None) -> None:
        """Second half of :meth:`eliminate`, with the first ``already`` columns of the frame eliminated before."""
        eliminate(information, vector, already, self.width - already)
        frame, rest_columns = Conditional(information[: self.width], vector[: self.width]), slice(self.width, None)
        shared, information_ahead, vector_ahead = None, information[rest_columns, rest_columns], vector[rest_columns]
        if sigmas is not None and len(sigmas):
            information_ahead = information_ahead.copy()
            columns = np.arange(len(vector_ahead) - self.static, len(vector_ahead))
            shared = add_process_noise(information_ahead, vector_ahead, columns, sigmas, np.zeros(self.static))
        self._frames[number] = _Eliminated(frame, shared, information_ahead, vector_ahead)

    def _add(self, previous: _Eliminated, information: Array, vector: Array) -> None:
        """Add the marginal of earlier frames to a slice."""
        ahead, shared = len(previous.vector) - self.static, np.arange(len(vector) - self.static, len(vector))
        frames = np.concatenate([np.arange(self.width), self.width + self.far])[:ahead]
        places = np.concatenate([frames, shared])
        add_at(previous.information, previous.vector, places, information, vector)

    def marginalise_before(self, number: int) -> None:
        """Marginalise the frames with a smaller number."""
        for old_number in [n for n in self._frames if n < number]:
            self._past = self._frames.pop(old_number)

    def solution(self) -> "LagSolution":
        """Solve for all variables of the lag.

        Raises:
            SolveError: if the shared columns are not determined.
        """
        newest = self._frames[max(self._frames)]
        ahead = len(newest.vector) - self.static
        information, vector = newest.information[ahead:, ahead:].copy(), newest.vector[ahead:].copy()
        eliminate(information, vector, 0, self.static)
        return LagSolution(self._frames, Conditional(information, vector), self.width, self.far)


class LagSolution:
    """Values and covariances of the lag.

    Attributes:
        values: ``(T, w)`` of the frames.
        shared: ``(s,)``, shared columns after the newest frame.
    """

    def __init__(self, eliminated: dict[int, _Eliminated], static: Conditional, width: int, far: np.ndarray) -> None:
        self._eliminated, self._static, self.width, self._far = dict(eliminated), static, width, far
        self.shared = static.given(np.zeros(0))
        self.values = _substituted(list(eliminated.values()), far, self.shared, width)

    @property
    def frames(self) -> dict[int, Array]:
        """Values ``(w,)`` by frame number."""
        return dict(zip(self._eliminated, self.values, strict=True))

    def shared_covariance(self) -> Array:
        """Marginal covariance ``(s, s)`` of the shared columns after the newest frame."""
        s = len(self.shared)
        half = self._static.forward(np.eye(s), np.zeros((0, s)))
        return np.asarray(half.T @ half)

    def covariance(self, number: int) -> Array:
        """Marginal covariance ``(w, w)`` of a frame; the cost grows with the number of later frames."""
        *_, covariance = self.covariance_in_steps(number)
        assert covariance is not None
        return covariance

    def covariance_in_steps(self, number: int) -> Iterator[Array | None]:
        """Compute :meth:`covariance` in steps, one for each frame from there on; yields None until the last one.

        With ``R`` the triangular factor of the lag and ``E`` the frame's unit columns, it is ``YᵀY`` for ``RᵀY = E``:
        one forward substitution. No information matrix is inverted, which would lose digits.
        """
        w, s, newest, far = self.width, len(self.shared), max(self._eliminated), len(self._far)
        total, right = np.zeros((w, w)), np.eye(w)
        width_ahead = (0, w, w + far)[min(REACH, newest - number)]
        behind = np.zeros((width_ahead + s, w))  # later frames, shared columns
        for frame_number in range(number, newest + 1):
            eliminated, ahead = self._eliminated[frame_number], len(behind) - s
            Y = eliminated.frame.forward(right, behind)
            total += Y.T @ Y
            if eliminated.shared is not None:
                stepped = behind[ahead:].copy()
                behind[ahead:] = 0.0
                Y = eliminated.shared.forward(stepped, behind)
                total += Y.T @ Y
            yield None
            if frame_number < newest:
                right, remaining = behind[:w], behind[w:]
                behind = np.zeros(((0, w, w + far)[min(REACH, newest - frame_number - 1)] + s, w))
                behind[self._far[: ahead - w]], behind[len(behind) - s :] = (
                    remaining[: ahead - w],
                    remaining[ahead - w :],
                )
        Y = self._static.forward(behind, np.zeros((0, w)))
        yield total + Y.T @ Y


def _substituted(frames: list[_Eliminated], far: np.ndarray, shared: Array, width: int) -> Array:
    """Back-substitute the values ``(T, w)`` of frames in time order from the shared columns."""
    values = np.empty((len(frames), width))
    for t, eliminated in reversed(list(enumerate(frames))):
        ahead = values[t + 1 : t + 2].ravel(), values[t + 2 : t + 3, far].ravel()
        if eliminated.shared is not None:
            shared = eliminated.shared.given(np.concatenate([*ahead, shared]))
        values[t] = eliminated.frame.given(np.concatenate([*ahead, shared]))
    return values
