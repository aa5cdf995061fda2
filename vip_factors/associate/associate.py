"""Association of a whole recording: from detections and inertially tracked motions to wearers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from vip_factors.associate.assignment import AssignmentProblem, solve_in_windows
from vip_factors.associate.cues import assign_by_position, clothes_log_odds
from vip_factors.associate.features import (
    Context,
    inter_features,
    intra_features,
    meta_features,
    pairs_of_frame,
    unary_features,
    vote_turn,
)
from vip_factors.associate.findings import association_findings
from vip_factors.associate.hypothesis import hypotheses, keypoint_sigma, used_confidence, wearer_points
from vip_factors.associate.tracklets import brief_choices, contradicted, tracklets
from vip_factors.associate.weights import Logistic, load_weights, verdict_features
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.settings import AssociationSettings

NOMINAL_RATE = 30.0  # frames per second to which the settings' offsets refer


@dataclass(frozen=True)
class Association:
    """Association of ``N`` detections with wearers.

    Attributes:
        wearer: ``(N,)`` index of the wearer in each detection, −1 for nobody.
        confidence: ``(N,)`` probability of that choice, 0 for nobody.
        R_camera_world: ``(N, 3, 3)`` hypothesis camera of the wearer in the world of the wearer's motion; identity for
            nobody.
        p_camera_world: ``(N, 3)`` metres, origin of that world in the camera's frame
            (``p_camera = R_camera_world @ p_world + p_camera_world``); NaN for nobody.
        unary: ``(N,)`` cost (negative log-odds) of the chosen hypothesis, otherwise of the best one; NaN without any.
        findings: ambiguities and errors that were noticed.
        by_place: ``(N,)`` whether it was associated by its position under a known camera, not by motion; its confidence
            is then the least that is required otherwise. Empty without a known camera.
        by_clothes: whether clothes were used.
        track: ``(N,)`` tracklet of each detection; empty if they were not determined.
    """

    wearer: np.ndarray
    confidence: Array
    R_camera_world: Array
    p_camera_world: Array
    unary: Array
    findings: tuple[Finding, ...] = ()
    by_place: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    by_clothes: bool = False
    track: np.ndarray = field(default_factory=lambda: np.zeros(0, int))


def associate(
    detections: Detections,
    model: CameraModel,
    motions: Sequence[Motion],
    settings: AssociationSettings | None = None,
    camera: CameraPath | None = None,
    gravity_camera: Array | None = None,
    progress: Callable[[float], None] | None = None,
    previous: Association | None = None,
) -> Association:
    """Associate detections with wearers.

    Args:
        detections: times on the recording's clock.
        model: model of the camera.
        motions: the wearers' inertially tracked motions, each in its own world with Z up unless ``camera`` is given.
        settings: defaults if None.
        camera: path of the camera in the world of all motions (second pass), or None (first pass).
        gravity_camera: ``(F, 3)`` direction of gravity (down) in the camera's frame by its IMU, of any length; NaN
            where unknown.
        progress: receives the fraction done.
        previous: association of the same detections, whose tracklets are used again.

    Raises:
        InputError: without motions, or if gravity has another shape.
    """
    settings = settings or AssociationSettings()
    if not motions:
        raise InputError("association without a wearer's motion: give at least one")
    weights = load_weights(settings.weights) if settings.weights else load_weights()
    context = make_context(detections, model, motions, camera, gravity_camera, previous=previous)
    suffix = "" if camera is None else "_camera"
    features = unary_features(context)
    odds = weights.logistic["unary" + suffix].log_odds(features)
    result = _by_motion(context, features, odds, weights.logistic, settings, progress)
    clothes = _clothes(context, detections, result.wearer)
    if clothes is not None and settings.by_clothes:
        h = context.hypotheses
        dressed = odds + clothes[h.wearer, h.detection]
        result = replace(_by_motion(context, features, dressed, weights.logistic, settings, None), by_clothes=True)
    if context.camera is not None and settings.by_place:
        result = _with_positions(result, context, context.camera, settings.least_confidence, clothes)
    if not settings.check:
        return result
    return replace(result, findings=association_findings(detections, context, odds, motions, result.wearer))


def add_by_position(
    association: Association,
    detections: Detections,
    model: CameraModel,
    motions: Sequence[Motion],
    camera: CameraPath,
    settings: AssociationSettings | None = None,
) -> Association:
    """Add detections at the wearers' positions to an association. Arguments as for :func:`associate`."""
    settings = settings or AssociationSettings()
    if not settings.by_place:
        return association
    context = make_context(detections, model, motions, camera, None, fitted=False, previous=association)
    if context.camera is None:
        return association
    clothes = _clothes(context, detections, association.wearer) if settings.by_clothes else None
    return _with_positions(association, context, context.camera, settings.least_confidence, clothes)


def _by_motion(
    context: Context,
    features: Array,
    odds: Array,
    logistic: Mapping[str, Logistic],
    settings: AssociationSettings,
    progress: Callable[[float], None] | None,
) -> Association:
    """Association by the assignment problem, for hypotheses with features ``(P, ...)`` and log-odds ``(P,)``."""
    least_choices = 3  # least number of a wearer: strangers move alike for a moment
    verdict = logistic["verdict" + ("" if context.camera is None else "_camera")]
    problem, rows = build_assignment(context, odds, logistic, settings)
    chosen = choose(context, problem, settings, progress)
    log_odds = verdict.log_odds(verdict_features(context, features[rows], odds[rows], problem, chosen))
    confidence = 1 / (1 + np.exp(-np.clip(log_odds, -50, 50)))
    sure = confidence >= settings.least_confidence
    # Choices that contradict the wearer's tracklets.
    detection, sure_rows = problem.detection[chosen][sure], rows[chosen][sure]
    wearer_of, odds_of = np.full(len(context.frame), -1), np.zeros(len(context.frame))
    wearer_of[detection], odds_of[detection] = context.hypotheses.wearer[sure_rows], odds[sure_rows]
    wrong = contradicted(context.frame, context.track, wearer_of, odds_of)
    wrong |= brief_choices(context.track, np.where(wrong, -1, wearer_of), context.weight, context.rate)
    sure[sure] = ~wrong[detection]
    wearer = problem.wearer[chosen]
    sure &= np.bincount(wearer, weights=sure, minlength=1)[wearer] >= least_choices  # seen again
    return _result(context, odds, rows[chosen][sure], confidence[sure])


def _clothes(context: Context, detections: Detections, wearer: np.ndarray) -> Array | None:
    """Log-odds ``(W, N)`` by clothes; None if they carry no information."""
    if detections.torso_colour is None:
        return None
    odds = clothes_log_odds(context, detections.torso_colour, wearer)
    return odds if np.any(odds) else None


def _with_positions(
    result: Association, context: Context, camera: CameraPath, confidence: float, clothes: Array | None
) -> Association:
    """Add the detections at the positions of wearers."""
    wearer = assign_by_position(context, camera, result.wearer, clothes)
    added = (wearer != result.wearer) & ~contradicted(context.frame, context.track, wearer, -result.unary)
    wearer = np.where(added, wearer, result.wearer)
    R = transpose(camera.R_world_camera)[context.frame]
    p = -(R @ camera.p_world_camera[context.frame][..., None])[..., 0]
    return replace(
        result,
        wearer=wearer,
        confidence=np.where(added, confidence, result.confidence),
        R_camera_world=np.where(added[:, None, None], R, result.R_camera_world),
        p_camera_world=np.where(added[:, None], p, result.p_camera_world),
        by_place=added | result.by_place if len(result.by_place) else added,
    )


def make_context(
    detections: Detections,
    model: CameraModel,
    motions: Sequence[Motion],
    camera: CameraPath | None,
    gravity_camera: Array | None,
    fitted: bool = True,
    previous: Association | None = None,
) -> Context:
    """Tracklets of a recording, and hypothesis cameras if ``fitted``. Arguments as for :func:`associate`."""
    F = len(detections.time)
    up = None
    if gravity_camera is not None:
        if np.shape(gravity_camera) != (F, 3):
            raise InputError(f"gravity in the camera {np.shape(gravity_camera)}: expected ({F}, 3), as the video")
        with np.errstate(invalid="ignore", divide="ignore"):
            up = -gravity_camera / np.linalg.norm(gravity_camera, axis=1, keepdims=True)
    rays, weight = model.normalise(detections.pixels), used_confidence(detections)
    wearers = tuple(wearer_points(motion, detections.keypoints, detections.time) for motion in motions)
    track = np.zeros(0, int) if previous is None else previous.track
    if len(track) != len(detections):
        track = tracklets(detections.frame, rays, weight, detections.rate or NOMINAL_RATE)
    looked_at = detections if fitted else detections.select(np.zeros(len(detections), bool))
    return Context(
        hypotheses=hypotheses(looked_at, rays[: len(looked_at)], wearers),
        wearers=wearers,
        names=detections.keypoints.keypoints,
        rays=rays,
        weight=weight,
        track=track,
        frame=detections.frame,
        time=detections.time,
        sigma=keypoint_sigma(detections.keypoints),
        camera=None if camera is None else camera.at(detections.time),
        up_camera=up,
    )


def build_assignment(
    context: Context, odds: Array, logistic: Mapping[str, Logistic], settings: AssociationSettings
) -> tuple[AssignmentProblem, np.ndarray]:
    """Assignment problem over the ``H`` likely hypotheses of ``P``, and their rows ``(H,)``.

    ``odds`` ``(P,)`` are the log-odds of single hypotheses, ``logistic`` the regressions by name.
    """
    h, suffix = context.hypotheses, "" if context.camera is None else "_camera"
    rows = np.flatnonzero(gated(context, odds, settings))
    a, b = inter_edges(context, rows, settings)
    # Edges to neighbouring frames carry nearly the same information: together they count like one.
    weight_between_frames, weight_within_frame = 0.16, 0.5
    costs = [-weight_between_frames * logistic["inter" + suffix].log_odds(inter_features(context, a, b))]
    edges = [np.stack([a, b], axis=1)]
    for a, b, features in intra_edges(context, rows, odds):
        edges.append(np.stack([a, b], axis=1))
        costs.append(-weight_within_frame * logistic["intra" + suffix].log_odds(features))
    new = np.full(len(h), -1)
    new[rows] = np.arange(len(rows))
    problem = AssignmentProblem(
        h.frame[rows], h.wearer[rows], h.detection[rows], -odds[rows], new[np.concatenate(edges)], np.concatenate(costs)
    )
    return problem, rows


def choose(
    context: Context,
    problem: AssignmentProblem,
    settings: AssociationSettings,
    progress: Callable[[float], None] | None = None,
) -> np.ndarray:
    """Solve the assignment window by window: the choice ``(H,)``."""
    window, overlap = (max(1, round(seconds * context.rate)) for seconds in (settings.window_s, settings.overlap_s))
    return solve_in_windows(problem, max(window, overlap + 1), overlap, progress)


def gated(context: Context, odds: Array, settings: AssociationSettings) -> np.ndarray:
    """Hypotheses ``(P,)`` that are likely enough, and among the likeliest of their wearer and frame."""
    h = context.hypotheses
    group = h.frame * len(context.wearers) + h.wearer
    order = np.lexsort((-odds, group))
    first_of_group = np.flatnonzero(np.diff(group[order], prepend=-1))
    rank = np.empty(len(h), int)
    rank[order] = np.arange(len(h)) - np.repeat(first_of_group, np.diff(np.append(first_of_group, len(h))))
    least_odds = -5.0  # one in 150
    return (odds > least_odds) & (rank < settings.rivals)


def inter_edges(context: Context, rows: np.ndarray, settings: AssociationSettings) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of hypotheses ``(E,)``, ``(E,)`` of one wearer, some frames apart."""
    h = context.hypotheses
    offsets = np.unique([max(1, round(offset * context.rate / NOMINAL_RATE)) for offset in settings.offsets])
    stride = len(context.time) + int(offsets.max()) + 1
    key = h.wearer[rows] * stride + h.frame[rows]
    order = np.argsort(key, kind="stable")
    rows, key = rows[order], key[order]
    first_rows, second = [], []
    for offset in offsets:
        low, high = np.searchsorted(key, key + offset, "left"), np.searchsorted(key, key + offset, "right")
        count = high - low
        first_rows.append(np.repeat(np.arange(len(rows)), count))
        second.append(np.repeat(low - np.cumsum(count) + count, count) + np.arange(count.sum()))
    return rows[np.concatenate(first_rows)], rows[np.concatenate(second)]


def intra_edges(context: Context, rows: np.ndarray, odds: Array) -> list[tuple[np.ndarray, np.ndarray, Array]]:
    """Pairs of different wearers' hypotheses in one frame, with their features."""
    which = np.zeros(len(context.hypotheses), bool)
    which[rows] = True
    good = np.where(which, 1 / (1 + np.exp(-np.clip(odds, -50, 50))), 0.0)
    edges = []
    for i, j in combinations(range(len(context.wearers)), 2):
        a, b = pairs_of_frame(context, i, j, which)
        if not len(a):
            continue
        if context.camera is not None:
            features = meta_features(context, a, b)
        else:
            features = intra_features(context, a, b, vote_turn(context, good, i, j))
        edges.append((a, b, features))
    return edges


def _result(context: Context, odds: Array, rows: np.ndarray, confidence: Array) -> Association:
    h, N = context.hypotheses, len(context.frame)
    unary = np.full(N, np.inf)
    np.minimum.at(unary, h.detection, -odds)
    unary[~np.isfinite(unary)] = np.nan
    wearer, sure = np.full(N, -1), np.zeros(N)
    R, p = np.tile(np.eye(3), (N, 1, 1)), np.full((N, 3), np.nan)
    detection = h.detection[rows]
    wearer[detection], sure[detection], unary[detection] = h.wearer[rows], confidence, -odds[rows]
    R[detection] = h.R_camera_world[rows]
    p[detection] = -(h.R_camera_world[rows] @ h.p_world_camera[rows][..., None])[..., 0]
    return Association(wearer, sure, R, p, unary, track=context.track)
