"""What speaks for or against two hypotheses together (thesis eqs. 4.14–4.18): over time, and within a frame.

The wearers' worlds share only their vertical in the first pass: each inertial tracker has its own heading and its own
path. So where the thesis fits one meta-camera to two wearers of a frame, the first pass compares what must agree
whatever the worlds: which way is up in the camera, and the turn between the two worlds, which is one constant about
the vertical for the whole recording and is found by vote. In the second pass worlds are common and the meta-camera is
fitted (:func:`meta_features`).
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.associate.features import Context
from vip_factors.associate.hypothesis import fit_cameras
from vip_factors.associate.tracklets import keypoint_distance, person_size
from vip_factors.geometry.rotations import Array, angle_between, transpose, wrap_angle, yaw_of


def inter_features(context: Context, a: np.ndarray, b: np.ndarray) -> Array:
    """Features ``(E, len(INTER))`` of two hypotheses (rows ``a``, ``b``) of one wearer in different frames."""
    h = context.hypotheses
    depth = (h.p_camera_pelvis[a, 2] + h.p_camera_pelvis[b, 2]) / 2
    u, v = h.detection[a], h.detection[b]
    size = person_size(context.rays, context.weight)
    plain = np.stack(
        [
            np.log(np.linalg.norm(h.p_camera_pelvis[a] - h.p_camera_pelvis[b], axis=1) / np.maximum(depth, 1) + 0.02),
            np.log(angle_between(h.R_camera_pelvis[a], h.R_camera_pelvis[b]) + 0.05),
            np.log(angle_between(h.R_camera_world[a], h.R_camera_world[b]) + 0.05),
            np.log(
                np.minimum(
                    keypoint_distance(
                        context.rays[u], context.rays[v], context.weight[u], context.weight[v],
                        np.maximum(size[u], size[v]),
                    ),
                    4.0,
                )
                + 0.02
            ),
            (context.track[u] == context.track[v]).astype(float),
        ],
        axis=1,
    )  # fmt: skip
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
