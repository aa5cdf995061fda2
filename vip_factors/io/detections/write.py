"""Tracked 2D poses of a video as MMPose's JSON, which tells the keypoints' names: what :mod:`formats` reads.

Beyond MMPose's own fields, ``meta_info`` says what the keypoint set is called and how the poses were found, a frame has
``time_s`` and an instance ``track_id``.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array

PIXEL_DIGITS, SCORE_DIGITS, TIME_DIGITS = 2, 4, 6


@dataclass(frozen=True)
class TrackedPose:
    """One person in one frame.

    Attributes:
        track: number of the person, the same in all frames.
        pixels: ``(K, 2)`` in the image as it is shown; the middle of its first pixel is at (0.5, 0.5).
        confidence: ``(K,)`` in [0, 1]; 0 where a keypoint was not found.
        score: of the person, in [0, 1].
    """

    track: int
    pixels: Array
    confidence: Array
    score: float


def write_mmpose(
    path: str | PathLike[str],
    keypoints: KeypointSet,
    frames: Sequence[Sequence[TrackedPose]],
    time: Array,
    about: Mapping[str, Any],
    overwrite: bool = False,
) -> None:
    """Write the poses of all frames of a video, frames without people included, whole or not at all.

    Args:
        path: of the file, usually ``.json``.
        keypoints: of the poses.
        frames: everybody in each of the video's ``F`` frames.
        time: ``(F,)`` seconds of the frames after the first.
        about: for people: the video, the model …
        overwrite: whether an existing file may be replaced.

    Raises:
        InputError: if the file exists, or its folder is missing or read-only.
    """
    meta = {
        "dataset_name": keypoints.name,
        "num_keypoints": len(keypoints),
        "keypoint_id2name": {str(index): name for index, name in enumerate(keypoints.keypoints)},
        **about,
    }
    with atomic_open(path, "w", overwrite) as file:
        file.write(f'{{"meta_info": {json.dumps(meta)},\n"instance_info": [\n')
        for index, people in enumerate(frames):
            entry = {
                "frame_id": index + 1,  # as MMPose counts
                "time_s": round(float(time[index]), TIME_DIGITS),
                "instances": [_instance(one) for one in people],
            }
            file.write(json.dumps(entry) + (",\n" if index + 1 < len(frames) else "\n"))
        file.write("]}\n")


def _instance(pose: TrackedPose) -> dict[str, Any]:
    found = pose.confidence > 0
    pixels = np.where(found[:, None], pose.pixels, 0.0)
    box = [*pixels[found].min(axis=0), *pixels[found].max(axis=0)] if np.any(found) else [0.0] * 4
    return {
        "track_id": pose.track,
        "keypoints": _rounded(pixels, PIXEL_DIGITS),
        "keypoint_scores": _rounded(pose.confidence, SCORE_DIGITS),
        "bbox": [_rounded(np.array(box), PIXEL_DIGITS)],
        "bbox_score": round(float(pose.score), SCORE_DIGITS),
    }


def _rounded(values: Array, digits: int) -> Any:
    return np.round(values.astype(float), digits).tolist()
