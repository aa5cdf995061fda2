"""Who stands where: detections that the programme leaves over, given to wearers by the known camera.

The programme fits a camera to every detection, which takes six of its numbers, and doubts whoever shows few joints:
half hidden people. Once the camera's path is known and the motions are in its world, each wearer's keypoints are
expected at places in the picture, and what lies there is theirs, unless somebody else's would do nearly as well.
"""

import numpy as np

from vip_factors.associate.features import Context, rival
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_path import CameraPath

FEWEST_SEEN = 4  # keypoints: eight numbers, none of which a camera takes
ENOUGH_SURE = 10  # sightings of a wearer, to know how keypoints scatter about the motion
RAYLEIGH_MEDIAN = 1.1774  # median length of a vector of two normal numbers
PREDICTED_M = 0.03  # what a fused motion errs by where nobody was seen: its usual joint error
# Mean of log(1 + z²) over the keypoints, z in sigmas, as of keypoints 2.5 sigmas off each. Of two people's joints in
# one detection more than two thirds must be in place to reach it.
FITTING = float(np.log1p(2.5**2))
LEAD = 1.0  # how much worse the next best must be: e times the squared errors
DRESSED = -2.0  # log-odds of the clothes at least: one in eight of the wearer's own looks less like them
NEVER = 100.0  # a cost beyond all others
NEAREST = 0.3  # m, before the camera


def left_over(context: Context, camera: CameraPath, wearer: np.ndarray, clothes: Array | None = None) -> np.ndarray:
    """Wearers ``(N,)`` of the detections, with those added that lie where the wearer is; −1 for nobody.

    Wearers are added only in frames that do not show them yet, and only to detections that are nobody's.

    Args:
        context: of a recording.
        camera: its path at the video's frames, in the world of all motions.
        wearer: ``(N,)`` of the detections as given before, −1 for nobody.
        clothes: ``(W, N)`` log-odds that a detection is dressed as a wearer; whoever is surely not is not taken.
    """
    cost = np.stack([place_cost(context, camera, w, wearer == w) for w in range(len(context.wearers))])
    w, d = (index.ravel() for index in np.indices(cost.shape))
    if clothes is not None:
        cost = np.where(clothes < DRESSED, NEVER, cost)
    cost = np.where((wearer >= 0) & (wearer != np.arange(len(cost))[:, None]), NEVER, cost).ravel()
    fits = (cost <= FITTING) & (rival(d, d, cost) >= LEAD) & (rival(context.frame[d], w, cost) >= LEAD)
    shown = np.zeros((len(context.wearers), len(context.time)), bool)
    shown[wearer[wearer >= 0], context.frame[wearer >= 0]] = True
    added = fits & ~shown[w, context.frame[d]]
    result = wearer.copy()
    result[d[added]] = w[added]
    return result


def place_cost(context: Context, camera: CameraPath, wearer: int, sure: np.ndarray) -> Array:
    """How far off ``(N,)`` each detection is from where a wearer is expected: the keypoints' mean of log(1 + z²).

    Sigmas are the scatter of the detections that are the wearer's already, and what a motion errs by.

    Args:
        context: of a recording.
        camera: its path at the video's frames.
        wearer: whose place.
        sure: ``(N,)`` which detections are theirs already; with hardly any nobody fits.
    """
    if np.sum(sure) < ENOUGH_SURE:
        return np.full(len(sure), NEVER)
    points, frame = context.wearers[wearer].p_world_keypoint, context.frame
    p = (points - camera.p_world_camera[:, None]) @ camera.R_world_camera
    depth = np.maximum(p[..., 2], NEAREST)
    error = np.linalg.norm((p[..., :2] / depth[..., None])[frame] - context.rays, axis=-1) * depth[frame]
    known = np.isfinite(error) & (context.weight > 0)
    scatter = [np.median(column[one & sure]) if np.any(one & sure) else PREDICTED_M
               for column, one in zip(error.T, known.T, strict=True)]  # fmt: skip
    z = np.where(known, error, 0.0) / np.hypot(np.array(scatter) / RAYLEIGH_MEDIAN, PREDICTED_M)
    weight = np.where(known, context.weight, 0.0)
    mean = np.sum(weight * np.log1p(z**2), axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
    return np.where(np.sum(known, axis=1) >= FEWEST_SEEN, mean, NEVER)
