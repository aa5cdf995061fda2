"""Where wearers stand whose poses are known and whose places are not: by a video frame of a known camera."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares, linear_sum_assignment

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
    """Median error in heights of the person, and the root's place: where its keypoints are seen where they are.

    The point nearest to all rays would be the linear way; pose errors draw it towards the camera, by half the depth.
    """
    R_world_camera, p_world_camera = pose
    height = float(max(np.ptp(pixels, axis=0).max(), 1.0))

    def error(p_camera: Array) -> Array:
        in_front = p_camera + o_camera
        in_front = np.concatenate([in_front[:, :2], np.maximum(in_front[:, 2:], NEAREST_M)], axis=1)
        return np.asarray((camera.model.project(in_front) - pixels) / height).ravel()

    o_camera = offset @ R_world_camera
    depth = camera.model.focal[1] * max(np.ptp(o_camera[:, 1]), NEAREST_M) / height
    flat = camera.model.normalise(pixels.mean(axis=0)[None])[0]
    start = depth * np.array([*flat, 1.0]) - o_camera.mean(axis=0)
    found = least_squares(error, start, loss="soft_l1", f_scale=FITS)
    median = float(np.median(np.linalg.norm(error(found.x).reshape(-1, 2), axis=1)))
    return median, np.asarray(p_world_camera + R_world_camera @ found.x)
