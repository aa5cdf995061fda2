"""A first root path, from kinematics alone: whichever foot stands lowest stands still."""

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.geometry.rotations import Array

HEIGHT_BAND = 0.03  # m above the lowest point within which a point may bear the body: soles and floors are not flat
SPEED_SCALE = 0.4  # m/s: a planted foot rolls slower than this, a swinging one moves at 2–4 m/s
SMOOTHING = 0.1  # s over which confidence is averaged: a contact lasts longer than that
ROUNDING = 1e-6  # frames: at 15 Hz it is one and a half of them, and the last digit of a time must not say one or two


def contact_points(skeleton: Skeleton, sole: float = 0.0) -> tuple[tuple[int, Array], ...]:
    """Heel and ball of both feet, as (bone, ``p_bone_point``); the ankle and toe joint where a skeleton has no heel.

    Under them is a sole as thick as ``sole`` metres.
    """
    points = []
    for side in ("left", "right"):
        ankle, ball = joint_index(f"{side}_ankle"), joint_index(f"{side}_foot")
        heel = skeleton.landmarks.get(f"{side}_heel")
        points.append((ankle, heel.p_bone_point if heel else np.zeros(3)))
        points.append((ankle, skeleton.p_parent_joint[ball]))
    return tuple((bone, p - np.array([0.0, sole, 0.0])) for bone, p in points)


def standing_path(body: BodyState, points: tuple[tuple[int, Array], ...]) -> Array:
    """Root positions ``(T, 3)`` that keep the lowest contact point of each frame where it is, on a floor at z = 0.

    ``body`` has its root at the origin in all frames.
    """
    relative = np.stack([body.point(bone, p) for bone, p in points], axis=1)
    lowest = np.argmin(relative[:, :, 2], axis=1)
    rows = np.arange(len(relative) - 1)
    step = relative[rows, lowest[:-1]] - relative[rows + 1, lowest[:-1]]
    path = np.zeros((len(relative), 3))
    path[1:, :2] = np.cumsum(step[:, :2], axis=0)
    path[:, 2] = -relative[:, :, 2].min(axis=1)
    return path


def contact_confidence(body: BodyState, points: tuple[tuple[int, Array], ...], step: float) -> Array:
    """How surely each contact point ``(T, C)`` bears the body, in [0, 1]: it is low, and slower than anything else.

    ``body`` is placed in the world, with a first guess of its root path.
    """
    p = np.stack([body.point(bone, point) for bone, point in points], axis=1)
    velocity = np.gradient(p, step, axis=0)
    speed = np.linalg.norm(velocity, axis=2)
    height = p[:, :, 2] - p[:, :, 2].min(axis=1, keepdims=True)
    confidence = np.exp(-0.5 * (speed / SPEED_SCALE) ** 2 - 0.5 * (height / HEIGHT_BAND) ** 2)
    frames = max(1, round(SMOOTHING / step + ROUNDING))
    averaged = uniform_filter1d(confidence, frames, axis=0)
    return np.clip(averaged, 0.0, 1.0)  # the running sum rounds to slightly below zero
