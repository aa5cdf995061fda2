"""2D poses as detectors' programs write them, each told by its content, with the same complaints for all; and writing
our own detector's, as MMPose does.

* OpenPose: a folder with one JSON file a frame, ``{"people": [{"pose_keypoints_2d": [x, y, c, …]}]}``. Frames without
  people have files too, so the lowest number is the video's first frame: 0 as OpenPose counts, 1 where the frames were
  numbered by another tool.
* MMPose: ``{"meta_info": …, "instance_info": [{"frame_id": 1, "instances": […]}]}``, or that list alone. An instance
  has ``keypoints`` [[x, y], …] and ``keypoint_scores`` [c, …]. Frames are counted from 1, and all are listed.
* COCO's results and AlphaPose: a list of ``{"image_id": 12, "keypoints": [x, y, c, …], "score": …}``, an entry a
  person; AlphaPose names the images, ``"12.jpg"``. Frames are counted from 0.

What we write has more than MMPose's own fields: ``meta_info`` says what the keypoint set is called and how the poses
were found, a frame has ``time_s`` and an instance ``track_id``.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.body.keypoints import KeypointSet
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.typed_files import MOST_MOTION_BYTES, Number, convert, read_json

PERSON = 1  # COCO's category
EXPECTED = "2D poses as OpenPose (a folder), AlphaPose, MMPose or COCO's results (a .json file)"
Numbers = list[float | None]
MOST_DIGITS = 15  # of a frame's number


@dataclass
class DetectedPeople:
    """People as a file lists them.

    Attributes:
        path: of the file or folder.
        first_number: what the format calls the first frame of a video.
        listed: numbers of all frames that the file speaks of, those without people included.
        numbers: the frame's number of each person.
        rows: each person's keypoints, flat ``(3 J,)``: x, y, confidence.
        where: of each person, as a complaint names it.
        names: the keypoints' names in order, if the file tells them.
        time: seconds of each listed frame by its number, if the file tells them.
    """

    path: Path
    first_number: int = 0
    listed: list[int] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    rows: list[Array] = field(default_factory=list)
    where: list[str] = field(default_factory=list)
    names: tuple[str, ...] = ()
    time: dict[int, float] = field(default_factory=dict)

    def add(self, number: int, row: Array, where: str) -> None:
        """One person of one frame."""
        self.numbers.append(number)
        self.rows.append(row)
        self.where.append(where)


class _OpenPosePerson(msgspec.Struct, frozen=True):
    pose_keypoints_2d: Numbers = []
    pose_keypoints: Numbers = []  # up to OpenPose 1.2


class _OpenPoseFile(msgspec.Struct, frozen=True):
    people: list[_OpenPosePerson]


class _Result(msgspec.Struct, frozen=True):
    """Person of COCO's results or AlphaPose."""

    image_id: int | str
    keypoints: Numbers
    category_id: int = PERSON


class _Instance(msgspec.Struct, frozen=True):
    keypoints: list[tuple[float | None, float | None]]
    keypoint_scores: Numbers


class _Frame(msgspec.Struct, frozen=True):
    frame_id: int | str
    instances: list[_Instance]
    time_s: Number | None = None


class _Meta(msgspec.Struct, frozen=True):
    keypoint_id2name: dict[str, str] | list[str] = []


class _MmposeFile(msgspec.Struct, frozen=True):
    instance_info: list[_Frame]
    meta_info: _Meta = _Meta()


def read_people(path: Path) -> DetectedPeople:
    """Everybody in all frames of a file or folder of any known format.

    Raises:
        InputError: if there is nothing at the path, or a person, frame or file is not of its form.
        FileFormatError: for content that is of no known format.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder of 2D poses")
    if path.is_dir():
        files = sorted(path.glob("*.json"))
        if not files:
            raise FileFormatError(f"{path}: expected a folder with OpenPose's JSON files, one a frame")
        return _openpose(path, ((file, _content(file)) for file in files))
    if path.suffix.lower() == ".json":
        content = _content(path)
        first = content[0] if isinstance(content, list) and content else None
        if _has(content, "people"):
            return _openpose(path, [(path, content)])
        if _has(content, "instance_info"):
            return _mmpose(path, convert(path, "", content, _MmposeFile))
        if _has(first, "instances"):
            return _mmpose(path, _MmposeFile(convert(path, "", content, list[_Frame])))
        if _has(first, "image_id"):
            return _results(path, convert(path, "", content, list[_Result]))
        if content == []:
            raise FileFormatError(f"{path}: expected people; the list is empty")
    raise FileFormatError(f"{path}: expected {EXPECTED}")


def _content(path: Path) -> Any:
    return read_json(path, object, EXPECTED, MOST_MOTION_BYTES)


def _has(content: object, name: str) -> bool:
    return isinstance(content, dict) and name in content


def _openpose(path: Path, contents: Iterable[tuple[Path, object]]) -> DetectedPeople:
    detected, file_of = DetectedPeople(path), dict[int, Path]()
    for file, content in contents:
        number = frame_number(file.stem.removesuffix("_keypoints"), str(file))
        if number in file_of:
            raise FileFormatError(
                f"{path}: {file_of[number].name} and {file.name} are both frame {number}: expected the frames of one "
                "video; give each camera a folder of its own"
            )
        file_of[number] = file
        for index, person in enumerate(convert(file, "", content, _OpenPoseFile).people):
            # Empty where only a face or a hand was found, and where tools that sort people leave a place.
            if keypoints := person.pose_keypoints_2d or person.pose_keypoints:
                where = f"{file}, person {index}"
                detected.add(number, _row(keypoints, where), where)
    detected.listed = sorted(file_of)
    detected.first_number = 1 if detected.listed and detected.listed[0] == 1 else 0
    return detected


def _results(path: Path, people: Sequence[_Result]) -> DetectedPeople:
    detected = DetectedPeople(path)
    for index, person in enumerate(people):
        where = f"{path}, entry {index}"
        if person.category_id == PERSON:
            detected.add(frame_number(person.image_id, where), _row(person.keypoints, where), where)
    detected.listed = sorted(set(detected.numbers))
    return detected


def _mmpose(path: Path, content: _MmposeFile) -> DetectedPeople:
    detected = DetectedPeople(path, names=_names(content.meta_info.keypoint_id2name))
    for index, frame in enumerate(content.instance_info):
        number = frame_number(frame.frame_id, f"{path}, frame entry {index}")
        detected.listed.append(number)
        if frame.time_s is not None:
            detected.time[number] = frame.time_s
        for place, person in enumerate(frame.instances):
            where = f"{path}, frame entry {index}, instance {place}"
            points = np.array(person.keypoints, dtype=float).reshape(-1, 2)
            scores = np.array(person.keypoint_scores, dtype=float)
            if len(points) != len(scores):
                raise FileFormatError(
                    f"{where}: {len(points)} keypoints and {len(scores)} scores: expected a score for each"
                )
            detected.add(number, np.column_stack([points, scores]).ravel(), where)
    detected.listed = sorted(set(detected.listed))
    detected.first_number = 0 if detected.listed and detected.listed[0] == 0 else 1
    return detected


def _names(names: dict[str, str] | list[str]) -> tuple[str, ...]:
    """The keypoints' names in order, if they are told."""
    if isinstance(names, dict):
        numbered = {int(key): name for key, name in names.items() if key.isdecimal()}
        return tuple(name for _, name in sorted(numbered.items()))
    return tuple(names)


def _row(keypoints: Numbers, where: str) -> Array:
    """One person's flat list x, y, confidence … as an array, NaN for null."""
    if len(keypoints) % 3:
        raise FileFormatError(
            f"{where}: keypoints are {len(keypoints)} numbers: expected x, y, confidence of every keypoint"
        )
    return np.array(keypoints, dtype=float)


def frame_number(name: int | str, where: str) -> int:
    """The last digits of a file's name, or the number itself: ``cam1_000012_keypoints`` → 12.

    Raises:
        FileFormatError: if there are none.
    """
    if isinstance(name, int) and name >= 0:
        return name
    digits = re.findall(r"[0-9]+", re.sub(r"\.[A-Za-z]\w*$", "", name)) if isinstance(name, str) else []
    if not digits or len(digits[-1].lstrip("0")) > MOST_DIGITS:
        raise FileFormatError(
            f"{where}: no frame number in {str(name)[:60]!r}: expected one such as 12 or 'walk_000012.jpg'"
        )
    return int(digits[-1])


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
