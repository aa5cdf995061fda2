"""The variables of a problem as columns: what each frame has of its own, and named blocks of what all frames share."""

import itertools
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple, Protocol, Self

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.poses import pose_right_jacobian
from vip_factors.geometry.rotations import Array, exp, right_jacobian

ROOT = 3 * JOINT_COUNT  # first column of the root translation in a wearer's frame
FRAME = ROOT + 3  # width of a wearer's frame
POSE = 6  # width of a camera's pose: rotation, then translation
STATIC = -1  # instead of a chain's number: what all frames share


class Manifold(StrEnum):
    """How a variable moves by a step."""

    VECTOR = "vector"
    POINT = "point"
    ROTATION = "rotation"  # R ← R Exp(δ)
    POSE = "pose"  # T ← T Exp(δ), as GTSAM's Pose3, rotation first

    @property
    def width(self) -> int:
        """Columns of one variable."""
        return {Manifold.VECTOR: 1, Manifold.POINT: 3, Manifold.ROTATION: 3, Manifold.POSE: 6}[self]

    @property
    def is_flat(self) -> bool:
        """Whether steps simply add."""
        return self in (Manifold.VECTOR, Manifold.POINT)


class Retractable(Protocol):
    """Several variables that move by steps ``(n, c)`` of their tangents."""

    def retract(self, steps: Array) -> Self:
        """The variables moved."""
        ...


class Owner(StrEnum):
    """Whose variables they are."""

    WEARER = "wearer"
    CAMERA = "camera"
    DETECTOR = "detector"  # shared by all whom it looks at


class OwnerId(NamedTuple):
    """One of the owners of a kind."""

    kind: Owner
    number: int = 0


@dataclass(frozen=True)
class StaticBlock:
    """Variables of one kind that all frames share.

    Attributes:
        name: of the attribute of the owner's state that holds them.
        manifold: of each.
        items: how many: one for each sensor, say.
        free: whether they move; else they are kept as they are.
        step: one unit of damping is a prior of this size on each column of a step (rad, m, s); a number, or one for
            each column of an item.
        process_noise: how far each column may wander, per √second, in a stream.
        relinearise: a column that moved by more is linearised anew, in a stream.
    """

    name: str
    manifold: Manifold
    items: int
    free: bool
    step: float | tuple[float, ...]
    process_noise: float | tuple[float, ...] = 0.0
    relinearise: float | tuple[float, ...] = np.inf

    @property
    def item_width(self) -> int:
        """Columns of one item."""
        return self.manifold.width

    @property
    def width(self) -> int:
        """Columns in the tangent: none where it is kept."""
        return self.items * self.item_width if self.free else 0

    def per_column(self, value: float | tuple[float, ...]) -> Array:
        """A number, or one for each column of an item, as one for each of all columns."""
        return np.tile(np.broadcast_to(np.asarray(value, dtype=float), self.item_width), self.items)

    def retract(self, value: Array | float | Retractable, step: Array) -> Array | float | Retractable:
        """The variables moved by steps ``(width,)``; every solver moves them by this.

        Vectors are ``(items,)`` or, a single one, a number; points ``(items, 3)``; rotations ``(items, 3, 3)`` or
        ``(3, 3)``; poses
        :class:`~vip_factors.problem.state.CameraPoses`.
        """
        item_steps = step.reshape(self.items, self.item_width)
        if isinstance(value, float):
            return float(value + step[0])
        if not isinstance(value, np.ndarray):
            return value.retract(item_steps)
        if self.manifold is Manifold.ROTATION:
            return value @ exp(item_steps.reshape(*value.shape[:-2], 3))
        return value + step.reshape(value.shape)

    def chart(self, coordinates: Array) -> Array:
        """Derivative ``(items, c, c)`` of a step from a moved value by its coordinates ``(width,)`` around a fixed one.

        ``X ⊞ (x + dx) = (X ⊞ x) ⊞ (chart dx)``: far from the fixed value a step and a difference of coordinates differ.
        """
        item_coordinates = coordinates.reshape(self.items, self.item_width)
        if self.manifold.is_flat:
            return np.broadcast_to(np.eye(self.item_width), (self.items, self.item_width, self.item_width))
        return (
            right_jacobian(item_coordinates)
            if self.manifold is Manifold.ROTATION
            else pose_right_jacobian(item_coordinates)
        )


@dataclass(frozen=True)
class FrameBlock:
    """What one owner has of its own in every frame: ``width`` columns, of which some have names."""

    owner: OwnerId
    width: int
    step: Array
    names: dict[str, slice]


@dataclass(frozen=True)
class ColumnRange:
    """Columns of a block: in the frames of ``chain``, or in the static vector where that is ``STATIC``."""

    chain: int
    start: int
    stop: int

    @property
    def columns(self) -> slice:
        """The same as a slice."""
        return slice(self.start, self.stop)


@dataclass(frozen=True)
class Layout:
    """All variables of a problem that move.

    A frame's vector is what each owner has in it, side by side: the chains. The static vector is the free blocks side
    by side, those of one owner together.

    Attributes:
        chains: what each owner has in a frame.
        blocks: of all owners, by owner.
    """

    chains: tuple[FrameBlock, ...]
    blocks: tuple[tuple[OwnerId, tuple[StaticBlock, ...]], ...]

    @cached_property
    def frame_width(self) -> int:
        """Of a whole frame."""
        return sum(chain.width for chain in self.chains)

    @cached_property
    def chain_columns(self) -> tuple[slice, ...]:
        """Of each chain in a frame's vector."""
        return _consecutive([chain.width for chain in self.chains])

    @cached_property
    def static_width(self) -> int:
        """Of the static vector."""
        return sum(block.width for _, block, _ in self.placed)

    @cached_property
    def placed(self) -> tuple[tuple[OwnerId, StaticBlock, slice], ...]:
        """Every block with its columns in the static vector; none of a kept one."""
        every = [(owner, block) for owner, blocks in self.blocks for block in blocks]
        columns = _consecutive([block.width for _, block in every])
        return tuple((*owned_block, block_columns) for owned_block, block_columns in zip(every, columns, strict=True))

    @cached_property
    def owners(self) -> tuple[tuple[OwnerId, slice], ...]:
        """Those that have free blocks, each with its columns in the static vector."""
        widths = [sum(block.width for block in blocks) for _, blocks in self.blocks]
        columns = _consecutive(widths)
        return tuple(
            (owner, owner_columns)
            for (owner, _), owner_columns, width in zip(self.blocks, columns, widths, strict=True)
            if width
        )

    @cached_property
    def _ranges(self) -> dict[tuple[OwnerId, str], tuple[ColumnRange, StaticBlock | None]]:
        ranges: dict[tuple[OwnerId, str], tuple[ColumnRange, StaticBlock | None]] = {}
        for owner, block, columns in self.placed:
            if block.free:
                ranges[owner, block.name] = ColumnRange(STATIC, columns.start, columns.stop), block
        for number, chain in enumerate(self.chains):
            for name, columns in chain.names.items():
                ranges[chain.owner, name] = ColumnRange(number, columns.start, columns.stop), None
        return ranges

    def columns_of(self, owner: OwnerId, name: str) -> ColumnRange | None:
        """Where a block's columns are; None where it does not move."""
        entry = self._ranges.get((owner, name))
        return None if entry is None else entry[0]

    def block(self, owner: OwnerId, name: str) -> StaticBlock | None:
        """A free static block."""
        entry = self._ranges.get((owner, name))
        return None if entry is None else entry[1]

    def chain_of(self, owner: OwnerId) -> int | None:
        """Number of an owner's chain; None where it has none."""
        return next((number for number, chain in enumerate(self.chains) if chain.owner == owner), None)

    def of_owners(self, owners: Collection[OwnerId]) -> "Layout":
        """The same of some owners alone."""
        blocks = tuple((owner, owned) for owner, owned in self.blocks if owner in owners)
        return Layout(tuple(chain for chain in self.chains if chain.owner in owners), blocks)

    def frame_columns(self, owners: Collection[OwnerId]) -> np.ndarray:
        """Of some owners in a frame's vector."""
        return _joined(
            chain_columns
            for chain, chain_columns in zip(self.chains, self.chain_columns, strict=True)
            if chain.owner in owners
        )

    def static_columns(self, owners: Collection[OwnerId]) -> np.ndarray:
        """Of some owners in the static vector."""
        return _joined(owner_columns for owner, owner_columns in self.owners if owner in owners)

    def columns(self, owner: OwnerId, name: str) -> np.ndarray:
        """Columns of a static block in the static vector; empty where it does not move."""
        column_range = self.columns_of(owner, name)
        if column_range is None or column_range.chain != STATIC:
            return np.zeros(0, dtype=int)
        return np.arange(column_range.start, column_range.stop)

    def item_columns(self, owner: OwnerId, name: str, item: int) -> np.ndarray:
        """Columns of one item of a static block; empty where the block does not move."""
        block, columns = self.block(owner, name), self.columns(owner, name)
        return columns if block is None else columns[item * block.item_width : (item + 1) * block.item_width]

    def per_column(self, attribute: str) -> Array:
        """``step``, ``process_noise`` or ``relinearise`` of the blocks, for each column of the static vector."""
        values = [block.per_column(getattr(block, attribute)) for _, block, _ in self.placed if block.free]
        return np.concatenate([np.zeros(0), *values])


def _joined(columns: Iterable[slice]) -> np.ndarray:
    return np.concatenate(
        [np.zeros(0, int), *(np.arange(column_slice.start, column_slice.stop) for column_slice in columns)]
    )


def _consecutive(widths: Sequence[int]) -> tuple[slice, ...]:
    ends = np.cumsum([0, *widths]).tolist()
    return tuple(slice(start, stop) for start, stop in itertools.pairwise(ends))
