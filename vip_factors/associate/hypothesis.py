"""Hypothesis cameras: where the camera would be if a detection showed a wearer (thesis 4.3.2, M_H)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.associate.camera_fit import CameraFit, fit_cameras
from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.sensors.detections import Detections

LEAST_CONFIDENCE = 0.1  # detectors write guesses below this
PERSON_SIZE = 0.77  # m: square root of the area that a person covers, for the OKS sigmas
DETECTOR = (
    0.5  # of an OKS sigma is what a detector errs by; the sigmas are those of annotators on all sorts of pictures
)
# Metres that an inertial tracker's keypoints lie off, mounted by eye (10–15°): orientation errors add up along limbs.
_POSE_SIGMA = {"wrist": 0.12, "ankle": 0.12, "heel": 0.13, "toe": 0.14, "elbow": 0.08, "knee": 0.08}
_TRUNK_SIGMA = 0.05


@dataclass(frozen=True)
class WearerPoints:
    """Keypoints of one wearer at the video's frames.

    Attributes:
        p_world_keypoint: ``(F, K, 3)`` metres in the wearer's own world; NaN for keypoints that are not on our body,
            and in frames outside the motion.
        p_world_pelvis: ``(F, 3)``.
        R_world_pelvis: ``(F, 3, 3)``.
        covered: ``(F,)`` whether the motion covers the frame.
    """

    p_world_keypoint: Array
    p_world_pelvis: Array
    R_world_pelvis: Array
    covered: np.ndarray


@dataclass(frozen=True)
class Hypotheses:
    """All ``P`` pairs of a wearer and a detection whose camera could be found.

    Attributes:
        wearer, detection, frame: ``(P,)`` indices.
        R_camera_world: ``(P, 3, 3)``, in the wearer's own world.
        p_world_camera: ``(P, 3)`` metres.
        p_camera_pelvis: ``(P, 3)`` metres: the wearer's root before the camera.
        R_camera_pelvis: ``(P, 3, 3)``.
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
        """Some of them, by mask or indices."""
        return Hypotheses(**{name: values[which] for name, values in vars(self).items()})


def keypoint_sigma(keypoints: KeypointSet) -> Array:
    """How far ``(K,)`` a wearer's keypoints lie off what a detector points at, in metres."""
    pose = [
        next((sigma for part, sigma in _POSE_SIGMA.items() if part in name), _TRUNK_SIGMA)
        for name in keypoints.keypoints
    ]
    return np.hypot(DETECTOR * PERSON_SIZE * keypoints.sigmas, pose)


def wearer_points(motion: Motion, keypoints: KeypointSet, time: Array) -> WearerPoints:
    """A wearer's keypoints at instants ``(F,)`` in seconds from the recording's start."""
    margin = 1 / motion.rate
    covered = (time >= motion.time[0] - margin) & (time <= motion.time[-1] + margin)
    R = np.stack(
        [interpolate_rotations(motion.time, one, time) for one in motion.R_parent_child.swapaxes(0, 1)], axis=1
    )
    p = np.stack([np.interp(time, motion.time, column) for column in motion.p_world_pelvis.T], axis=1)
    state = forward_kinematics(motion.skeleton, R, p)
    points = np.full((len(time), len(keypoints), 3), np.nan)
    for k, landmark in enumerate(keypoints.on_body(motion.skeleton)):
        if landmark is not None:
            points[covered, k] = state.point(landmark.bone, landmark.p_bone_point)[covered]
    return WearerPoints(points, p, R[:, 0], covered)


def used_confidence(detections: Detections) -> Array:
    """Confidences ``(N, K)``, 0 for keypoints that are not there or no more than guessed."""
    usable = detections.seen & (detections.confidence >= LEAST_CONFIDENCE)
    return np.where(usable, np.minimum(detections.confidence, 1.0), 0.0)


def hypotheses(
    detections: Detections, rays: Array, wearers: Sequence[WearerPoints], keypoints: KeypointSet | None = None
) -> Hypotheses:
    """The hypothesis camera of every wearer and detection for which one can be found.

    Args:
        detections: ``N`` of them.
        rays: ``(N, K, 2)`` undistorted coordinates of their pixels at depth one.
        wearers: their keypoints at the video's frames.
        keypoints: whose sigmas to use if not the detections' own.
    """
    weight, sigma = used_confidence(detections), keypoint_sigma(keypoints or detections.keypoints)
    parts = []
    for w, wearer in enumerate(wearers):
        index = np.flatnonzero(wearer.covered[detections.frame])
        frame = detections.frame[index]
        local = wearer.p_world_keypoint[frame] - wearer.p_world_pelvis[frame][:, None]
        known = np.all(np.isfinite(local), axis=-1)
        fit = fit_cameras(local, rays[index], np.where(known, weight[index], 0.0), sigma)
        parts.append(_of_wearer(w, wearer, index, frame, fit))
    return Hypotheses(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def _of_wearer(w: int, wearer: WearerPoints, detection: np.ndarray, frame: np.ndarray, fit: CameraFit) -> Hypotheses:
    R, t = fit.R_camera_world, fit.p_camera_origin
    p_world_camera = wearer.p_world_pelvis[frame] - (transpose(R) @ t[..., None])[..., 0]
    every = Hypotheses(
        np.full(len(detection), w), detection, frame, R, p_world_camera, t, R @ wearer.R_world_pelvis[frame],
        fit.error, fit.cost,
    )  # fmt: skip
    return every.select(fit.accepted)
