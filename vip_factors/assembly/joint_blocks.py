"""What terms say of joint rotations themselves, as blocks of a body's frame."""

from typing import TYPE_CHECKING

import numpy as np

from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.problem.layout import ROOT
from vip_factors.terms.equations import JointEquations

if TYPE_CHECKING:
    from vip_factors.assembly.accumulator import Accumulator

JOINTS = slice(3, ROOT)  # columns of joints 1 … 23 in a body's frame
_EACH = np.arange(POSE_SIZE).reshape(-1, 3) + JOINTS.start


def add_joints(sums: "Accumulator", eq: JointEquations) -> None:
    """Take in the equations of one term."""
    part = sums.layout.part_of(eq.owner)
    if part is None or not eq.acts:
        return
    by_joints = [
        D if sums.charts is None else D @ sums.charts.joints(part, eq.first + ahead, len(D))
        for ahead, D in enumerate(eq.by_joints())
    ]
    if eq.whitening is None:
        _add_separate(sums, eq, part, by_joints[0])
    else:
        _add_together(sums, eq, part, by_joints)


def _add_separate(sums: "Accumulator", eq: JointEquations, part: int, D: Array) -> None:
    """Each joint by itself, or each of its coordinates."""
    (i, j), shift = sums.slot(0, 0)
    source, target = sums.rows(shift, eq)
    weighted = transpose(eq.weight.reshape(*D.shape[:2], -1, 1) * D)[source]
    into = sums.frame_frame(part, i, part, j)[target]
    into[:, _EACH[:, :, None], _EACH[:, None, :]] += weighted @ D[source]
    sums.frame_gradient(part, i)[target, JOINTS] += _blocks_apply(weighted, eq.residual[source])


def _add_together(sums: "Accumulator", eq: JointEquations, part: int, by_joints: list[Array]) -> None:
    """All coordinates at once: ``P`` between block-diagonal ``D``."""
    assert eq.whitening is not None
    P, force, weight = eq.information, eq.weight * (eq.residual[:, 0] @ eq.whitening), eq.weight[..., None, None]
    assert P is not None
    for i, D in enumerate(by_joints):
        (a, _), shift = sums.slot(i, i)
        source, target = sums.rows(shift, eq)
        Dt = transpose(D[source])
        half = _blocks_times(weight[source] * Dt, P)  # Dᵀ P
        sums.frame_frame(part, a, part, a)[target, JOINTS, JOINTS] += _blocks_times(Dt, transpose(half))
        sums.frame_gradient(part, a)[target, JOINTS] += _blocks_apply(Dt, force[source])
        for j in range(i + 1, len(by_joints)):
            slot, _ = sums.slot(i, j)  # in the row of the earlier frame, as its own block
            block = transpose(_blocks_times(transpose(by_joints[j][source]), transpose(half)))
            sums.frame_frame(part, slot[0], part, slot[1])[target, JOINTS, JOINTS] += block
        if eq.mean is not None:
            _add_mean(sums, eq, part, i, D, force)


def _add_mean(sums: "Accumulator", eq: JointEquations, part: int, i: int, D: Array, force: Array) -> None:
    """The block that coordinates are compared with: its derivative is theirs, turned round."""
    assert eq.mean is not None
    place, P = sums.layout.place(eq.owner, eq.mean), eq.information
    if place is None:
        return
    assert P is not None
    (a, _), shift = sums.slot(i, i)
    source, target = sums.rows(shift, eq)
    weight = eq.weight[..., None, None]
    sums.frame_static(part, a, place.columns)[target, JOINTS] -= _blocks_times(weight[source] * transpose(D[source]), P)
    columns = np.arange(place.columns.start, place.columns.stop)[None]
    sums.add_static(columns, columns, weight * P, eq, mirror=False)
    sums.add_static_gradient(columns, -force[:, None], eq)


def _blocks_times(blocks: Array, matrix: Array) -> Array:
    """``B M`` ``(t, 69, 69)`` for block-diagonal ``B``, given as ``(t, 23, 3, 3)``; ``M`` ``(69, 69)`` or stacked."""
    rows = matrix.reshape(*matrix.shape[:-2], POSE_SIZE // 3, 3, matrix.shape[-1])
    return (blocks @ rows).reshape(len(blocks), POSE_SIZE, POSE_SIZE)


def _blocks_apply(blocks: Array, vector: Array) -> Array:
    """``B v`` ``(t, 69)`` for block-diagonal ``B``."""
    return (blocks @ vector.reshape(len(blocks), POSE_SIZE // 3, 3, 1)).reshape(len(blocks), POSE_SIZE)
