"""User-defined GTSAM factors, linearised by GTSAM and added to the normal equations of the solvers."""

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
"""Function of the times ``(n,)`` in seconds of new frames and the number of the first one; returns a user's factors.

The factors are on variables of these frames, of earlier ones, and on static variables, with the keys of
:mod:`vip_factors.factor_graph.keys`. For a recording it is called once with all frames, for a stream frame by frame.
"""


@dataclass(frozen=True)
class LinearFactor:
    """Linearised factor: information ``(n, n)`` and right-hand side ``(n,)`` on the steps of its variables."""

    variables: tuple[Variable, ...]
    information: Array
    information_vector: Array

    @classmethod
    def at(cls, factor: gtsam.NonlinearFactor, state: SceneState, first_frame: int = 0) -> "LinearFactor | None":
        """Linearise a factor at a state that begins with frame ``first_frame``; None if the factor is not active.

        Raises:
            InputError: for a variable that the scene does not have, or a derivative that is not finite.
        """
        variables = tuple(_checked(int(key), state, first_frame) for key in list(factor.keys()))
        linear = factor.linearize(values_of(state, variables, first_frame))
        if linear is None:
            return None
        order = [int(key) for key in list(linear.keys())]
        augmented = np.asarray(linear.augmentedInformation())
        if not np.all(np.isfinite(augmented)):
            names = ", ".join(gtsam.DefaultKeyFormatter(key) for key in order)
            raise InputError(f"an extra factor on {names} has a residual or a derivative that is not finite")
        by_key = {variable.key: variable for variable in variables}
        return cls(tuple(by_key[key] for key in order), augmented[:-1, :-1], augmented[:-1, -1])

    def blocks(self) -> Iterator[tuple[Variable, slice]]:
        """Yield the variables with their rows."""
        start = 0
        for variable in self.variables:
            yield variable, slice(start, start + variable.width)
            start += variable.width


def _checked(key: int, state: SceneState, first_frame: int) -> Variable:
    variable, frames = variable_of(key), max([1, *(wearer.frames for wearer in state.wearers)])
    name = gtsam.DefaultKeyFormatter(key)
    if variable is None:
        raise InputError(f"an extra factor has the key {name}: expected a key of vip_factors.factor_graph.keys")
    kind, number, count = variable.owner.kind, variable.owner.number, state.count(variable.owner.kind)
    if number >= count:
        raise InputError(f"an extra factor is on {kind} {number} ({name}): there are {count}, counted from 0")
    if variable.is_of_a_frame and not first_frame <= variable.frame < first_frame + frames:
        raise InputError(
            f"an extra factor is on frame {variable.frame} ({name}): expected one of {first_frame} to "
            f"{first_frame + frames - 1}"
        )
    is_sensors = variable.block in ROWS and ROWS[variable.block].of_sensors
    if is_sensors and variable.item >= len(state.wearers[variable.wearer].headings):
        raise InputError(f"an extra factor is on sensor {variable.item} ({name}): the wearer has fewer")
    return variable


class UserTerms:
    """User-defined factors on a recording."""

    def __init__(self, make: ExtraFactors) -> None:
        self._make = make
        self._cached: tuple[bytes, gtsam.NonlinearFactorGraph] | None = None

    def factors(self, problem: SceneProblem) -> gtsam.NonlinearFactorGraph:
        """Return the factors on a problem's frames, cached by their times."""
        time = np.asarray(problem.wearers[0].frames.time)
        if self._cached is None or self._cached[0] != time.tobytes():
            self._cached = time.tobytes(), self._make(time, 0)
        return self._cached[1]

    def cost(self, problem: SceneProblem, state: SceneState) -> float:
        """Cost of the factors at a state; see :class:`~vip_factors.problem.scene.ExtraTerms`."""
        graph = self.factors(problem)
        variables = {int(key): _checked(int(key), state, 0) for key in list(graph.keyVector())}
        return float(graph.error(values_of(state, variables.values())))

    def linearised(self, problem: SceneProblem, layout: Layout, state: SceneState) -> "LinearFactors":
        """Linearise the factors at a state; see :class:`~vip_factors.problem.scene.ExtraTerms`."""
        graph, factors = self.factors(problem), LinearFactors(layout)
        for index in range(graph.size()):
            linear = LinearFactor.at(graph.at(index), state)
            if linear is not None:
                factors.append(linear, _first_frame(linear.variables, problem))
        return factors


class LinearFactors:
    """Linearised user-defined factors: local ones, and rows of those that connect distant frames.

    Attributes:
        multipliers: number of these rows; each becomes a Lagrange multiplier.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout, self._near = layout, list[tuple[int, LinearFactor]]()
        self._rows = list[tuple[dict[int, Array], Array, Array]]()  # A by frame and by shared columns, b
        self.multipliers = 0

    def append(self, linear: LinearFactor, first_frame: int) -> None:
        """Add a factor whose first frame is ``first_frame``."""
        frames = [
            variable.frame for variable in linear.variables if variable.is_of_a_frame or variable.is_of_the_camera_path
        ]
        if max(frames, default=first_frame) - first_frame <= REACH:
            self._near.append((first_frame, linear))
            return
        squares, vectors = np.linalg.eigh(linear.information)
        is_positive = squares > 1e-12 * squares[-1]
        A, layout = np.sqrt(squares[is_positive])[:, None] * vectors[:, is_positive].T, self._layout
        by_frame, by_shared = dict[int, Array](), np.zeros((len(A), layout.static_width))
        for variable, rows in linear.blocks():
            columns = variable_columns(layout, variable)
            if columns is not None and columns[0] == STATIC:
                by_shared[:, columns[1] : columns[1] + variable.width] = A[:, rows]
            elif columns is not None:
                start = layout.chain_columns[columns[0]].start + columns[1]
                row = by_frame.setdefault(variable.frame, np.zeros((len(A), layout.frame_width)))
                row[:, start : start + variable.width] = A[:, rows]
        b = vectors[:, is_positive].T @ linear.information_vector / np.sqrt(squares[is_positive])
        self._rows.append((by_frame, by_shared, b))
        self.multipliers += len(A)

    def add_to(self, blocks: Blocks, begin: int) -> None:
        """Add the factors to blocks; see :class:`~vip_factors.problem.scene.LinearTerms`."""
        stretch, shared = range(begin, begin + len(blocks.frames)), self._layout.static_width
        start = shared
        for first_frame, linear in self._near:
            if first_frame in stretch:
                add_factor(blocks, self._layout, linear, first_frame - begin, begin)
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
    """Frame with which a factor is summed: its first one, or the first one with its heading."""
    frames = [variable.frame for variable in variables if variable.is_of_a_frame or variable.is_of_the_camera_path]
    first_frame = min(frames, default=0)
    for variable in variables:
        if variable.block == HEADINGS and problem.wearers[variable.wearer].headings_drift:
            numbers = problem.wearers[variable.wearer].heading_numbers()
            if not frames:
                first_frame = int(np.searchsorted(numbers, variable.step))
            if numbers[first_frame] != variable.step:
                raise InputError("an extra factor is on a heading that is not that of its first frame")
    return first_frame


def variable_columns(layout: Layout, variable: Variable) -> tuple[int, int] | None:
    """Chain (or ``STATIC``) and first column of a variable; None if it is constant."""
    owner = variable.owner
    if variable.is_of_a_frame:
        chain = layout.chain_of(owner)
        if chain is None:
            return None
        return chain, layout.chains[chain].names["root"].start if variable.block == ROOT else 3 * variable.item
    columns = layout.columns_of(owner, variable.block)
    if columns is None:
        return None
    return columns.chain, columns.start + (0 if variable.is_one_vector else variable.width * variable.item)


class StreamedTerms:
    """User-defined factors in a stream, stored by their first frame."""

    def __init__(self, make: ExtraFactors, layout: Layout) -> None:
        self._make, self._layout = make, layout
        self._factors: dict[int, list[gtsam.NonlinearFactor]] = {}

    def append(self, number: int, time: float) -> None:
        """Add the factors of a new frame.

        Raises:
            InputError: for a factor that spans more frames than a stream allows.
        """
        graph = self._make(np.array([time]), number)
        for index in range(graph.size()):
            factor = graph.at(index)
            variables = [variable_of(int(key)) for key in list(factor.keys())]
            frames = [variable.frame for variable in variables if variable is not None and variable.is_of_a_frame]
            first_frame = min(frames, default=number)
            if not number - REACH <= first_frame or max(frames, default=number) > number:
                raise InputError(
                    f"an extra factor came with frame {number} and is on frames {first_frame} to {max(frames)}: in a "
                    f"stream, expected frames {number - REACH} to {number}"
                )
            self._factors.setdefault(first_frame, []).append(factor)

    def drop_before(self, number: int) -> None:
        """Drop factors of earlier frames, which are marginalised."""
        for old in [key for key in self._factors if key < number]:
            del self._factors[old]

    def add_to(self, blocks: Blocks, state: SceneState, first_frame: int, charts: Charts) -> None:
        """Add the factors of the stretch that begins with frame ``first_frame``."""
        for number in range(first_frame, first_frame + len(blocks.frames)):
            for factor in self._factors.get(number, ()):
                linear = LinearFactor.at(factor, state, first_frame)
                if linear is not None:
                    add_factor(blocks, self._layout, linear, number - first_frame, first_frame, charts)


def add_factor(
    blocks: Blocks, layout: Layout, linear: LinearFactor, t: int, begin: int, charts: Charts | None = None
) -> None:
    """Add a factor whose first frame is the ``t``-th of the blocks; blocks and charts begin at frame ``begin``."""
    placed = list[tuple[int | None, slice, Array]]()  # frame of the factor or None, columns, Jacobian
    for variable, columns in linear.blocks():
        placed_columns = variable_columns(layout, variable)
        if placed_columns is None:
            continue
        chain, start = placed_columns
        turn = np.eye(len(linear.information_vector))[:, columns]
        frame, place = t, None
        if chain != STATIC:
            frame = variable.frame - begin
            place, start = frame - t, start + layout.chain_columns[chain].start
        if charts is not None:
            chart = charts.turns[variable.wearer][frame, variable.item] if variable.block == JOINT else None
            if variable.block not in (JOINT, ROOT):
                chart = charts.item_jacobian(variable.owner, variable.block, variable.item, frame)
            turn = turn if chart is None else turn @ chart
        placed.append((place, slice(start, start + variable.width), turn))
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
