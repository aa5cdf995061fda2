"""Features of single hypotheses (thesis eq. 4.13, and further ones) and of pairs.

Major joints are counted as in the thesis (4.4.3), each with more weight if a detector gives few of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.associate.hypothesis import Hypotheses, WearerPoints, fit_cameras
from vip_factors.associate.tracklets import keypoint_distance, person_size, sums_around
from vip_factors.body.skeleton import SIDES
from vip_factors.geometry.rotations import Array, angle_between, transpose, wrap_angle, yaw_of
from vip_factors.sensors.camera import CameraPath


def major_joints(names: Sequence[str]) -> np.ndarray:
    """Keypoints ``(K,)`` that are major joints."""
    joints = ("neck", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    return np.array([name.split("_")[-1] in joints for name in names], dtype=bool)


def given_keypoints(frequency: Array) -> np.ndarray:
    """Keypoints ``(K,)`` that a detector gives, by the frequency of each ``(K,)``."""
    least_share = 0.1  # of the most frequent keypoint's frequency
    return np.asarray((frequency > 0) & (frequency >= least_share * frequency.max(initial=0.0)))


def joint_weight_of(major: np.ndarray, frequency: Array) -> float:
    """Weight of each ``major`` joint ``(K,)`` by the frequencies of keypoints ``(K,)``.

    It is more than one if the detector gives fewer joints than the twelve or thirteen that the regressions were trained
    on.
    """
    all_joints = 12  # both sides, without the neck, which not every detector gives
    count = int(np.sum(major & given_keypoints(frequency)))
    return max(1.0, all_joints / count) if count else 1.0


_LIMBS = ((("shoulder", "elbow"), ("elbow", "wrist")), (("hip", "knee"), ("knee", "ankle")))
LIMB_ENDS = (
    *((f"{side}_{a}", f"{side}_{b}") for limb in _LIMBS for side in SIDES for a, b in limb),
    *((f"left_{joint}", f"right_{joint}") for joint in ("shoulder", "hip")),
)
FITTING_M = 0.15  # half a head, and the error of an inertial tracker
WINDOWS_S = (0.5, 2.0)  # over which features are averaged along a tracklet: half a step, and a few

_UNARY = (
    "log_cost log_cost_half_second log_cost_two_seconds limbs limbs_half_second limbs_two_seconds joints_seen "
    "joints_fitting seven_seen seven_fitting tilt unsteady unsteady_two_seconds track_seconds rival_person "
    "rival_person_two_seconds rival_wearer rival_wearer_two_seconds"
)
UNARY = tuple(_UNARY.split())
UNARY_CAMERA = (*UNARY, "path_error", "path_error_two_seconds", "path_rival", "path_turn")
INTER_PLAIN = ("trans", "ori", "turn", "image", "tracklet")
INTER = (*INTER_PLAIN, *(f"{name}_by_time" for name in INTER_PLAIN), "time")
INTRA = ("tilt_gap", "yaw_gap", "yaw_known", "height_gap")
INTRA_CAMERA = ("tilt_gap", "yaw_gap", "meta_a", "meta_b", "meta_cost")


@dataclass(frozen=True)
class Context:
    """Data of one recording that all features share.

    Attributes:
        hypotheses: the ``P`` hypotheses.
        wearers: the wearers' keypoints at the times of video frames.
        names, sigma: names of the keypoints, and their standard deviations ``(K,)`` in metres.
        rays, weight: ``(N, K, 2)`` undistorted coordinates of the detections and ``(N, K)`` confidences.
        track, frame: ``(N,)`` tracklet and video frame of each detection.
        time: ``(F,)`` seconds of the video frames.
        camera: path of the camera at the video frames, in a world that all wearers share, or None.
        up_camera: ``(F, 3)`` upward direction in the camera by its IMU; NaN where unknown.
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
        """Video frames per second, from the median step."""
        return 1 / float(np.median(np.diff(self.time))) if len(self.time) > 1 else 30.0


def unary_features(context: Context) -> Array:
    """Features ``(P, len(UNARY))`` of all hypotheses, or ``(P, len(UNARY_CAMERA))`` if the camera is known."""
    usual_keypoints = 15  # of a person who is entirely visible
    h = context.hypotheses
    # A camera takes six of 2n degrees of freedom: squared errors are too small where it is fitted to few keypoints.
    used = np.sum(np.isfinite(h.error[..., 0]), axis=1)
    log_cost = np.log(h.cost * ((1 - 3 / usual_keypoints) / (1 - 3 / used)) + 0.02)
    limbs, tilt, unsteady = _limb_agreement(context), _tilt(context), _unsteadiness(context)
    track_frames = np.bincount(context.track)[context.track[h.detection]]
    seconds = np.minimum(track_frames / context.rate, WINDOWS_S[-1])
    short, long = (partial(_mean_along_track, context, window) for window in WINDOWS_S)
    long_cost, long_unsteady = long(log_cost), long(unsteady)
    columns = [log_cost, short(log_cost), long_cost, limbs, short(limbs), long(limbs), *_joint_counts(context)]
    columns += [tilt, unsteady, long_unsteady, seconds]
    columns += [rival(h.frame, h.wearer, cost) for cost in (log_cost, long_cost)]
    columns += [rival(h.detection, h.detection, cost) for cost in (log_cost, long_cost)]
    if context.camera is not None:
        error = path_error(context, context.camera)
        R_camera_world = transpose(context.camera.R_world_camera)[h.frame]
        turn = angle_between(R_camera_world, h.R_camera_world)
        columns += [error, long(error), rival(h.frame, h.wearer, error), turn]
    return np.stack(columns, axis=1)


def _joint_counts(context: Context) -> tuple[Array, ...]:
    """Counts ``(P,)`` of major joints that are visible and that fit, and whether these reach seven (thesis 4.4.3).

    If the detector gives fewer joints than usual, each has more weight.
    """
    enough_joints = 7  # that fit, for a detection to count as a person's (thesis 4.4.3)
    h, major = context.hypotheses, major_joints(context.names)
    joint_weight = joint_weight_of(major, np.sum(context.weight > 0, axis=0))
    sure = np.clip((context.weight[h.detection][:, major] - 0.1) / 0.3, 0, 1)
    error = np.linalg.norm(h.error[:, major], axis=-1)
    fits = np.exp(-0.5 * (np.nan_to_num(error, nan=np.inf) / FITTING_M) ** 2)
    visible, fitting = joint_weight * sure.sum(axis=1), joint_weight * np.sum(sure * fits, axis=1)
    return visible, fitting, *(1 / (1 + np.exp(-2 * (count - enough_joints + 0.5))) for count in (visible, fitting))


def path_error(context: Context, camera: CameraPath) -> Array:
    """Logarithm ``(P,)`` of the robust reprojection error for a known camera path, in sigmas of a keypoint."""
    h = context.hypotheses
    points = np.stack([wearer.p_world_keypoint for wearer in context.wearers])[h.wearer, h.frame]
    p = (points - camera.p_world_camera[h.frame][:, None]) @ camera.R_world_camera[h.frame]
    depth = np.maximum(p[..., 2], 0.3)
    error = np.linalg.norm(p[..., :2] / depth[..., None] - context.rays[h.detection], axis=-1) * depth
    is_visible = np.isfinite(error) & (context.weight[h.detection] > 0)
    w = np.where(is_visible, context.weight[h.detection], 0.0)
    square = np.where(is_visible, error / context.sigma, 0.0) ** 2
    return np.log(np.sum(w * np.log1p(square), axis=1) / np.maximum(w.sum(axis=1), 0.1) + 0.02)


def _limb_agreement(context: Context) -> Array:
    """Mean cosine ``(P,)`` between detected limbs and those of the hypothesis, weighted by length."""
    h, names = context.hypotheses, context.names
    ends = [(names.index(a), names.index(b)) for a, b in LIMB_ENDS if a in names and b in names]
    if not ends:
        return np.zeros(len(h))
    a, b = np.array(ends).T
    depth = h.p_camera_pelvis[:, 2, None, None]
    detected = context.rays[h.detection] * depth
    expected = detected + h.error
    limb, wanted = detected[:, b] - detected[:, a], expected[:, b] - expected[:, a]
    length = np.linalg.norm(limb, axis=-1) * np.linalg.norm(wanted, axis=-1)
    is_visible = np.isfinite(length) & (length > 1e-6)
    cosine = np.where(is_visible, np.sum(limb * wanted, axis=-1) / np.where(is_visible, length, 1.0), 0.0)
    w = np.where(is_visible, np.sqrt(np.where(is_visible, length, 0.0)), 0.0)
    return np.sum(w * cosine, axis=1) / np.maximum(w.sum(axis=1), 0.1)


def _tilt(context: Context) -> Array:
    """Angle ``(P,)`` between the vertical of the hypothesis camera and that of its IMU, or of most hypotheses."""
    h = context.hypotheses
    up = h.R_camera_world[:, :, 2]
    expected = context.up_camera[h.frame] if context.up_camera is not None else np.full((len(h), 3), np.nan)
    unknown = ~np.all(np.isfinite(expected), axis=1)
    if unknown.any():
        expected = np.where(unknown[:, None], _agreed_up(context)[h.frame], expected)
    return np.arccos(np.clip(np.sum(up * expected, axis=1), -1, 1))


def _agreed_up(context: Context) -> Array:
    """Upward direction in the camera ``(F, 3)``: weighted, trimmed mean over good hypotheses of nearby frames."""
    h, F = context.hypotheses, len(context.time)
    up = h.R_camera_world[:, :, 2]
    window = 2 * max(1, round(WINDOWS_S[0] * context.rate)) + 1
    w = np.exp(-2 * h.cost)
    agreed = np.tile([0.0, -1.0, 0.0], (F, 1))
    for trust in (np.deg2rad(60.0), np.deg2rad(25.0), np.deg2rad(15.0)):
        off = np.arccos(np.clip(np.sum(up * agreed[h.frame], axis=1), -1, 1))
        trusted = w * np.exp(-0.5 * (off / trust) ** 2)
        total = np.stack([np.bincount(h.frame, trusted * column, F) for column in up.T], axis=1)
        total = uniform_filter1d(total, window, axis=0, mode="constant")
        length = np.linalg.norm(total, axis=1, keepdims=True)
        agreed = np.where(length > 1e-6, total / np.maximum(length, 1e-6), agreed)
    return agreed


def _unsteadiness(context: Context) -> Array:
    """Angle ``(P,)`` by which the hypothesis camera turns in the world within a sixth of a second."""
    turn_over_s = 0.17  # between the compared hypotheses of a wearer and a tracklet
    h = context.hypotheses
    if not len(h):
        return np.zeros(0)
    offset = max(1, round(turn_over_s * context.rate))
    key = (context.track[h.detection] * len(context.wearers) + h.wearer) * (len(context.time) + 2 * offset) + h.frame
    order = np.argsort(key)
    row = order[np.minimum(np.searchsorted(key[order], key + offset), len(key) - 1)]
    exists = key[row] == key + offset
    angle = np.where(exists, angle_between(h.R_camera_world, h.R_camera_world[row]), np.nan)
    backwards = np.full(len(h), np.nan)
    backwards[row[exists]] = angle[exists]
    turn = np.fmax(angle, backwards)
    return np.where(np.isfinite(turn), turn, np.deg2rad(20.0))  # a neutral value for a person seen for a moment


def _mean_along_track(context: Context, window_s: float, values: Array) -> Array:
    """Means ``(P,)`` of the same wearer's values over a time window along the tracklet."""
    h, half = context.hypotheses, window_s / 2 * context.rate
    group = context.track[h.detection] * len(context.wearers) + h.wearer
    key = group * (len(context.time) + 4 * int(half + 1)) + h.frame
    total, count = sums_around(key, half, key, values)
    return total / count


def rival(group: np.ndarray, other_group: np.ndarray, values: Array) -> Array:
    """Difference ``(P,)`` of the best other value of the same group to each value, within ± ``no_rival``."""
    no_rival = 1.5  # difference that counts without a rival
    key = np.unique(np.stack([group, other_group]), axis=1, return_inverse=True)[1].ravel()
    order = np.lexsort((values, key))
    first_of_group = np.flatnonzero(np.diff(key[order], prepend=-1))
    size = np.diff(np.append(first_of_group, len(key)))
    best_value = values[order[first_of_group]]
    second = np.where(size > 1, values[order[np.minimum(first_of_group + 1, max(len(key) - 1, 0))]], np.inf)
    is_best = np.zeros(len(values), bool)
    is_best[order[first_of_group]] = True
    best_other = np.where(is_best, second[key], best_value[key])
    return np.clip(best_other - values, -no_rival, no_rival)


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
    """Estimate the turn between two wearers' worlds; each pair of hypotheses in a frame votes by its probability."""
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
    """Rows ``(E,)`` and ``(E,)`` of the pairs of two wearers' hypotheses in one frame with different detections."""
    h = context.hypotheses
    a, b = (np.flatnonzero((h.wearer == w) & which) for w in (wearer_a, wearer_b))
    low, high = np.searchsorted(h.frame[b], h.frame[a], "left"), np.searchsorted(h.frame[b], h.frame[a], "right")
    count = high - low
    rows_a = np.repeat(np.arange(len(a)), count)
    rows_b = np.repeat(low - np.concatenate([[0], np.cumsum(count)[:-1]]), count) + np.arange(count.sum())
    rows_of_a, second = a[rows_a], b[rows_b.astype(int)]
    different = h.detection[rows_of_a] != h.detection[second]
    return rows_of_a[different], second[different]


def intra_features(context: Context, a: np.ndarray, b: np.ndarray, turn: WorldTurn) -> Array:
    """Features ``(E, len(INTRA))`` of two wearers' hypotheses in one frame, in worlds related by a turn only."""
    h = context.hypotheses
    tilt = np.arccos(np.clip(np.sum(h.R_camera_world[a, :, 2] * h.R_camera_world[b, :, 2], axis=1), -1, 1))
    yaw = yaw_of(transpose(h.R_camera_world[a]) @ h.R_camera_world[b])
    depth = np.maximum(np.maximum(h.p_camera_pelvis[a, 2], h.p_camera_pelvis[b, 2]), 1.0)
    height = np.abs(h.p_world_camera[a, 2] - h.p_world_camera[b, 2]) / depth
    gap = np.abs(wrap_angle(yaw - turn.angle))
    turn_share = np.full(len(a), turn.share)
    return np.stack([np.log(tilt + 0.05), np.log(gap + 0.05) * turn_share, turn_share, np.log(height + 0.02)], axis=1)


def meta_features(context: Context, a: np.ndarray, b: np.ndarray) -> Array:
    """Features ``(E, len(INTRA_CAMERA))`` of two wearers' hypotheses (rows ``a``, ``b``) in one frame and world."""
    furthest_m = 20.0  # distance of camera centres at which it is clipped
    h = context.hypotheses
    points = np.stack([wearer.p_world_keypoint for wearer in context.wearers])
    points_of_both = np.concatenate([points[h.wearer[rows], h.frame[rows]] for rows in (a, b)], axis=1)
    rays = np.concatenate([context.rays[h.detection[rows]] for rows in (a, b)], axis=1)
    weight = np.concatenate([context.weight[h.detection[rows]] for rows in (a, b)], axis=1)
    origin = context.wearers[0].p_world_pelvis[h.frame[a]]
    is_on_body = np.all(np.isfinite(points_of_both), axis=-1)
    weight = np.where(is_on_body, weight, 0.0)
    fit = fit_cameras(points_of_both - origin[:, None], rays, weight, np.tile(context.sigma, 2))
    centre = origin - (transpose(fit.R_camera_world) @ fit.p_camera_origin[..., None])[..., 0]
    off = list[Array]()
    for rows in (a, b):
        gap = np.linalg.norm(h.p_world_camera[rows] - centre, axis=1) / np.maximum(h.p_camera_pelvis[rows, 2], 1)
        off.append(np.log(np.minimum(np.where(fit.accepted, gap, furthest_m), furthest_m) + 0.02))
    tilt = angle_between(h.R_camera_world[a], h.R_camera_world[b])
    yaw = np.abs(yaw_of(transpose(h.R_camera_world[a]) @ h.R_camera_world[b]))
    cost = np.log(np.where(fit.accepted, fit.cost, 20.0) + 0.02)
    return np.stack([np.log(tilt + 0.05), np.log(yaw + 0.05), *off, cost], axis=1)
