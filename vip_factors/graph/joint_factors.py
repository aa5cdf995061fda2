"""Normal equations of the factors on joint rotations themselves: pose prior, limits, initial pose and smoothness."""

import numpy as np

from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.factors.coasting import pelvis_turn_jacobians
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.graph.model import InertialModel
from vip_factors.graph.residuals import Residuals
from vip_factors.graph.state import GraphState
from vip_factors.graph.terms import ROOT, pose_mean_columns
from vip_factors.graph.wearer_residuals import initial_pose_residuals, is_smoothed, limit_residuals, turn_residuals

PELVIS = slice(0, 3)  # columns of the pelvis's rotation in a frame's tangent
JOINTS = slice(3, ROOT)  # columns of joints 1 … 23 in a frame's tangent
_BLOCKS = np.arange(POSE_SIZE).reshape(-1, 3) + JOINTS.start


def add_joint_factors(
    model: InertialModel, state: GraphState, frames: slice, hessian: Array, gradient: Array, following: Array | None
) -> None:
    """Add the factors on a stretch of frames, and those that tie it to its neighbours.

    Args:
        model, state: of the whole recording.
        frames: the stretch.
        hessian, gradient: of the stretch, ``(t, n, n)`` and ``(t, n)`` over all columns; added to in place.
        following: ``(t, 2, 75, 75)`` of the stretch with the next frames; added to in place. None leaves out what ties
            frames.
    """
    R, count = state.R_parent_child[:, 1:], frames.stop - frames.start
    before, last = max(frames.start - 1, 0), min(frames.stop, len(R) - 1)
    tied = following is not None and is_smoothed(model)
    turns = transpose(R[before:last]) @ R[before + 1 : last + 1] if tied else R[:0]
    vectors = log(np.concatenate([R[frames], turns]))
    jacobians = inverse_right_jacobian(vectors)
    x, D = vectors[:count].reshape(count, POSE_SIZE), jacobians[:count]
    _add_prior(model, x, D, state.pose_mean, hessian, gradient)
    limits = limit_residuals(model, x)
    if limits.residual.any():
        sigma = model.settings.joint_limit.sigma
        _add_by_joint(limits, (limits.residual != 0).reshape(*D.shape[:3], 1) * D / sigma, hessian, gradient)
    initial = initial_pose_residuals(model, state.R_parent_child[frames], frames)
    if initial is not None:
        sigma = model.initial_pose_sigma
        _add_by_joint(initial, inverse_right_jacobian(initial.residual * sigma) / sigma, hessian, gradient)
    if following is None:
        return
    if len(turns):
        own = slice(frames.start - before, last - before)  # of the pairs, those whose first frame is in the stretch
        _add_smoothness(model, vectors[count:], jacobians[count:], own, hessian, gradient, following)
    if model.turning[before:last].any():
        _add_turns(model, state, slice(before, last), frames.start, hessian, gradient, following)


def _add_prior(model: InertialModel, x: Array, D: Array, mean: Array, hessian: Array, gradient: Array) -> None:
    information = model.settings.pose_prior.scale**2 * model.prior.information
    force, Dt = (x - mean) @ information, transpose(D)
    weighted = _blocks_times(Dt, information)
    hessian[:, JOINTS, JOINTS] += _blocks_times(Dt, transpose(weighted))
    gradient[:, JOINTS] += _blocks_apply(Dt, force)
    if model.free_pose_mean:
        mean_columns = pose_mean_columns(len(model.sensors))
        columns = slice(mean_columns.start, mean_columns.stop)
        hessian[:, JOINTS, columns] -= weighted
        hessian[:, columns, columns] += information
        gradient[:, columns] -= force


def _add_smoothness(
    model: InertialModel, turn: Array, J: Array, own: slice, hessian: Array, gradient: Array, following: Array
) -> None:
    """Of pairs of frames: the derivative of their ``turn`` is ``J`` by the later one and ``−Jᵀ`` by the earlier.

    All but at most one pair have their first frame in the stretch (``own``); all but at most one their second.
    """
    information = (model.settings.smoothness.time / model.frames.step) ** 2 * model.prior.information
    force = turn.reshape(len(turn), POSE_SIZE) @ information
    last = len(hessian) - (own.stop - own.start)  # 1 if the last frame of all is in the stretch, which begins no pair
    now, after = slice(0, len(hessian) - last), slice(1 - own.start, 1 - own.start + own.start + len(hessian) - 1)
    weighted = transpose(_blocks_times(J, information))  # P Jᵀ
    hessian[now, JOINTS, JOINTS] += _blocks_times(J[own], weighted[own])
    following[now, 0, JOINTS, JOINTS] -= transpose(_blocks_times(transpose(J[own]), weighted[own]))
    gradient[now, JOINTS] -= _blocks_apply(J[own], force[own])
    into = slice(0, len(hessian) - after.start)
    Jt = transpose(J[into])
    hessian[after, JOINTS, JOINTS] += _blocks_times(Jt, transpose(_blocks_times(Jt, information)))
    gradient[after, JOINTS] += _blocks_apply(Jt, force[into])


def _add_turns(
    model: InertialModel, state: GraphState, pairs: slice, start: int, hessian: Array, gradient: Array, following: Array
) -> None:
    """Of pelvises that turn unseen, in ``pairs`` by their first frames; the stretch begins at frame ``start``."""
    term, sigma = turn_residuals(model, state.R_parent_child, pairs), model.settings.coasting.turn_sigma
    r, weight = term.residual[:, 0, :, None], term.weight[..., None]
    by_now, by_after = (J / sigma for J in pelvis_turn_jacobians(r[..., 0] * sigma, model.frames.step))
    own = slice(start - pairs.start, len(r))  # whose first frame is in the stretch, and so for their second one
    into = slice(0, min(len(r), start + len(hessian) - 1 - pairs.start))
    now, after = slice(0, own.stop - own.start), slice(pairs.start + 1 - start, pairs.start + 1 - start + into.stop)
    weighted = weight * transpose(by_now)
    hessian[now, PELVIS, PELVIS] += (weighted @ by_now)[own]
    following[now, 0, PELVIS, PELVIS] += (weighted @ by_after)[own]
    gradient[now, PELVIS] += (weighted @ r)[own, :, 0]
    weighted = weight * transpose(by_after)
    hessian[after, PELVIS, PELVIS] += (weighted @ by_after)[into]
    gradient[after, PELVIS] += (weighted @ r)[into, :, 0]


def _add_by_joint(term: Residuals, J: Array, hessian: Array, gradient: Array) -> None:
    """Add factors with whitened Jacobians ``(t, 23, 3, 3)``, each by its own joint: one for each, or for each row."""
    weighted = transpose(term.weight.reshape(*J.shape[:2], -1, 1) * J)
    hessian[:, _BLOCKS[:, :, None], _BLOCKS[:, None, :]] += weighted @ J
    gradient[:, JOINTS] += _blocks_apply(weighted, term.residual)


def _blocks_times(blocks: Array, matrix: Array) -> Array:
    """``B M`` ``(t, 69, 69)`` for block-diagonal ``B``, given as ``(t, 23, 3, 3)``; ``M`` ``(69, 69)`` or stacked."""
    rows = matrix.reshape(*matrix.shape[:-2], POSE_SIZE // 3, 3, matrix.shape[-1])
    return (blocks @ rows).reshape(len(blocks), POSE_SIZE, POSE_SIZE)


def _blocks_apply(blocks: Array, vector: Array) -> Array:
    """``B v`` ``(t, 69)`` for block-diagonal ``B``."""
    return (blocks @ vector.reshape(len(blocks), POSE_SIZE // 3, 3, 1)).reshape(len(blocks), POSE_SIZE)
