"""What speaks for or against a hypothesis on its own (thesis eq. 4.13, and further features).

The thesis's major joints are counted (4.4.3), and how much each of them counts where a detector gives few.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.associate.hypothesis import Hypotheses, WearerPoints, fit_cameras
from vip_factors.associate.tracklets import keypoint_distance, person_size, sums_around
from vip_factors.geometry.rotations import Array, angle_between, transpose, wrap_angle, yaw_of
from vip_factors.sensors.camera import CameraPath


def major_joints(names: Sequence[str]) -> np.ndarray:
    """Which keypoints ``(K,)`` are major joints."""
    joints = ("neck", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    return np.array([name.split("_")[-1] in joints for name in names], dtype=bool)


def given_keypoints(frequency: Array) -> np.ndarray:
    """Which keypoints ``(K,)`` a detector gives, by how often ``(K,)`` it gives each."""
    given = 0.1  # of how often the most frequent keypoint is found: a rarer one is not among those a detector gives
    return np.asarray((frequency > 0) & (frequency >= given * frequency.max(initial=0.0)))


def counts_for(major: np.ndarray, frequency: Array) -> float:
    """For how many ``major`` joints ``(K,)`` each one counts, by how often ``(K,)`` each keypoint is detected: more
    than one where the detector gives fewer than usual. The choice of wearers was learned from people of whom twelve or
    thirteen can be seen.
    """
    all_joints = 12  # of which so many are enough: both sides, without the neck, which not every detector gives
    given = int(np.sum(major & given_keypoints(frequency)))
    return max(1.0, all_joints / given) if given else 1.0


LIMB_ENDS = (
    ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"), ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"), ("left_hip", "left_knee"), ("left_knee", "left_ankle"),
    ("right_hip", "right_knee"), ("right_knee", "right_ankle"), ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
)  # fmt: skip
FITTING_M = 0.15  # a head's half, and what an inertial tracker errs
WINDOWS_S = (0.5, 2.0)  # over which a tracklet's evidence is averaged: half a step, and a few

UNARY = (
    "log_cost", "log_cost_half_second", "log_cost_two_seconds", "limbs", "limbs_half_second", "limbs_two_seconds",
    "joints_seen", "joints_fitting", "seven_seen", "seven_fitting", "tilt", "unsteady",
    "unsteady_two_seconds", "track_seconds", "rival_person", "rival_person_two_seconds",
    "rival_wearer", "rival_wearer_two_seconds",
)  # fmt: skip
UNARY_CAMERA = (*UNARY, "path_error", "path_error_two_seconds", "path_rival", "path_turn")
INTER_PLAIN = ("trans", "ori", "turn", "image", "tracklet")
INTER = (*INTER_PLAIN, *(f"{name}_by_time" for name in INTER_PLAIN), "time")
INTRA = ("tilt_gap", "yaw_gap", "yaw_known", "height_gap")
INTRA_CAMERA = ("tilt_gap", "yaw_gap", "meta_a", "meta_b", "meta_cost")


@dataclass(frozen=True)
class Context:
    """What the features of one recording share.

    Attributes:
        hypotheses: all ``P`` of them.
        wearers: the wearers' keypoints at the video's frames.
        names, sigma: of the keypoints, and ``(K,)`` metres, how far they lie off.
        rays, weight: ``(N, K, 2)`` undistorted coordinates of the detections and ``(N, K)`` confidences.
        track, frame: ``(N,)`` tracklet and video frame of each detection.
        time: ``(F,)`` of the video's frames, seconds.
        camera: the path at the video's frames, in the world that all wearers share, or None.
        up_camera: ``(F, 3)`` which way is up in the camera, by its IMU; NaN where unknown.
    """

    hypotheses: Hypotheses
    wearers: tuple[WearerPoints, ...]
    names: tuple[str, ...]
    rays: Array
    weight: Array
    track: np.ndarray
    frame: np.ndarray
    time: Array
    sigma: Array
    camera: CameraPath | None = None
    up_camera: Array | None = None

    @property
    def rate(self) -> float:
        """Video frames per second, by the median step between them."""
        return 1 / float(np.median(np.diff(self.time))) if len(self.time) > 1 else 30.0


def unary_features(context: Context) -> Array:
    """Features ``(P, len(UNARY))`` of every hypothesis, or ``(P, len(UNARY_CAMERA))`` where the camera is known."""
    h = context.hypotheses
    log_cost = np.log(h.cost * _by_freedom(context) + 0.02)
    limbs = _limb_agreement(context)
    tilt = _tilt(context)
    unsteady, seconds = _unsteadiness(context), _track_seconds(context)
    short, long = (partial(_mean_along_track, context, window) for window in WINDOWS_S)
    long_cost, long_unsteady = long(log_cost), long(unsteady)
    columns = [
        log_cost, short(log_cost), long_cost, limbs, short(limbs), long(limbs),
        *_joint_counts(context),
        tilt, unsteady, long_unsteady, seconds,
        rival(h.frame, h.wearer, log_cost), rival(h.frame, h.wearer, long_cost),
        rival(h.detection, h.detection, log_cost), rival(h.detection, h.detection, long_cost),
    ]  # fmt: skip
    if context.camera is not None:
        error = path_error(context, context.camera)
        R_camera_world = transpose(context.camera.R_world_camera)[h.frame]
        turn = angle_between(R_camera_world, h.R_camera_world)
        columns += [error, long(error), rival(h.frame, h.wearer, error), turn]
    return np.stack(columns, axis=1)


def _by_freedom(context: Context) -> Array:
    """By what to multiply ``(P,)`` mean squared errors: the six numbers of a camera fit to few keypoints anyhow.

    Such errors are too small by the share of their degrees of freedom that the camera takes: of ``2n`` numbers six.
    """
    usual_keypoints = 15  # of somebody who is seen whole
    used = np.sum(np.isfinite(context.hypotheses.error[..., 0]), axis=1)
    return np.asarray((1 - 3 / usual_keypoints) / (1 - 3 / used))


def _joint_counts(context: Context) -> tuple[Array, ...]:
    """How many major joints ``(P,)`` are seen and how many of them fit, and whether these are seven (thesis 4.4.3).

    Where the detector gives fewer joints than usual, each of them counts for several.
    """
    enough_joints = 7  # rightly found, for a detection to count as somebody's (thesis 4.4.3)
    h, major = context.hypotheses, major_joints(context.names)
    each = counts_for(major, np.sum(context.weight > 0, axis=0))
    sure = np.clip((context.weight[h.detection][:, major] - 0.1) / 0.3, 0, 1)
    error = np.linalg.norm(h.error[:, major], axis=-1)
    fits = np.exp(-0.5 * (np.nan_to_num(error, nan=np.inf) / FITTING_M) ** 2)
    seen, fitting = each * sure.sum(axis=1), each * np.sum(sure * fits, axis=1)
    return seen, fitting, *(1 / (1 + np.exp(-2 * (count - enough_joints + 0.5))) for count in (seen, fitting))


def path_error(context: Context, camera: CameraPath) -> Array:
    """Logarithm ``(P,)`` of the robust reprojection error under a known camera path, in sigmas of a keypoint."""
    h = context.hypotheses
    points = np.stack([wearer.p_world_keypoint for wearer in context.wearers])[h.wearer, h.frame]
    p = (points - camera.p_world_camera[h.frame][:, None]) @ camera.R_world_camera[h.frame]
    depth = np.maximum(p[..., 2], 0.3)
    error = np.linalg.norm(p[..., :2] / depth[..., None] - context.rays[h.detection], axis=-1) * depth
    known = np.isfinite(error) & (context.weight[h.detection] > 0)
    w = np.where(known, context.weight[h.detection], 0.0)
    square = np.where(known, error / context.sigma, 0.0) ** 2
    return np.log(np.sum(w * np.log1p(square), axis=1) / np.maximum(w.sum(axis=1), 0.1) + 0.02)


def _limb_agreement(context: Context) -> Array:
    """Mean cosine ``(P,)`` between limbs as detected and as the hypothesis camera would see them, by their length."""
    h, names = context.hypotheses, context.names
    ends = [(names.index(a), names.index(b)) for a, b in LIMB_ENDS if a in names and b in names]
    if not ends:
        return np.zeros(len(h))
    a, b = np.array(ends).T
    depth = h.p_camera_pelvis[:, 2, None, None]
    there = context.rays[h.detection] * depth
    expected = there + h.error
    found, wanted = there[:, b] - there[:, a], expected[:, b] - expected[:, a]
    length = np.linalg.norm(found, axis=-1) * np.linalg.norm(wanted, axis=-1)
    known = np.isfinite(length) & (length > 1e-6)
    cosine = np.where(known, np.sum(found * wanted, axis=-1) / np.where(known, length, 1.0), 0.0)
    w = np.where(known, np.sqrt(np.where(known, length, 0.0)), 0.0)
    return np.sum(w * cosine, axis=1) / np.maximum(w.sum(axis=1), 0.1)


def _tilt(context: Context) -> Array:
    """Angle ``(P,)`` between up in the hypothesis camera and by its IMU; without one, by what hypotheses say mostly."""
    h = context.hypotheses
    up = h.R_camera_world[:, :, 2]
    expected = context.up_camera[h.frame] if context.up_camera is not None else np.full((len(h), 3), np.nan)
    unknown = ~np.all(np.isfinite(expected), axis=1)
    if unknown.any():
        expected = np.where(unknown[:, None], _agreed_up(context)[h.frame], expected)
    return np.arccos(np.clip(np.sum(up * expected, axis=1), -1, 1))


def _agreed_up(context: Context) -> Array:
    """Which way is up in the camera ``(F, 3)`` as good hypotheses of nearby frames say, by weighted, trimmed mean."""
    h, F = context.hypotheses, len(context.time)
    up = h.R_camera_world[:, :, 2]
    window = 2 * max(1, round(WINDOWS_S[0] * context.rate)) + 1
    w = np.exp(-2 * h.cost)
    agreed = np.tile([0.0, -1.0, 0.0], (F, 1))
    for trust in (np.deg2rad(60.0), np.deg2rad(25.0), np.deg2rad(15.0)):
        off = np.arccos(np.clip(np.sum(up * agreed[h.frame], axis=1), -1, 1))
        each = w * np.exp(-0.5 * (off / trust) ** 2)
        total = np.stack([np.bincount(h.frame, each * column, F) for column in up.T], axis=1)
        total = uniform_filter1d(total, window, axis=0, mode="constant")
        length = np.linalg.norm(total, axis=1, keepdims=True)
        agreed = np.where(length > 1e-6, total / np.maximum(length, 1e-6), agreed)
    return agreed


def _later(context: Context, seconds: float) -> np.ndarray:
    """For each hypothesis the row of the same wearer with the same tracklet about ``seconds`` later; −1 if none."""
    h = context.hypotheses
    offset = max(1, round(seconds * context.rate))
    key = (context.track[h.detection] * len(context.wearers) + h.wearer) * (len(context.time) + 2 * offset) + h.frame
    order = np.argsort(key)
    place = np.minimum(np.searchsorted(key[order], key + offset), len(key) - 1)
    found = order[place] if len(key) else order
    return np.where(key[found] == key + offset, found, -1)


def _unsteadiness(context: Context) -> Array:
    """Angle ``(P,)`` by which the hypothesis camera turns in the world within a sixth of a second."""
    turn_over_s = 0.17  # between hypotheses whose cameras are compared for steadiness
    h = context.hypotheses
    later = _later(context, turn_over_s)
    angle = angle_between(h.R_camera_world, h.R_camera_world[later]) if len(h) else np.zeros(0)
    angle = np.where(later >= 0, angle, np.nan)
    backwards = np.full(len(h), np.nan)
    backwards[later[later >= 0]] = angle[later >= 0]
    both = np.fmax(angle, backwards)
    return np.where(np.isfinite(both), both, np.deg2rad(20.0))  # as a person seen for a moment: neither good nor bad


def _track_seconds(context: Context) -> Array:
    """How long ``(P,)`` the tracklet of the detection lasts, up to the longer window."""
    count = np.bincount(context.track)[context.track[context.hypotheses.detection]]
    return np.minimum(count / context.rate, WINDOWS_S[-1])


def _mean_along_track(context: Context, window_s: float, values: Array) -> Array:
    """Means ``(P,)`` over a window of time along the tracklet, of values of the same wearer's hypotheses."""
    h, half = context.hypotheses, window_s / 2 * context.rate
    group = context.track[h.detection] * len(context.wearers) + h.wearer
    key = group * (len(context.time) + 4 * int(half + 1)) + h.frame
    total, count = sums_around(key, half, key, values)
    return total / count


def rival(group: np.ndarray, other_group: np.ndarray, values: Array) -> Array:
    """How much worse ``(P,)`` the best other hypothesis of the same group is than this one, between ± NO_RIVAL."""
    no_rival = 1.5  # how much worse an absent rival counts
    key = np.unique(np.stack([group, other_group]), axis=1, return_inverse=True)[1].ravel()
    order = np.lexsort((values, key))
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    size = np.diff(np.append(first, len(key)))
    best = values[order[first]]
    second = np.where(size > 1, values[order[np.minimum(first + 1, max(len(key) - 1, 0))]], np.inf)
    is_best = np.zeros(len(values), bool)
    is_best[order[first]] = True
    other = np.where(is_best, second[key], best[key])
    return np.clip(other - values, -no_rival, no_rival)


def inter_features(context: Context, a: np.ndarray, b: np.ndarray) -> Array:
    """Features ``(E, len(INTER))`` of two hypotheses (rows ``a``, ``b``) of one wearer in different frames."""
    h = context.hypotheses
    depth = (h.p_camera_pelvis[a, 2] + h.p_camera_pelvis[b, 2]) / 2
    u, v = h.detection[a], h.detection[b]
    rays, weight, size = context.rays, context.weight, person_size(context.rays, context.weight)
    image = keypoint_distance(rays[u], rays[v], weight[u], weight[v], np.maximum(size[u], size[v]))
    columns = [
        np.log(np.linalg.norm(h.p_camera_pelvis[a] - h.p_camera_pelvis[b], axis=1) / np.maximum(depth, 1) + 0.02),
        np.log(angle_between(h.R_camera_pelvis[a], h.R_camera_pelvis[b]) + 0.05),
        np.log(angle_between(h.R_camera_world[a], h.R_camera_world[b]) + 0.05),
        np.log(np.minimum(image, 4.0) + 0.02),
        (context.track[u] == context.track[v]).astype(float),
    ]
    plain = np.stack(columns, axis=1)
    time = np.log(np.abs(context.time[h.frame[a]] - context.time[h.frame[b]]) * 30)[:, None]
    return np.concatenate([plain, plain * time, time], axis=1)


@dataclass(frozen=True)
class WorldTurn:
    """The constant turn about the vertical between two worlds, ``R_a_b = Rz(angle)``, and its share of the votes."""

    angle: float
    share: float


def vote_turn(context: Context, good: Array, wearer_a: int, wearer_b: int) -> WorldTurn:
    """Find the turn between two wearers' worlds from all frames, each pair of hypotheses voting by its probability."""
    a, b = pairs_of_frame(context, wearer_a, wearer_b, good > 0.3)
    if len(a) == 0:
        return WorldTurn(0.0, 0.0)
    h = context.hypotheses
    R_a_b = transpose(h.R_camera_world[a]) @ h.R_camera_world[b]
    weight = good[a] * good[b] * np.exp(-0.5 * (np.arccos(np.clip(R_a_b[:, 2, 2], -1, 1)) / np.deg2rad(15)) ** 2)
    bins = 72
    yaw = yaw_of(R_a_b)
    votes = np.bincount(((yaw + np.pi) / (2 * np.pi) * bins).astype(int) % bins, weight, bins)
    smooth = uniform_filter1d(votes, 5, mode="wrap") * 5
    centre = (np.argmax(smooth) + 0.5) / bins * 2 * np.pi - np.pi
    near = np.abs(wrap_angle(yaw - centre)) < np.deg2rad(20)
    mean = np.sum(np.where(near, weight, 0) * wrap_angle(yaw - centre)) / max(float(np.sum(weight[near])), 1e-9)
    return WorldTurn(float(wrap_angle(centre + mean)), float(smooth.max() / max(votes.sum(), 1e-9)))


def pairs_of_frame(context: Context, wearer_a: int, wearer_b: int, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows ``(E,)`` and ``(E,)`` of all hypotheses of two wearers in one frame with different detections."""
    h = context.hypotheses
    a, b = (np.flatnonzero((h.wearer == w) & which) for w in (wearer_a, wearer_b))
    low, high = np.searchsorted(h.frame[b], h.frame[a], "left"), np.searchsorted(h.frame[b], h.frame[a], "right")
    count = high - low
    rows_a = np.repeat(np.arange(len(a)), count)
    rows_b = np.repeat(low - np.concatenate([[0], np.cumsum(count)[:-1]]), count) + np.arange(count.sum())
    first, second = a[rows_a], b[rows_b.astype(int)]
    different = h.detection[first] != h.detection[second]
    return first[different], second[different]


def intra_features(context: Context, a: np.ndarray, b: np.ndarray, turn: WorldTurn) -> Array:
    """Features ``(E, len(INTRA))`` of two wearers' hypotheses in one frame, their worlds unrelated but for a turn."""
    h = context.hypotheses
    tilt = np.arccos(np.clip(np.sum(h.R_camera_world[a, :, 2] * h.R_camera_world[b, :, 2], axis=1), -1, 1))
    yaw = yaw_of(transpose(h.R_camera_world[a]) @ h.R_camera_world[b])
    depth = np.maximum(np.maximum(h.p_camera_pelvis[a, 2], h.p_camera_pelvis[b, 2]), 1.0)
    height = np.abs(h.p_world_camera[a, 2] - h.p_world_camera[b, 2]) / depth
    gap = np.abs(wrap_angle(yaw - turn.angle))
    known = np.full(len(a), turn.share)
    return np.stack([np.log(tilt + 0.05), np.log(gap + 0.05) * known, known, np.log(height + 0.02)], axis=1)


def meta_features(context: Context, a: np.ndarray, b: np.ndarray) -> Array:
    """Features ``(E, len(INTRA_CAMERA))`` of two wearers' hypotheses (rows ``a``, ``b``) in one frame and world."""
    furthest_m = 20.0  # camera centres further apart than this are all equally wrong
    h = context.hypotheses
    points = np.stack([wearer.p_world_keypoint for wearer in context.wearers])
    both = np.concatenate([points[h.wearer[one], h.frame[one]] for one in (a, b)], axis=1)
    rays = np.concatenate([context.rays[h.detection[one]] for one in (a, b)], axis=1)
    weight = np.concatenate([context.weight[h.detection[one]] for one in (a, b)], axis=1)
    origin = context.wearers[0].p_world_pelvis[h.frame[a]]
    known = np.all(np.isfinite(both), axis=-1)
    fit = fit_cameras(both - origin[:, None], rays, np.where(known, weight, 0.0), np.tile(context.sigma, 2))
    centre = origin - (transpose(fit.R_camera_world) @ fit.p_camera_origin[..., None])[..., 0]
    off = [np.linalg.norm(h.p_world_camera[one] - centre, axis=1) / np.maximum(h.p_camera_pelvis[one, 2], 1)
           for one in (a, b)]  # fmt: skip
    off = [np.log(np.minimum(np.where(fit.accepted, each, furthest_m), furthest_m) + 0.02) for each in off]
    tilt = angle_between(h.R_camera_world[a], h.R_camera_world[b])
    yaw = np.abs(yaw_of(transpose(h.R_camera_world[a]) @ h.R_camera_world[b]))
    cost = np.log(np.where(fit.accepted, fit.cost, 20.0) + 0.02)
    return np.stack([np.log(tilt + 0.05), np.log(yaw + 0.05), *off, cost], axis=1)
