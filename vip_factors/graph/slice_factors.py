"""The factors of a scene, gathered into slices: each factor into that of its first frame."""

from itertools import combinations

import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.factors.coasting import pelvis_turn_jacobians
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.graph import twist
from vip_factors.graph.batch import BatchObjective
from vip_factors.graph.bone_factors import add_bone_factors
from vip_factors.graph.camera_batch import CameraObjective
from vip_factors.graph.joint_factors import JOINTS, PELVIS, add_joint_factors, is_smoothed
from vip_factors.graph.scene_batch import view_equations
from vip_factors.graph.scene_model import SceneModel
from vip_factors.graph.scene_state import CAMERA, SceneState
from vip_factors.graph.slices import Slices
from vip_factors.graph.state import GraphState
from vip_factors.graph.terms import FRAME
from vip_factors.graph.wearer_residuals import motion_residuals, turn_residuals


def scene_slices(model: SceneModel, state: SceneState, slices: Slices) -> Slices:
    """The slices of a scene's problem at a state, in the memory of earlier ``slices`` if that is enough."""
    slices, columns = slices.emptied(model.frames), slices.columns
    everything = slice(0, model.frames)
    for number, (wearer, own) in enumerate(zip(model.wearers, state.wearers, strict=True)):
        body = forward_kinematics(wearer.skeleton, own.R_parent_child, own.p_world_pelvis)
        objective, place = BatchObjective(wearer, number), columns.wearers[number]
        _add_poses(slices, objective, own, body, place)
        _add_smoothness(slices, objective, own, place)
        _add_turns(slices, objective, own, place)
        _add_motion(slices, objective, own, body, place)
        whose = [columns.camera, *[np.full(CAMERA, -1)] * len(model.further)]
        for camera, one in zip(whose, model.viewpoints(state.camera), strict=True):
            view = one.views[number]
            if view.seen.any():
                equations = view_equations(view, everything, one.problem, one.state, body)
                both = np.concatenate([place[:FRAME], camera])
                slices.add(everything, both, equations.hessian, equations.gradient)
    _add_camera(slices, CameraObjective(model.camera, model.frames, model.step), state)
    return slices


def _add_poses(
    slices: Slices, objective: BatchObjective, state: GraphState, body: BodyState, place: np.ndarray
) -> None:
    """The factors of a wearer on single frames, and the priors on what all share."""
    model, T = objective.model, len(body.p_world_joint)
    everything, width = slice(0, T), objective.used
    used = np.concatenate([np.arange(FRAME), objective.static_columns])
    H, g = np.zeros((T, width, width)), np.zeros((T, width))
    add_joint_factors(model, state, everything, H, g, None)
    add_bone_factors(model, objective.sites, state, body, everything, None, None, H, g)
    H[:, FRAME:, :FRAME] = transpose(H[:, :FRAME, FRAME:])
    slices.add(everything, place, H[:, used[:, None], used], g[:, used])
    for _, residual, own, J in objective.static_rows(state):
        there = np.searchsorted(used, own)
        slices.add(slice(0, 1), place[there], (J.T @ J)[None], (J.T @ residual)[None])


def _add_smoothness(slices: Slices, objective: BatchObjective, state: GraphState, place: np.ndarray) -> None:
    """The factors of a wearer between each frame and the next one."""
    model, w = objective.model, slices.columns.frame
    if not is_smoothed(model):
        return
    R, information = state.R_parent_child[:, 1:], model.prior.information
    turn = log(transpose(R[:-1]) @ R[1:])
    by_after = inverse_right_jacobian(turn)
    T = len(turn)
    blocks = np.concatenate([-transpose(by_after), by_after], axis=1)  # of 23 joints in either frame
    information = (model.settings.smoothness.time / model.frames.step) ** 2 * np.tile(information, (2, 2))
    Bt = transpose(blocks)
    half = (Bt @ information.reshape(-1, 3, 2 * POSE_SIZE)).reshape(T, 2 * POSE_SIZE, 2 * POSE_SIZE)
    hessian = (Bt @ transpose(half).reshape(T, -1, 3, 2 * POSE_SIZE)).reshape(half.shape)
    force = np.tile(turn.reshape(T, -1), (1, 2)) @ information / 2
    gradient = (Bt @ force.reshape(T, -1, 3, 1)).reshape(T, -1)
    joints = place[JOINTS]
    slices.add(slice(0, T), np.concatenate([joints, joints + w]), hessian, gradient)


def _add_turns(slices: Slices, objective: BatchObjective, state: GraphState, place: np.ndarray) -> None:
    """The factors of a wearer between pelvises of which one was not measured."""
    model, w = objective.model, slices.columns.frame
    if not model.turning.any():
        return
    term = turn_residuals(model, state.R_parent_child)
    sigma, step, root = model.settings.coasting.turn_sigma, model.frames.step, np.sqrt(term.weight)[..., None]
    J = np.concatenate(pelvis_turn_jacobians(term.residual[:, 0] * sigma, step), axis=2) / sigma
    pelvis, pairs = place[PELVIS], slice(0, len(J))
    slices.add_rows(pairs, np.concatenate([pelvis, pelvis + w]), root * J, root[..., 0] * term.residual[:, 0])


def _add_motion(
    slices: Slices, objective: BatchObjective, state: GraphState, body: BodyState, place: np.ndarray
) -> None:
    """The factors of a wearer that see a point move: over three frames, or over two."""
    model, sites, w = objective.model, objective.sites, slices.columns.frame
    p, S = sites.on(body), len(model.sensors)
    by_twist, screws, frame = body.point_twists(p), body.screws, place[:FRAME]
    for term in motion_residuals(model, state, p):
        chosen, count = term.sites, len(term.residual)
        if count == 0:
            continue
        bones, reach, first = sites.bones[chosen], 2 if term.start else 1, slice(0, count)
        # Which frame of each factor, counted from its first: one after the other, so that one call does them all.
        frames = np.arange(reach + 1)[:, None] + np.arange(count)
        c = term.coefficients[2 - reach :, None, None, None, None]
        J, moved = by_twist[frames][:, :, chosen], screws[frames]
        pushed = J.swapaxes(3, 4) * (c * term.weight[..., None, None])
        own = twist.carried(bones, _flat(c * (pushed @ J)))
        force = twist.carried(bones, _flat((pushed @ term.residual[..., None])[..., 0]))
        hessians, gradients = twist.hessian(_flat(moved), own), twist.gradient(_flat(moved), force)
        for i in range(reach + 1):
            here = slice(i * count, (i + 1) * count)
            slices.add(first, frame + w * i, hessians[here], gradients[here])
        earlier, later = np.array(list(combinations(range(reach + 1), 2))).T
        between = twist.carried(bones, _flat(c[later] * (pushed[earlier] @ J[later])))
        blocks = twist.hessian_between(_flat(moved[earlier]), between, _flat(moved[later]))
        for pair, (i, j) in enumerate(zip(earlier, later, strict=True)):
            slices.add_between(first, frame + w * i, frame + w * j, blocks[pair * count : (pair + 1) * count])
        if term.by_heading is None or not model.free_headings:
            continue
        headings = place[FRAME : FRAME + S]
        blocks = twist.coupling_of_each(_flat(moved), bones, _flat(pushed @ term.by_heading[..., None]))
        for i in range(reach + 1):
            slices.add_between(first, frame + w * i, headings, blocks[i * count : (i + 1) * count])
        slices.hessian[first, headings, headings] += term.weight * np.sum(term.by_heading**2, axis=2)
        slices.gradient[first, headings] += term.weight * np.sum(term.by_heading * term.residual, axis=2)


def _flat(stacked: Array) -> Array:
    """The first two axes as one."""
    return stacked.reshape(-1, *stacked.shape[2:])


def _add_camera(slices: Slices, objective: CameraObjective, state: SceneState) -> None:
    """The factors of the camera alone."""
    camera, T, w = state.camera, objective.frames, slices.columns.frame
    place, everything = slices.columns.camera, slice(0, objective.frames)
    slices.add_rows(everything, place, *objective.orientation_rows(camera))
    if objective.frame_width and T > 1:
        pose, both = place[:6], np.concatenate([place[:6], place[:6] + w])
        for term in objective.motion_residuals(camera):
            assert term.by_heading is not None
            jacobian, root = camera.poses.point_jacobian(objective.camera.p_camera_imu), np.sqrt(term.weight)
            count = len(term.residual)
            rows = [c * jacobian[ahead : ahead + count] for ahead, c in enumerate(term.coefficients)]
            J = root[..., None] * np.concatenate([*rows, term.by_heading[:, 0, :, None]], axis=2)
            columns = np.concatenate([both, pose + 2 * w, place[6:7]])
            slices.add_rows(slice(0, count), columns, J, root * term.residual[:, 0])
        by_now, by_after, residual = objective.velocity_rows(camera)
        slices.add_rows(slice(0, T - 1), both, np.concatenate([by_now, by_after], axis=2), residual)
    for _, residual, own, J in objective.static_rows(camera):
        slices.add(slice(0, 1), place[own], (J.T @ J)[None], (J.T @ residual)[None])
