"""The keypoints of a moving body in a camera's image, and how far they lie from what a detector found."""

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.motion import Motion
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import NEAREST_M, CameraModel
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.detections import Detections


def keypoints_in_world(motion: Motion, keypoints: KeypointSet) -> Array:
    """World positions ``(T, K, 3)`` of keypoints in metres; NaN for those that are not on our body."""
    points = np.full((len(motion), len(keypoints), 3), np.nan)
    for column, place in enumerate(keypoints.on_body(motion.skeleton)):
        if place is not None:
            points[:, column] = motion.state.point(place.bone, place.p_bone_point)
    return points


def keypoints_in_image(
    motion: Motion, keypoints: KeypointSet, path: CameraPath, model: CameraModel, time: Array
) -> Array:
    """Pixels ``(F, K, 2)`` of keypoints at instants ``(F,)`` of the recording's clock.

    Between frames of the motion, world points are interpolated linearly: at 60 Hz within 2 mm of the true arc. NaN
    outside the motion's time (a frame's length of slack), behind the camera, and for keypoints not on our body.
    """
    own, points = motion.time, keypoints_in_world(motion, keypoints)
    inside = (time >= own[0] - 1 / motion.rate) & (time <= own[-1] + 1 / motion.rate)
    place = np.clip((time - own[0]) * motion.rate, 0, len(own) - 1)
    left = np.minimum(place.astype(int), max(len(own) - 2, 0))
    right, share = np.minimum(left + 1, len(own) - 1), (place - left)[:, None, None]
    p_camera = path.at(time).to_camera((1 - share) * points[left] + share * points[right])
    seen = inside[:, None] & (p_camera[..., 2] > NEAREST_M)
    pixels = model.project(np.where(seen[..., None], p_camera, [0.0, 0.0, 1.0]))
    return np.where(seen[..., None], pixels, np.nan)


def reprojection_error(
    motion: Motion, path: CameraPath, model: CameraModel, detections: Detections, chosen: np.ndarray
) -> Array:
    """Distances ``(n, K)`` in pixels of detected keypoints from a body's; NaN where one of the two is missing.

    Args:
        motion: of the body.
        path, model: of the camera.
        detections: with times on the recording's clock (see :meth:`Detections.shifted`).
        chosen: indices ``(n,)`` of the body's detections.
    """
    pixels = keypoints_in_image(motion, detections.keypoints, path, model, detections.time)
    distance = np.linalg.norm(pixels[detections.frame[chosen]] - detections.pixels[chosen], axis=-1)
    return np.where(detections.seen[chosen], distance, np.nan)
