"""Where wearers stand whose poses are known and whose places are not: by a video frame of a known camera."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import Skeleton
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.live import LiveCamera, VideoFrame
from vip_factors.stages.views import points_on_body

LEAST_KEYPOINTS = 6
# Median error of the keypoints, in heights of the person in the image, with which a detection may show a wearer: a
# joint is 5 % off with a calibration that is found, and 20 % in somebody else's pose.
FITS = 0.10
NEAREST_M = 0.5  # depth at least


def places_in(
    camera: LiveCamera, pose: tuple[Array, Array], bodies: Sequence[BodyState], skeletons: Sequence[Skeleton],
    video: VideoFrame,
) -> list[Array | None]:  # fmt: skip
    """Root position ``(3,)`` of each wearer, metres, as a video frame shows them; None of one unseen.

    Args:
        camera: that gave the frame.
        pose: its rotation and position in the world.
        bodies: of the wearers in that one frame, anywhere.
        skeletons: of them.
        video: the frame.
    """
    cost = np.full((len(bodies), len(video.pixels)), np.inf)
    place = np.zeros((*cost.shape, 3))
    for wearer, (body, skeleton) in enumerate(zip(bodies, skeletons, strict=True)):
        used, points = points_on_body(camera.keypoints, skeleton)
        offset = np.concatenate([point.of(body) for point in points]) - body.p_world_joint[0, 0]
        for person, pixels in enumerate(video.pixels[:, used]):
            seen = (video.confidence[person, used] > 0) & np.all(np.isfinite(pixels), axis=1)
            if seen.sum() >= LEAST_KEYPOINTS:
                cost[wearer, person], place[wearer, person] = _fit(camera, pose, offset[seen], pixels[seen])
    found: list[Array | None] = [None] * len(bodies)
    for wearer, person in np.transpose(linear_sum_assignment(np.minimum(cost, 10 * FITS))).tolist():
        if cost[wearer, person] < FITS:
            found[wearer] = place[wearer, person]
    return found


def _fit(camera: LiveCamera, pose: tuple[Array, Array], offset: Array, pixels: Array) -> tuple[float, Array]:
    """Median error in heights of the person, and the root's place: nearest to the rays through the keypoints."""
    R_world_camera, p_world_camera = pose
    rays = np.concatenate([camera.model.normalise(pixels), np.ones((len(pixels), 1))], axis=1) @ R_world_camera.T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    p = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, p_world_camera - offset))
    p_camera = (p + offset - p_world_camera) @ R_world_camera
    if np.any(p_camera[:, 2] < NEAREST_M):
        return np.inf, p
    error = np.linalg.norm(camera.model.project(p_camera) - pixels, axis=1)
    height = np.ptp(pixels, axis=0).max()
    return float(np.median(error) / max(height, 1.0)), np.asarray(p)
