"""One frame's GTSAM factors: the definition of the problem, for batch and for streaming alike."""

from collections.abc import Iterator

import gtsam
import numpy as np

from vip_factors.factors.acceleration import acceleration_factor
from vip_factors.factors.coasting import pelvis_turn_factor, root_coasting_factor
from vip_factors.factors.floor_contact import floor_contact_factor
from vip_factors.factors.foot_contact import foot_contact_factor
from vip_factors.factors.gauge_prior import gauge_prior_factor
from vip_factors.factors.heading_knots import HeadingAt
from vip_factors.factors.heading_prior import heading_prior_factor
from vip_factors.factors.heading_walk import heading_walk_factor
from vip_factors.factors.joint_limit import joint_limit_factors
from vip_factors.factors.orientation import orientation_factor
from vip_factors.factors.pose_prior import pose_mean_factor, pose_prior_factor
from vip_factors.factors.rotation_prior import rotation_prior_factor
from vip_factors.factors.smoothness import smoothness_factor
from vip_factors.graph.keys import frame_keys, heading_key, joint_key, mounting_key, pose_mean_key, root_key
from vip_factors.graph.model import InertialModel

LAST_JOINT = 23


def heading_in(model: InertialModel, t: int, sensor: int, wearer: int = 0) -> int | HeadingAt:
    """Where the factors of frame ``t`` find a sensor's heading: its key, or those of the knots around the frame."""
    weights = model.knot_weights(slice(t, t + 1))
    if weights is None:
        return heading_key(sensor, wearer)
    knots = [int(k) for k in np.flatnonzero(weights[0])]
    return HeadingAt([heading_key(sensor, wearer, k) for k in knots], [float(weights[0, k]) for k in knots])


def pose_factors(model: InertialModel, t: int, wearer: int = 0) -> Iterator[gtsam.NonlinearFactor]:
    """Factors on the pose of frame ``t`` alone (and on headings and mountings)."""
    keys, frames, settings = frame_keys(t, wearer), model.frames, model.settings
    for s, sensor in enumerate(model.sensors):
        if frames.orientation_valid[t, s]:
            R = frames.R_inertial_sensor[t, s]
            yield orientation_factor(
                model.skeleton, keys, heading_in(model, t, s, wearer), mounting_key(s, wearer), sensor.bone, R,
                settings.orientation,
            )  # fmt: skip
    yield pose_prior_factor(keys, pose_mean_key(wearer), model.prior, settings.pose_prior)
    for joint in range(1, LAST_JOINT + 1):
        yield from joint_limit_factors(keys, joint, model.limits, settings.joint_limit)
    for c, contact in enumerate(model.contacts if model.has_floor else ()):
        confidence = float(model.contact_confidence[t, c])
        if confidence > 0:
            yield floor_contact_factor(
                model.skeleton, keys, contact.bone, contact.p_bone_point, confidence, settings.floor_contact
            )
    if model.initial_pose is not None and t < model.initial_pose.left:
        for joint in range(1, LAST_JOINT + 1):
            R = model.initial_pose.R_parent_child[joint]
            yield rotation_prior_factor("initial pose", joint_key(t, joint, wearer), R, model.initial_pose_sigma)


def motion_factors(model: InertialModel, t: int, wearer: int = 0) -> Iterator[gtsam.NonlinearFactor]:
    """Factors that tie frames ``t − 1``, ``t`` and ``t + 1`` together."""
    if not model.use_acceleration:
        return
    keys = [frame_keys(frame, wearer) for frame in (t - 1, t, t + 1)]
    frames, settings, step = model.frames, model.settings, model.frames.step
    for s, sensor in enumerate(model.sensors):
        if frames.acceleration_valid[t, s]:
            force = frames.specific_force_inertial[t, s]
            yield acceleration_factor(
                model.skeleton, keys, heading_in(model, t, s, wearer), sensor.bone, sensor.p_bone_point, force, step,
                settings.acceleration,
            )  # fmt: skip
    if model.coasting[t]:
        yield root_coasting_factor([frame.root for frame in keys], step, settings.coasting)


def pair_factors(model: InertialModel, t: int, wearer: int = 0) -> Iterator[gtsam.NonlinearFactor]:
    """Factors that tie frames ``t`` and ``t + 1`` together."""
    if not model.use_acceleration:
        return
    now, after = frame_keys(t, wearer), frame_keys(t + 1, wearer)
    settings, step = model.settings, model.frames.step
    for c, contact in enumerate(model.contacts):
        confidence = float(model.contact_confidence[t, c])
        if confidence > 0:
            yield foot_contact_factor(
                model.skeleton, [now, after], contact.bone, contact.p_bone_point, step, confidence,
                settings.foot_contact,
            )  # fmt: skip
    if settings.smoothness.use:
        yield smoothness_factor(now, after, step, model.prior, settings.smoothness)
    if model.turning[t]:
        yield pelvis_turn_factor(now.joints[0], after.joints[0], step, settings.coasting)


def static_factors(model: InertialModel, wearer: int = 0) -> Iterator[gtsam.NonlinearFactor]:
    """Priors on headings and their walk, mountings and on the root of the first frame."""
    if not model.is_beginning:
        return
    for s, sigma in enumerate(model.heading_sigmas):
        if model.free_headings:
            yield heading_prior_factor(heading_key(s, wearer), float(model.prior_headings[s]), float(sigma))
        if model.free_mountings:
            R = model.prior_R_bone_sensor[s]
            yield rotation_prior_factor("mounting prior", mounting_key(s, wearer), R, float(model.mounting_sigma[s]))
    if model.free_headings and model.headings_walk:
        for k, sigma in enumerate(model.walk_sigmas):
            for s in range(len(model.sensors)):
                before, after = heading_key(s, wearer, k), heading_key(s, wearer, k + 1)
                yield heading_walk_factor(before, after, float(sigma))
    if model.free_pose_mean:
        yield pose_mean_factor(pose_mean_key(wearer), model.prior, model.settings.pose_prior)
    if model.use_acceleration and model.is_gauge:
        yield gauge_prior_factor(root_key(0, wearer), model.p_world_start, model.settings.gauge_prior)


def nonlinear_graph(model: InertialModel, wearer: int = 0) -> gtsam.NonlinearFactorGraph:
    """One wearer's whole recording as one GTSAM graph, callback by callback: the slow twin of the batched objective."""
    graph = gtsam.NonlinearFactorGraph()
    T = len(model.frames)
    for t in range(T):
        for factor in pose_factors(model, t, wearer):
            graph.push_back(factor)
        if 0 < t < T - 1:
            for factor in motion_factors(model, t, wearer):
                graph.push_back(factor)
        if t < T - 1:
            for factor in pair_factors(model, t, wearer):
                graph.push_back(factor)
    for factor in static_factors(model, wearer):
        graph.push_back(factor)
    return graph
