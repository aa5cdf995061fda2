"""Association by clothes and by position in the image, where motion is ambiguous.

Clothes: the torso colours of a wearer's certain detections are compared with those of other people in frames that
certainly show the wearer elsewhere. Where everybody wears the same, the two agree, and clothes count nothing.

Position: the assignment fits a camera to every detection, which takes six degrees of freedom and rejects partly hidden
people. Once the camera path is known in the world of the motions, each wearer's keypoints have predicted positions in
the image, and the detection there is the wearer's, unless another one fits nearly as well.
"""

import numpy as np

from vip_factors.associate.features import Context, rival
from vip_factors.associate.tracklets import sums_around
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraPath

SURELY = 3.0  # limit of the log-odds of clothes: twenty to one


def clothes_log_odds(context: Context, colour: Array, wearer: np.ndarray) -> Array:
    """Log-odds ``(W, N)`` by clothes that each detection shows each wearer; 0 without information.

    Args:
        context: context of the recording.
        colour: ``(N, B)`` colour histograms of torsos; NaN where not visible.
        wearer: ``(N,)`` wearers associated by motion, −1 for nobody.
    """
    unseen = 0.2  # share of other people's torsos with any colour: somebody new may appear
    changed = 0.05  # share of the wearer's torsos with any colour: light changes, jackets are opened
    trusted = 0.6  # share of the wearer's torsos that is used, the most similar: some associations by motion are wrong
    enough_looks = 10  # least number of torsos of the wearer, and of others
    W, N = len(context.wearers), len(wearer)
    odds = np.zeros((W, N))
    around = _around(context, colour)
    looked = np.isfinite(colour[:, 0])
    has_colour = np.isfinite(around).all(axis=1)
    for w in range(W):
        shows = np.zeros(len(context.time), bool)
        shows[context.frame[wearer == w]] = True
        of_wearer = looked & (wearer == w)
        of_others = looked & (wearer != w) & shows[context.frame]
        if min(of_wearer.sum(), of_others.sum()) < enough_looks:
            continue
        # Hellinger distances from the wearer's usual histogram.
        usual = np.median(colour[of_wearer], axis=0)
        alike = np.sum(np.sqrt(np.maximum(around, 0) * (usual / max(float(usual.sum()), 1e-9))), axis=1)
        unlike = np.asarray(np.sqrt(np.maximum(1 - alike, 0)))
        of_wearer &= unlike <= np.quantile(unlike[of_wearer], trusted)
        mine = _density(unlike[has_colour], unlike[of_wearer], changed)
        odds[w, has_colour] = np.clip(
            np.log(mine / _density(unlike[has_colour], unlike[of_others], unseen)), -SURELY, SURELY
        )
    return odds


def _around(context: Context, colour: Array) -> Array:
    """Colours ``(N, B)`` averaged along each detection's tracklet; NaN where never visible."""
    window_s = 2.0  # of the average: an arm in front of the chest or a passer-by lasts less
    half = window_s / 2 * context.rate
    key = context.track * (len(context.time) + 4 * int(half + 1)) + context.frame
    looked = np.isfinite(colour).all(axis=1)
    total, count = sums_around(key, half, key[looked], colour[looked])
    return np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)


def _density(distance: Array, samples: Array, uniform_share: float) -> Array:
    """Smoothed density ``(n,)`` of distances ``at`` some values, with a share that is uniform."""
    cells = 100  # of the distances' histogram
    unlike = 0.1  # Hellinger distance between two views of the same clothes
    edges = np.linspace(0, 1, cells + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    share = np.histogram(np.clip(samples, 0, 1), edges)[0] / len(samples)
    width = unlike * np.sqrt(2 * np.pi)
    density = np.exp(-0.5 * ((middles[:, None] - middles) / unlike) ** 2) @ share / width
    return np.asarray((1 - uniform_share) * np.interp(distance, middles, density) + uniform_share)


# Mean of log(1 + z²) of keypoints that are 2.5 sigmas off each. A detection with joints of two people reaches it only
# if more than two thirds of them are the wearer's.
FITTING = float(np.log1p(2.5**2))
NEVER = 100.0  # cost of what is excluded


def assign_by_position(
    context: Context, camera: CameraPath, wearer: np.ndarray, clothes: Array | None = None
) -> np.ndarray:
    """Add detections at the predicted position of a wearer to the associated ones ``(N,)``; −1 for nobody.

    Detections are added only in frames without one of the wearer, if they are not associated and the log-odds
    ``clothes`` ``(W, N)`` do not exclude them. ``camera`` is in the world of all motions.
    """
    dressed = -2.0  # least log-odds of clothes: one in eight of the wearer's own detections is below
    lead = 1.0  # least difference to the next best cost: e times the squared errors
    cost = np.stack([position_cost(context, camera, w, wearer == w) for w in range(len(context.wearers))])
    w, d = (index.ravel() for index in np.indices(cost.shape))
    if clothes is not None:
        cost = np.where(clothes < dressed, NEVER, cost)
    cost = np.where((wearer >= 0) & (wearer != np.arange(len(cost))[:, None]), NEVER, cost).ravel()
    fits = (cost <= FITTING) & (rival(d, d, cost) >= lead) & (rival(context.frame[d], w, cost) >= lead)
    shown = np.zeros((len(context.wearers), len(context.time)), bool)
    shown[wearer[wearer >= 0], context.frame[wearer >= 0]] = True
    added = fits & ~shown[w, context.frame[d]]
    result = wearer.copy()
    result[d[added]] = w[added]
    return result


def position_cost(context: Context, camera: CameraPath, wearer: int, sure: np.ndarray) -> Array:
    """Distance ``(N,)`` of each detection from a wearer's predicted keypoints: mean of log(1 + z²).

    Sigmas combine the scatter of the detections that are ``sure`` ``(N,)`` to be the wearer's and the error of motions;
    with too few of these no detection fits.
    """
    nearest = 0.3  # m, before the camera
    predicted_m = 0.03  # error of a fused motion where nobody was seen
    rayleigh_median = 1.1774  # median length of a vector of two standard normal numbers
    enough_sure = 10  # least number of the wearer's detections, to know the scatter
    fewest_seen = 4  # least number of keypoints
    if np.sum(sure) < enough_sure:
        return np.full(len(sure), NEVER)
    points, frame = context.wearers[wearer].p_world_keypoint, context.frame
    p = (points - camera.p_world_camera[:, None]) @ camera.R_world_camera
    depth = np.maximum(p[..., 2], nearest)
    error = np.linalg.norm((p[..., :2] / depth[..., None])[frame] - context.rays, axis=-1) * depth[frame]
    is_visible = np.isfinite(error) & (context.weight > 0)
    scatter = [
        np.median(column[use & sure]) if np.any(use & sure) else predicted_m
        for column, use in zip(error.T, is_visible.T, strict=True)
    ]
    z = np.where(is_visible, error, 0.0) / np.hypot(np.array(scatter) / rayleigh_median, predicted_m)
    weight = np.where(is_visible, context.weight, 0.0)
    mean = np.sum(weight * np.log1p(z**2), axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
    return np.where(np.sum(is_visible, axis=1) >= fewest_seen, mean, NEVER)
