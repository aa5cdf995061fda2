"""Who is who by clothes and by position in the picture, where motion leaves it open.

Clothes: what the torsos of a wearer's sure detections look like is compared with what others look like in frames that
surely show the wearer elsewhere. Where everybody is dressed alike the two are the same, and clothes say nothing.

Position: the assignment fits a camera to every detection, which takes six of its numbers, and doubts whoever shows few
joints: half hidden people. Once the camera's path is known and the motions are in its world, each wearer's keypoints
are expected at places in the picture, and what lies there is theirs, unless somebody else's would do nearly as well.
"""

import numpy as np

from vip_factors.associate.features import Context, rival
from vip_factors.associate.tracklets import sums_around
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraPath

SURELY = 3.0  # most that clothes may say, in log-odds: twenty to one


def clothes_log_odds(context: Context, colour: Array, wearer: np.ndarray) -> Array:
    """Log-odds ``(W, N)`` by clothes that each detection shows each wearer; 0 where they tell nothing.

    Args:
        context: of the recording.
        colour: ``(N, B)`` shares of the torsos' colours; NaN where not seen.
        wearer: ``(N,)`` who was found by motion, −1 for nobody.
    """
    unseen = 0.2  # share of others' looks: somebody may come whom nobody has seen yet
    changed = 0.05  # share of the wearer's looks that are like nothing before: light changes, jackets are opened
    trusted = 0.6  # of the wearer's sure looks, those most alike: by motion alone a third may be of somebody else
    enough_looks = 10  # of the wearer's torso, and of others', to compare anybody with
    W, N = len(context.wearers), len(wearer)
    odds = np.zeros((W, N))
    around = _around(context, colour)
    looked = np.isfinite(colour[:, :1]).ravel()
    known = np.isfinite(around).all(axis=1)
    for w in range(W):
        shows = np.zeros(len(context.time), bool)
        shows[context.frame[wearer == w]] = True
        own = looked & (wearer == w)
        others = looked & (wearer != w) & shows[context.frame]
        if min(own.sum(), others.sum()) < enough_looks:
            continue
        unlike = _unlike(around, np.median(colour[own], axis=0))
        own &= unlike <= np.quantile(unlike[own], trusted)
        mine = _density(unlike[known], unlike[own], changed)
        odds[w, known] = np.clip(np.log(mine / _density(unlike[known], unlike[others], unseen)), -SURELY, SURELY)
    return odds


def _around(context: Context, colour: Array) -> Array:
    """Colours ``(N, B)`` averaged over a time of each detection's tracklet; NaN where it was never seen."""
    window_s = 2.0  # of a tracklet over which torsos are averaged: an arm before the chest or a passer-by lasts less
    half = window_s / 2 * context.rate
    key = context.track * (len(context.time) + 4 * int(half + 1)) + context.frame
    looked = np.isfinite(colour).all(axis=1)
    total, count = sums_around(key, half, key[looked], colour[looked])
    return np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)


def _unlike(colour: Array, reference: Array) -> Array:
    """Hellinger distances ``(N,)`` of shares ``(N, B)`` from others ``(B,)``."""
    share = reference / max(float(reference.sum()), 1e-9)
    return np.asarray(np.sqrt(np.maximum(1 - np.sum(np.sqrt(np.maximum(colour, 0) * share), axis=1), 0)))


def _density(at: Array, samples: Array, elsewhere: float) -> Array:
    """How dense ``(n,)`` distances lie, smoothed by what light and folds make; a share of them lies anywhere."""
    cells = 100  # of the distances' histogram
    unlike = 0.1  # Hellinger distance that light and folds make between two looks at the same clothes
    edges = np.linspace(0, 1, cells + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    share = np.histogram(np.clip(samples, 0, 1), edges)[0] / len(samples)
    width = unlike * np.sqrt(2 * np.pi)
    density = np.exp(-0.5 * ((middles[:, None] - middles) / unlike) ** 2) @ share / width
    return np.asarray((1 - elsewhere) * np.interp(at, middles, density) + elsewhere)


# Mean of log(1 + z²) over the keypoints, z in sigmas, as of keypoints 2.5 sigmas off each. Of two people's joints in
# one detection more than two thirds must be in place to reach it.
FITTING = float(np.log1p(2.5**2))
NEVER = 100.0  # a cost beyond all others


def assign_by_position(
    context: Context, camera: CameraPath, wearer: np.ndarray, clothes: Array | None = None
) -> np.ndarray:
    """Wearers ``(N,)`` of the detections, with those added that lie where the wearer is; −1 for nobody.

    Wearers are added only in frames that do not show them yet, and only to detections that are nobody's, and that are
    not surely dressed otherwise by the log-odds ``clothes`` ``(W, N)``. ``camera`` is in the world of all motions.
    """
    dressed = -2.0  # log-odds of the clothes at least: one in eight of the wearer's own looks less like them
    lead = 1.0  # how much worse the next best must be: e times the squared errors
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
    """How far off ``(N,)`` each detection is from where a wearer is expected: the keypoints' mean of log(1 + z²).

    Sigmas are the scatter of the detections that are ``sure`` ``(N,)`` the wearer's already, and what a motion errs by;
    with hardly any of these nobody fits.
    """
    nearest = 0.3  # m, before the camera
    predicted_m = 0.03  # what a fused motion errs by where nobody was seen: its usual joint error
    rayleigh_median = 1.1774  # median length of a vector of two normal numbers
    enough_sure = 10  # sightings of a wearer, to know how keypoints scatter about the motion
    fewest_seen = 4  # keypoints: eight numbers, none of which a camera takes
    if np.sum(sure) < enough_sure:
        return np.full(len(sure), NEVER)
    points, frame = context.wearers[wearer].p_world_keypoint, context.frame
    p = (points - camera.p_world_camera[:, None]) @ camera.R_world_camera
    depth = np.maximum(p[..., 2], nearest)
    error = np.linalg.norm((p[..., :2] / depth[..., None])[frame] - context.rays, axis=-1) * depth[frame]
    known = np.isfinite(error) & (context.weight > 0)
    scatter = [np.median(column[one & sure]) if np.any(one & sure) else predicted_m
               for column, one in zip(error.T, known.T, strict=True)]  # fmt: skip
    z = np.where(known, error, 0.0) / np.hypot(np.array(scatter) / rayleigh_median, predicted_m)
    weight = np.where(known, context.weight, 0.0)
    mean = np.sum(weight * np.log1p(z**2), axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
    return np.where(np.sum(known, axis=1) >= fewest_seen, mean, NEVER)
