"""The factors evaluated for all frames at once: whitened residuals and, if asked, their Jacobians.

Columns number a frame's own tangent: three for
each of 24 joints, three for the root, then what all frames share: one for each heading, three for each mounting, and
69 for the mean pose.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.body.pose_prior import POSE_SIZE, joint_vector
from vip_factors.body.skeleton import JOINT_COUNT, ancestors
from vip_factors.factors.acceleration import acceleration_by_heading, acceleration_residual
from vip_factors.factors.floor_contact import floor_contact_residual
from vip_factors.factors.foot_contact import foot_contact_residual
from vip_factors.factors.joint_limit import joint_limit_residual
from vip_factors.factors.orientation import orientation_jacobians, orientation_residual
from vip_factors.factors.pose_prior import joint_vector_jacobian, pose_prior_residual
from vip_factors.factors.robust import RobustLoss
from vip_factors.factors.rotation_prior import rotation_prior_residual
from vip_factors.geometry.rotations import Array, inverse_right_jacobian
from vip_factors.graph.evaluated import MotionTerm, PoseTerm
from vip_factors.graph.model import InertialModel
from vip_factors.graph.state import GraphState

ROOT = 3 * JOINT_COUNT  # first column of the root translation
FRAME = ROOT + 3  # width of a frame's tangent
SQUARE = RobustLoss()


def width(sensors: int) -> int:
    """Number of all columns."""
    return FRAME + 4 * sensors + POSE_SIZE


def pose_mean_columns(sensors: int) -> range:
    """Columns of the mean pose."""
    return range(width(sensors) - POSE_SIZE, width(sensors))


def heading_column(sensor: int) -> int:
    """Column of a sensor's heading."""
    return FRAME + sensor


def mounting_columns(sensor: int, sensors: int) -> range:
    """Columns of a sensor's mounting."""
    start = FRAME + sensors + 3 * sensor
    return range(start, start + 3)


def chain_columns(bone: int) -> list[int]:
    """Columns of the joints from the root to a bone."""
    return [3 * joint + axis for joint in ancestors(bone) for axis in range(3)]


def pose_terms(
    model: InertialModel, state: GraphState, body: BodyState, frames: slice, jacobians: bool
) -> Iterator[PoseTerm]:
    """All factors on single frames, for a stretch of frames; ``state`` and ``body`` hold that stretch alone."""
    T = len(state.p_world_pelvis)
    yield from _orientation_terms(model, state, body, frames, jacobians)
    x = joint_vector(state.R_parent_child)
    D = joint_vector_jacobian(x) if jacobians else None
    yield _prior_term(model, x, state.pose_mean, D)
    yield from _limit_terms(model, x, D)
    if model.has_floor:
        yield from _floor_terms(model, body, frames, jacobians)
    if model.initial_pose is not None and frames.start < model.initial_pose.frames:
        mask = (np.arange(T) + frames.start < model.initial_pose.frames).astype(float)
        R = state.R_parent_child[:, 1:]
        error = rotation_prior_residual(R, model.initial_pose.R_parent_child[1:])
        sigma = model.initial_pose_sigma
        J = inverse_right_jacobian(error) / sigma if jacobians else None
        for joint in range(1, JOINT_COUNT):
            own = None if J is None else J[:, joint - 1]
            yield PoseTerm("initial pose", error[:, joint - 1] / sigma, mask, SQUARE, _joint_columns(joint), own)


def _floor_terms(model: InertialModel, body: BodyState, frames: slice, jacobians: bool) -> Iterator[PoseTerm]:
    settings = model.settings.floor_contact
    for c, contact in enumerate(model.contacts):
        confidence = model.contact_confidence[frames, c]
        root = np.sqrt(confidence)[:, None] / settings.sigma  # whitens: the loss sees the confidence too
        residual = root * floor_contact_residual(contact.of(body))
        J = None
        if jacobians:
            _, by_joints = body.point_jacobian(contact.bone, contact.p_bone_point)
            height = by_joints[:, :, 2].reshape(len(residual), -1)
            J = (root * np.concatenate([height, np.tile([0.0, 0.0, 1.0], (len(residual), 1))], axis=1))[:, None]
        columns = [*chain_columns(contact.bone), ROOT, ROOT + 1, ROOT + 2]
        yield PoseTerm("floor contact", residual, (confidence > 0).astype(float), settings.loss, columns, J)


def _joint_columns(joint: int) -> list[int]:
    return list(range(3 * joint, 3 * joint + 3))


def _orientation_terms(
    model: InertialModel, state: GraphState, body: BodyState, frames: slice, jacobians: bool
) -> Iterator[PoseTerm]:
    settings, S = model.settings.orientation, len(model.sensors)
    weights = model.knot_weights(frames)
    for s, sensor in enumerate(model.sensors):
        R, mounting = model.frames.R_inertial_sensor[frames, s], state.R_bone_sensor[s]
        R_world_bone = body.R_world_bone[:, sensor.bone]
        residual = orientation_residual(R_world_bone, mounting, state.heading(s, weights), R)
        columns = [*chain_columns(sensor.bone), heading_column(s), *mounting_columns(s, S)]
        J = None
        if jacobians:
            by_turn, by_mounting, by_heading = orientation_jacobians(R_world_bone, mounting, residual)
            by_joints = by_turn[:, None] @ body.orientation_jacobian(sensor.bone)[1]
            stacked = by_joints.swapaxes(1, 2).reshape(len(residual), 3, -1)
            J = np.concatenate([stacked, by_heading[:, :, None], by_mounting], axis=2) / settings.sigma
        mask = model.frames.orientation_valid[frames, s].astype(float)
        yield PoseTerm("orientation", residual / settings.sigma, mask, settings.loss, columns, J)


def _prior_term(model: InertialModel, x: Array, mean: Array, D: Array | None) -> PoseTerm:
    settings = model.settings.pose_prior
    residual = pose_prior_residual(x, mean, model.prior, settings)
    columns = list(range(3, ROOT))
    J = None
    if D is not None:
        L = settings.scale * model.prior.whitening.reshape(69, 23, 3)
        J = np.einsum("mja,tjab->tmjb", L, D, optimize=True).reshape(len(x), 69, 69)
        if model.free_pose_mean:
            by_mean = np.broadcast_to(-L.reshape(69, 69), J.shape)
            J, columns = np.concatenate([J, by_mean], axis=2), [*columns, *pose_mean_columns(len(model.sensors))]
    return PoseTerm("pose prior", residual, np.ones(len(x)), SQUARE, columns, J)


def _limit_terms(model: InertialModel, x: Array, D: Array | None) -> Iterator[PoseTerm]:
    settings = model.settings.joint_limit
    outside = joint_limit_residual(x, model.limits.lower, model.limits.upper).reshape(len(x), 23, 3)
    for joint in range(1, JOINT_COUNT):
        residual = outside[:, joint - 1] / settings.sigma
        if not residual.any():
            continue
        J = None if D is None else (residual != 0)[:, :, None] * D[:, joint - 1] / settings.sigma
        yield PoseTerm("joint limit", residual, np.ones(len(x)), settings.loss, _joint_columns(joint), J)


def motion_terms(model: InertialModel, state: GraphState, body: BodyState, jacobians: bool) -> Iterator[MotionTerm]:
    """All factors over two or three frames, for the whole recording."""
    if not model.use_acceleration:
        return
    step, settings, contact = model.frames.step, model.settings.acceleration, model.settings.foot_contact
    centre = slice(1, -1)
    weights = model.knot_weights(centre)
    for s, sensor in enumerate(model.sensors):
        p, heading = sensor.of(body), state.heading(s, weights)
        force = model.frames.specific_force_inertial[centre, s]
        residual = acceleration_residual(p[:-2], p[centre], p[2:], step, heading, force) / settings.sigma
        by_heading = acceleration_by_heading(heading, force) / settings.sigma if jacobians else None
        mask = model.frames.acceleration_valid[centre, s].astype(float)
        coefficients = np.array([1.0, -2.0, 1.0]) / (step**2 * settings.sigma)
        yield MotionTerm("acceleration", 1, residual, mask, settings.loss, s, coefficients, by_heading)
    for c, point in enumerate(model.contacts):
        p = point.of(body)
        residual = foot_contact_residual(p[:-1], p[1:], step) / contact.sigma
        coefficients = np.array([0.0, -1.0, 1.0]) / (step * contact.sigma)
        mask = model.contact_confidence[:-1, c]
        index = len(model.sensors) + c
        yield MotionTerm("foot contact", 0, residual, mask, contact.loss, index, coefficients, None)
