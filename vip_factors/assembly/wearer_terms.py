"""The terms on one wearer's motion and sensors."""

from collections.abc import Iterator

import numpy as np

from vip_factors.assembly.equations import (
    BoneEquations,
    DenseEquations,
    DifferenceEquations,
    JointEquations,
    Part,
)
from vip_factors.assembly.evaluation import WearerEvaluation
from vip_factors.assembly.registry import Term
from vip_factors.assembly.wearer_priors import PRIORS
from vip_factors.body.hinges import HINGES
from vip_factors.body.kinematics import BodyState
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.problem.points import BodyPoints
from vip_factors.terms.acceleration import acceleration_by_heading, acceleration_residual
from vip_factors.terms.coasting import (
    DIFFERENCE,
    pelvis_turn_jacobians,
    pelvis_turn_residual,
    root_coasting_residual,
)
from vip_factors.terms.floor_contact import floor_contact_residual
from vip_factors.terms.foot_contact import foot_contact_residual
from vip_factors.terms.hinge import hinge_jacobians, hinge_residual
from vip_factors.terms.joint_limit import joint_limit_residual
from vip_factors.terms.orientation import orientation_jacobians, orientation_residual
from vip_factors.terms.pose_prior import pose_prior_residual
from vip_factors.terms.robust import SQUARE
from vip_factors.terms.rotation_prior import rotation_prior_residual
from vip_factors.terms.smoothness import smoothness_residual, turn_jacobians
from vip_factors.terms.sole import sole_shift


def orientation(at: WearerEvaluation, first: slice) -> Iterator[BoneEquations]:
    """One factor for each sensor."""
    problem, settings, bones = at.problem, at.problem.settings.orientation, at.problem.sensor_points.bones
    R, mounting = at.body.R_world_bone[first][:, bones], at.state.R_bone_sensor
    error = orientation_residual(R, mounting, at.headings(first), problem.frames.R_inertial_sensor[first])

    def derivatives() -> tuple[Array, tuple[Part, ...]]:
        by_turn, by_mounting, by_heading = (J / settings.sigma for J in orientation_jacobians(R, mounting, error))
        return by_turn, (
            Part(at.owner, "headings", by_heading[..., None], each=True),
            Part(at.owner, "R_bone_sensor", by_mounting, each=True),
        )

    seen = problem.frames.orientation_valid[first]
    yield BoneEquations(
        "orientation", first.start, error / settings.sigma, seen, settings.loss, at.owner, bones, derivatives
    )


def acceleration(at: WearerEvaluation, first: slice) -> Iterator[DifferenceEquations]:
    """One factor for each sensor, on where it sits in three frames and on its heading in the middle one."""
    problem, settings, points = at.problem, at.problem.settings.acceleration, at.problem.sensor_points
    if not problem.use_acceleration:
        return
    body, step = at.body.at(slice(first.start, first.stop + 2)), problem.frames.step
    p, centre = at.sensor_points.on(body), slice(first.start + 1, first.stop + 1)
    headings, force = at.headings(centre), problem.frames.specific_force_inertial[centre]
    residual = acceleration_residual(p[:-2], p[1:-1], p[2:], step, headings, force) / settings.sigma
    by_heading = acceleration_by_heading(headings, force) / settings.sigma
    c = np.array([1.0, -2.0, 1.0]) / (step**2 * settings.sigma)
    yield DifferenceEquations(
        "acceleration", first.start, residual, problem.frames.acceleration_valid[centre], settings.loss, at.owner,
        points.bones, _arms(at, p, first), c,
        (
            Part(at.owner, "headings", by_heading[..., None], each=True, ahead=1),
            *_of_places(at, body, c),
            *_of_body(at, points, first, c),
        ),
    )  # fmt: skip


def foot_contact(at: WearerEvaluation, first: slice) -> Iterator[DifferenceEquations]:
    """One factor for each contact point, from a frame to the next."""
    problem, settings, points = at.problem, at.problem.settings.foot_contact, at.problem.contact_points
    if not (problem.use_acceleration and problem.contacts):
        return
    step = problem.frames.step
    p, c = (
        at.contact_points.on(at.body.at(slice(first.start, first.stop + 1))),
        np.array([-1.0, 1.0]) / (step * settings.sigma),
    )
    yield DifferenceEquations(
        "foot contact", first.start, foot_contact_residual(p[:-1], p[1:], step) / settings.sigma,
        problem.contact_confidence[first] * problem.frames.follows[first, None], settings.loss, at.owner,
        points.bones, _arms(at, p, first), c, (*_of_body(at, points, first, c), *_of_sole(at, first, c)),
    )  # fmt: skip


def floor_contact(at: WearerEvaluation, first: slice) -> Iterator[BoneEquations]:
    """One factor for each contact point."""
    problem, settings, points = at.problem, at.problem.settings.floor_contact, at.problem.contact_points
    if not (problem.has_floor and problem.contacts):
        return
    body = at.body.at(first)
    p = at.contact_points.on(body)

    def derivatives() -> tuple[Array, tuple[Part, ...]]:
        up = np.broadcast_to(np.array([[0.0, 0.0, 1.0]]) / settings.sigma, (*p.shape[:2], 1, 3))
        of_sole = (Part(at.owner, "sole", up @ _contacts_by_sole(at, body)),) if problem.free_sole else ()
        return up @ body.point_twists(p), (*at.body_parts(body, points, up), *of_sole)

    yield BoneEquations(
        "floor contact", first.start, floor_contact_residual(p) / settings.sigma, problem.contact_confidence[first],
        settings.loss, at.owner, points.bones, derivatives,
    )  # fmt: skip


def root_coasting(at: WearerEvaluation, first: slice) -> Iterator[DifferenceEquations]:
    """One factor on the root in three frames, where no accelerometer says how it moves."""
    problem, sigma = at.problem, at.problem.settings.coasting.acceleration_sigma
    coasting = problem.coasting[first.start + 1 : first.stop + 1, None]
    if not coasting.any():
        return
    p, step = at.state.p_world_pelvis[first.start : first.stop + 2, None], problem.frames.step
    residual = root_coasting_residual(p[:-2], p[1:-1], p[2:], step) / sigma
    yield DifferenceEquations(
        "root coasting",
        first.start,
        residual,
        coasting,
        SQUARE,
        at.owner,
        (0,),
        np.zeros_like(p),
        DIFFERENCE / (step**2 * sigma),
    )


def pelvis_turn(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the pelvis in two frames, where no sensor saw it turn."""
    problem, sigma = at.problem, at.problem.settings.coasting.turn_sigma
    turning = problem.turning[first, None]
    if not turning.any():
        return
    R, step = at.state.R_parent_child[first.start : first.stop + 1, 0], problem.frames.step
    rate = pelvis_turn_residual(R[:-1], R[1:], step)

    def parts() -> tuple[Part, ...]:
        by_both = pelvis_turn_jacobians(rate, step)
        return tuple(Part(at.owner, "pelvis", J[:, None] / sigma, ahead=ahead) for ahead, J in enumerate(by_both))

    yield DenseEquations("pelvis turn", first.start, rate[:, None] / sigma, turning, SQUARE, parts)


def pose_prior(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor a frame."""
    prior, settings = at.problem.prior, at.problem.settings.pose_prior
    x = at.joint_vectors(first)
    residual = pose_prior_residual(x.reshape(len(x), -1), at.state.pose_mean, prior, settings)
    yield JointEquations(
        "pose prior", first.start, residual[:, None], 1.0, SQUARE, at.owner, lambda: (at.joint_jacobians(first),),
        settings.scale * prior.whitening, settings.scale**2 * prior.information, "pose_mean",
    )  # fmt: skip


def smoothness(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor for each frame and its next."""
    problem, settings, prior = at.problem, at.problem.settings.smoothness, at.problem.prior
    if not (problem.use_acceleration and settings.use):
        return
    R = at.state.R_parent_child[first.start : first.stop + 1, 1:]
    follows, scale = problem.frames.follows[first, None, None], settings.time / problem.frames.step
    turn = follows * log(transpose(R[:-1]) @ R[1:])
    residual = smoothness_residual(turn, problem.frames.step, prior, settings)
    yield JointEquations(
        "smoothness", first.start, residual[:, None], 1.0, SQUARE, at.owner,
        lambda: tuple(follows[..., None] * J for J in turn_jacobians(turn)),
        scale * prior.whitening, scale**2 * prior.information,
    )  # fmt: skip


def joint_limit(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor for each joint but the root, or for each of its axes."""
    limits, settings = at.problem.limits, at.problem.settings.joint_limit
    x = at.joint_vectors(first)
    outside = joint_limit_residual(x.reshape(len(x), -1), limits.lower, limits.upper)
    residual = outside.reshape(len(x), -1, 1 if settings.per_axis else 3) / settings.sigma
    outside_range = (outside != 0).reshape(*x.shape, 1)
    yield JointEquations(
        "joint limit", first.start, residual, 1.0, settings.loss, at.owner,
        lambda: (outside_range * at.joint_jacobians(first) / settings.sigma,), acts=bool(outside_range.any()),
    )  # fmt: skip


def hinge(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor a frame on all elbows and knees."""
    settings = at.problem.settings.hinge
    if not settings.use:
        return
    R, whitening = at.state.R_parent_child[first], 1 / settings.sigmas

    def parts() -> tuple[Part, ...]:
        by_joints, by_variables = hinge_jacobians(R, at.state.hinges)
        scaled = [(whitening[:, None] * J)[:, None] for J in (*by_joints, by_variables)]
        names = [*(one.joint for one in HINGES), "hinges"]
        return tuple(Part(at.owner, name, J) for name, J in zip(names, scaled, strict=True))

    residual = (whitening * hinge_residual(R, at.state.hinges))[:, None]
    yield DenseEquations("hinge", first.start, residual, 1.0, settings.loss, parts)


def initial_pose(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor for each joint but the root, in the frames of the declared pose."""
    declared = at.problem.initial_pose
    if declared is None or first.start >= declared.left:
        return
    sigma = at.problem.initial_pose_sigma
    held = slice(first.start, min(first.stop, declared.left))
    error = rotation_prior_residual(at.state.R_parent_child[held, 1:], declared.pose.R_parent_child[1:])
    yield JointEquations(
        "initial pose", held.start, error / sigma, 1.0, SQUARE, at.owner,
        lambda: (inverse_right_jacobian(error) / sigma[..., None],),
    )  # fmt: skip


def _of_body(at: WearerEvaluation, points: BodyPoints, first: slice, coefficients: Array) -> tuple[Part, ...]:
    """What the motion of points over successive frames says of the body's lengths."""
    count, reach = first.stop - first.start, len(coefficients) - 1
    parts = at.body_parts(at.body.at(slice(first.start, first.stop + reach)), points)
    return tuple(
        Part(one.owner, one.block, sum(c * one.jacobian[i : i + count] for i, c in enumerate(coefficients)))
        for one in parts
    )


def _of_places(at: WearerEvaluation, body: BodyState, coefficients: Array) -> tuple[Part, ...]:
    """What the motion of sensors over successive frames says of their places."""
    if not at.problem.free_places:
        return ()
    R = body.R_world_bone[:, at.problem.sensor_points.bones]
    count = len(R) - len(coefficients) + 1
    by_place = sum(c * R[i : i + count] for i, c in enumerate(coefficients))
    return (Part(at.owner, "sensor_places", by_place, each=True),)


def _contacts_by_sole(at: WearerEvaluation, body: BodyState) -> Array:
    """How what touches the ground moves with the sole's logarithm, ``(t, n, 3, 1)``."""
    return np.asarray(body.R_world_bone[:, at.problem.contact_points.bones] @ sole_shift(at.sole)[:, None])


def _of_sole(at: WearerEvaluation, first: slice, coefficients: Array) -> tuple[Part, ...]:
    """What the motion of contacts over successive frames says of the sole."""
    if not at.problem.free_sole:
        return ()
    count = first.stop - first.start
    moves = _contacts_by_sole(at, at.body.at(slice(first.start, first.stop + len(coefficients) - 1)))
    return (Part(at.owner, "sole", sum(c * moves[i : i + count] for i, c in enumerate(coefficients))),)


def _arms(at: WearerEvaluation, p_world: Array, first: slice) -> Array:
    """From the root to points ``(t, n, 3)`` in the frames from the first of a stretch on."""
    return p_world - at.state.p_world_pelvis[first.start : first.start + len(p_world), None]


WEARER_TERMS: tuple[Term[WearerEvaluation], ...] = (
    Term("orientation", 0, orientation),
    Term("pose prior", 0, pose_prior),
    Term("joint limit", 0, joint_limit),
    Term("hinge", 0, hinge),
    Term("floor contact", 0, floor_contact),
    Term("initial pose", 0, initial_pose, every_frame=False),
    Term("smoothness", 1, smoothness),
    Term("pelvis turn", 1, pelvis_turn, every_frame=False),
    Term("acceleration", 2, acceleration),
    Term("foot contact", 1, foot_contact),
    Term("root coasting", 2, root_coasting, every_frame=False),
    *PRIORS,
)
