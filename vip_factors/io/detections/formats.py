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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.body.keypoints import KeypointSet
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

PERSON = 1  # COCO's category
TIME = "time_s"  # of a frame; our own detector writes it
OPENPOSE_KEYS = ("pose_keypoints_2d", "pose_keypoints")  # the second up to OpenPose 1.2


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


def read_people(path: Path) -> DetectedPeople:
    """Everybody in all frames of a file or folder of any known format.

    Raises:
        InputError: if there is nothing at the path.
        FileFormatError: for content that is of no known format, or a person, frame or file that is not of its form.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder of 2D poses")
    expected = "2D poses as OpenPose (a folder), AlphaPose, MMPose or COCO's results (a .json file)"
    if path.is_dir():
        files, expected = sorted(path.glob("*.json")), "a folder with OpenPose's JSON files, one a frame"
        if files and _holds(load_json(files[0]), "people"):
            return _openpose(path, files)
    elif path.suffix.lower() == ".json":
        content = load_json(path)
        first: Any = content[0] if isinstance(content, list) and content else None
        if _holds(content, "people"):
            return _openpose(path, [path])
        if _holds(content, "instance_info") or _holds(first, "instances"):
            return _mmpose(path, content)
        if _holds(first, "keypoints") and isinstance(first.get("image_id"), int | str):
            return _results(path, content)
        expected = "people; the list is empty" if content == [] else expected
    raise FileFormatError(f"{path}: expected {expected}")


def _holds(content: Any, name: str) -> Any:
    return isinstance(content, dict) and name in content


def _openpose(path: Path, files: Sequence[Path]) -> DetectedPeople:
    found, of_number = DetectedPeople(path), dict[int, Path]()
    for file in files:
        number = frame_number(file.stem.removesuffix("_keypoints"), str(file))
        if number in of_number:
            raise FileFormatError(
                f"{path}: {of_number[number].name} and {file.name} are both frame {number}: expected the frames of one "
                "video; give each camera a folder of its own"
            )
        of_number[number] = file
        people = _list_of(_entry_of(load_json(file), str(file), ["people"])["people"], str(file), "people")
        for index, person in enumerate(people):
            if person == {}:
                continue  # as tools that sort people leave a place empty
            where = f"{file}, person {index}"
            key = next((one for one in OPENPOSE_KEYS if _holds(person, one)), OPENPOSE_KEYS[0])
            row = _keypoint_row(_entry_of(person, where, [key])[key], where)
            if len(row):  # empty: only a face or a hand was found
                found.add(number, row, where)
    found.listed = sorted(of_number)
    found.first_number = 1 if found.listed and found.listed[0] == 1 else 0
    return found


def _results(path: Path, content: Any) -> DetectedPeople:
    found = DetectedPeople(path)
    for index, entry in enumerate(content):
        where = f"{path}, entry {index}"
        person = _entry_of(entry, where, ["image_id", "keypoints"])
        if person.get("category_id", PERSON) == PERSON:
            found.add(frame_number(person["image_id"], where), _keypoint_row(person["keypoints"], where), where)
    found.listed = sorted(set(found.numbers))
    return found


def _mmpose(path: Path, content: Any) -> DetectedPeople:
    told = content if isinstance(content, dict) else {"instance_info": content}
    found = DetectedPeople(path, names=_names(told.get("meta_info")))
    for index, frame in enumerate(_list_of(told["instance_info"], str(path), "instance_info")):
        where = f"{path}, frame entry {index}"
        entry = _entry_of(frame, where, ["frame_id", "instances"])
        number = frame_number(entry["frame_id"], where)
        found.listed.append(number)
        if TIME in entry:
            found.time[number] = _seconds(entry[TIME], where)
        for one, instance in enumerate(_list_of(entry["instances"], where, "instances")):
            of_person = f"{where}, instance {one}"
            given = _entry_of(instance, of_person, ["keypoints", "keypoint_scores"])
            points, scores = (_numbers(given[name], of_person) for name in ("keypoints", "keypoint_scores"))
            if points.ndim != 2 or points.shape[1] != 2 or scores.shape != points.shape[:1]:
                raise FileFormatError(
                    f"{of_person}: keypoints {points.shape} and scores {scores.shape}: expected (J, 2) and (J,), in "
                    "pixels"
                )
            found.add(number, np.column_stack([points, scores]).ravel(), of_person)
    found.listed = sorted(set(found.listed))
    found.first_number = 0 if found.listed and found.listed[0] == 0 else 1
    return found


def _seconds(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise FileFormatError(f"{where}: {TIME} is {value!r}: expected seconds")
    return float(value)


def _names(meta: Any) -> tuple[str, ...]:
    """The keypoints' names in order, if they are told."""
    names = meta.get("keypoint_id2name") if isinstance(meta, dict) else None
    if isinstance(names, dict):
        try:
            return tuple(str(name) for _, name in sorted((int(key), name) for key, name in names.items()))
        except ValueError:
            return ()
    return tuple(map(str, names)) if isinstance(names, list) else ()


@lru_cache(maxsize=2)  # a format is recognised by the content that is then read
def _content(path: Path, stamp: tuple[int, int]) -> Any:
    try:
        return json.loads(path.read_bytes())
    except json.JSONDecodeError as error:
        raise FileFormatError(
            f"{path}, line {error.lineno}: not JSON ({error.msg}); the file may be cut off: write or copy it again"
        ) from error
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: not JSON, but binary (byte {error.start})") from error
    except (ValueError, RecursionError) as error:  # numbers of too many digits, brackets in brackets without end
        raise FileFormatError(f"{path}: not readable as JSON ({error})") from error


def load_json(path: Path) -> Any:
    """The content of a JSON file.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is not JSON, with the line.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    status = path.stat()
    if status.st_size == 0:
        raise FileFormatError(f"{path} is empty (0 bytes): expected JSON")
    return _content(path, (status.st_size, status.st_mtime_ns))


def _keypoint_row(values: Any, where: str) -> Array:
    """One person's flat list x, y, confidence … as an array."""
    if not isinstance(values, list) or len(values) % 3:
        found = f"{len(values)} numbers" if isinstance(values, list) else type(values).__name__
        raise FileFormatError(f"{where}: keypoints are {found}: expected x, y, confidence of every keypoint")
    row = _numbers(values, where)
    if row.ndim != 1:
        raise FileFormatError(f"{where}: keypoints are lists in a list: expected one flat list x, y, confidence, …")
    return row


def _numbers(values: Any, where: str) -> Array:
    """A (nested) list of numbers as an array; null and NaN become NaN."""
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise FileFormatError(f"{where}: keypoints are not all numbers ({error})") from error


def _entry_of(entry: Any, where: str, needed: Sequence[str]) -> Mapping[str, Any]:
    """An entry that has all of the fields."""
    missing = [name for name in needed if name not in entry] if isinstance(entry, dict) else list(needed)
    if missing:
        raise FileFormatError(f"{where}: {', '.join(missing)} missing: expected fields {', '.join(needed)}")
    checked: Mapping[str, Any] = entry
    return checked


def _list_of(entries: Any, where: str, what: str) -> list[Any]:
    if not isinstance(entries, list):
        raise FileFormatError(f"{where}: {what} is {type(entries).__name__}: expected a list")
    return entries


def frame_number(name: Any, where: str) -> int:
    """The last digits of a file's name, or the number itself: ``cam1_000012_keypoints`` → 12.

    Raises:
        FileFormatError: if there are none.
    """
    if isinstance(name, int) and not isinstance(name, bool) and name >= 0:
        return name
    found = re.findall(r"\d+", re.sub(r"\.[A-Za-z]\w*$", "", name)) if isinstance(name, str) else []
    if not found:
        raise FileFormatError(f"{where}: no frame number in {name!r}: expected one such as 12 or 'walk_000012.jpg'")
    return int(found[-1])


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
