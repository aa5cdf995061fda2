"""How sure a choice is, once all are made: what each says on its own, and what those around it say."""

import numpy as np

from vip_factors.associate.features import UNARY, UNARY_CAMERA, Context
from vip_factors.associate.programme import Programme
from vip_factors.geometry.rotations import Array

AROUND_S = 2.0  # over which neighbours' support is averaged
MOST_SUPPORT = 12.0  # log-odds: beyond, it is all the same
_SUPPORT = ("odds", "inter_support", "intra_support", "beside", "support_around", "share_around")
VERDICT = (*UNARY, *_SUPPORT)
VERDICT_CAMERA = (*UNARY_CAMERA, *_SUPPORT)


def verdict_features(context: Context, unary: Array, odds: Array, programme: Programme, chosen: np.ndarray) -> Array:
    """Features ``(C, len(VERDICT))`` of the chosen hypotheses.

    Args:
        context: of the recording.
        unary: ``(H, ...)`` features of the programme's hypotheses.
        odds: ``(H,)`` their log-odds.
        programme: all within the gate.
        chosen: ``(H,)`` of them.
    """
    a, b = programme.edges.T
    both = chosen[a] & chosen[b]
    a, b, support = a[both], b[both], -programme.edge_cost[both]
    between_frames = programme.frame[a] != programme.frame[b]
    H = len(chosen)

    def summed(which: np.ndarray, values: Array) -> Array:
        per_choice = np.bincount(a[which], values[which], H) + np.bincount(b[which], values[which], H)
        return np.asarray(per_choice, dtype=float)

    inter, intra = summed(between_frames, support), summed(~between_frames, support)
    beside = summed(~between_frames, np.ones(len(a)))
    total = np.clip(odds + inter + intra, -MOST_SUPPORT, MOST_SUPPORT)
    around, share = _around(context, programme, chosen, total)
    columns = [np.clip(one, -MOST_SUPPORT, MOST_SUPPORT)[chosen] for one in (odds, inter, intra, beside, around, share)]
    return np.concatenate([unary[chosen], np.stack(columns, axis=1)], axis=1)


def _around(context: Context, programme: Programme, chosen: np.ndarray, value: Array) -> tuple[Array, Array]:
    """Mean value of the choices for the same wearer nearby in time, and in what share of frames there are any."""
    half = max(1, round(AROUND_S / 2 * context.rate))
    key = programme.wearer * (len(context.time) + 3 * half) + programme.frame
    order = np.flatnonzero(chosen)[np.argsort(key[chosen], kind="stable")]
    ordered = key[order]
    low, high = np.searchsorted(ordered, key - half, "left"), np.searchsorted(ordered, key + half, "right")
    total = np.concatenate([[0.0], np.cumsum(value[order])])
    return (total[high] - total[low]) / np.maximum(high - low, 1), (high - low) / (2 * half + 1)
