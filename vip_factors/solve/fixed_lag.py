"""A fixed-lag smoother of a chain: frames are eliminated in time order, what all frames share last.

It is the elimination that iSAM2 does with keys constrained to time order and leaves marginalised, kept as a list
instead of a tree: for a chain the tree is one, and each of its cliques is a dense block, which LAPACK eliminates in
three calls. What the list brings: what is left behind a frame can be taken up again at any of them (a frame that moved
is linearised anew, a late measurement put in), what all frames share may wander, and covariances of the newest and of
the oldest frame cost a few products. It knows nothing of bodies.
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
    """A frame given those after it; shared variables given those that frames to come share, where they wandered; and
    what is known from it and all before of the two frames after it and what frames to come share.
    """

    frame: Conditional
    shared: Conditional | None
    information: Array
    vector: Array


class FixedLagChain:
    """The eliminated frames of the lag. Of marginalised ones later frames hold all that they said.

    Args:
        frame, static: widths of a frame, and of what all frames share.
        far: which columns of a frame the frame two before it sees; None for all.

    Attributes:
        width, static, far: these.
    """

    def __init__(self, frame: int, static: int, far: np.ndarray | None = None) -> None:
        self.width, self.static, self.far = frame, static, np.arange(frame) if far is None else far
        self._frames: dict[int, _Eliminated] = {}
        self._past: _Eliminated | None = None  # what is known from the frames that were marginalised

    @property
    def numbers(self) -> range:
        """Numbers of the frames that are kept."""
        return range(min(self._frames), max(self._frames) + 1) if self._frames else range(0)

    def eliminate(self, number: int, information: Array, vector: Array, sigmas: Array | None = None) -> None:
        """Put in a frame, behind the one before it; what was kept of this and of later ones is replaced.

        Args:
            number: of the frame: one of those that are kept, or the next.
            information, vector: ``(n, n)`` and ``(n,)`` of all factors whose first frame this is: columns of the frame,
                of the next and far ones of that after it, where there are any, and of what is shared; both are changed.
            sigmas: ``(s,)`` by which what is shared wanders behind the frame.

        Raises:
            SolveError: if a variable is not determined, or for another number.
        """
        self.begin(number, information, vector)
        self.end(number, information, vector, 0, sigmas)

    def begin(self, number: int, information: Array, vector: Array) -> None:
        """The same as far as what is known from before is added to a frame's factors, and no further."""
        kept = self.numbers
        if kept and not kept[0] <= number <= kept[-1] + 1:
            raise SolveError(f"frame {number} does not follow one of the frames {kept[0]} to {kept[-1]}")
        before = self._frames.get(number - 1, self._past)
        for later in range(number, kept.stop):
            del self._frames[later]
        if before is not None:
            self._add(before, information, vector)

    def end(self, number: int, information: Array, vector: Array, already: int, sigmas: Array | None = None) -> None:
        """The rest of it, once :func:`eliminate` has been called for the first ``already`` columns of the frame."""
        eliminate(information, vector, already, self.width - already)
        frame, others = Conditional(information[: self.width], vector[: self.width]), slice(self.width, None)
        shared, rest, left = None, information[others, others], vector[others]
        if sigmas is not None and len(sigmas):
            rest, columns = rest.copy(), np.arange(len(left) - self.static, len(left))
            shared = add_process_noise(rest, left, columns, sigmas, np.zeros(self.static))
        self._frames[number] = _Eliminated(frame, shared, rest, left)

    def _add(self, before: _Eliminated, information: Array, vector: Array) -> None:
        """What the frames before say of the first ones of a slice, and of what is shared."""
        ahead, shared = len(before.vector) - self.static, np.arange(len(vector) - self.static, len(vector))
        frames = np.concatenate([np.arange(self.width), self.width + self.far])[:ahead]
        places = np.concatenate([frames, shared])
        add_at(before.information, before.vector, places, information, vector)

    def marginalise_before(self, number: int) -> None:
        """Marginalise the frames with a smaller number: what is known from them stays."""
        for gone in [one for one in self._frames if one < number]:
            self._past = self._frames.pop(gone)

    def solution(self) -> "LagSolution":
        """All variables of the lag.

        Raises:
            SolveError: if what the newest frame shares with those to come is not determined.
        """
        newest = self._frames[max(self._frames)]
        ahead = len(newest.vector) - self.static
        information, vector = newest.information[ahead:, ahead:].copy(), newest.vector[ahead:].copy()
        eliminate(information, vector, 0, self.static)
        return LagSolution(self._frames, Conditional(information, vector), self.width, self.far)


class LagSolution:
    """The minimum over the lag, and how sure it is.

    Attributes:
        values: ``(T, w)`` of the frames.
        shared: ``(s,)``, what the newest frame shares with those to come.
    """

    def __init__(self, eliminated: dict[int, _Eliminated], last: Conditional, width: int, far: np.ndarray) -> None:
        self._eliminated, self._last, self.width, self._far = dict(eliminated), last, width, far
        self.shared = last.given(np.zeros(0))
        self.values = _substituted(list(eliminated.values()), far, self.shared, width)

    @property
    def frames(self) -> dict[int, Array]:
        """The values by a frame's number."""
        return dict(zip(self._eliminated, self.values, strict=True))

    def shared_covariance(self) -> Array:
        """Marginal covariance ``(s, s)`` of what the newest frame shares with those to come."""
        s = len(self.shared)
        half = self._last.forward(np.eye(s), np.zeros((0, s)))
        return np.asarray(half.T @ half)

    def covariance(self, number: int) -> Array:
        """Marginal covariance ``(w, w)`` of a frame; the later it is, the less it costs."""
        *_, found = self.covariance_in_steps(number)
        assert found is not None
        return found

    def covariance_in_steps(self, number: int) -> Iterator[Array | None]:
        """The same in as many steps as there are frames from there on, and one; None until the last one.

        With ``R`` the triangular factor of all, it is ``YᵀY`` for ``RᵀY = E``, with ``E`` the variable's columns: one
        substitution forwards. No information matrix is inverted, so an accelerometer's double integration costs no
        digits.
        """
        w, s, newest, far = self.width, len(self.shared), max(self._eliminated), len(self._far)
        total, own = np.zeros((w, w)), np.eye(w)
        seen = (0, w, w + far)[min(REACH, newest - number)]
        behind = np.zeros((seen + s, w))  # of the frames ahead, and of what is shared
        for at in range(number, newest + 1):
            one, ahead = self._eliminated[at], len(behind) - s
            Y = one.frame.forward(own, behind)
            total += Y.T @ Y
            if one.shared is not None:
                stepped = behind[ahead:].copy()
                behind[ahead:] = 0.0
                Y = one.shared.forward(stepped, behind)
                total += Y.T @ Y
            yield None
            if at < newest:
                own, left = behind[:w], behind[w:]
                behind = np.zeros(((0, w, w + far)[min(REACH, newest - at - 1)] + s, w))
                behind[self._far[: ahead - w]], behind[len(behind) - s :] = left[: ahead - w], left[ahead - w :]
        Y = self._last.forward(behind, np.zeros((0, w)))
        yield total + Y.T @ Y


def _substituted(frames: list[_Eliminated], far: np.ndarray, shared: Array, width: int) -> Array:
    """Values ``(T, w)`` of frames in their order, of what the newest one shares with those to come."""
    values = np.empty((len(frames), width))
    for t, one in reversed(list(enumerate(frames))):
        ahead = values[t + 1 : t + 2].ravel(), values[t + 2 : t + 3, far].ravel()
        if one.shared is not None:
            shared = one.shared.given(np.concatenate([*ahead, shared]))
        values[t] = one.frame.given(np.concatenate([*ahead, shared]))
    return values
