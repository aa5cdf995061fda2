import cv2
import numpy as np
import pytest

from vip_factors.associate.hypothesis import fit_cameras
from vip_factors.body.keypoints import keypoint_set
from vip_factors.geometry.rotations import angle_between, exp
from vip_factors.simulate.gestures import gestures


@pytest.fixture(scope="module")
def bodies() -> np.ndarray:
    """Keypoints (P, 17, 3) of many poses about the root."""
    motion = gestures(20.0, rate=10.0)
    points = [motion.state.point(one.bone, one.p_bone_point) for one in keypoint_set("coco17").on_body(motion.skeleton)]
    return np.stack(points, axis=1) - motion.p_world_pelvis[:, None]


def cameras(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random cameras, tilted up to 25° and rolled, and where the person stands before them."""
    random = np.random.default_rng(seed)
    R_level = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # rows: camera axes in the world
    about_up = np.stack([np.zeros(count), np.zeros(count), random.uniform(-np.pi, np.pi, count)], axis=1)
    tilt = np.deg2rad(random.uniform(-25, 25, (count, 3))) * [1, 0.3, 1]
    t = np.stack([random.uniform(-2, 2, count), random.uniform(-0.5, 0.5, count), random.uniform(4, 9, count)], axis=1)
    return exp(tilt) @ R_level @ exp(about_up), t


def seen(points: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    p = points @ np.swapaxes(R, -1, -2) + t[:, None]
    return p[..., :2] / p[..., 2:]


def test_exact_keypoints_give_the_exact_camera(bodies: np.ndarray) -> None:
    R, t = cameras(len(bodies), 0)
    fit = fit_cameras(bodies, seen(bodies, R, t), np.ones(bodies.shape[:2]), np.full(17, 0.05))
    assert fit.accepted.all()
    found = angle_between(fit.R_camera_world, R) < 1e-3
    assert found.mean() > 0.97  # of some poses, seen from some sides, the start leads to the reflected camera
    np.testing.assert_allclose(fit.p_camera_origin[found], t[found], atol=5e-3)
    assert fit.cost[found].max() < 1e-4


def test_noisy_fits_are_no_worse_than_those_of_opencv(bodies: np.ndarray) -> None:
    random = np.random.default_rng(1)
    R, t = cameras(len(bodies), 1)
    rays = seen(bodies, R, t) + 0.02 / t[:, None, 2:] * random.standard_normal((*bodies.shape[:2], 2))
    fit = fit_cameras(bodies, rays, np.ones(bodies.shape[:2]), np.full(17, 0.5))  # wide sigmas: plain least squares
    ours = np.linalg.norm(seen(bodies, fit.R_camera_world, fit.p_camera_origin) - rays, axis=-1)
    theirs = []
    for X, x in zip(bodies, rays, strict=True):
        _, turn, shift = cv2.solvePnP(X, x, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        _, turn, shift = cv2.solvePnP(X, x, np.eye(3), None, turn, shift, True, cv2.SOLVEPNP_ITERATIVE)
        there = cv2.projectPoints(X, turn, shift, np.eye(3), None)[0][:, 0]
        theirs.append(np.linalg.norm(there - x, axis=-1))
    rms = [np.sqrt(np.mean(np.square(one), axis=1)) for one in (ours, theirs)]
    assert np.mean(rms[0] < 1.02 * rms[1]) > 0.97


def test_a_few_wrong_keypoints_do_not_matter(bodies: np.ndarray) -> None:
    random = np.random.default_rng(2)
    R, t = cameras(len(bodies), 2)
    rays = seen(bodies, R, t) + 0.005 / t[:, None, 2:] * random.standard_normal((*bodies.shape[:2], 2))
    rays[:, [9, 15]] += 0.1
    fit = fit_cameras(bodies, rays, np.ones(bodies.shape[:2]), np.full(17, 0.03))
    assert np.median(np.rad2deg(angle_between(fit.R_camera_world, R))) < 2


def test_refuses_too_few_keypoints_and_what_is_not_a_number(bodies: np.ndarray) -> None:
    R, t = cameras(4, 3)
    rays, weight = seen(bodies[:4], R, t), np.ones((4, 17))
    weight[0, 5:] = 0.0  # five left
    weight[1, 6:] = 0.0  # six
    rays[2, :12] = np.nan  # five
    fit = fit_cameras(bodies[:4], rays, weight, np.full(17, 0.05))
    assert fit.accepted.tolist() == [False, True, False, True]
    assert np.isnan(fit.cost[[0, 2]]).all()
    assert np.isnan(fit.p_camera_origin[0]).all()


def test_refuses_people_too_near_or_reduced_to_a_point(bodies: np.ndarray) -> None:
    rays = np.stack([bodies[0][:, [0, 2]] * 50, np.full((17, 2), 0.1)])
    fit = fit_cameras(bodies[:2], rays, np.ones((2, 17)), np.full(17, 0.05))
    assert not fit.accepted.any()


def test_no_matches_are_no_trouble() -> None:
    fit = fit_cameras(np.zeros((0, 17, 3)), np.zeros((0, 17, 2)), np.zeros((0, 17)), np.full(17, 0.05))
    assert fit.accepted.shape == (0,)
