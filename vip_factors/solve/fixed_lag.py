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
from scipy.linalg.blas import dtrsm, dtrsv

from vip_factors.compiled import kernels
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.slices import REACH, eliminated


@dataclass(frozen=True)
class _Conditional:
    """``R x + S y = d`` of some variables ``x`` and all that are eliminated after them, ``y``.

    ``rows`` hold ``R``, of which only what lies on and above the diagonal counts, and ``S``.
    """

    rows: Array
    d: Array

    @property
    def R(self) -> Array:
        """``(w, w)``."""
        return self.rows[:, : len(self.d)]

    @property
    def S(self) -> Array:
        """``(w, m)``."""
        return self.rows[:, len(self.d) :]

    def given(self, later: Array) -> Array:
        """The variables, of the values of the later ones."""
        right = self.d - self.S @ later
        solved: Array = dtrsv(self.R, right) if len(right) else right  # of nothing at all it complains
        return solved


def eliminate(information: Array, vector: Array, first: int, width: int) -> None:
    """Eliminate ``width`` variables of ``½ xᵀ H x − vᵀ x`` from ``first`` on, those before being so already, in place.

    Their rows become those of the conditional, those behind what is known of the others; of ``H``, ``(n, n)`` in C's
    order, what lies on and above the diagonal counts.

    Raises:
        SolveError: if they are not determined.
    """
    if kernels is not None:
        if not kernels.eliminate(information, vector, first, width):
            raise SolveError("the linear system is not determined")
        return
    own, others = slice(first, first + width), slice(first + width, None)
    rest = np.array(information[others, others])
    R, S_transposed = eliminated(information[own, own], np.array(information[own, others]), rest)
    if width:
        vector[own] = dtrsv(R, vector[own], trans=1)
    information[own, own], information[own, others], information[others, others] = R, S_transposed.T, rest
    vector[others] -= S_transposed @ vector[own]


@dataclass(frozen=True)
class _Quadratic:
    """``½ xᵀ information x − vectorᵀ x``, of which only what lies on and above the diagonal counts."""

    information: Array
    vector: Array

    def without(self, width: int, already: int = 0) -> tuple[_Conditional, "_Quadratic"]:
        """Its first variables, given all others, and what it says of those; what there was is changed.

        Args:
            width: of the first variables.
            already: how many of them :func:`eliminate` has been called for.

        Raises:
            SolveError: if they are not determined.
        """
        eliminate(self.information, self.vector, already, width - already)
        own, others = slice(0, width), slice(width, None)
        return (
            _Conditional(self.information[own], self.vector[own]),
            _Quadratic(self.information[others, others], self.vector[others]),
        )


@dataclass(frozen=True)
class _Eliminated:
    """A frame given those after it; shared variables given those that frames to come share, where they wandered; and
    what is known from it and all before of the two frames after it and what frames to come share.
    """

    frame: _Conditional
    shared: _Conditional | None
    rest: _Quadratic


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
        self._past: _Quadratic | None = None  # what is known from the frames that were marginalised

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
        before = self._frames[number - 1].rest if number - 1 in self._frames else self._past
        for later in range(number, kept.stop):
            del self._frames[later]
        if before is not None:
            self._add(before, information, vector)

    def end(self, number: int, information: Array, vector: Array, already: int, sigmas: Array | None = None) -> None:
        """The rest of it, once :func:`eliminate` has been called for the first ``already`` columns of the frame."""
        frame, rest = _Quadratic(information, vector).without(self.width, already)
        shared = None
        if sigmas is not None and len(sigmas):
            shared, rest = self._wandered(rest, sigmas)
        self._frames[number] = _Eliminated(frame, shared, rest)

    def _add(self, before: _Quadratic, information: Array, vector: Array) -> None:
        """What the frames before say of the first ones of a slice, and of what is shared."""
        ahead, shared = len(before.vector) - self.static, np.arange(len(vector) - self.static, len(vector))
        frames = np.concatenate([np.arange(self.width), self.width + self.far])[:ahead]
        places = np.concatenate([frames, shared])
        if kernels is not None:
            kernels.add_before(before.information, before.vector, places, information, vector)
            return
        vector[places] += before.vector
        information[np.ix_(places, places)] += np.triu(before.information)

    def _wandered(self, rest: _Quadratic, sigmas: Array) -> tuple[_Conditional, _Quadratic]:
        """The shared variables eliminated, and what is known of those that stepped on from them."""
        s, weight = self.static, np.diag(sigmas**-2.0)
        frames, old = slice(s, -s), slice(-s, None)  # of the shared ones first, then the frames, then their successors
        n = len(rest.vector)
        H, vector = np.zeros((n + s, n + s)), np.zeros(n + s)
        H[frames, frames], vector[frames] = rest.information[:-s, :-s], rest.vector[:-s]
        H[:s, frames] = rest.information[:-s, old].T
        H[:s, :s], vector[:s] = rest.information[old, old], rest.vector[old]
        H[:s, :s][np.diag_indices(s)] += sigmas**-2.0  # below the diagonal is anything: a sum would warn of it
        H[:s, old], H[old, old] = -weight, weight
        return _Quadratic(H, vector).without(s)

    def marginalise_before(self, number: int) -> None:
        """Marginalise the frames with a smaller number: what is known from them stays."""
        for kept in [one for one in self._frames if one < number]:
            self._past = self._frames.pop(kept).rest

    def solution(self) -> "LagSolution":
        """All variables of the lag.

        Raises:
            SolveError: if what the newest frame shares with those to come is not determined.
        """
        rest = self._frames[max(self._frames)].rest
        ahead = len(rest.vector) - self.static
        last, _ = _Quadratic(rest.information[ahead:, ahead:].copy(), rest.vector[ahead:].copy()).without(self.static)
        return LagSolution(self._frames, last, self.width, self.far)


class LagSolution:
    """The minimum over the lag, and how sure it is.

    Attributes:
        values: ``(T, w)`` of the frames.
        shared: ``(s,)``, what the newest frame shares with those to come.
    """

    def __init__(self, eliminated: dict[int, _Eliminated], last: _Conditional, width: int, far: np.ndarray) -> None:
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
        half = _forward(self._last, np.eye(s), np.zeros((0, s)))
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
            Y = _forward(one.frame, own, behind)
            total += Y.T @ Y
            if one.shared is not None:
                stepped = behind[ahead:].copy()
                behind[ahead:] = 0.0
                Y = _forward(one.shared, stepped, behind)
                total += Y.T @ Y
            yield None
            if at < newest:
                own, left = behind[:w], behind[w:]
                behind = np.zeros(((0, w, w + far)[min(REACH, newest - at - 1)] + s, w))
                behind[self._far[: ahead - w]], behind[len(behind) - s :] = left[: ahead - w], left[ahead - w :]
        Y = _forward(self._last, behind, np.zeros((0, w)))
        yield total + Y.T @ Y


def _substituted(frames: list[_Eliminated], far: np.ndarray, shared: Array, width: int) -> Array:
    """Values ``(T, w)`` of frames in their order, of what the newest one shares with those to come."""
    values = np.empty((len(frames), width))
    if kernels is not None:
        steps = [() if one.shared is None else (one.shared.rows, one.shared.d) for one in frames]
        own = [(one.frame.rows, one.frame.d, *step) for one, step in zip(frames, steps, strict=True)]
        kernels.substitute_lag(own, far, shared, values)
        return values
    for t, one in reversed(list(enumerate(frames))):
        ahead = np.concatenate([values[t + 1 : t + 2].ravel(), values[t + 2 : t + 3, far].ravel()])
        if one.shared is not None:
            shared = one.shared.given(np.concatenate([ahead, shared]))
        values[t] = one.frame.given(np.concatenate([ahead, shared]))
    return values


def _forward(conditional: _Conditional, right: Array, behind: Array) -> Array:
    """``Y`` of ``Rᵀ Y = right``, in its place; ``Sᵀ Y`` is taken from ``behind``."""
    if kernels is not None:
        kernels.forward(conditional.rows, right, behind)
        return right
    found: Array = dtrsm(1.0, conditional.R, right, trans_a=1) if right.size else right
    behind -= conditional.S.T @ found
    return found
