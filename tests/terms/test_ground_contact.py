"""Where the ray of a standing foot's pixel meets the floor, how exactly, and when a foot is believed to stand."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.factor_settings import GroundContactSettings, Weighing
from vip_factors.geometry.rotations import exp, rotation_z, transpose
from vip_factors.problem.scene import Foot
from vip_factors.problem.state import CameraPoses
from vip_factors.sensors.camera import CameraModel
from vip_factors.terms.ground_contact import (
    acceleration_confidence,
    ground_contact_residual,
    ground_contact_whitening,
    pixel_rays,
    rays_meet_floor,
)

T = 6
LENS = CameraModel(1920, 1080, (1400.0, 1390.0), (950.0, 550.0), (-0.1, 0.02, 0.001, -0.002))
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # the body's y axis is the world's z
LOOKS_ALONG_Y = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
ANKLE = joint_index("left_ankle")
FOOT = Foot(ANKLE, np.zeros(3), np.array([[0.0, -0.08, -0.05], [0.0, -0.07, 0.13]]))
SOLE = 0.02


def standing() -> tuple[BodyState, CameraPoses, np.ndarray]:
    """A body whose left sole touches the floor somehow, a camera above it, and the pixels of that ankle."""
    random = np.random.default_rng(3)
    skeleton = skeleton_from_stature(1.75)
    R = exp(0.2 * random.standard_normal((T, 24, 3)))
    R[:, 0] = UPRIGHT @ exp(0.2 * random.standard_normal((T, 3)))
    body = forward_kinematics(skeleton, R, random.standard_normal((T, 3)))
    sole = np.stack([body.point(ANKLE, p - [0, SOLE, 0])[:, 2] for p in FOOT.p_bone_sole], axis=1)
    root = np.zeros((T, 3))
    root[:, 2] = -sole.min(axis=1)
    body = replace(body, p_world_joint=body.p_world_joint + root[:, None])
    camera = CameraPoses(
        LOOKS_ALONG_Y @ exp([-0.25, 0, 0]) @ exp(0.03 * random.standard_normal((T, 3))),
        np.array([0.0, -4.0, 1.6]) + 0.1 * random.standard_normal((T, 3)),
    )
    p_camera = np.einsum("tji,tj->ti", camera.R_world_camera, body.p_world_joint[:, ANKLE] - camera.p_world_camera)
    return body, camera, LENS.project(p_camera)


def test_a_standing_foot_is_where_its_pixel_says() -> None:
    body, camera, pixels = standing()
    p, height = FOOT.ankle(body, SOLE)
    ray = pixel_rays(LENS, pixels)
    np.testing.assert_allclose(ground_contact_residual(p, height, camera, ray), 0, atol=1e-9)
    assert rays_meet_floor(height, camera, ray).all()


@pytest.mark.parametrize("weighing", Weighing)
def test_turning_the_world_leaves_the_whitened_residual_as_long(weighing: Weighing) -> None:
    body, camera, pixels = standing()
    settings = GroundContactSettings(weighing=weighing)
    p, height = FOOT.ankle(body, SOLE)
    ray, turn = pixel_rays(LENS, pixels + 8.0), rotation_z(0.9)
    turned = CameraPoses(turn @ camera.R_world_camera, camera.p_world_camera @ turn.T)
    lengths = []
    for ankle, seen_by in ((p, camera), (p @ turn.T, turned)):
        W = ground_contact_whitening(height, seen_by, ray, np.full(T, 5.0), LENS, np.full(T, 0.7), settings)
        residual = ground_contact_residual(ankle, height, seen_by, ray)
        lengths.append(np.linalg.norm(np.einsum("tij,tj->ti", W, residual), axis=1))
    np.testing.assert_allclose(lengths[0], lengths[1], rtol=1e-9)


def test_weighed_by_pixels_it_knows_what_a_pixel_and_an_uneven_floor_do() -> None:
    body, camera, pixels = standing()
    random = np.random.default_rng(4)
    settings = replace(GroundContactSettings(weighing=Weighing.PIXELS), floor_sigma=0.02)
    p, height = FOOT.ankle(body, SOLE)
    W = ground_contact_whitening(height, camera, pixel_rays(LENS, pixels), np.full(T, 3.0), LENS, np.ones(T), settings)
    whitened = []
    for _ in range(1500):
        ray = pixel_rays(LENS, pixels + 3.0 * random.standard_normal(pixels.shape))
        moved = height + settings.floor_sigma * random.standard_normal(T)
        whitened.append(np.einsum("tij,tj->ti", W, ground_contact_residual(p, moved, camera, ray)))
    samples = np.array(whitened)
    covariance = np.einsum("nti,ntj->tij", samples, samples) / len(samples)
    np.testing.assert_allclose(covariance, np.broadcast_to(np.eye(3), covariance.shape), atol=0.15)


def test_rays_that_do_not_meet_the_floor_near_by_are_told_apart() -> None:
    camera = CameraPoses(np.broadcast_to(LOOKS_ALONG_Y, (4, 3, 3)), np.tile([0.0, 0.0, 1.5], (4, 1)))
    ray = np.array([[0.0, 0.3, 1], [0.0, -0.3, 1], [0.0, 0.02, 1], [0.0, 0.06, 1]])  # down, up, flat, far
    meets = rays_meet_floor(np.full(4, 0.1), camera, ray)
    np.testing.assert_array_equal(meets, [True, False, False, False])


def test_a_foot_that_accelerates_or_is_the_higher_one_is_believed_less() -> None:
    settings = GroundContactSettings()
    acceleration = np.array([[0.0, 20.0], [2.0, np.nan]])
    lowest = np.array([[0.0, 0.1], [0.1, 0.0]])
    confidence = acceleration_confidence(acceleration, lowest, settings)
    np.testing.assert_allclose(confidence, [[2.0, 0.25], [1.0, 1.0]], atol=1e-6)


def test_a_sole_turned_with_the_body_is_as_high() -> None:
    body, _, _ = standing()
    turn = rotation_z(1.2)
    turned = BodyState(turn @ body.R_world_bone, body.p_world_joint @ transpose(turn))
    np.testing.assert_allclose(FOOT.ankle(turned, SOLE)[1], FOOT.ankle(body, SOLE)[1], atol=1e-12)
