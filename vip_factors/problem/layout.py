"""Columns of a problem's variables: those of each frame, and named blocks that all frames share (static)."""

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
STATIC = -1  # instead of a chain's number, for static variables


class Manifold(StrEnum):
    """Manifold of a variable, by which a step moves it."""

    VECTOR = "vector"
    POINT = "point"
    ROTATION = "rotation"  # R ← R Exp(δ)
    POSE = "pose"  # T ← T Exp(δ), as GTSAM's Pose3, rotation first

    @property
    def width(self) -> int:
        """Dimension of the tangent space."""
        return {Manifold.VECTOR: 1, Manifold.POINT: 3, Manifold.ROTATION: 3, Manifold.POSE: 6}[self]

    @property
    def is_flat(self) -> bool:
        """True if a step is added to the value."""
        return self in (Manifold.VECTOR, Manifold.POINT)


class Retractable(Protocol):
    """Several variables that move by steps ``(n, c)`` of their tangents."""

    def retract(self, steps: Array) -> Self:
        """Return the variables moved by steps."""
        ...


class Owner(StrEnum):
    """Kind of owner of variables."""

    WEARER = "wearer"
    CAMERA = "camera"
    DETECTOR = "detector"  # shared by all cameras


class OwnerId(NamedTuple):
    """Owner of variables: its kind, and its number among those of the kind."""

    kind: Owner
    number: int = 0


@dataclass(frozen=True)
class StaticBlock:
    """Static variables of one kind and owner.

    Attributes:
        name: attribute of the owner's state that holds them.
        manifold: of each item.
        items: their number, such as one for each sensor.
        free: True if they are variables, False if they are constant.
        step: one unit of damping is a prior of this size on each column of a step (rad, m, s); a number, or one for
            each column of an item.
        process_noise: random walk of each column in a stream, per √second.
        relinearise: change of a column in a stream, beyond which it is linearised again.
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
        """Number of columns of one item."""
        return self.manifold.width

    @property
    def width(self) -> int:
        """Number of columns: zero for constants."""
        return self.items * self.item_width if self.free else 0

    def per_column(self, value: float | tuple[float, ...]) -> Array:
        """Expand a number, or one for each column of an item, to all columns."""
        return np.tile(np.broadcast_to(np.asarray(value, dtype=float), self.item_width), self.items)

    def retract(self, value: Array | float | Retractable, step: Array) -> Array | float | Retractable:
        """Move variables by steps ``(width,)``.

        Vectors are ``(items,)`` or a single number; points ``(items, 3)``; rotations ``(items, 3, 3)`` or ``(3, 3)``;
        poses :class:`~vip_factors.problem.state.CameraPoses`.
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
        jacobian = right_jacobian if self.manifold is Manifold.ROTATION else pose_right_jacobian
        return jacobian(item_coordinates)


@dataclass(frozen=True)
class FrameBlock:
    """Columns of one owner in every frame: ``width`` of them; ``names`` are those of named variables."""

    owner: OwnerId
    width: int
    step: Array
    names: dict[str, slice]


@dataclass(frozen=True)
class ColumnRange:
    """Columns of a block in the frames of a ``chain``, or in the static vector if that is ``STATIC``."""

    chain: int
    start: int
    stop: int

    @property
    def columns(self) -> slice:
        """The columns as a slice."""
        return slice(self.start, self.stop)


@dataclass(frozen=True)
class Layout:
    """Columns of all variables of a problem.

    A frame's vector concatenates the chains, the static vector the free blocks, owner by owner.

    Attributes:
        chains: columns of each owner in a frame.
        blocks: static blocks by owner.
    """

    chains: tuple[FrameBlock, ...]
    blocks: tuple[tuple[OwnerId, tuple[StaticBlock, ...]], ...]

    @cached_property
    def frame_width(self) -> int:
        """Number of columns of a frame's vector."""
        return sum(chain.width for chain in self.chains)

    @cached_property
    def chain_columns(self) -> tuple[slice, ...]:
        """Columns of each chain in a frame's vector."""
        return _consecutive([chain.width for chain in self.chains])

    @cached_property
    def static_width(self) -> int:
        """Number of columns of the static vector."""
        return sum(block.width for _, block, _ in self.placed)

    @cached_property
    def placed(self) -> tuple[tuple[OwnerId, StaticBlock, slice], ...]:
        """All static blocks with their columns in the static vector; constant ones have none."""
        every = [(owner, block) for owner, blocks in self.blocks for block in blocks]
        columns = _consecutive([block.width for _, block in every])
        return tuple((*owned_block, block_columns) for owned_block, block_columns in zip(every, columns, strict=True))

    @cached_property
    def owners(self) -> tuple[tuple[OwnerId, slice], ...]:
        """Owners of free blocks with their columns in the static vector."""
        widths = [sum(block.width for block in blocks) for _, blocks in self.blocks]
        columns = _consecutive(widths)
        return tuple(
            (owner, owner_columns)
            for (owner, _), owner_columns, width in zip(self.blocks, columns, widths, strict=True)
            if width
        )

    @cached_property
    def _ranges(self) -> dict[tuple[OwnerId, str], ColumnRange]:
        ranges = {
            (owner, block.name): ColumnRange(STATIC, columns.start, columns.stop)
            for owner, block, columns in self.placed
            if block.free
        }
        for number, chain in enumerate(self.chains):
            for name, columns in chain.names.items():
                ranges[chain.owner, name] = ColumnRange(number, columns.start, columns.stop)
        return ranges

    def columns_of(self, owner: OwnerId, name: str) -> ColumnRange | None:
        """Columns of a block; None if it is constant."""
        return self._ranges.get((owner, name))

    def chain_of(self, owner: OwnerId) -> int | None:
        """Number of an owner's chain; None without one."""
        return next((number for number, chain in enumerate(self.chains) if chain.owner == owner), None)

    def of_owners(self, owners: Collection[OwnerId]) -> "Layout":
        """Layout of some of the owners."""
        blocks = tuple((owner, owned) for owner, owned in self.blocks if owner in owners)
        return Layout(tuple(chain for chain in self.chains if chain.owner in owners), blocks)

    def frame_columns(self, owners: Collection[OwnerId]) -> np.ndarray:
        """Columns of some owners in a frame's vector."""
        return _joined(
            chain_columns
            for chain, chain_columns in zip(self.chains, self.chain_columns, strict=True)
            if chain.owner in owners
        )

    def static_columns(self, owners: Collection[OwnerId]) -> np.ndarray:
        """Columns of some owners in the static vector."""
        return _joined(owner_columns for owner, owner_columns in self.owners if owner in owners)

    def columns(self, owner: OwnerId, name: str) -> np.ndarray:
        """Columns of a static block in the static vector; empty if it is constant."""
        column_range = self.columns_of(owner, name)
        if column_range is None or column_range.chain != STATIC:
            return np.zeros(0, dtype=int)
        return np.arange(column_range.start, column_range.stop)

    def item_columns(self, owner: OwnerId, name: str, item: int) -> np.ndarray:
        """Columns of one item of a static block; empty if the block is constant."""
        width = next(
            block.item_width for block_owner, block, _ in self.placed if (block_owner, block.name) == (owner, name)
        )
        return self.columns(owner, name)[item * width : (item + 1) * width]

    def per_column(self, attribute: str) -> Array:
        """Attribute ``step``, ``process_noise`` or ``relinearise`` of the blocks, by column of the static vector."""
        values = [block.per_column(getattr(block, attribute)) for _, block, _ in self.placed if block.free]
        return np.concatenate([np.zeros(0), *values])


def _joined(columns: Iterable[slice]) -> np.ndarray:
    return np.concatenate(
        [np.zeros(0, int), *(np.arange(column_slice.start, column_slice.stop) for column_slice in columns)]
    )


def _consecutive(widths: Sequence[int]) -> tuple[slice, ...]:
    ends = np.cumsum([0, *widths]).tolist()
    return tuple(slice(start, stop) for start, stop in itertools.pairwise(ends))
