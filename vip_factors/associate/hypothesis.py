"""Hypothesis cameras: the camera pose if a detection showed a wearer (thesis 4.3.2, M_H).

PnP of all pairs of a wearer and a detection at once: a closed-form start, then robust Gauss–Newton. Each match is first
transformed to a virtual camera that looks straight at the person, where the weak-perspective start is good anywhere in
the image. Residuals are in metres at the person's depth, so that near and far people count alike (thesis eq. 4.14).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.compiled import Kernels, kernels
from vip_factors.geometry.rotations import Array, exp, hat, transpose
from vip_factors.sensors.detections import Detections

FEWEST_KEYPOINTS = 6  # three would determine a camera; with fewer than six a wrong person fits as well as the right one
CAUCHY = 2.0  # scale of the robust loss, in sigmas
START_STEPS, FINAL_STEPS = 5, 6  # of Gauss–Newton, from every start and from the best
NEAREST_DEPTH, FURTHEST_DEPTH = 0.5, 80.0  # m, range in which a person is entirely visible and distinguishable


@dataclass(frozen=True)
class CameraFit:
    """Cameras fitted to ``P`` matches of ``K`` points with as many rays.

    Attributes:
        R_camera_world: ``(P, 3, 3)``; identity where rejected.
        p_camera_origin: ``(P, 3)`` metres, origin of the points in the camera's frame; NaN where rejected.
        error: ``(P, K, 2)`` reprojection errors in metres at the person's depth; NaN where not visible or rejected.
        cost: ``(P,)`` robust mean of squared errors in sigmas (Cauchy); NaN where rejected.
        accepted: ``(P,)`` whether a plausible camera was found.
    """

    R_camera_world: Array
    p_camera_origin: Array
    error: Array
    cost: Array
    accepted: np.ndarray


def fit_cameras(points: Array, rays: Array, weight: Array, sigma: Array) -> CameraFit:
    """Fit one camera to each match.

    Args:
        points: ``(P, K, 3)`` metres, each match in any frame.
        rays: ``(P, K, 2)`` undistorted image coordinates at depth one; anything where the weight is zero.
        weight: ``(P, K)`` confidences; 0 for keypoints to ignore.
        sigma: ``(K,)`` or ``(P, K)`` metres, standard deviations of keypoints.
    """
    chunk = 2048  # matches at a time, so that their Jacobians fit into the cache
    sigma = np.broadcast_to(sigma, weight.shape)
    fits = [
        _fit_chunk(points[i : i + chunk], rays[i : i + chunk], weight[i : i + chunk], sigma[i : i + chunk])
        for i in range(0, max(len(points), 1), chunk)
    ]
    return CameraFit(*(np.concatenate([getattr(fit, name) for fit in fits]) for name in CameraFit.__annotations__))


def _fit_chunk(points: Array, rays: Array, weight: Array, sigma: Array) -> CameraFit:
    usable = (weight > 0) & np.all(np.isfinite(rays), axis=-1) & np.all(np.isfinite(points), axis=-1)
    is_determined = usable.sum(axis=1) >= FEWEST_KEYPOINTS
    usable = usable & is_determined[:, None]
    w = np.where(usable, weight, 0.0)
    w[~is_determined] = 1.0  # only to be finite: such matches are rejected
    X = np.where(usable[..., None], points, 0.0)
    centre = _mean(X, w)
    X = X - centre[:, None]
    R_virtual_camera, flat = _straight_ahead(np.where(usable[..., None], rays, 0.0), w)
    problem = _Problem(X, flat, w, sigma)
    R, t, cost = problem.best(problem.starts())
    p, flat_there = problem.seen(R, t)
    error = (flat_there - flat) * t[:, None, 2:]
    nearest = np.where(usable, p[..., 2], np.inf).min(axis=1)
    with np.errstate(invalid="ignore"):
        accepted = (
            is_determined & (nearest > NEAREST_DEPTH / 2) & (t[:, 2] > NEAREST_DEPTH) & (t[:, 2] < FURTHEST_DEPTH)
        )
    accepted &= np.all(np.isfinite(R), axis=(1, 2)) & np.all(np.isfinite(t), axis=1)
    back = transpose(R_virtual_camera)
    R_camera = back @ R
    origin = (back @ (t - (R @ centre[..., None])[..., 0])[..., None])[..., 0]
    return CameraFit(
        np.where(accepted[:, None, None], R_camera, np.eye(3)),
        np.where(accepted[:, None], origin, np.nan),
        np.where((usable & accepted[:, None])[..., None], error, np.nan),
        np.where(accepted, cost, np.nan),
        accepted,
    )


def _mean(values: Array, w: Array) -> Array:
    return np.einsum("pk,pki->pi", w, values) / np.maximum(w.sum(axis=1), 1e-9)[:, None]


def _straight_ahead(rays: Array, w: Array) -> tuple[Array, Array]:
    """Rotations ``(P, 3, 3)`` to cameras that look at the centre of the rays, and the rays ``(P, K, 2)`` there."""
    forward = np.concatenate([_mean(rays, w), np.ones((len(rays), 1))], axis=1)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    axis = np.cross(forward, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    R = exp(axis / np.maximum(sine, 1e-12) * np.arctan2(sine, forward[:, 2:]))
    turned = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1) @ transpose(R)
    return R, turned[..., :2] / np.maximum(turned[..., 2:], 0.05)


class _Problem:
    """Matches in their virtual cameras: points relative to their centre, rays to the axis."""

    def __init__(self, X: Array, flat: Array, w: Array, sigma: Array) -> None:
        self.X, self.flat, self.w = X, flat, w
        self.scale = np.sqrt(w) / sigma  # times depth: whitened residuals
        self.total = np.maximum(w.sum(axis=1), 1e-9)
        self.depth = np.ones(len(X))

    def starts(self) -> list[tuple[Array, Array]]:
        """Weak-perspective cameras: two for a flat body, tilted either way, and one for a solid body."""
        X, w = self.X, self.w
        weighted = X * w[..., None]
        _, axes = np.linalg.eigh(transpose(weighted) @ X)
        N = np.ascontiguousarray(transpose(axes)[:, ::-1])  # rows: longest axis first
        N[:, 2] = np.cross(N[:, 0], N[:, 1])
        q = X @ transpose(N)
        moment = np.einsum("pk,pki,pkj->pij", w, q, q, optimize=True)
        moment += np.eye(3) * (1e-4 * np.trace(moment, axis1=1, axis2=2)[:, None, None] + 1e-9)
        cross = np.einsum("pk,pki,pkj->pij", w, self.flat - _mean(self.flat, w)[:, None], q, optimize=True)
        A = cross[:, :, :2] @ np.linalg.inv(moment[:, :2, :2])
        U, s, Vt = np.linalg.svd(A)
        scale = np.maximum(s[:, 0], 1e-6)
        self.depth = np.clip(1 / scale, NEAREST_DEPTH, FURTHEST_DEPTH)
        ratio = (s[:, 1] / scale)[:, None]
        flat = np.concatenate([U[:, :, :1], U[:, :, 1:] * ratio[..., None]], axis=2) @ Vt
        slant = U[:, :, 1] * np.sqrt(np.maximum(1 - ratio**2, 0))
        starts = [self._start(np.concatenate([flat, sign * slant[..., None]], axis=2), N) for sign in (1.0, -1.0)]
        U3, _, Vt3 = np.linalg.svd(cross @ np.linalg.inv(moment), full_matrices=False)
        return [*starts, self._start(U3 @ Vt3, N)]

    def _start(self, rows: Array, N: Array) -> tuple[Array, Array]:
        """Camera from the first two rows of its rotation, which are orthonormal."""
        R = np.concatenate([rows, np.cross(rows[:, 0], rows[:, 1])[:, None]], axis=1)
        middle = _mean(self.flat, self.w)
        return R @ N, np.concatenate([middle, np.ones((len(R), 1))], axis=1) * self.depth[:, None]

    def best(self, starts: list[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
        """Descend from the start of least cost; the cameras and their costs."""
        tried = [self._descend(*start, START_STEPS) for start in starts]
        R, t, costs = (np.stack(values) for values in zip(*tried, strict=True))
        choice, rows = np.nan_to_num(costs, nan=np.inf).argmin(axis=0), np.arange(len(self.X))
        return self._descend(R[choice, rows], t[choice, rows], FINAL_STEPS)

    def seen(self, R: Array, t: Array) -> tuple[Array, Array]:
        """Points in the virtual camera ``(P, K, 3)`` and their images ``(P, K, 2)``."""
        p = self.X @ transpose(R) + t[:, None]
        return p, p[..., :2] / np.maximum(p[..., 2:], NEAREST_DEPTH / 5)

    def cost(self, R: Array, t: Array) -> Array:
        """Robust mean ``(P,)`` of the squared errors in sigmas."""
        square = self._squares(self.seen(R, t)[1])
        return np.sum(self.w * CAUCHY**2 * np.log1p(square / CAUCHY**2), axis=1) / self.total

    def _squares(self, flat: Array) -> Array:
        error = (flat - self.flat) * (self.scale / np.sqrt(np.maximum(self.w, 1e-12)) * self.depth[:, None])[..., None]
        return np.einsum("pki,pki->pk", error, error)

    def _descend(self, R: Array, t: Array, steps: int, kernels: Kernels = kernels) -> tuple[Array, Array, Array]:
        """Cameras after some Gauss–Newton steps, and their costs."""
        max_turn = 0.5  # rad per step, for which the linearisation holds
        if kernels is not None:
            R, t, cost = R.copy(), t.copy(), np.empty(len(R))
            precision = np.square(self.scale * self.depth[:, None] / CAUCHY) / np.maximum(self.w, 1e-12)
            kernels.follow_cameras(self.X, self.flat, self.w, precision, steps, R, t, cost)
            return R, t, cost
        damping = np.full(len(R), 1e-3)
        cost = self.cost(R, t)
        for _ in range(steps):
            H, g = self._linearised(R, t)
            diagonal = np.einsum("pii->pi", H)
            damped = H + np.eye(6) * (damping[:, None] * diagonal + 1e-6)[:, None, :]
            step = -np.linalg.solve(damped, g[..., None])[..., 0]
            turn = np.linalg.norm(step[:, :3], axis=1, keepdims=True)
            step *= np.minimum(1, max_turn / np.maximum(turn, 1e-12))
            R_new, t_new = exp(step[:, :3]) @ R, t + step[:, 3:]
            t_new[:, 2] = np.clip(t_new[:, 2], t[:, 2] / 2, t[:, 2] * 2)
            cost_new = self.cost(R_new, t_new)
            better = cost_new < cost
            R, t = np.where(better[:, None, None], R_new, R), np.where(better[:, None], t_new, t)
            cost = np.where(better, cost_new, cost)
            damping = np.where(better, damping * 0.1, damping * 30)
        return R, t, cost

    def _linearised(self, R: Array, t: Array) -> tuple[Array, Array]:
        """Normal matrix ``(P, 6, 6)`` and gradient ``(P, 6)`` for a rotation Exp(ω) R and a shift of t."""
        p, flat = self.seen(R, t)
        doubt = 1 / np.sqrt(1 + self._squares(flat) / CAUCHY**2)
        scale = self.scale * self.depth[:, None] * doubt
        inverse = 1 / np.maximum(p[..., 2], NEAREST_DEPTH / 5)
        by_point = np.zeros((*p.shape[:-1], 2, 3))
        by_point[..., 0, 0] = by_point[..., 1, 1] = inverse
        by_point[..., 2] = -flat * inverse[..., None]
        J = np.concatenate([-by_point @ hat(p - t[:, None]), by_point], axis=-1) * scale[..., None, None]
        J = J.reshape(len(R), 2 * J.shape[1], 6)
        error = ((flat - self.flat) * scale[..., None]).reshape(len(R), J.shape[1], 1)
        return transpose(J) @ J, (transpose(J) @ error)[..., 0]


LEAST_CONFIDENCE = 0.1  # below which detectors write guesses


@dataclass(frozen=True)
class WearerPoints:
    """Keypoints of one wearer at the times of the video frames.

    Attributes:
        p_world_keypoint: ``(F, K, 3)`` metres in the wearer's own world; NaN for keypoints that the body model lacks,
            and for frames outside the motion.
        p_world_pelvis, R_world_pelvis: ``(F, 3)`` and ``(F, 3, 3)``.
        covered: ``(F,)`` whether the motion covers the frame.
    """

    p_world_keypoint: Array
    p_world_pelvis: Array
    R_world_pelvis: Array
    covered: np.ndarray


@dataclass(frozen=True)
class Hypotheses:
    """The ``P`` pairs of a wearer and a detection for which a camera was found.

    Attributes:
        wearer, detection, frame: ``(P,)`` indices.
        R_camera_world, p_world_camera: ``(P, 3, 3)`` and ``(P, 3)`` metres, in the wearer's own world.
        p_camera_pelvis, R_camera_pelvis: ``(P, 3)`` metres and ``(P, 3, 3)``, pose of the wearer's pelvis in the
            camera.
        error: ``(P, K, 2)`` reprojection errors, metres at the person's depth.
        cost: ``(P,)`` robust mean of squared errors in sigmas.
    """

    wearer: np.ndarray
    detection: np.ndarray
    frame: np.ndarray
    R_camera_world: Array
    p_world_camera: Array
    p_camera_pelvis: Array
    R_camera_pelvis: Array
    error: Array
    cost: Array

    def __len__(self) -> int:
        return len(self.wearer)

    def select(self, which: np.ndarray) -> "Hypotheses":
        """Some of the hypotheses, by mask or indices."""
        return Hypotheses(**{name: values[which] for name, values in vars(self).items()})


def keypoint_sigma(keypoints: KeypointSet) -> Array:
    """Standard deviations ``(K,)`` in metres between a wearer's keypoints and detected ones."""
    # Errors of an inertial tracker's keypoints with mountings off by 10–15°: they add up along limbs.
    limbs = {"wrist": 0.12, "ankle": 0.12, "heel": 0.13, "toe": 0.14, "elbow": 0.08, "knee": 0.08}
    trunk = 0.05
    detector = 0.5  # error of a detector in OKS sigmas, which are the scatter of annotators
    person_size = 0.77  # m: square root of the image area of a person, for the OKS sigmas
    pose = [next((sigma for joint, sigma in limbs.items() if joint in name), trunk) for name in keypoints.keypoints]
    return np.hypot(detector * person_size * keypoints.sigmas, pose)


def wearer_points(motion: Motion, keypoints: KeypointSet, time: Array) -> WearerPoints:
    """A wearer's keypoints at instants ``(F,)`` in seconds from the recording's start."""
    margin = 1 / motion.rate
    covered = (time >= motion.time[0] - margin) & (time <= motion.time[-1] + margin)
    R, p = motion.poses_at(time)
    state = forward_kinematics(motion.skeleton, R, p)
    points = np.full((len(time), len(keypoints), 3), np.nan)
    for k, landmark in enumerate(keypoints.on_body(motion.skeleton)):
        if landmark is not None:
            points[covered, k] = state.point(landmark.bone, landmark.p_bone_point)[covered]
    return WearerPoints(points, p, R[:, 0], covered)


def used_confidence(detections: Detections) -> Array:
    """Confidences ``(N, K)``, 0 for keypoints that are missing or uncertain."""
    usable = detections.seen & (detections.confidence >= LEAST_CONFIDENCE)
    return np.where(usable, np.minimum(detections.confidence, 1.0), 0.0)


def hypotheses(detections: Detections, rays: Array, wearers: Sequence[WearerPoints]) -> Hypotheses:
    """Hypothesis cameras of all wearers and detections for which one can be found.

    ``rays`` ``(N, K, 2)`` are the detections' undistorted coordinates at depth one.
    """
    weight, sigma = used_confidence(detections), keypoint_sigma(detections.keypoints)
    by_wearer = []
    for w, wearer in enumerate(wearers):
        index = np.flatnonzero(wearer.covered[detections.frame])
        frame = detections.frame[index]
        local = wearer.p_world_keypoint[frame] - wearer.p_world_pelvis[frame][:, None]
        is_on_body = np.all(np.isfinite(local), axis=-1)
        fit = fit_cameras(local, rays[index], np.where(is_on_body, weight[index], 0.0), sigma)
        R, t = fit.R_camera_world, fit.p_camera_origin
        p_world_camera = wearer.p_world_pelvis[frame] - (transpose(R) @ t[..., None])[..., 0]
        R_camera_pelvis, number = R @ wearer.R_world_pelvis[frame], np.full(len(index), w)
        every = Hypotheses(number, index, frame, R, p_world_camera, t, R_camera_pelvis, fit.error, fit.cost)
        by_wearer.append(every.select(fit.accepted))
    return Hypotheses(
        **{name: np.concatenate([getattr(group, name) for group in by_wearer]) for name in vars(by_wearer[0])}
    )
