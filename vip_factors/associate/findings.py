"""Findings about the association of detections with wearers."""

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

SAMPLE = 300  # detections tested for the order of keypoints
# The same for the declared order with sides exchanged, also in a mirrored image: 17 sound scenes are above 1.13 or
# better in at most 0.42 of the detections; 13 of 17 mirrored ones are below 0.8, all better in 0.65 or more.
SIDES_BETTER, SIDES_SHARE = 0.8, 0.7
TELLING = ("shoulder", "hip", "knee", "ankle")  # eight keypoints that distinguish people
REFUSED = 20.0  # cost, in squared sigmas, of a detection that no camera fits


def association_findings(
    detections: Detections, context: Context, odds: Array, motions: Sequence[Motion], wearer: np.ndarray
) -> tuple[Finding, ...]:
    """Findings about the association; none if all is well."""
    if len(detections) == 0:
        return (_unused(f"nobody is visible in any of its {len(detections.time)} frames, check the detections' file"),)
    if not any(points.covered[detections.frame].any() for points in context.wearers):
        return (_unused("it does not overlap with the sensors in time, check the camera's time offset"),)
    if _shown_at_once(context) < FEWEST_KEYPOINTS:
        return (_keypoints_finding(context),)
    findings = [*_order_finding(detections, context, motions), *_alike_findings(context, motions)]
    for w, motion in enumerate(motions):
        if not np.any(wearer == w):
            findings.append(_missing_finding(context, odds, w, motion))
    return tuple(findings)


def _usable(context: Context) -> np.ndarray:
    """Keypoints ``(N, K)`` that are visible and on the body model."""
    on_body = np.any([np.isfinite(points.p_world_keypoint).any(axis=(0, 2)) for points in context.wearers], axis=0)
    return np.asarray((context.weight > 0) & on_body)


def _shown_at_once(context: Context) -> float:
    """Least number of usable keypoints in the best tenth of the detections."""
    return float(np.quantile(_usable(context).sum(axis=1), 0.9))


def _given_names(context: Context) -> list[str]:
    """Names of the keypoints on the body model that the detector gives."""
    which = given_keypoints(_usable(context).sum(axis=0))
    return [name for name, is_given in zip(context.names, which, strict=True) if is_given]


def _unused(reason: str) -> Finding:
    return Finding("video unused", words={"reason": reason})


def _keypoints_finding(context: Context) -> Finding:
    given_names = _given_names(context)
    missing = [joint for joint in TELLING if not any(joint in name for name in given_names)]
    return _unused(
        f"people are visible with {_shown_at_once(context):.0f} keypoints each (the detector gives "
        f"{', '.join(given_names) or 'none that is on the body'}), and at least {FEWEST_KEYPOINTS} at once are needed "
        f"to associate wearers: add {' and '.join(missing) or 'those that are missing'}"
    )


def _missing_finding(context: Context, odds: Array, w: int, motion: Motion) -> Finding:
    few_keypoints = 8  # of the detector, below which a wearer without detections is no sign of an error
    given_names, what = _given_names(context), ""
    if not np.any(context.hypotheses.wearer == w):
        what = f"no detection shows {FEWEST_KEYPOINTS} keypoints at once while the sensors measure"
    elif len(given_names) < few_keypoints:
        what = f"the detector gives {len(given_names)} keypoints ({', '.join(given_names)})"
    if what:
        advice = f"{what}; more of them (knees and ankles, elbows and wrists) would help"
        return Finding("hardly seen", motion.name, words={"seen": "not surely recognised", "so": advice})
    reason = (
        "people are visible, but none moves like the wearer: either the wearer is not in the image, or the "
        "video's clock, the order of keypoints or the sensor placement is wrong"
    )
    return Finding("video mismatch", motion.name, words={"reason": reason})


def _alike_findings(context: Context, motions: Sequence[Motion]) -> list[Finding]:
    """Findings about pairs of wearers whose motions are alike, from any viewpoint."""
    alike_share = 0.7  # of the frames
    alike_m = 0.08  # mean distance between two wearers' keypoints below which they cannot be distinguished
    findings = []
    for i, j in combinations(range(len(motions)), 2):
        gap = _distance_up_to_heading(context, i, j)
        if len(gap) and np.mean(gap < alike_m) > alike_share:
            numbers = {"cm": 100 * float(np.median(gap))}
            findings.append(Finding("alike", motions[i].name, subject=motions[j].name, numbers=numbers))
    return findings


def _distance_up_to_heading(context: Context, i: int, j: int) -> Array:
    """Mean keypoint distance of two wearers in metres, relative to the root and heading, per frame."""
    a, b = context.wearers[i], context.wearers[j]
    is_covered = a.covered & b.covered
    points_a, points_b = (
        (wearer.p_world_keypoint[is_covered] - wearer.p_world_pelvis[is_covered][:, None])
        @ rotation_z(yaw_of(wearer.R_world_pelvis[is_covered] @ _UPRIGHT_PELVIS))
        for wearer in (a, b)
    )
    common = np.all(np.isfinite(points_a) & np.isfinite(points_b), axis=(0, 2))
    if not is_covered.any() or not common.any():
        return np.zeros(0)
    return np.linalg.norm(points_a[:, common] - points_b[:, common], axis=-1).mean(axis=1)


# R_pelvis_upright: a pelvis at rest has y up and z forward; after this rotation z is up.
_UPRIGHT_PELVIS = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])


def _order_finding(detections: Detections, context: Context, motions: Sequence[Motion]) -> list[Finding]:
    """Finding about another known order of keypoints that fits the detections much better."""
    # Ratio of costs for a finding; another viewpoint reaches 0.9
    much_better, much_share = 0.6, 0.75
    chunks = 6  # of the sample; two or three of them exclude most orders
    declared = detections.keypoints
    usable = np.flatnonzero((context.weight > 0).sum(axis=1) >= max(8, 0.6 * len(declared)))
    if len(usable) < 5:
        return []
    sample = usable[np.linspace(0, len(usable) - 1, min(SAMPLE, len(usable))).astype(int)]
    least = np.full(len(detections), REFUSED)
    np.fmin.at(least, context.hypotheses.detection, context.hypotheses.cost)
    reference, better = least[sample], list[tuple[float, str]]()
    for name, keypoints, mirrored, flip_x in _orders(declared):
        is_same_set = name.startswith(f"{declared.name} ")
        ratio, share = (SIDES_BETTER, SIDES_SHARE) if is_same_set else (much_better, much_share)
        cost = np.full(len(sample), np.nan)
        for chunk in (slice(begin, None, chunks) for begin in range(chunks)):
            cost[chunk] = _best_costs(detections, context, motions, sample[chunk], keypoints, mirrored, flip_x)
            if np.mean(~(cost >= reference)) <= share:  # too low even if all others were better
                break
        else:
            if np.median(cost) < ratio * np.median(reference):
                better.append((float(np.median(cost)), name))
    if not better:
        return []
    return [Finding("keypoint order", words={"given": declared.name, "better": min(better)[1]})]


def _orders(declared: KeypointSet) -> list[tuple[str, KeypointSet, bool, float]]:
    """Other orders: name, set, whether sides are exchanged, and −1 for an image that is mirrored as well."""
    further = [keypoints for keypoints in KEYPOINT_SETS.values() if keypoints.name != declared.name]
    same = [declared, *(keypoints for keypoints in further if len(keypoints) == len(declared))]
    plain = [(keypoints.name, keypoints, False, 1.0) for keypoints in same[1:]]
    exchanged = [(f"{keypoints.name} with left and right exchanged", keypoints, True, 1.0) for keypoints in same]
    mirrored = (f"{declared.name} in a mirrored picture (or one half a stride late)", declared, True, -1.0)
    return [*plain, *exchanged, mirrored]


def _best_costs(
    detections: Detections,
    context: Context,
    motions: Sequence[Motion],
    sample: np.ndarray,
    keypoints: KeypointSet,
    mirrored: bool,
    flip_x: float,
) -> Array:
    """Least cost ``(S,)`` over the wearers for detections in another keypoint order; a high one where none fits."""
    order = keypoints.mirrored if mirrored else np.arange(len(keypoints))
    sigma, time = keypoint_sigma(keypoints)[order], detections.time[detections.frame[sample]]
    least_cost = np.full(len(sample), REFUSED)
    for motion in motions:
        points = wearer_points(motion, keypoints, time)
        local = (points.p_world_keypoint - points.p_world_pelvis[:, None])[:, order]
        is_on_body = np.all(np.isfinite(local), axis=-1)
        fit = fit_cameras(
            local, context.rays[sample] * [flip_x, 1.0], np.where(is_on_body, context.weight[sample], 0.0), sigma
        )
        least_cost = np.fmin(least_cost, fit.cost)
    return least_cost
