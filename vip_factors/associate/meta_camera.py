"""The meta-camera: one camera for two wearers of a frame, where their worlds are common (thesis eq. 4.18)."""

import numpy as np

from vip_factors.associate.camera_fit import fit_cameras
from vip_factors.associate.features import Context
from vip_factors.geometry.rotations import Array, angle_between, transpose, yaw_of

FURTHEST_M = 20.0  # camera centres further apart than this are all equally wrong


def meta_features(context: Context, a: np.ndarray, b: np.ndarray) -> Array:
    """Features ``(E, len(INTRA_CAMERA))`` of two wearers' hypotheses (rows ``a``, ``b``) in one frame and world."""
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
    off = [np.log(np.minimum(np.where(fit.accepted, each, FURTHEST_M), FURTHEST_M) + 0.02) for each in off]
    tilt = angle_between(h.R_camera_world[a], h.R_camera_world[b])
    yaw = np.abs(yaw_of(transpose(h.R_camera_world[a]) @ h.R_camera_world[b]))
    cost = np.log(np.where(fit.accepted, fit.cost, 20.0) + 0.02)
    return np.stack([np.log(tilt + 0.05), np.log(yaw + 0.05), *off, cost], axis=1)
