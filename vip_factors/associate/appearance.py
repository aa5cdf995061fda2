"""What clothes say about who is who, learned from the surely found of this very recording.

Motion decides; clothes speak where it does not. What the torsos of a wearer's sure detections look like is compared
with what others look like in frames that surely show the wearer elsewhere. Where everybody is dressed alike the two are
the same, and clothes say nothing.
"""

import numpy as np

from vip_factors.associate.features import Context
from vip_factors.geometry.rotations import Array

WINDOW_S = 2.0  # of a tracklet over which torsos are averaged: an arm before the chest or a passer-by lasts less
ENOUGH_LOOKS = 10  # of the wearer's torso, and of others', to compare anybody with
UNLIKE = 0.1  # Hellinger distance that light and folds make between two looks at the same clothes
TRUSTED = 0.6  # of the wearer's sure looks, those most alike: by motion alone a third may be of somebody else
CHANGED = 0.05  # share of the wearer's looks that are like nothing before: light changes, jackets are opened
UNSEEN = 0.2  # share of others' looks: somebody may come whom nobody has seen yet
CELLS = 100  # of the distances' histogram
SURELY = 3.0  # most that clothes may say, in log-odds: twenty to one


def clothes_odds(context: Context, colour: Array, wearer: np.ndarray) -> Array:
    """Log-odds ``(W, N)`` by clothes that each detection shows each wearer; 0 where they tell nothing.

    Args:
        context: of the recording.
        colour: ``(N, B)`` shares of the torsos' colours; NaN where not seen.
        wearer: ``(N,)`` who was found by motion, −1 for nobody.
    """
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
        if min(own.sum(), others.sum()) < ENOUGH_LOOKS:
            continue
        unlike = _unlike(around, np.median(colour[own], axis=0))
        own &= unlike <= np.quantile(unlike[own], TRUSTED)
        mine = _density(unlike[known], unlike[own], CHANGED)
        odds[w, known] = np.clip(np.log(mine / _density(unlike[known], unlike[others], UNSEEN)), -SURELY, SURELY)
    return odds


def _around(context: Context, colour: Array) -> Array:
    """Colours ``(N, B)`` averaged over a time of each detection's tracklet; NaN where it was never seen."""
    half = WINDOW_S / 2 * context.rate
    key = context.track * (len(context.time) + 4 * int(half + 1)) + context.frame
    looked = np.flatnonzero(np.isfinite(colour).all(axis=1))
    looked = looked[np.argsort(key[looked], kind="stable")]
    ordered = key[looked]
    low, high = np.searchsorted(ordered, key - half, "left"), np.searchsorted(ordered, key + half, "right")
    total = np.concatenate([np.zeros((1, colour.shape[1])), np.cumsum(colour[looked], axis=0)])
    count = high - low
    return np.where(count[:, None] > 0, (total[high] - total[low]) / np.maximum(count, 1)[:, None], np.nan)


def _unlike(colour: Array, reference: Array) -> Array:
    """Hellinger distances ``(N,)`` of shares ``(N, B)`` from others ``(B,)``."""
    share = reference / max(float(reference.sum()), 1e-9)
    return np.asarray(np.sqrt(np.maximum(1 - np.sum(np.sqrt(np.maximum(colour, 0) * share), axis=1), 0)))


def _density(at: Array, samples: Array, elsewhere: float) -> Array:
    """How dense ``(n,)`` distances lie, smoothed by what light and folds make; a share of them lies anywhere."""
    edges = np.linspace(0, 1, CELLS + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    share = np.histogram(np.clip(samples, 0, 1), edges)[0] / len(samples)
    width = UNLIKE * np.sqrt(2 * np.pi)
    density = np.exp(-0.5 * ((middles[:, None] - middles) / UNLIKE) ** 2) @ share / width
    return np.asarray((1 - elsewhere) * np.interp(at, middles, density) + elsewhere)
