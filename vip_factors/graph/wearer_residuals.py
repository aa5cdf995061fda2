"""The factors of one wearer evaluated for all frames at once: their whitened residuals, kind by kind."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.factors.acceleration import acceleration_by_heading, acceleration_residual
from vip_factors.factors.coasting import DIFFERENCE, pelvis_turn_residual, root_coasting_residual
from vip_factors.factors.floor_contact import floor_contact_residual
from vip_factors.factors.foot_contact import foot_contact_residual
from vip_factors.factors.joint_limit import joint_limit_residual
from vip_factors.factors.orientation import orientation_residual
from vip_factors.factors.pose_prior import pose_prior_residual
from vip_factors.factors.robust import RobustLoss
from vip_factors.factors.rotation_prior import rotation_prior_residual
from vip_factors.factors.smoothness import smoothness_residual
from vip_factors.geometry.rotations import Array
from vip_factors.graph.model import BodyPoint, InertialModel
from vip_factors.graph.residuals import MotionResiduals, Residuals
from vip_factors.graph.state import GraphState

SQUARE = RobustLoss()
PELVIS = BodyPoint(0, np.zeros(3))  # its origin, which the root's translation moves


@dataclass(frozen=True)
class Sites:
    """Points on the body, as arrays: ``bones`` they are on, and ``p_bone_point`` ``(n, 3)`` metres."""

    bones: tuple[int, ...]
    p_bone_point: Array

    @classmethod
    def of(cls, points: Sequence[BodyPoint]) -> "Sites":
        """The same points."""
        p = np.array([point.p_bone_point for point in points]).reshape(-1, 3)
        return cls(tuple(point.bone for point in points), p)

    @classmethod
    def seen_by(cls, model: InertialModel) -> "Sites":
        """Those of a model's factors: its sensors, then its contacts, and last the pelvis if it coasts anywhere."""
        return cls.of([*model.sensors, *model.contacts, *[PELVIS] * bool(model.coasting.any())])

    def on(self, body: BodyState) -> Array:
        """World positions ``(T, n, 3)``."""
        return body.points(np.array(self.bones, dtype=int), self.p_bone_point)


def headings(state: GraphState, weights: Array | None) -> Array:
    """Of all sensors: constant ``(S,)``, or ``(t, S)`` at the frames whose knots' ``weights`` ``(t, K)`` are given."""
    return state.headings if weights is None else weights @ state.heading_knots


def orientation_residuals(model: InertialModel, state: GraphState, body: BodyState, frames: slice) -> Residuals:
    """One factor for each sensor; ``body`` holds the stretch of frames alone."""
    settings, R = model.settings.orientation, body.R_world_bone[:, [sensor.bone for sensor in model.sensors]]
    residual = orientation_residual(
        R, state.R_bone_sensor, headings(state, model.knot_weights(frames)), model.frames.R_inertial_sensor[frames]
    )
    return Residuals("orientation", residual / settings.sigma, model.frames.orientation_valid[frames], settings.loss)


def floor_residuals(model: InertialModel, p_world_contact: Array, frames: slice) -> Residuals:
    """One factor for each contact point ``(t, C, 3)``."""
    settings = model.settings.floor_contact
    residual = floor_contact_residual(p_world_contact) / settings.sigma
    return Residuals("floor contact", residual, model.contact_confidence[frames], settings.loss)


def prior_residuals(model: InertialModel, x: Array, mean: Array) -> Residuals:
    """One factor a frame, of joint vectors ``(t, 69)``."""
    residual = pose_prior_residual(x, mean, model.prior, model.settings.pose_prior)
    return Residuals("pose prior", residual[:, None], 1.0, SQUARE)


def limit_residuals(model: InertialModel, x: Array) -> Residuals:
    """One factor for each joint but the root (or for each of its axes), of joint vectors ``(t, 69)``."""
    settings = model.settings.joint_limit
    rows = 1 if settings.per_axis else 3
    outside = joint_limit_residual(x, model.limits.lower, model.limits.upper).reshape(len(x), -1, rows)
    return Residuals("joint limit", outside / settings.sigma, 1.0, settings.loss)


def initial_pose_residuals(model: InertialModel, R_parent_child: Array, frames: slice) -> Residuals | None:
    """One factor for each joint but the root, in the frames of the declared pose; None if the stretch has none."""
    initial = model.initial_pose
    if initial is None or frames.start >= initial.left:
        return None
    held = np.arange(frames.start, frames.stop)[:, None] < initial.left
    error = rotation_prior_residual(R_parent_child[:, 1:], initial.R_parent_child[1:])
    return Residuals("initial pose", error / model.initial_pose_sigma, held, SQUARE)


def pose_residuals(
    model: InertialModel, state: GraphState, body: BodyState, p_world_site: Array, x: Array
) -> Iterator[Residuals]:
    """All factors on poses, of single frames and of two; with all sites ``(T, n, 3)`` and joint vectors ``(T, 69)``."""
    everything = slice(0, len(model.frames))
    yield orientation_residuals(model, state, body, everything)
    yield prior_residuals(model, x, state.pose_mean)
    yield limit_residuals(model, x)
    if model.has_floor and model.contacts:
        yield floor_residuals(model, p_world_site[:, contact_sites(model)], everything)
    initial = initial_pose_residuals(model, state.R_parent_child, everything)
    if initial is not None:
        yield initial
    if is_smoothed(model):
        yield smoothness_residuals(model, state.R_parent_child)
    if model.turning.any():
        yield turn_residuals(model, state.R_parent_child)


def contact_sites(model: InertialModel) -> slice:
    """Which of all sites are the contacts."""
    return slice(len(model.sensors), len(model.sensors) + len(model.contacts))


def motion_residuals(model: InertialModel, state: GraphState, p_world_site: Array) -> Iterator[MotionResiduals]:
    """All factors over two or three frames, on the model's sites ``(T, n, 3)``."""
    if not model.use_acceleration:
        return
    step, settings, contact = model.frames.step, model.settings.acceleration, model.settings.foot_contact
    p, S = p_world_site, len(model.sensors)
    centre, q = slice(1, -1), p[:, :S]
    turned, force = headings(state, model.knot_weights(centre)), model.frames.specific_force_inertial[centre]
    yield MotionResiduals(
        "acceleration",
        acceleration_residual(q[:-2], q[centre], q[2:], step, turned, force) / settings.sigma,
        model.frames.acceleration_valid[centre], settings.loss, 1, slice(0, S),
        np.array([1.0, -2.0, 1.0]) / (step**2 * settings.sigma),
        acceleration_by_heading(turned, force) / settings.sigma,
    )  # fmt: skip
    if model.contacts:
        sites = contact_sites(model)
        yield MotionResiduals(
            "foot contact",
            foot_contact_residual(p[:-1, sites], p[1:, sites], step) / contact.sigma,
            model.contact_confidence[:-1], contact.loss, 0, sites,
            np.array([0.0, -1.0, 1.0]) / (step * contact.sigma),
        )  # fmt: skip
    if model.coasting.any():
        sigma, last = model.settings.coasting.acceleration_sigma, contact_sites(model).stop
        root = p[:, last : last + 1]
        yield MotionResiduals(
            "root coasting",
            root_coasting_residual(root[:-2], root[centre], root[2:], step) / sigma,
            model.coasting[centre, None], SQUARE, 1, slice(last, last + 1),
            DIFFERENCE / (step**2 * sigma),
        )  # fmt: skip


def is_smoothed(model: InertialModel) -> bool:
    """Whether the model has smoothness factors; where frames are independent it has none."""
    return model.use_acceleration and model.settings.smoothness.use and len(model.frames) > 1


def smoothness_residuals(model: InertialModel, R_parent_child: Array) -> Residuals:
    """One factor for each frame and its next."""
    R, settings = R_parent_child[:, 1:], model.settings.smoothness
    residual = smoothness_residual(R[:-1], R[1:], model.frames.step, model.prior, settings)
    return Residuals("smoothness", residual[:, None], 1.0, SQUARE)


def turn_residuals(model: InertialModel, R_parent_child: Array, pairs: slice | None = None) -> Residuals:
    """One factor for each frame of a stretch (or of all) and its next, where no sensor saw the pelvis turn."""
    pairs = slice(0, len(R_parent_child) - 1) if pairs is None else pairs
    R = R_parent_child[pairs.start : pairs.stop + 1, :1]
    residual = pelvis_turn_residual(R[:-1], R[1:], model.frames.step) / model.settings.coasting.turn_sigma
    return Residuals("pelvis turn", residual, model.turning[pairs, None], SQUARE)
