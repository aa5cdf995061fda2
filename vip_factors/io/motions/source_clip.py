"""A motion as its file tells it: any skeleton, any axes, any unit, forward kinematics done."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class SourceClip:
    """A foreign skeleton and its poses, in the file's own axes and unit.

    A *node* is a joint, or the free end of a last bone, which is called ``<joint>/end``.

    Attributes:
        names: ``N`` node names.
        p_rest: ``(N, 3)`` node positions with all joint rotations at identity.
        R_world_node: ``(T, N, 3, 3)``: how each node's bone has turned from that rest pose.
        p_world_node: ``(T, N, 3)`` node positions.
        rate: frames per second.
        name: what the clip is called.
        path: the file, for messages.
    """

    names: tuple[str, ...]
    p_rest: Array
    R_world_node: Array
    p_world_node: Array
    rate: float
    name: str
    path: str

    def __len__(self) -> int:
        return len(self.p_world_node)

    def node(self, name: str) -> int:
        """Index of a node by its exact name."""
        return self.names.index(name)

    def frames(self, selection: slice) -> "SourceClip":
        """The clip at some of its frames (the step must be one)."""
        return SourceClip(
            self.names,
            self.p_rest,
            self.R_world_node[selection],
            self.p_world_node[selection],
            self.rate,
            self.name,
            self.path,
        )


def rest_positions(parents: Sequence[int], offsets: Array) -> Array:
    """Node positions ``(N, 3)`` at rest; a node's parent precedes it, the root's parent is −1."""
    positions = np.zeros_like(offsets)
    for node, parent in enumerate(parents):
        positions[node] = offsets[node] + (positions[parent] if parent >= 0 else 0.0)
    return positions


def source_kinematics(parents: Sequence[int], p_parent_node: Array, R_parent_node: Array) -> tuple[Array, Array]:
    """World rotations ``(T, N, 3, 3)`` and positions ``(T, N, 3)`` of a chain of nodes.

    Args:
        parents: index of each node's parent, which precedes it; −1 for the root.
        p_parent_node: ``(T, N, 3)`` node positions in the parent's frame; the root's in the world.
        R_parent_node: ``(T, N, 3, 3)``.
    """
    R_world = np.empty_like(R_parent_node)
    p_world = np.empty_like(p_parent_node)
    for node, parent in enumerate(parents):
        if parent < 0:
            R_world[:, node], p_world[:, node] = R_parent_node[:, node], p_parent_node[:, node]
            continue
        np.matmul(R_world[:, parent], R_parent_node[:, node], out=R_world[:, node])
        arm = np.einsum("tij,tj->ti", R_world[:, parent], p_parent_node[:, node])
        p_world[:, node] = p_world[:, parent] + arm
    return R_world, p_world
