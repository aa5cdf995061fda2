"""Everybody in a video, frame by frame."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.body.keypoints import KeypointSet, keypoint_set
from vip_factors.detect.onnx_pose import OnnxPose, box_around
from vip_factors.detect.settings import DetectSettings
from vip_factors.detect.sides import confused
from vip_factors.detect.tracks import Track, Tracker
from vip_factors.errors import InputError
from vip_factors.io.detections.mmpose_write import TrackedPose
from vip_factors.io.video import VideoFacts, iterate_frames, video_facts

BLAZEPOSE = "blazepose33"


@dataclass(frozen=True)
class Stretch:
    """Which frames to look at: from ``start_s`` to ``end_s`` of the video (None: its ends), each ``every``-th."""

    start_s: float | None = None
    end_s: float | None = None
    every: int = 1

    def frames(self, facts: VideoFacts) -> range:
        """Their indices.

        Raises:
            InputError: if there are none.
        """
        if self.every < 1:
            raise InputError(f"every {self.every}: expected 1 for every frame, 2 for every second one …")
        low = 0 if self.start_s is None else int(np.searchsorted(facts.time, self.start_s))
        high = len(facts) if self.end_s is None else int(np.searchsorted(facts.time, self.end_s, side="right"))
        if low >= high:
            raise InputError(
                f"{facts.path} lasts {facts.time[-1]:.1f} s: there is no frame from {self.start_s or 0:g} to "
                f"{facts.time[-1] if self.end_s is None else self.end_s:g} s"
            )
        return range(low, high, self.every)


@dataclass(frozen=True)
class VideoPoses:
    """Poses of a video.

    Attributes:
        facts: of the video.
        keypoints: of the poses.
        frames: everybody in each of the video's frames; nobody where no one looked.
        looked: indices of the frames that were looked at.
    """

    facts: VideoFacts
    keypoints: KeypointSet
    frames: list[list[TrackedPose]]
    looked: range

    @property
    def tracks(self) -> list[int]:
        """Numbers of the people, in order."""
        return sorted({one.track for people in self.frames for one in people})


def detect_video(
    path: Path,
    tracker: Tracker,
    settings: DetectSettings,
    stretch: Stretch | None = None,
    model: OnnxPose | None = None,
    tell: Callable[[float], None] = lambda fraction: None,
) -> VideoPoses:
    """Poses of everybody in a video.

    Args:
        path: of the video.
        tracker: follows people; its landmarks are the poses, if no other model is given.
        settings: thresholds and periods.
        stretch: which frames to look at; all if None.
        model: that finds the keypoints of the people followed.
        tell: called with the fraction that is done.

    Raises:
        InputError, FileFormatError: if there is no such video, or no such frame in it.
    """
    facts = video_facts(path)
    looked = (stretch or Stretch()).frames(facts)
    keypoints = keypoint_set(BLAZEPOSE) if model is None else model.keypoints
    frames: list[list[TrackedPose]] = [[] for _ in range(len(facts))]
    images = iterate_frames(path, facts.time, looked.step, looked.start, looked.stop)
    for index, image, people in _followed(images, tracker):
        poses = [_pose(one, image, model) for one in people]
        frames[index] = [one for one in poses if np.any(one.confidence > 0)]
        tell((index + 1 - looked.start) / len(range(looked.start, looked.stop)))
    somebody = [[one for one in poses if one.track not in tracker.given_up] for poses in frames]
    rate = facts.rate / looked.step
    least = min(math.ceil(settings.least_s * rate), len(looked))  # a short video has no longer tracks
    tidy = _tidied(somebody, keypoints, least, max(1, round(settings.turn_s * rate)))
    return VideoPoses(facts, keypoints, tidy, looked)


def _followed(images: Iterator, tracker: Tracker) -> Iterator[tuple[int, np.ndarray, list[Track]]]:
    for index, time, image in images:
        yield index, image, tracker.step(image, time)


def _pose(track: Track, image: np.ndarray, model: OnnxPose | None) -> TrackedPose:
    seen = track.seen
    pixels, confidence = seen.pixels, seen.confidence
    height, width = image.shape[:2]
    if model is not None:
        inside = np.clip(pixels, 0, [width, height])
        pixels, confidence = model.look(image, box_around(inside))
    within = np.all((pixels >= 0) & (pixels < [width, height]), axis=1)  # beyond the image both models only guess
    return TrackedPose(track.number, pixels, np.where(within, confidence, 0.0), seen.presence)


def _tidied(
    frames: Sequence[Sequence[TrackedPose]], keypoints: KeypointSet, least: int, reach: int
) -> list[list[TrackedPose]]:
    """Without tracks of less than so many frames, the others numbered from 1 as they come, sides set right."""
    of_track: dict[int, list[tuple[int, TrackedPose]]] = defaultdict(list)
    for index, people in enumerate(frames):
        for one in people:
            of_track[one.track].append((index, one))
    kept = [one for one in of_track.values() if len(one) >= least]
    tidy: list[list[TrackedPose]] = [[] for _ in frames]
    for number, poses in enumerate(kept, start=1):
        pixels, confidence = (np.stack([getattr(one, name) for _, one in poses]) for name in ("pixels", "confidence"))
        turned = confused(keypoints, pixels, confidence, reach)
        for (index, pose), exchange in zip(poses, turned, strict=True):
            order = keypoints.mirrored if exchange else slice(None)
            tidy[index].append(TrackedPose(number, pose.pixels[order], pose.confidence[order], pose.score))
    return tidy
