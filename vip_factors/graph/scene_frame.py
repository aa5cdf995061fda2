"""The GTSAM factors that touch the camera: with those of each wearer, the definition of a scene's problem."""

from collections.abc import Iterator

import gtsam
import numpy as np

from vip_factors.factors.camera_acceleration import camera_acceleration_factor
from vip_factors.factors.camera_orientation import camera_orientation_factor
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.factors.camera_velocity import camera_velocity_factor
from vip_factors.factors.ground_contact import ground_contact_factor
from vip_factors.factors.heading_prior import heading_prior_factor
from vip_factors.factors.reprojection import reprojection_factor
from vip_factors.factors.rotation_prior import rotation_prior_factor
from vip_factors.graph.frame import nonlinear_graph
from vip_factors.graph.keys import (
    camera_heading_key,
    camera_key,
    camera_mounting_key,
    clock_key,
    frame_keys,
)
from vip_factors.graph.scene_model import CameraProblem, KeypointView, SceneModel


def view_factors(model: SceneModel, wearer: int, t: int) -> Iterator[gtsam.NonlinearFactor]:
    """What the cameras saw of one wearer in frame ``t``."""
    pose = camera_key(t if model.camera.moving else 0)
    yield from _one_view(model, wearer, t, model.views[wearer], model.camera, pose)
    for known in model.further:
        yield from _one_view(model, wearer, t, known.views[wearer], known.problem, known.state.poses)


def _one_view(
    model: SceneModel, wearer: int, t: int, view: KeypointView, camera: CameraProblem, pose: int | CameraPoses
) -> Iterator[gtsam.NonlinearFactor]:
    for k in np.flatnonzero(view.seen[t]):
        point = view.points[k]
        clock = (clock_key(), view.pixels_per_second[t, k]) if camera.free_clock else None
        yield reprojection_factor(
            model.wearers[wearer].skeleton, frame_keys(t, wearer), pose, point.bone, point.p_bone_point,
            camera.model, view.pixels[t, k], float(view.sigma[t, k]), camera.settings.reprojection, clock,
        )  # fmt: skip
    ground = view.ground
    if ground is None:
        return
    for g in np.flatnonzero(ground.stands[t]):
        yield ground_contact_factor(
            model.wearers[wearer].skeleton, frame_keys(t, wearer), pose, ground.feet[g], ground.rays[t, g],
            ground.whitening[t, g], camera.settings.ground_contact.loss,
        )  # fmt: skip


def camera_factors(model: SceneModel, t: int) -> Iterator[gtsam.NonlinearFactor]:
    """What the camera's own IMU says in frame ``t``, and its tie to the next frame."""
    camera, settings, imu = model.camera, model.camera.settings, model.camera.imu
    pose = camera_key(t if camera.moving else 0)
    if imu is not None and imu.orientation_valid[t, 0]:
        yield camera_orientation_factor(
            pose, camera_heading_key(), camera_mounting_key(), imu.R_inertial_sensor[t, 0],
            camera.orientation_weight(model.step), settings.orientation,
        )  # fmt: skip
    if not camera.moving or not camera.free_pose:
        return
    if imu is not None and 0 < t < model.frames - 1 and imu.acceleration_valid[t, 0]:
        keys = [camera_key(frame) for frame in (t - 1, t, t + 1)]
        yield camera_acceleration_factor(
            keys, camera_heading_key(), camera.p_camera_imu, imu.specific_force_inertial[t, 0], model.step,
            settings.acceleration,
        )  # fmt: skip
    if t < model.frames - 1:
        yield camera_velocity_factor(pose, camera_key(t + 1), model.step, settings.velocity)


def camera_static_factors(model: SceneModel) -> Iterator[gtsam.NonlinearFactor]:
    """Priors on what all frames share."""
    camera = model.camera
    if not camera.is_beginning:
        return
    if camera.imu is not None:
        sigma = float(np.deg2rad(camera.settings.heading_sigma_deg))
        yield heading_prior_factor(camera_heading_key(), camera.prior_heading, sigma)
        yield rotation_prior_factor(
            "camera mounting prior", camera_mounting_key(), camera.prior_R_camera_imu, camera.mounting_sigma
        )
    if camera.free_clock:
        yield gtsam.PriorFactorDouble(
            clock_key(), 0.0, gtsam.noiseModel.Isotropic.Sigma(1, camera.settings.clock_sigma)
        )


def scene_graph(model: SceneModel) -> gtsam.NonlinearFactorGraph:
    """The whole scene as one GTSAM graph: the slow twin of the batched objective."""
    graph = gtsam.NonlinearFactorGraph()
    for number, wearer in enumerate(model.wearers):
        graph.push_back(nonlinear_graph(wearer, number))
        for t in range(model.frames):
            for factor in view_factors(model, number, t):
                graph.push_back(factor)
    for t in range(model.frames):
        for factor in camera_factors(model, t):
            graph.push_back(factor)
    for factor in camera_static_factors(model):
        graph.push_back(factor)
    return graph
