"""Charts: coordinates around fixed points, in which a stream solves instead of in steps.

Terms differentiate by steps ``δ`` from the current value, ``x ⊞ δ``. If ``x = X ⊞ c`` with a fixed point ``X``, a
change ``dc`` of the coordinates is the step ``J_r(c) dc``, so ``J_r`` multiplies every derivative from the right.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, joint_index
from vip_factors.geometry.poses import pose_right_jacobian
from vip_factors.geometry.rotations import Array, right_jacobian
from vip_factors.problem.layout import ROOT, Layout, Owner, OwnerId
from vip_factors.terms.equations import JacobianBlock


@dataclass(frozen=True)
class Charts:
    """Derivatives of steps with respect to coordinates.

    Attributes:
        turns: joint rotations ``(T, 24, 3, 3)`` by wearer.
        poses: poses ``(T, 6, 6)`` by moving camera.
        static: static blocks ``(items, c, c)`` by owner and block.
    """

    turns: Mapping[int, Array]
    poses: Mapping[OwnerId, Array]
    static: Mapping[tuple[OwnerId, str], Array]

    @classmethod
    def at(cls, layout: Layout, frames: Array, static: Array) -> "Charts":
        """Evaluate at coordinates ``(T, w)`` of frames and ``(s,)`` of static variables."""
        turns, poses = {}, {}
        bodies = [number for number, chain in enumerate(layout.chains) if chain.owner.kind is Owner.WEARER]
        vectors = [
            frames[:, layout.chain_columns[number]][:, :ROOT].reshape(len(frames), JOINT_COUNT, 3) for number in bodies
        ]
        if bodies:
            stacked = right_jacobian(np.stack(vectors))
            turns = {
                layout.chains[number].owner.number: jacobians for number, jacobians in zip(bodies, stacked, strict=True)
            }
        for number, chain in enumerate(layout.chains):
            if chain.owner.kind is Owner.CAMERA:
                poses[chain.owner] = pose_right_jacobian(frames[:, layout.chain_columns[number]])
        blocks = {
            (owner, block.name): block.chart(static[columns])
            for owner, block, columns in layout.placed
            if block.free and not block.manifold.is_flat
        }
        return cls(turns, poses, blocks)

    def joints(self, wearer: int, start: int, count: int) -> Array:
        """Derivatives ``(count, 23, 3, 3)`` for joints 1 … 23 of a body in a stretch of frames."""
        return self.turns[wearer][start : start + count, 1:]

    def screws(self, wearer: int, start: int, screws: Array) -> Array:
        """Transform screws ``(t, 25, 6, 3)`` of a stretch of frames to coordinates."""
        by_joints = screws[:, :-1] @ self.turns[wearer][start : start + len(screws)]
        return np.concatenate([by_joints, screws[:, -1:]], axis=1)

    def item_jacobian(self, owner: OwnerId, block: str, index: int, frame: int) -> Array | None:
        """Derivative for one item of a static block or a camera's pose in a frame; None if it is the identity."""
        static = self.static.get((owner, block))
        if static is not None:
            return static[index]
        return self.poses[owner][frame] if block == "poses" and owner in self.poses else None

    def jacobian(self, block: JacobianBlock, first_frame: int) -> Array:
        """Transform a block's derivative ``(t, n, m, c)`` to coordinates."""
        frames = slice(first_frame + block.ahead, first_frame + block.ahead + len(block.jacobian))
        static = self.static.get((block.owner, block.block))
        if static is not None:
            return block.jacobian @ static
        if block.block == "poses" and block.owner in self.poses:
            return block.jacobian @ self.poses[block.owner][frames, None]
        if block.block in JOINT_NAMES:
            return block.jacobian @ self.turns[block.owner.number][frames, None, joint_index(block.block)]
        return block.jacobian
