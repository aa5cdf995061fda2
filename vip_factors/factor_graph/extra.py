"""A user's own GTSAM factors among ours: linearised by GTSAM, and added to what the fast solvers eliminate."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.errors import InputError
from vip_factors.factor_graph.variables import HEADINGS, JOINT, ROOT, Variable, values_of, variable_of
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, Layout
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import ROWS
from vip_factors.solve.slices import REACH, Blocks

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
    name = gtsam.DefaultKeyFormatter(key)
    if one is None:
        raise InputError(f"an extra factor has the key {name}: expected a key of vip_factors.factor_graph.keys")
    kind, number, count = one.owner.kind, one.owner.number, state.count(one.owner.kind)
    if number >= count:
        raise InputError(f"an extra factor is on {kind} {number} ({name}): there are {count}, counted from 0")
    if one.is_of_a_frame and not first <= one.frame < first + frames:
        raise InputError(
            f"an extra factor is on frame {one.frame} ({name}): expected one of {first} to {first + frames - 1}"
        )
    if one.block in ROWS and ROWS[one.block].of_sensors and one.item >= len(state.wearers[one.wearer].headings):
        raise InputError(f"an extra factor is on sensor {one.item} ({name}): the wearer has fewer")
    return one


class UserTerms:
    """A user's factors on a whole recording."""

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

    def linearised(self, problem: SceneProblem, layout: Layout, state: SceneState) -> "LinearFactors":
        """See :class:`~vip_factors.problem.scene.ExtraTerms`."""
        graph, found = self.factors(problem), LinearFactors(layout)
        for index in range(graph.size()):
            linear = LinearFactor.at(graph.at(index), state)
            if linear is not None:
                found.append(linear, _first_frame(linear.variables, problem))
        return found


class LinearFactors:
    """A user's linearised factors: those over frames near one another, and rows of those that tie frames further apart.

    Attributes:
        multipliers: how many rows.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout, self._near = layout, list[tuple[int, LinearFactor]]()
        self._rows = list[tuple[dict[int, Array], Array, Array]]()  # A by frame and by shared columns, b
        self.multipliers = 0

    def append(self, linear: LinearFactor, first: int) -> None:
        """A factor whose first frame is ``first``."""
        frames = [one.frame for one in linear.variables if one.is_of_a_frame or one.is_of_the_camera_path]
        if max(frames, default=first) - first <= REACH:
            self._near.append((first, linear))
            return
        squares, vectors = np.linalg.eigh(linear.information)
        kept = squares > 1e-12 * squares[-1]
        A, layout = np.sqrt(squares[kept])[:, None] * vectors[:, kept].T, self._layout
        by_frame, by_shared = dict[int, Array](), np.zeros((len(A), layout.static_width))
        for one, own in linear.blocks():
            found = variable_columns(layout, one)
            if found is not None and found[0] == STATIC:
                by_shared[:, found[1] : found[1] + one.width] = A[:, own]
            elif found is not None:
                start = layout.chain_columns[found[0]].start + found[1]
                row = by_frame.setdefault(one.frame, np.zeros((len(A), layout.frame_width)))
                row[:, start : start + one.width] = A[:, own]
        b = vectors[:, kept].T @ linear.information_vector / np.sqrt(squares[kept])
        self._rows.append((by_frame, by_shared, b))
        self.multipliers += len(A)

    def add_to(self, blocks: Blocks, begin: int) -> None:
        """See :class:`~vip_factors.problem.scene.LinearTerms`."""
        stretch, shared = range(begin, begin + len(blocks.frames)), self._layout.static_width
        start = shared
        for first, linear in self._near:
            if first in stretch:
                add_factor(blocks, self._layout, linear, first - begin, begin)
        for by_frame, by_shared, b in self._rows:
            columns = slice(start, start + len(b))
            for frame, row in by_frame.items():
                if frame in stretch:
                    blocks.coupling[frame - begin, 0, :, columns] += row.T
            if begin == 0:
                blocks.static[0, :shared, columns] += by_shared.T
                blocks.static[0, columns, columns] -= np.eye(len(b))
                blocks.static_gradient[0, columns] -= b
            start += len(b)


def _first_frame(variables: Sequence[Variable], problem: SceneProblem) -> int:
    """The frame that a factor is summed with: the first one that it sees, or the first with a heading that it sees."""
    frames = [one.frame for one in variables if one.is_of_a_frame or one.is_of_the_camera_path]
    first = min(frames, default=0)
    for one in variables:
        if one.block == HEADINGS and problem.wearers[one.wearer].headings_drift:
            numbers = problem.wearers[one.wearer].heading_numbers()
            if not frames:
                first = int(np.searchsorted(numbers, one.step))
            if numbers[first] != one.step:
                raise InputError("an extra factor sees a heading that is not that of its first frame")
    return first


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

    def add_to(self, blocks: Blocks, state: SceneState, first: int, charts: Charts) -> None:
        """Add the factors of a stretch of frames, whose first has the number ``first``."""
        for number in range(first, first + len(blocks.frames)):
            for factor in self._factors.get(number, ()):
                linear = LinearFactor.at(factor, state, first)
                if linear is not None:
                    add_factor(blocks, self._layout, linear, number - first, first, charts)


def add_factor(
    blocks: Blocks, layout: Layout, linear: LinearFactor, t: int, begin: int, charts: Charts | None = None
) -> None:
    """Add a factor whose first frame is the ``t``-th of those from ``begin`` on, of which ``charts`` are."""
    placed = list[tuple[int | None, slice, Array]]()  # its i-th frame or none, columns there, J
    for one, own in linear.blocks():
        found = variable_columns(layout, one)
        if found is None:
            continue
        chain, start = found
        turn = np.eye(len(linear.information_vector))[:, own]
        frame, place = t, None
        if chain != STATIC:
            frame = one.frame - begin
            place, start = frame - t, start + layout.chain_columns[chain].start
        if charts is not None:
            chart = charts.turns[one.wearer][frame, one.item] if one.block == JOINT else None
            if one.block not in (JOINT, ROOT):
                chart = charts.item_jacobian(one.owner, one.block, one.item, frame)
            turn = turn if chart is None else turn @ chart
        placed.append((place, slice(start, start + one.width), turn))
    shared = min(t, len(blocks.static) - 1)
    for i, rows, J in placed:
        vector = J.T @ linear.information_vector
        (blocks.static_gradient[shared] if i is None else blocks.gradient[t, i])[rows] -= vector
        for j, columns, K in placed:
            block = J.T @ linear.information @ K
            if i is None and j is None:
                blocks.static[shared, rows, columns] += block
            elif i is not None and j is None:
                blocks.coupling[t, i, rows, columns] += block
            elif i is not None and j is not None and i <= j:
                start = j * layout.frame_width
                blocks.frames[t, i, rows, start + columns.start : start + columns.stop] += block
