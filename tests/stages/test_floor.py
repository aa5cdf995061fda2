"""The world's zero is under the soles that stand, wherever a camera of unknown pose was put at the start."""

from dataclasses import replace

import numpy as np
from filmed_gestures import QUICK, camera_of, filmed_gestures

from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.skeleton import contact_points
from vip_factors.pipeline import smooth
from vip_factors.sensors.scene import Scene

SOLE_M = 0.018


def soles(motion: Motion) -> np.ndarray:
    """``(T, 4, 3)`` heels and balls of both feet."""
    body = forward_kinematics(motion.skeleton, motion.R_parent_child, motion.p_world_pelvis)
    return np.stack([body.point(bone, p) for bone, p in contact_points(motion.skeleton, SOLE_M)], axis=1)


def before_tripod(seconds: float) -> Scene:
    """A scene filmed by a camera that stands, nobody knows where."""
    scene = filmed_gestures("fixed", seconds=seconds)
    return replace(scene, camera=replace(camera_of(scene), known_path=None))


def test_soles_stand_at_nought_before_a_camera_whose_pose_is_not_known() -> None:
    lowest = soles(smooth(before_tripod(3.0), QUICK).wearers[0].motion)[..., 2].min(axis=1)
    assert abs(np.median(lowest)) < 0.02  # of all frames, those in which nothing rests among them
    assert np.quantile(np.abs(lowest), 0.95) < 0.03


def test_planted_feet_stay_where_they_are() -> None:
    motion = smooth(before_tripod(3.0), QUICK).wearers[0].motion
    points = soles(motion)
    speed = np.linalg.norm(np.gradient(points, 1 / motion.rate, axis=0)[..., :2], axis=2).min(axis=1)
    assert np.median(speed) < 0.02


def test_the_floor_is_left_where_it_is_if_wanted() -> None:
    scene = before_tripod(2.0)
    found, left = (smooth(scene, replace(QUICK, floor=one)).wearers[0].motion for one in ("found", "none"))
    shift = found.p_world_pelvis - left.p_world_pelvis
    np.testing.assert_allclose(shift, np.broadcast_to(shift[0], shift.shape), atol=2e-3)
