"""2D pose detections of one camera, of wearers and bystanders: tracks, keypoints of a motion, reprojection error."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
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


SHORTEST_TRACK_S = 2.0  # in which a body is seen


@dataclass(frozen=True)
class ImageTrack:
    """One body in consecutive video frames.

    Attributes:
        time: ``(n,)`` seconds on the video's clock, increasing; frames without the body are absent.
        pixels: ``(n, K, 2)``, NaN if a keypoint is not detected.
        size: ``(n,)`` pixels, smoothed spread of the keypoints.
    """

    time: Array
    pixels: Array
    size: Array


def simple_tracks(detections: Detections) -> list[ImageTrack]:
    """Track bodies in a video; the longest tracks come first."""
    least_confidence = 0.2  # of keypoints that are used
    max_tracks = 40  # bystanders may have thousands
    pixels = np.where((detections.confidence >= least_confidence)[..., None], detections.pixels, np.nan)
    tracks = []
    for rows in _linked(detections, pixels):
        time = detections.time[detections.frame[rows]]
        if time[-1] - time[0] >= SHORTEST_TRACK_S:
            tracks.append(ImageTrack(time, pixels[rows], _smooth_size(time, _spread(pixels[rows]))))
    tracks.sort(key=lambda track: len(track.time), reverse=True)
    return tracks[:max_tracks]


def _linked(detections: Detections, pixels: Array) -> list[list[int]]:
    """Link detections to tracks; returns the detections' indices of each track."""
    reach = 0.35  # largest shift of the keypoints between frames over their spread; a runner's is 0.1
    doubt = 1.5  # ratio of two candidates' shifts below which a track ends: ambiguous
    longest_gap_s = 0.25  # without a detection
    done: list[list[int]] = []
    alive: list[list[int]] = []
    for frame in np.unique(detections.frame):
        indices = np.arange(*detections.of_frame(int(frame)).indices(len(detections)))
        time = detections.time[frame]
        fresh = [time - detections.time[detections.frame[rows[-1]]] <= longest_gap_s for rows in alive]
        done += [rows for rows, young in zip(alive, fresh, strict=True) if not young]
        alive = [rows for rows, young in zip(alive, fresh, strict=True) if young]
        matched: set[int] = set()
        if alive:
            shift = _shifts(pixels[[rows[-1] for rows in alive]], pixels[indices])
            ended = []
            for row, column in zip(*scipy.optimize.linear_sum_assignment(np.minimum(shift, 1e3)), strict=True):
                if shift[row, column] > reach:
                    continue
                rivals = [*np.delete(shift[row], column), *np.delete(shift[:, column], row)]
                if min(rivals, default=np.inf) < doubt * shift[row, column]:
                    ended.append(row)
                    continue
                alive[row].append(int(indices[column]))
                matched.add(int(column))
            done += [alive[row] for row in ended]
            alive = [rows for row, rows in enumerate(alive) if row not in ended]
        alive += [[int(index)] for column, index in enumerate(indices) if column not in matched]
    return done + alive


def _shifts(pixels: Array, next_pixels: Array) -> Array:
    """Median distance ``(A, B)`` of common keypoints over their spread; infinite for less than four."""
    distance = np.linalg.norm(pixels[:, None] - next_pixels[None], axis=-1)
    common = np.isfinite(distance)
    filled = np.sort(np.where(common, distance, np.inf), axis=-1)
    count = common.sum(axis=-1)
    middle = np.take_along_axis(filled, np.maximum(count // 2, 0)[..., None].clip(max=filled.shape[-1] - 1), axis=-1)
    size = np.fmax(_spread(pixels), 1.0)
    return np.where(count >= 4, middle[..., 0] / size[:, None], np.inf)


def _spread(pixels: Array) -> Array:
    """Diagonal ``(n,)`` of the keypoints' bounding box; 0 with fewer than two keypoints."""
    is_finite = np.isfinite(pixels)
    low = np.where(is_finite, pixels, np.inf).min(axis=1)
    high = np.where(is_finite, pixels, -np.inf).max(axis=1)
    return np.linalg.norm(np.where(np.isfinite(low), high - low, 0.0), axis=-1)


def _smooth_size(time: Array, size: Array) -> Array:
    """Large quantile over a window, so that raised arms do not change the size."""
    window = 2.0  # s
    knots = np.arange(time[0], time[-1] + window / 2, window / 2)
    starts, ends = np.searchsorted(time, knots - window / 2), np.searchsorted(time, knots + window / 2, side="right")
    values = [np.quantile(size[a:b], 0.8) if b > a else np.nan for a, b in zip(starts, ends, strict=True)]
    good = np.isfinite(values)
    return np.maximum(np.interp(time, knots[good], np.array(values)[good]), 1.0)
