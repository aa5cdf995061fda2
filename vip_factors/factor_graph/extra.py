"""A user's own GTSAM factors among ours: linearised by GTSAM, and added to what the fast solvers eliminate."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.errors import InputError
from vip_factors.factor_graph.variables import HEADINGS, JOINT, ROOT, Variable, frames_of, values_of, variable_of
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, Layout
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import ROWS
from vip_factors.solve.chain_system import frame_keys, knot_key, static_key
from vip_factors.solve.elimination import coupling_factor
from vip_factors.solve.slices import REACH, Slices

ExtraFactors = Callable[[Array, int], gtsam.NonlinearFactorGraph]
"""Makes a user's factors: of the times ``(n,)`` in seconds of frames that are new, and the number of the first of them.

The factors are on the variables of these frames, of earlier ones, and of what all frames share, by the keys of
:mod:`vip_factors.factor_graph.keys`. Of a whole recording all frames come at once, with ``first = 0``; of a stream each
by itself.
"""


@dataclass(frozen=True)
class LinearFactor:
    """A linearised factor: information ``(n, n)`` and the right-hand side ``(n,)`` on the steps of its variables."""

    variables: tuple[Variable, ...]
    information: Array
    information_vector: Array

    @property
    def frames(self) -> range:
        """Frames that it sees; of none, the first."""
        return frames_of(self.variables)

    @classmethod
    def at(cls, factor: gtsam.NonlinearFactor, state: SceneState, first: int = 0) -> "LinearFactor | None":
        """A factor at a state, whose first frame has the number ``first``; None if the factor is not active there.

        Raises:
            InputError: for a variable that is none of the scene's, or a derivative that is not finite.
        """
        variables = tuple(_checked(int(key), state, first) for key in list(factor.keys()))
        linear = factor.linearize(values_of(state, variables, first))
        if linear is None:
            return None
        order = [int(key) for key in list(linear.keys())]
        whole = np.asarray(linear.augmentedInformation())
        if not np.all(np.isfinite(whole)):
            names = ", ".join(gtsam.DefaultKeyFormatter(key) for key in order)
            raise InputError(f"an extra factor on {names} has a residual or a derivative that is not finite")
        by_key = {one.key: one for one in variables}
        return cls(tuple(by_key[key] for key in order), whole[:-1, :-1], whole[:-1, -1])

    def blocks(self) -> Iterator[tuple[Variable, slice]]:
        """The variables with their rows."""
        start = 0
        for one in self.variables:
            yield one, slice(start, start + one.width)
            start += one.width


def _checked(key: int, state: SceneState, first: int) -> Variable:
    one, frames = variable_of(key), max([1, *(own.frames for own in state.wearers)])
    wearers, name = len(state.wearers), gtsam.DefaultKeyFormatter(key)
    if one is None:
        raise InputError(f"an extra factor has the key {name}: expected a key of vip_factors.factor_graph.keys")
    if one.wearer >= wearers:
        raise InputError(f"an extra factor is on wearer {one.wearer} ({name}): there are {wearers}, counted from 0")
    if one.is_of_a_frame and not first <= one.frame < first + frames:
        raise InputError(
            f"an extra factor is on frame {one.frame} ({name}): expected one of {first} to {first + frames - 1}"
        )
    if one.block in ROWS and ROWS[one.block].of_sensors and one.item >= len(state.wearers[one.wearer].headings):
        raise InputError(f"an extra factor is on sensor {one.item} ({name}): the wearer has fewer")
    return one


class UserTerms:
    """A user's factors on a whole recording, for the chain's solver."""

    def __init__(self, make: ExtraFactors) -> None:
        self._make = make
        self._made: tuple[bytes, gtsam.NonlinearFactorGraph] | None = None

    def factors(self, problem: SceneProblem) -> gtsam.NonlinearFactorGraph:
        """Those on a problem's frames."""
        time = np.asarray(problem.wearers[0].frames.time)
        if self._made is None or self._made[0] != time.tobytes():
            self._made = time.tobytes(), self._make(time, 0)
        return self._made[1]

    def cost(self, problem: SceneProblem, state: SceneState) -> float:
        """See :class:`~vip_factors.problem.scene.ExtraTerms`."""
        graph = self.factors(problem)
        variables = {int(key): _checked(int(key), state, 0) for key in list(graph.keyVector())}
        return float(graph.error(values_of(state, variables.values())))

    def linearised(
        self, problem: SceneProblem, layout: Layout, state: SceneState
    ) -> Iterator[tuple[int, gtsam.GaussianFactor]]:
        """See :class:`~vip_factors.problem.scene.ExtraTerms`."""
        graph, places = self.factors(problem), _ChainPlaces(layout, problem.frames)
        for index in range(graph.size()):
            linear = LinearFactor.at(graph.at(index), state)
            if linear is not None:
                for factor in places.spread(linear):
                    yield linear.frames[0], factor


class _ChainPlaces:
    """Where variables are in the vectors of a chain."""

    def __init__(self, layout: Layout, frames: int) -> None:
        self._layout, self._keys = layout, [frame_keys(number, frames) for number in range(len(layout.chains))]

    def spread(self, linear: LinearFactor) -> Iterator[gtsam.GaussianFactor]:
        """A factor on variables as factors on the vectors that hold them; what is kept is left out."""
        rows: dict[int, list[np.ndarray]] = {}
        columns: dict[int, list[np.ndarray]] = {}
        widths: dict[int, int] = {}
        for one, rows_of_one in linear.blocks():
            found = self._column(one)
            if found is not None:
                key, start, width = found
                rows.setdefault(key, []).append(np.arange(rows_of_one.start, rows_of_one.stop))
                columns.setdefault(key, []).append(np.arange(start, start + one.width))
                widths[key] = width
        keys = list(rows)
        for number, key in enumerate(keys):
            own, into = np.concatenate(rows[key]), np.concatenate(columns[key])
            H, g = np.zeros((widths[key], widths[key])), np.zeros(widths[key])
            H[np.ix_(into, into)], g[into] = linear.information[np.ix_(own, own)], linear.information_vector[own]
            yield gtsam.HessianFactor(key, H, g, 0.0)
            for other in keys[number + 1 :]:
                theirs, there = np.concatenate(rows[other]), np.concatenate(columns[other])
                block = np.zeros((widths[key], widths[other]))
                block[np.ix_(into, there)] = linear.information[np.ix_(own, theirs)]
                yield coupling_factor(key, other, block)

    def _column(self, one: Variable) -> tuple[int, int, int] | None:
        """The vector's key, the first column in it, and its width."""
        owner = one.owner
        if one.knot:
            group = next((g for g, (other, _) in enumerate(self._layout.owners) if other == owner), None)
            block = self._layout.block(owner, HEADINGS)
            return None if group is None or block is None else (knot_key(group, one.knot), one.item, block.width)
        columns = variable_columns(self._layout, one)
        if columns is None:
            return None
        chain, start = columns
        if chain != STATIC:
            return self._keys[chain][one.frame], start, self._layout.chains[chain].width
        for group, (_, own) in enumerate(self._layout.owners):
            if own.start <= start < own.stop:
                return static_key(group), start - own.start, own.stop - own.start
        return None


def variable_columns(layout: Layout, one: Variable) -> tuple[int, int] | None:
    """A variable's chain (or ``STATIC``) and first column there; None where it is kept."""
    owner = one.owner
    if one.is_of_a_frame:
        chain = layout.chain_of(owner)
        if chain is None:
            return None
        return chain, layout.chains[chain].names["root"].start if one.block == ROOT else 3 * one.item
    found = layout.columns_of(owner, one.block)
    return None if found is None else (found.chain, found.start + one.width * one.item * (not one.is_one_vector))


class StreamedTerms:
    """A user's factors in a stream: each is kept with the first frame that it sees."""

    def __init__(self, make: ExtraFactors, layout: Layout) -> None:
        self._make, self._layout = make, layout
        self._factors: dict[int, list[gtsam.NonlinearFactor]] = {}

    def append(self, number: int, time: float) -> None:
        """A new frame.

        Raises:
            InputError: for a factor over more frames than a stream's factors may see.
        """
        graph = self._make(np.array([time]), number)
        for index in range(graph.size()):
            factor = graph.at(index)
            variables = [variable_of(int(key)) for key in list(factor.keys())]
            seen = [one.frame for one in variables if one is not None and one.is_of_a_frame]
            first = min(seen, default=number)
            if not number - REACH <= first or max(seen, default=number) > number:
                raise InputError(
                    f"an extra factor came with frame {number} and sees frames {first} to {max(seen)}: in a stream, "
                    f"expected frames {number - REACH} to {number}"
                )
            self._factors.setdefault(first, []).append(factor)

    def drop_before(self, number: int) -> None:
        """Drop those of earlier frames: what they said is in the marginal."""
        for old in [one for one in self._factors if one < number]:
            del self._factors[old]

    def add_to(self, slices: Slices, state: SceneState, first: int, charts: Charts) -> None:
        """Add the factors of a stretch of frames, whose first has the number ``first``, to their slices."""
        for number in range(first, first + state.wearers[0].frames):
            for factor in self._factors.get(number, ()):
                linear = LinearFactor.at(factor, state, first)
                if linear is not None:
                    self._add(slices, linear, number - first, first, charts)

    def _add(self, slices: Slices, linear: LinearFactor, t: int, first: int, charts: Charts) -> None:
        rows, columns, turns = list[np.ndarray](), list[np.ndarray](), np.eye(len(linear.information_vector))
        for one, own in linear.blocks():
            found = variable_columns(self._layout, one)
            if found is None:
                continue
            chain, start = found
            ahead = one.frame - first - t
            base = (
                (REACH + 1) * slices.frame
                if chain == STATIC
                else (ahead * slices.frame + self._layout.chain_columns[chain].start)
            )
            rows.append(np.arange(own.start, own.stop))
            columns.append(base + start + np.arange(one.width))
            if one.block == JOINT:
                turns[own, own] = charts.turns[one.wearer][t + ahead, one.item]
            elif one.block != ROOT:
                chart = charts.of_item(one.owner, one.block, one.item, t + ahead)
                turns[own, own] = np.eye(one.width) if chart is None else chart
        if not rows:
            return
        J, into = turns[:, np.concatenate(rows)], np.concatenate(columns)
        place = np.minimum(into // slices.frame, REACH + 1)  # slices keep what is on and above the diagonal of blocks
        kept = place[:, None] <= place
        slices.hessian[t][np.ix_(into, into)] += kept * (J.T @ linear.information @ J)
        slices.gradient[t][into] -= J.T @ linear.information_vector
