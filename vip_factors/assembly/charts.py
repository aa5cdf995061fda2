"""Coordinates instead of steps: a stream keeps each variable as coordinates around a point that stays where it is.

Terms differentiate by steps from where a variable stands, ``x ⊞ δ``. Where it is ``X ⊞ c``, a change ``dc`` of its
coordinates is the step ``J_r(c) dc``: the chain rule puts ``J_r`` behind every derivative, near the point and far away.
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
    """Derivatives of steps by coordinates, at given coordinates.

    Attributes:
        turns: by wearer ``(T, 24, 3, 3)`` of the joints.
        poses: by camera ``(T, 6, 6)``, of those that move.
        static: by owner and block ``(items, c, c)``.
    """

    turns: Mapping[int, Array]
    poses: Mapping[OwnerId, Array]
    static: Mapping[tuple[OwnerId, str], Array]

    @classmethod
    def at(cls, layout: Layout, frames: Array, static: Array) -> "Charts":
        """At coordinates ``(T, w)`` of frames and ``(s,)`` of what they share."""
        turns, poses = {}, {}
        bodies = [number for number, one in enumerate(layout.chains) if one.owner.kind is Owner.WEARER]
        vectors = [
            frames[:, layout.chain_columns[number]][:, :ROOT].reshape(len(frames), JOINT_COUNT, 3) for number in bodies
        ]
        if bodies:
            stacked = right_jacobian(np.stack(vectors))
            turns = {layout.chains[number].owner.number: own for number, own in zip(bodies, stacked, strict=True)}
        for number, one in enumerate(layout.chains):
            if one.owner.kind is Owner.CAMERA:
                poses[one.owner] = pose_right_jacobian(frames[:, layout.chain_columns[number]])
        blocks = {
            (owner, block.name): block.chart(static[columns])
            for owner, block, columns in layout.placed
            if block.free and not block.manifold.is_flat
        }
        return cls(turns, poses, blocks)

    def joints(self, wearer: int, first: int, count: int) -> Array:
        """Of joints 1 … 23 of a body in a stretch of frames ``(count, 23, 3, 3)``."""
        return self.turns[wearer][first : first + count, 1:]

    def screws(self, wearer: int, first: int, screws: Array) -> Array:
        """Screws ``(t, 25, 6, 3)`` of a stretch of frames by the coordinates."""
        by_joints = screws[:, :-1] @ self.turns[wearer][first : first + len(screws)]
        return np.concatenate([by_joints, screws[:, -1:]], axis=1)

    def of_item(self, owner: OwnerId, block: str, item: int, frame: int) -> Array | None:
        """Of one item of a static block, or of a camera's pose in a frame; None where steps are coordinates."""
        static = self.static.get((owner, block))
        if static is not None:
            return static[item]
        return self.poses[owner][frame] if block == "poses" and owner in self.poses else None

    def jacobian(self, block: JacobianBlock, first: int) -> Array:
        """A block's derivative ``(t, n, m, c)`` by the coordinates."""
        frames = slice(first + block.ahead, first + block.ahead + len(block.jacobian))
        static = self.static.get((block.owner, block.block))
        if static is not None:
            return block.jacobian @ static
        if block.block == "poses" and block.owner in self.poses:
            return block.jacobian @ self.poses[block.owner][frames, None]
        if block.block in JOINT_NAMES:
            return block.jacobian @ self.turns[block.owner.number][frames, None, joint_index(block.block)]
        return block.jacobian
