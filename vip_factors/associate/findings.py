"""What is odd about who is seen."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from vip_factors.associate.features import Context, given_keypoints
from vip_factors.associate.hypothesis import FEWEST_KEYPOINTS, fit_cameras, keypoint_sigma, wearer_points
from vip_factors.body.keypoints import KEYPOINT_SETS, KeypointSet
from vip_factors.body.kinematics import Motion
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, rotation_z, yaw_of
from vip_factors.sensors.detections import Detections

SAMPLE = 300  # detections looked at for the order of keypoints
# The same of the given order with its sides exchanged, in a mirrored picture too: of 17 sound scenes none is below 1.13
# or better in more than 0.42 of the detections; 13 of 17 mirrored pictures are below 0.8, all better in 0.65 or more.
SIDES_BETTER, SIDES_SHARE = 0.8, 0.7
TELLING = ("shoulder", "hip", "knee", "ankle")  # eight keypoints by which people are told apart
REFUSED = 20.0  # cost, in squared sigmas, of a detection that no camera explains


def find_oddities(
    detections: Detections, context: Context, odds: Array, motions: Sequence[Motion], wearer: np.ndarray
) -> tuple[Finding, ...]:
    """What is odd; none if all is well."""
    if len(detections) == 0:
        return (_unused(f"nobody is visible in any of its {len(detections.time)} frames, check the detections' file"),)
    if not any(points.covered[detections.frame].any() for points in context.wearers):
        return (_unused("it does not overlap with the sensors in time, check the camera's time offset"),)
    if _shown_at_once(context) < FEWEST_KEYPOINTS:
        return (_too_few(context),)
    found = [*_order_finding(detections, context, motions), *_alike(context, motions)]
    for w, motion in enumerate(motions):
        if not np.any(wearer == w):
            found.append(_never_found(context, odds, w, motion))
    return tuple(found)


def _usable(context: Context) -> np.ndarray:
    """Which keypoints ``(N, K)`` are seen and on our body."""
    on_body = np.any([np.isfinite(one.p_world_keypoint).any(axis=(0, 2)) for one in context.wearers], axis=0)
    return np.asarray((context.weight > 0) & on_body)


def _shown_at_once(context: Context) -> float:
    """How many usable keypoints the best tenth of the detections have at least."""
    return float(np.quantile(_usable(context).sum(axis=1), 0.9))


def _given(context: Context) -> list[str]:
    """The keypoints on our body that the detector gives."""
    which = given_keypoints(_usable(context).sum(axis=0))
    return [name for name, given in zip(context.names, which, strict=True) if given]


def _unused(reason: str) -> Finding:
    return Finding("video unused", words={"reason": reason})


def _too_few(context: Context) -> Finding:
    given = _given(context)
    missing = [joint for joint in TELLING if not any(joint in name for name in given)]
    return _unused(
        f"people are visible with {_shown_at_once(context):.0f} keypoints each (the detector gives "
        f"{', '.join(given) or 'none that is on the body'}), and at least {FEWEST_KEYPOINTS} at once are needed to "
        f"tell who is who: add {' and '.join(missing) or 'those that are missing'}"
    )


def _never_found(context: Context, odds: Array, w: int, motion: Motion) -> Finding:
    few_keypoints = 8  # with fewer, that nobody is found is no sign of anything being wrong
    given, what = _given(context), ""
    if not np.any(context.hypotheses.wearer == w):
        what = f"no detection shows {FEWEST_KEYPOINTS} keypoints at once while the sensors measure"
    elif len(given) < few_keypoints:
        what = f"the detector gives {len(given)} keypoints ({', '.join(given)})"
    if what:
        so = f"{what}; more of them (knees and ankles, elbows and wrists) would tell"
        return Finding("hardly seen", motion.name, words={"seen": "not surely recognised", "so": so})
    reason = (
        "people are visible, but none moves as the sensors say: either this wearer is not in the picture, or the "
        "video's clock, its keypoints' order or the sensors' places are wrong"
    )
    return Finding("video mismatch", motion.name, words={"reason": reason})


def _alike(context: Context, motions: Sequence[Motion]) -> list[Finding]:
    """Pairs of wearers who move alike, seen from wherever."""
    alike_share = 0.7  # of the frames
    alike_m = 0.08  # mean distance between two wearers' keypoints below which nobody could tell them apart
    findings = []
    for i, j in combinations(range(len(motions)), 2):
        gap = _distance_up_to_heading(context, i, j)
        if len(gap) and np.mean(gap < alike_m) > alike_share:
            numbers = {"cm": 100 * float(np.median(gap))}
            findings.append(Finding("alike", motions[i].name, subject=motions[j].name, numbers=numbers))
    return findings


def _distance_up_to_heading(context: Context, i: int, j: int) -> Array:
    """Mean keypoint distance of two wearers in metres, each about the own root and turned alike, per frame."""
    a, b = context.wearers[i], context.wearers[j]
    both = a.covered & b.covered
    first, second = (
        (one.p_world_keypoint[both] - one.p_world_pelvis[both][:, None])
        @ rotation_z(yaw_of(one.R_world_pelvis[both] @ _UPRIGHT_PELVIS))
        for one in (a, b)
    )
    known = np.all(np.isfinite(first) & np.isfinite(second), axis=(0, 2)) if both.any() else np.zeros(0, bool)
    if not known.any():
        return np.zeros(0)
    return np.linalg.norm(first[:, known] - second[:, known], axis=-1).mean(axis=1)


# R_pelvis_upright: a pelvis at rest has y up and z forward; turned by this its z is up.
_UPRIGHT_PELVIS = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])


def _order_finding(detections: Detections, context: Context, motions: Sequence[Motion]) -> list[Finding]:
    """Whether another known order of keypoints explains the detections much better."""
    # Of the cost: what another order must reach; another view of the body reaches 0.9
    much_better, much_share = 0.6, 0.75
    parts = 6  # in which they are: after two or three of them most orders are out of the question
    given = detections.keypoints
    usable = np.flatnonzero((context.weight > 0).sum(axis=1) >= max(8, 0.6 * len(given)))
    if len(usable) < 5:
        return []
    sample = usable[np.linspace(0, len(usable) - 1, min(SAMPLE, len(usable))).astype(int)]
    least = np.full(len(detections), REFUSED)
    np.fmin.at(least, context.hypotheses.detection, context.hypotheses.cost)
    reference, found = least[sample], list[tuple[float, str]]()
    for name, keypoints, mirrored, across in _orders(given):
        much, share = (SIDES_BETTER, SIDES_SHARE) if name.startswith(f"{given.name} ") else (much_better, much_share)
        cost = np.full(len(sample), np.nan)
        for part in (slice(first, None, parts) for first in range(parts)):
            cost[part] = _best_costs(detections, context, motions, sample[part], keypoints, mirrored, across)
            if np.mean(~(cost >= reference)) <= share:  # were all the others better
                break
        else:
            if np.median(cost) < much * np.median(reference):
                found.append((float(np.median(cost)), name))
    if not found:
        return []
    return [Finding("keypoint order", words={"given": given.name, "better": min(found)[1]})]


def _orders(given: KeypointSet) -> list[tuple[str, KeypointSet, bool, float]]:
    """Names of others, sets, whether their sides are exchanged, and -1 for a picture that is mirrored as well."""
    same = [given, *(one for one in KEYPOINT_SETS.values() if len(one) == len(given) and one.name != given.name)]
    plain = [(one.name, one, False, 1.0) for one in same[1:]]
    exchanged = [(f"{one.name} with left and right exchanged", one, True, 1.0) for one in same]
    return [*plain, *exchanged, (f"{given.name} in a mirrored picture (or one half a stride late)", given, True, -1.0)]


def _best_costs(
    detections: Detections,
    context: Context,
    motions: Sequence[Motion],
    sample: np.ndarray,
    keypoints: KeypointSet,
    mirrored: bool,
    across: float,
) -> Array:
    """Least cost ``(S,)`` over the wearers of some detections read in another order; a high one where none fits."""
    order = keypoints.mirrored if mirrored else np.arange(len(keypoints))
    sigma, time = keypoint_sigma(keypoints)[order], detections.time[detections.frame[sample]]
    best = np.full(len(sample), REFUSED)
    for motion in motions:
        points = wearer_points(motion, keypoints, time)
        local = (points.p_world_keypoint - points.p_world_pelvis[:, None])[:, order]
        known = np.all(np.isfinite(local), axis=-1)
        fit = fit_cameras(
            local, context.rays[sample] * [across, 1.0], np.where(known, context.weight[sample], 0.0), sigma
        )
        best = np.fmin(best, fit.cost)
    return best
