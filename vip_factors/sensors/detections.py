"""What a 2D pose detector saw in the frames of one camera: everybody visible, wearers or not."""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.times import check_times
from vip_factors.sensors.video_clock import VideoClock


@dataclass(frozen=True)
class Detections:
    """``N`` people found in ``F`` video frames, ``K`` keypoints each.

    Attributes:
        keypoints: names and order of the keypoints.
        time: ``(F,)`` seconds of each video frame from the recording's start, increasing; frames without people count.
        frame: ``(N,)`` index of the video frame of each detection, not decreasing.
        pixels: ``(N, K, 2)``, distorted as in the image; NaN where a keypoint was not found.
        confidence: ``(N, K)`` in [0, 1]; 0 where a keypoint was not found.
        torso_colour: ``(N, B)`` shares of the colours between shoulders and hips in the video, adding up to one; NaN
            where nobody looked or the torso was not seen. None without a video.
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

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def rate(self) -> float:
        """Video frames per second (median), 0 for less than two frames."""
        return float(1 / np.median(np.diff(self.time))) if len(self.time) > 1 else 0.0

    @property
    def seen(self) -> np.ndarray:
        """``(N, K)`` whether a keypoint was found."""
        return (self.confidence > 0) & np.all(np.isfinite(self.pixels), axis=-1)

    def of_frame(self, frame: int) -> slice:
        """The detections of one video frame."""
        return slice(int(np.searchsorted(self.frame, frame)), int(np.searchsorted(self.frame, frame, side="right")))

    def select(self, which: np.ndarray) -> "Detections":
        """Some of the detections (mask or increasing indices), all video frames kept."""
        colour = None if self.torso_colour is None else self.torso_colour[which]
        return replace(
            self, frame=self.frame[which], pixels=self.pixels[which], confidence=self.confidence[which],
            torso_colour=colour,
        )  # fmt: skip

    def shifted(self, seconds: float) -> "Detections":
        """The same with all times moved by an offset of the video's clock."""
        return replace(self, time=self.time + seconds)

    def timed(self, clock: VideoClock) -> "Detections":
        """The same with times on the sensors' clock instead of the video's own."""
        return replace(self, time=clock.at(self.time))
