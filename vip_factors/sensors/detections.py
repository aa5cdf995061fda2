"""2D pose detections of one camera, of wearers and bystanders; keypoints of a motion and their reprojection error."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from vip_factors.body.keypoints import KeypointSet, keypoint_set
from vip_factors.body.kinematics import Motion
from vip_factors.display import Summarised
from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import NEAREST_M, CameraModel, CameraPath, VideoClock
from vip_factors.sensors.imu_stream import check_times


@dataclass(frozen=True, repr=False)
class Detections(Summarised):
    """``N`` people detected in ``F`` video frames, with ``K`` keypoints each.

    Attributes:
        keypoints: names and order of the keypoints.
        time: ``(F,)`` seconds of each video frame from the recording's start, increasing; frames without people count.
        frame: ``(N,)`` index of the video frame of each detection, not decreasing.
        pixels: ``(N, K, 2)``, distorted as in the image; NaN where a keypoint was not found.
        confidence: ``(N, K)`` in [0, 1]; 0 where a keypoint was not found.
        torso_colour: ``(N, B)`` histogram of the torso's colours in the video, with sum one; NaN if not computed or not
            visible. None without a video.
    """

    keypoints: KeypointSet
    time: Array
    frame: np.ndarray
    pixels: Array
    confidence: Array
    torso_colour: Array | None = None

    def __post_init__(self) -> None:
        N, K = len(self.frame), len(self.keypoints)
        if self.pixels.shape != (N, K, 2) or self.confidence.shape != (N, K):
            raise RecordingError(
                f"detections with pixels {self.pixels.shape} and confidence {self.confidence.shape}: expected "
                f"({N}, {K}, 2) and ({N}, {K}) for keypoint set {self.keypoints.name}"
            )
        if self.torso_colour is not None and (self.torso_colour.ndim != 2 or len(self.torso_colour) != N):
            raise RecordingError(f"colours of torsos {self.torso_colour.shape} for {N} detections: expected a row each")
        check_times(self.time, "video frames of the detections")
        if N and (np.any(np.diff(self.frame) < 0) or self.frame[0] < 0 or self.frame[-1] >= len(self.time)):
            raise RecordingError(f"detections: frame numbers are not in order within the {len(self.time)} video frames")

    def summary(self) -> list[str]:
        """Describe number of detections and keypoint set."""
        who = f"detected: {len(self)} 2D poses ({self.keypoints.name}) in {len(self.time)} video frames"
        return ["detections", who]

    @classmethod
    def none(cls, keypoints: KeypointSet) -> "Detections":
        """Make empty detections, without video frames."""
        K = len(keypoints)
        return cls(keypoints, np.zeros(0), np.zeros(0, int), np.zeros((0, K, 2)), np.zeros((0, K)))

    @classmethod
    def from_arrays(
        cls, time: ArrayLike, pixels: ArrayLike, keypoints: str | KeypointSet, confidence: ArrayLike | None = None
    ) -> "Detections":
        """Make detections from arrays over all video frames.

        Args:
            time: ``(F,)`` seconds of the video frames.
            pixels: ``(F, P, K, 2)`` of ``P`` people at most, or ``(F, K, 2)`` of one; NaN where nobody or nothing is.
            keypoints: name of the keypoint set: coco17, openpose18, body25, halpe26 …
            confidence: ``(F, P, K)`` or ``(F, K)`` in [0, 1]; 1 for each keypoint by default.

        Raises:
            InputError: for an unknown keypoint set.
            RecordingError: for arrays that do not belong together.
        """
        keypoints = keypoint_set(keypoints) if isinstance(keypoints, str) else keypoints
        poses, when = np.asarray(pixels, float), np.asarray(time, float)
        poses = poses[:, None] if poses.ndim == 3 else poses
        if poses.ndim != 4 or poses.shape[0] != len(when) or poses.shape[2:] != (len(keypoints), 2):
            raise RecordingError(
                f"2D poses {np.shape(pixels)} at {len(when)} times: expected ({len(when)}, people, "
                f"{len(keypoints)}, 2) of keypoint set {keypoints.name}"
            )
        sure = np.ones(poses.shape[:3]) if confidence is None else np.asarray(confidence, float)
        if sure.size != poses.size // 2:
            raise RecordingError(
                f"2D poses {np.shape(pixels)} with confidence {sure.shape}: expected one of each point"
            )
        sure = sure.reshape(poses.shape[:3])
        is_detected = np.all(np.isfinite(poses), axis=-1) & (sure > 0)
        frame, person = np.nonzero(is_detected.any(axis=-1))
        poses, sure = np.where(is_detected[..., None], poses, np.nan), np.where(is_detected, sure, 0.0)
        return cls(keypoints, when, frame, poses[frame, person], sure[frame, person])

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def rate(self) -> float:
        """Video frames per second (median), 0 for less than two frames."""
        return float(1 / np.median(np.diff(self.time))) if len(self.time) > 1 else 0.0

    @property
    def seen(self) -> np.ndarray:
        """Mask ``(N, K)`` of detected keypoints."""
        return (self.confidence > 0) & np.all(np.isfinite(self.pixels), axis=-1)

    def of_frame(self, frame: int) -> slice:
        """Slice of the detections of one video frame."""
        return slice(int(np.searchsorted(self.frame, frame)), int(np.searchsorted(self.frame, frame, side="right")))

    def select(self, which: np.ndarray) -> "Detections":
        """Select detections by mask or increasing indices; all video frames remain."""
        colour = None if self.torso_colour is None else self.torso_colour[which]
        frame, pixels, confidence = self.frame[which], self.pixels[which], self.confidence[which]
        return replace(self, frame=frame, pixels=pixels, confidence=confidence, torso_colour=colour)

    def shifted(self, seconds: float) -> "Detections":
        """Return the detections with all times shifted."""
        return replace(self, time=self.time + seconds)

    def timed(self, clock: VideoClock) -> "Detections":
        """Convert times to the sensors' clock."""
        return replace(self, time=clock.at(self.time))


def keypoints_in_world(motion: Motion, keypoints: KeypointSet) -> Array:
    """World positions ``(T, K, 3)`` of keypoints in metres; NaN for those that the skeleton does not have."""
    points = np.full((len(motion), len(keypoints), 3), np.nan)
    for column, place in enumerate(keypoints.on_body(motion.skeleton)):
        if place is not None:
            points[:, column] = motion.state.point(place.bone, place.p_bone_point)
    return points


def keypoints_in_image(
    motion: Motion, keypoints: KeypointSet, path: CameraPath, model: CameraModel, time: Array
) -> Array:
    """Pixels ``(F, K, 2)`` of keypoints at instants ``(F,)`` of the recording's clock.

    World points are interpolated linearly between frames. NaN outside the motion's time (with one frame of slack),
    behind the camera, and for keypoints that the skeleton does not have.
    """
    motion_time, points = motion.time, keypoints_in_world(motion, keypoints)
    inside = (time >= motion_time[0] - 1 / motion.rate) & (time <= motion_time[-1] + 1 / motion.rate)
    place = np.clip((time - motion_time[0]) * motion.rate, 0, len(motion_time) - 1)
    index = np.minimum(place.astype(int), max(len(motion_time) - 2, 0))
    right, share = np.minimum(index + 1, len(motion_time) - 1), (place - index)[:, None, None]
    p_camera = path.at(time).to_camera((1 - share) * points[index] + share * points[right])
    is_visible = inside[:, None] & (p_camera[..., 2] > NEAREST_M)
    pixels = model.project(np.where(is_visible[..., None], p_camera, [0.0, 0.0, 1.0]))
    return np.where(is_visible[..., None], pixels, np.nan)


def reprojection_error(
    motion: Motion, path: CameraPath, model: CameraModel, detections: Detections, chosen: np.ndarray
) -> Array:
    """Distances ``(n, K)`` in pixels of detected keypoints from a body's; NaN if one of the two is missing.

    Detections have times on the recording's clock; ``chosen`` ``(n,)`` are the indices of the body's detections.
    """
    pixels = keypoints_in_image(motion, detections.keypoints, path, model, detections.time)
    distance = np.linalg.norm(pixels[detections.frame[chosen]] - detections.pixels[chosen], axis=-1)
    return np.where(detections.seen[chosen], distance, np.nan)
