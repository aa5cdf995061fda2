"""People in a video: tracks are filtered, exchanged sides corrected, and poses drawn over the video on request.

A model may exchange left and right in some frames. Nobody turns round within a few frames, so where the trunk's sides
are exchanged against the frames just before, one of the two is wrong; the majority of the connected frames decides
which. The trunk of a person who really turns is narrow in between, and connects no frames.
"""

import math
import warnings
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from vip_factors.atomic import atomic_path, check_complete, check_target
from vip_factors.body.keypoints import KeypointSet, keypoint_set
from vip_factors.detect import blazepose as blazepose_models
from vip_factors.detect import models, tracks
from vip_factors.detect.models import OnnxPose, box_around
from vip_factors.detect.settings import DetectSettings
from vip_factors.detect.tracks import Track, Tracker
from vip_factors.display import ProgressCallback, silent
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.detections import TrackedPose, write_mmpose
from vip_factors.io.video import VideoFacts, iterate_frames, video_facts
from vip_factors.sensors.detections import Detections
from vip_factors.viz.film import draw_pose, limb_pairs

WIDTHS = ("shoulder", "hip")
# Least vote, in squares of the trunk's length. People seen from the front or behind vote with about 0.4, people who
# turn round within half a second with 0.1 at most.
CLEAR = 0.12


def exchanged_sides(keypoints: KeypointSet, pixels: Array, confidence: Array, reach: int) -> np.ndarray:
    """Frames ``(F,)`` of one person in which left and right are exchanged.

    Args:
        keypoints: keypoint set of the poses, with shoulders and hips.
        pixels: ``(F, K, 2)`` of the person in successive frames.
        confidence: ``(F, K)`` in [0, 1].
        reach: number of preceding frames to compare a frame with: a quarter of a second.
    """
    across, weight = _across(keypoints, pixels, confidence)
    sign = np.ones(len(pixels))
    start, linked = 0, 0
    for frame in range(1, len(pixels)):
        window = slice(max(start, frame - reach), frame)
        joint_weight = weight[window] * weight[frame]
        votes = np.sum(joint_weight * np.sum(across[window] * across[frame], axis=-1), axis=1)
        mean = float(np.sum(votes * sign[window]) / max(np.sum(joint_weight), 1e-9))
        sign[frame] = sign[linked]
        if abs(mean) >= CLEAR:
            sign[frame], linked = np.sign(mean), frame
        elif frame - linked >= reach:  # the end of connected frames
            _flip_to_majority(sign[start : linked + 1])
            sign[linked + 1 : frame + 1], start, linked = 1, frame, frame
    _flip_to_majority(sign[start:])
    return sign < 0


def _flip_to_majority(sign: Array) -> None:
    """Flip signs so that most are positive: the model is usually right."""
    if sign.sum() < 0:
        sign *= -1


def _across(keypoints: KeypointSet, pixels: Array, confidence: Array) -> tuple[Array, Array]:
    """Vectors from right to left ``(F, 2, 2)`` at shoulders and hips, in trunk lengths, and weights ``(F, 2)``."""
    left, right = ([keypoints.keypoints.index(f"{side}_{name}") for name in WIDTHS] for side in ("left", "right"))
    shoulders, hips = np.moveaxis((pixels[:, left] + pixels[:, right]) / 2, 1, 0)
    length = max(float(np.median(np.linalg.norm(shoulders - hips, axis=1))), 1e-9)
    return (pixels[:, left] - pixels[:, right]) / length, np.minimum(confidence[:, left], confidence[:, right])


DEFAULT = DetectSettings()


def _frames_to_look_at(facts: VideoFacts, settings: DetectSettings) -> range:
    start_s, end_s = settings.start_s, settings.end_s
    low = 0 if start_s is None else int(np.searchsorted(facts.time, start_s))
    high = len(facts) if end_s is None else int(np.searchsorted(facts.time, end_s, side="right"))
    if low >= high:
        last_s = facts.time[-1]
        raise InputError(
            f"{facts.path} lasts {last_s:.1f} s: there is no frame from {start_s or 0:g} to "
            f"{last_s if end_s is None else end_s:g} s"
        )
    return range(low, high, settings.every)


@dataclass(frozen=True)
class VideoPoses:
    """Poses of all people in a video.

    Attributes:
        facts: properties of the video.
        keypoints: keypoint set of the poses.
        frames: poses in each frame of the video; empty for frames without detection.
        looked: indices of the frames with detection.
        detector: name of the model.
        seconds: duration of the detection.
    """

    facts: VideoFacts
    keypoints: KeypointSet
    frames: list[list[TrackedPose]]
    looked: range
    detector: str = "BlazePose"
    seconds: float = 0.0

    @property
    def detections(self) -> Detections:
        """All poses as detections of a camera."""
        people = [(frame, pose) for frame, poses in enumerate(self.frames) for pose in poses]
        none = np.zeros((0, len(self.keypoints)))
        confidence = np.stack([pose.confidence for _, pose in people]) if people else none
        pixels = np.stack([pose.pixels for _, pose in people]) if people else np.zeros((*none.shape, 2))
        pixels = np.where(confidence[..., None] > 0, pixels, np.nan)
        frame = np.array([number for number, _ in people], int)
        return Detections(self.keypoints, self.facts.time, frame, pixels, confidence)

    @property
    def tracks(self) -> dict[int, list[int]]:
        """Indices of the frames of each person, by number."""
        frames_of = defaultdict[int, list[int]](list)
        for index, people in enumerate(self.frames):
            for pose in people:
                frames_of[pose.track].append(index)
        return dict(sorted(frames_of.items()))


def detect_video(
    path: Path,
    tracker: Tracker,
    settings: DetectSettings = DEFAULT,
    model: OnnxPose | None = None,
    progress: ProgressCallback = silent,
) -> VideoPoses:
    """Detect the poses of all people by a tracker, or by a ``model`` of the tracked people's keypoints."""
    least_s = 0.2  # shortest track that is kept: false detections last shorter
    turn_s = 0.25  # in which nobody turns round
    begin = perf_counter()
    facts = video_facts(path)
    looked = _frames_to_look_at(facts, settings)
    keypoints = keypoint_set("blazepose33") if model is None else model.keypoints
    frames: list[list[TrackedPose]] = [[] for _ in range(len(facts))]
    images = iterate_frames(path, facts.time, looked.step, looked.start, looked.stop)
    count = looked.stop - looked.start
    for index, time, image in images:
        poses = [_pose(track, image, model) for track in tracker.step(image, time)]
        frames[index] = [pose for pose in poses if np.any(pose.confidence > 0)]
        progress(f"looking for people in {count:,} frames", (index + 1 - looked.start) / count)
    somebody = [[pose for pose in poses if pose.track not in tracker.given_up] for poses in frames]
    rate = facts.rate / looked.step
    least = min(math.ceil(least_s * rate), len(looked))  # for short videos
    tidy = _tidied(somebody, keypoints, least, max(1, round(turn_s * rate)))
    return VideoPoses(facts, keypoints, tidy, looked, seconds=perf_counter() - begin)


def detect_people(
    path: Path,
    settings: DetectSettings = DEFAULT,
    progress: ProgressCallback = silent,
    *,
    out: Path | None = None,
    overlay: Path | None = None,
    overwrite: bool = False,
) -> VideoPoses:
    """Detect the poses of all people in a video, as :func:`vip_factors.api.detect`.

    ``overlay`` is an MP4 file for the video with the poses drawn over it.

    Raises:
        InputError, FileFormatError: if the video or a model cannot be read, or a package is missing.
    """
    if settings.keypoints is not None and settings.model is None:
        raise InputError("keypoints are given without a model: BlazePose has its fixed keypoint set (33)")
    for target in (out, overlay):
        if target is not None:
            check_target(target, overwrite)
    threads = settings.threads or tracks.usual_threads()
    model = OnnxPose(settings.model, threads, settings.keypoints) if settings.model is not None else None
    blazepose_models.check_interpreter()
    files = models.blazepose_files(settings.blazepose, lambda sentence: warnings.warn(sentence, stacklevel=2))
    poses = detect_video(path, tracks.blazepose_tracker(files, settings, threads), settings, model, progress)
    if settings.model is not None:
        poses = replace(poses, detector=settings.model.name)
    if out is not None:  # as MMPose does, with keypoint names and frame times
        facts = poses.facts
        metadata = {
            "detector": poses.detector,
            "video": facts.path.name,
            "video_size": [facts.width, facts.height],
            "video_rate_hz": round(facts.rate, 4),
        }
        write_mmpose(out, poses.keypoints, poses.frames, facts.time, metadata, overwrite)
    if overlay is not None:
        write_overlay(overlay, poses, overwrite, progress)
    return poses


def _pose(track: Track, image: np.ndarray, model: OnnxPose | None) -> TrackedPose:
    landmarks = track.landmarks
    pixels, confidence = landmarks.pixels, landmarks.confidence
    height, width = image.shape[:2]
    if model is not None:
        inside = np.clip(pixels, 0, [width, height])
        pixels, confidence = model.look(image, box_around(inside))
    within = np.all((pixels >= 0) & (pixels < [width, height]), axis=1)  # beyond the image both models only guess
    return TrackedPose(track.number, pixels, np.where(within, confidence, 0.0), landmarks.presence)


def _tidied(
    frames: Sequence[Sequence[TrackedPose]], keypoints: KeypointSet, least: int, reach: int
) -> list[list[TrackedPose]]:
    """Drop tracks of fewer than ``least`` frames, number the others from 1, and correct exchanged sides."""
    of_track: dict[int, list[tuple[int, TrackedPose]]] = defaultdict(list)
    for index, people in enumerate(frames):
        for person in people:
            of_track[person.track].append((index, person))
    long_tracks = [poses for poses in of_track.values() if len(poses) >= least]
    tidy: list[list[TrackedPose]] = [[] for _ in frames]
    for number, poses in enumerate(long_tracks, start=1):
        pixels, confidence = (np.stack([getattr(pose, name) for _, pose in poses]) for name in ("pixels", "confidence"))
        turned = exchanged_sides(keypoints, pixels, confidence, reach)
        for (index, pose), exchange in zip(poses, turned, strict=True):
            order = keypoints.mirrored if exchange else slice(None)
            tidy[index].append(TrackedPose(number, pose.pixels[order], pose.confidence[order], pose.score))
    return tidy


def write_overlay(path: Path, poses: VideoPoses, overwrite: bool = False, progress: ProgressCallback = silent) -> None:
    """Write the frames with detection as a video (``.mp4``), each person in a colour and with the track's number.

    Raises:
        InputError: if the file exists, or OpenCV cannot write such a video.
    """
    import cv2

    largest_side = 1280  # of the longer side, in pixels
    facts, looked = poses.facts, poses.looked
    scale, limbs = min(1.0, largest_side / max(facts.width, facts.height)), limb_pairs(poses.keypoints)
    size = tuple(2 * round(scale * length / 2) for length in (facts.width, facts.height))  # codecs need even numbers
    with atomic_path(path, overwrite) as temporary:
        code = cv2.VideoWriter.fourcc(*"mp4v")
        writer = cv2.VideoWriter(str(temporary), code, facts.rate / looked.step, size)
        if not writer.isOpened():
            raise InputError(f"{path}: OpenCV cannot write such a video: give a name that ends in .mp4")
        count = 0
        try:
            for index, _, image in iterate_frames(facts.path, facts.time, looked.step, looked.start, looked.stop):
                small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
                for pose in poses.frames[index]:
                    pixels = pose.pixels * [size[0] / facts.width, size[1] / facts.height]
                    draw_pose(small, limbs, pixels, pose.confidence, pose.track - 1, str(pose.track))
                writer.write(cv2.cvtColor(small, cv2.COLOR_RGB2BGR))
                count += 1
                progress("drawing", (index + 1 - looked.start) / (looked.stop - looked.start))
        finally:
            writer.release()
        read_back = cv2.VideoCapture(str(temporary))  # the writer reports no errors
        check_complete(int(read_back.get(cv2.CAP_PROP_FRAME_COUNT)), count, "frames")
        read_back.release()


def poses_summary(poses: VideoPoses) -> list[str]:
    """Summary of the detected people, line by line."""
    looked = len(poses.looked)
    tracks_of = poses.tracks
    speed = f", {looked / poses.seconds:.1f} frames a second" if poses.seconds > 0 else ""
    lines = [f"{looked} of {len(poses.frames)} frames of {poses.facts.path.name} looked at{speed}"]
    if not tracks_of:
        lines.append("nobody was found")
    for number, indices in tracks_of.items():
        begin, end = (poses.facts.time[index] for index in (indices[0], indices[-1]))
        lines.append(f"  person {number}: {len(indices)} frames, {begin:.1f} to {end:.1f} s")
    return lines
