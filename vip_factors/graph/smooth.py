"""The smoothness factors of all frames at once: their cost, and their share of the normal equations."""

import numpy as np

from vip_factors.factors.smoothness import smoothness_residual, turn_jacobians
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.graph.model import InertialModel
from vip_factors.graph.state import GraphState
from vip_factors.graph.system import ChainSystem
from vip_factors.graph.terms import ROOT

JOINTS = slice(3, ROOT)  # columns of joints 1 … 23 in a frame's tangent


def is_smoothed(model: InertialModel) -> bool:
    """Whether the model has smoothness factors; where frames are independent it has none."""
    return model.use_acceleration and model.settings.smoothness.use and len(model.frames) > 1


def smoothness_cost(model: InertialModel, state: GraphState) -> float:
    """Half the sum of squared whitened residuals."""
    R, settings = state.R_parent_child[:, 1:], model.settings.smoothness
    residual = smoothness_residual(R[:-1], R[1:], model.frames.step, model.prior, settings)
    return 0.5 * float(np.sum(residual**2))


def add_smoothness(system: ChainSystem, model: InertialModel, state: GraphState, frames: slice) -> None:
    """Add the factors between each of a stretch of frames and its next one."""
    assert system.following is not None
    start, stop = frames.start, min(frames.stop, len(model.frames) - 1)
    if start == stop:  # the last frame, alone in its stretch
        return
    R = state.R_parent_child[start : stop + 1, 1:]
    turn = log(transpose(R[:-1]) @ R[1:])
    now, after = turn_jacobians(turn)
    weighted = model.settings.smoothness.time / model.frames.step * model.prior.whitening
    now_rows, after_rows = _rows(weighted, now), _rows(weighted, after)
    residual = turn.reshape(len(turn), -1) @ weighted.T
    own, next_one = slice(start, stop), slice(start + 1, stop + 1)
    system.own[own, JOINTS, JOINTS] += transpose(now_rows) @ now_rows
    system.own[next_one, JOINTS, JOINTS] += transpose(after_rows) @ after_rows
    system.following[own, 0, JOINTS, JOINTS] += transpose(now_rows) @ after_rows
    for part, rows in ((own, now_rows), (next_one, after_rows)):
        system.gradient[part, JOINTS] += (transpose(rows) @ residual[..., None])[..., 0]


def _rows(weighted: Array, blocks: Array) -> Array:
    """``L J`` ``(T, 69, 69)`` for block-diagonal Jacobians ``(T, 23, 3, 3)``, one stack of blocks after the other."""
    joints = blocks.shape[1]
    columns = weighted.reshape(len(weighted), joints, 3).swapaxes(0, 1)  # (23, 69, 3)
    return np.ascontiguousarray((columns @ blocks).swapaxes(1, 2)).reshape(len(blocks), len(weighted), 3 * joints)
