"""Normal equations of the factors that see bones: orientations, accelerations, and contacts of the feet."""

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.factors.orientation import orientation_jacobians
from vip_factors.geometry.rotations import Array
from vip_factors.graph import twist
from vip_factors.graph.model import InertialModel
from vip_factors.graph.motion import MotionFactors, MotionInformation
from vip_factors.graph.state import GraphState
from vip_factors.graph.system import ChainSystem
from vip_factors.graph.terms import FRAME
from vip_factors.graph.walk import WalkSystem
from vip_factors.graph.wearer_residuals import Sites, contact_sites, floor_residuals, orientation_residuals

OMEGA = slice(0, 3)  # of a twist: the turn


def add_bone_factors(
    model: InertialModel, sites: Sites, state: GraphState, body: BodyState, frames: slice, motion: MotionFactors | None,
    system: ChainSystem | None, hessian: Array, gradient: Array,
) -> None:  # fmt: skip
    """Add the factors on a stretch of frames, and those that tie it to the next two.

    Args:
        model, state: of the whole recording.
        sites: all of the model's.
        body: of the stretch and up to two frames after it.
        frames: the stretch.
        motion: the factors over three frames, if there are any.
        system: gets the blocks with the next frames, and those with headings that walk; needed with ``motion`` only.
        hessian, gradient: of the stretch, ``(t, n, n)`` and ``(t, n)`` over all columns; added to in place.
    """
    count, S = frames.stop - frames.start, len(model.sensors)
    here = body.at(slice(0, count))
    p = sites.on(body)
    by_twist, screws = body.point_twists(p), body.screws
    told = None if motion is None else motion.information(frames, by_twist)
    own, force = _empty(count, len(sites.bones)) if told is None else (told.own, told.force)
    shared = _add_orientations(model, state, here, frames, own, force)
    if model.has_floor and model.contacts:
        contacts = contact_sites(model)
        term = floor_residuals(model, p[:count, contacts], frames)
        J = by_twist[:count, contacts, 2:] / model.settings.floor_contact.sigma  # the row of the height
        weighted = (term.weight[..., None, None] * J).swapaxes(2, 3)
        own[:, contacts] += weighted @ J
        force[:, contacts] += (weighted @ term.residual[..., None])[..., 0]
    now = screws[:count]
    hessian[:, :FRAME, :FRAME] += twist.hessian(now, twist.carried(sites.bones, own))
    gradient[:, :FRAME] += twist.gradient(now, twist.carried(sites.bones, force))
    if told is not None:
        assert system is not None
        assert system.following is not None
        for ahead, information in enumerate(told.ahead, start=1):
            n = len(information)
            if n == 0:  # the last frame, alone in its stretch
                continue
            system.following[frames.start : frames.start + n, ahead - 1] += twist.hessian_between(
                now[:n], twist.carried(sites.bones, information), screws[ahead : ahead + n]
            )
    if hessian.shape[1] > FRAME:
        walk = None if system is None else system.walk
        _add_shared(shared, told, sites.bones[:S], now, frames, walk, hessian, gradient)


def _empty(frames: int, points: int) -> tuple[Array, Array]:
    return np.zeros((frames, points, 6, 6)), np.zeros((frames, points, 6))


def _add_orientations(
    model: InertialModel, state: GraphState, body: BodyState, frames: slice, own: Array, force: Array
) -> Array:
    """Add the orientation factors; returns their equations ``(t, S, 7, 8)``.

    Their rows are those of the bone's turn, the heading and the mounting, their last column is the gradient.
    """
    term, S = orientation_residuals(model, state, body, frames), len(model.sensors)
    sigma, R = model.settings.orientation.sigma, body.R_world_bone[:, [sensor.bone for sensor in model.sensors]]
    by_turn, by_mounting, by_heading = orientation_jacobians(R, state.R_bone_sensor, term.residual * sigma)
    J = np.concatenate([by_turn, by_heading[..., None], by_mounting, sigma * term.residual[..., None]], axis=3) / sigma
    equations = (term.weight[..., None, None] * J[..., :7]).swapaxes(2, 3) @ J
    own[:, :S, OMEGA, OMEGA] += equations[:, :, :3, :3]
    force[:, :S, OMEGA] += equations[:, :, :3, 7]
    return equations


def _add_shared(
    equations: Array, told: MotionInformation | None, bones: tuple[int, ...], screws: Array, frames: slice,
    walk: WalkSystem | None, hessian: Array, gradient: Array,
) -> None:  # fmt: skip
    """Add what orientations and accelerations say of headings and mountings."""
    count, S = equations.shape[:2]
    by_twist, own = np.zeros((count, S, 6, 4)), equations[:, :, 3:, 3:]
    by_twist[:, :, OMEGA] = equations[:, :, :3, 3:7]
    if told is not None:
        own[:, :, 0, 0] += told.heading
        own[:, :, 0, 4] += told.heading_force
        after, same, before = told.by_heading
        by_twist[..., 0] += same
        if walk is None:
            by_twist[..., 0] += after + before
        else:
            for side, beside in enumerate((after, before)):
                walk.beside[frames, side] += twist.coupling_of_each(screws, bones, beside[..., None])
    block = twist.coupling_of_each(screws, bones, by_twist).reshape(count, FRAME, S, 4)
    headings, mountings = slice(FRAME, FRAME + S), slice(FRAME + S, FRAME + 4 * S)
    hessian[:, :FRAME, headings] += block[..., 0]
    hessian[:, :FRAME, mountings] += block[..., 1:].reshape(count, FRAME, 3 * S)
    columns = np.column_stack([np.arange(S), S + np.arange(3 * S).reshape(S, 3)]) + FRAME
    hessian[:, columns[:, :, None], columns[:, None, :]] += own[..., :4]
    gradient[:, columns] += own[..., 4]
