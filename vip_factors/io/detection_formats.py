"""The formats of 2D poses: everybody in all frames, as detectors' programs write them; each is recognised by content.

* OpenPose: a folder with one JSON file a frame, ``{"people": [{"pose_keypoints_2d": [x, y, c, …]}]}``. Frames without
  people have files too, so the lowest number is the video's first frame: 0 as OpenPose counts, 1 where the frames were
  numbered by another tool. AlphaPose's formats ``open`` and ``cmu`` have the same for each image in one file.
* MMPose: ``{"meta_info": …, "instance_info": [{"frame_id": 1, "instances": […]}]}``, or that list alone. An instance
  has ``keypoints`` [[x, y], …] and ``keypoint_scores`` [c, …]. Frames are counted from 1, and all are listed. Of a
  folder of images it writes a file each, with the instances alone.
* COCO's results and AlphaPose: a list of ``{"image_id": 12, "keypoints": [x, y, c, …], "score": …}``, an entry a
  person; AlphaPose names the images, ``"12.jpg"``. Frames are counted from 0.
"""

import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.typed_files import MOST_MOTION_BYTES, Number, convert, read_json
from vip_factors.tables import count

PERSON = 1  # COCO's category
EXPECTED = "2D poses as OpenPose (a folder), AlphaPose, MMPose or COCO's results (a .json file)"
MOST_DIGITS = 15  # of a frame's number
IMAGE_SUFFIX = re.compile(r"\.(jpe?g|png|bmp|tiff?|webp|mp4|json)$", re.IGNORECASE)

Numbers = list[float | None]


class DetectionsWarning(UserWarning):
    """Guess or change made in reading a file of 2D poses."""


def warn(path: Path, sentence: str) -> None:
    """Warn about a file of 2D poses."""
    warnings.warn(DetectionsWarning(f"{path}: {sentence}"), stacklevel=4)


@dataclass
class DetectedPeople:
    """People in a file.

    Attributes:
        path: of the file or folder.
        first_number: number of a video's first frame in the format.
        listed: numbers of all frames in the file, those without people included.
        numbers: the frame's number of each person.
        rows: each person's keypoints, flat ``(3 J,)``: x, y, confidence.
        where: place of each person in the file, for messages.
        names: the keypoints' names in order, if the file states them.
        time: seconds of each listed frame by its number, if the file states them.
    """

    path: Path
    first_number: int = 0
    listed: set[int] = field(default_factory=set)
    numbers: list[int] = field(default_factory=list)
    rows: list[Array] = field(default_factory=list)
    where: list[str] = field(default_factory=list)
    names: tuple[str, ...] = ()
    time: dict[int, float] = field(default_factory=dict)

    def add(self, number: int, keypoints: Numbers, where: str) -> None:
        """Add one person of one frame: x, y, confidence of every keypoint, None where there is none."""
        if len(keypoints) % 3:
            raise FileFormatError(
                f"{where}: keypoints are {len(keypoints)} numbers: expected x, y, confidence of every keypoint"
            )
        self.numbers.append(number)
        self.rows.append(np.array(keypoints, dtype=float))
        self.where.append(where)


class _OpenPosePerson(msgspec.Struct, frozen=True):
    pose_keypoints_2d: Numbers = []
    pose_keypoints: Numbers = []  # up to OpenPose 1.2
    joints: Numbers = []  # AlphaPose's format cmu


class _OpenPoseFile(msgspec.Struct, frozen=True):
    people: list[_OpenPosePerson] = []
    bodies: list[_OpenPosePerson] = []  # AlphaPose's format cmu


class _Result(msgspec.Struct, frozen=True):
    """Person of COCO's results or AlphaPose."""

    image_id: float | str
    keypoints: Numbers
    category_id: int = PERSON


class _Instance(msgspec.Struct, frozen=True):
    keypoints: list[tuple[float | None, float | None]]
    keypoint_scores: Numbers

    def flat(self, where: str) -> Numbers:
        """x, y, confidence of every keypoint."""
        points, scores = self.keypoints, self.keypoint_scores
        if len(points) != len(scores):
            raise FileFormatError(
                f"{where}: {len(points)} keypoints and {len(scores)} scores: expected a score for each"
            )
        return [number for point, score in zip(points, scores, strict=True) for number in (*point, score)]


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
    """Read everybody in all frames of a file or folder of any known format.

    Raises:
        InputError: if there is nothing at the path, or a person, frame or file is not of its form.
        FileFormatError: for content that is of no known format.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder of 2D poses")
    if path.is_dir():
        files = sorted(file for file in path.glob("*.json") if not file.name.startswith("."))
        if len(files) == 1 and not _is_openpose(_content(files[0])):
            return replace(read_people(files[0]), path=path)
        stray = list[str]()
        people = _frames_of_files(path, _contents_of_frames(files, stray))
        if stray:
            warn(path, f"left out, without 2D poses: {count(len(stray), 'file')} ({', '.join(stray[:4])})")
        return people
    if path.suffix.lower() == ".json":
        content = _content(path)
        entry = content[0] if isinstance(content, list) and content else None
        if _is_openpose(content):
            return _frames_of_files(path, [(path, path.name, content)])
        if isinstance(content, dict) and content and all(map(_is_openpose, content.values())):
            return _frames_of_files(path, [(path, name, frame) for name, frame in content.items()])
        if _has(content, "instance_info"):
            return _mmpose(path, convert(path, "", content, _MmposeFile))
        if _has(entry, "instances"):
            return _mmpose(path, _MmposeFile(convert(path, "", content, list[_Frame])))
        if _has(entry, "image_id"):
            return _results(path, convert(path, "", content, list[_Result]))
        if content == []:
            raise FileFormatError(f"{path}: expected people; the list is empty")
    raise FileFormatError(f"{path}: expected {EXPECTED}")


def _content(path: Path) -> Any:
    return read_json(path, object, EXPECTED, MOST_MOTION_BYTES)


def _has(content: object, name: str) -> bool:
    return isinstance(content, dict) and name in content


def _is_openpose(content: object) -> bool:
    return _has(content, "people") or _has(content, "bodies")


def _contents_of_frames(files: Iterable[Path], stray: list[str]) -> Iterator[tuple[Path, str, object]]:
    """Each file of a frame, its name and its content; names of other files become ``stray``."""
    for file in files:
        content = _content(file)
        instances = content["instance_info"] if _has(content, "instance_info") else content
        if _is_openpose(content):
            yield file, file.name, content
        elif isinstance(instances, list) and all(_has(instance, "keypoint_scores") for instance in instances):
            yield file, file.name, instances
        else:
            stray.append(file.name)


def _frames_of_files(path: Path, frames: Iterable[tuple[Path, str, object]]) -> DetectedPeople:
    """The people of frames that have a file or an entry each: OpenPose's content, or a list of MMPose's instances.

    Raises:
        FileFormatError: if there is no frame, or two have the same number.
    """
    people, name_of = DetectedPeople(path), dict[int, str]()
    for file, name, content in frames:
        number = frame_number(name, str(file))
        if number in name_of:
            raise FileFormatError(
                f"{path}: {name_of[number]} and {name} are both frame {number}: expected the frames of one video; give "
                "each camera a folder of its own"
            )
        name_of[number] = name
        if isinstance(content, list):
            persons = [instance.flat(str(file)) for instance in convert(file, "", content, list[_Instance])]
        else:
            frame = convert(file, "", content, _OpenPoseFile)
            everybody = (*frame.people, *frame.bodies)
            persons = [person.pose_keypoints_2d or person.pose_keypoints or person.joints for person in everybody]
        for index, keypoints in enumerate(persons):
            if keypoints:  # empty where only a face or a hand was detected, and where tools that sort leave a place
                people.add(number, keypoints, f"{file}, person {index}")
    if not name_of:
        raise FileFormatError(f"{path}: expected a folder with the JSON files of OpenPose or MMPose, one a frame")
    people.listed = set(name_of)
    people.first_number = int(min(people.listed) == 1)
    return people


def _results(path: Path, results: Sequence[_Result]) -> DetectedPeople:
    people = DetectedPeople(path)
    categories = sorted({result.category_id for result in results})
    person = categories[0] if len(categories) == 1 else PERSON  # a detector of people alone may count from 0
    if person not in categories:
        raise FileFormatError(f"{path}: categories are {', '.join(map(str, categories))}: expected {PERSON}, persons")
    for index, result in enumerate(results):
        where = f"{path}, entry {index}"
        if result.category_id == person:
            people.add(frame_number(result.image_id, where), result.keypoints, where)
    people.listed = set(people.numbers)
    return people


def _mmpose(path: Path, content: _MmposeFile) -> DetectedPeople:
    names = content.meta_info.keypoint_id2name
    if isinstance(names, dict):
        numbered = {int(key): name for key, name in names.items() if key.isdecimal()}
        names = [name for _, name in sorted(numbered.items())]
    people = DetectedPeople(path, names=tuple(names))
    for index, frame in enumerate(content.instance_info):
        number = frame_number(frame.frame_id, f"{path}, frame entry {index}")
        people.listed.add(number)
        if frame.time_s is not None:
            people.time[number] = frame.time_s
        for place, person in enumerate(frame.instances):
            where = f"{path}, frame entry {index}, instance {place}"
            people.add(number, person.flat(where), where)
    people.first_number = int(0 not in people.listed)
    return people


def frame_number(name: float | str, where: str) -> int:
    """The last digits of an image's name, or the number itself: ``cam1_000012_keypoints`` → 12.

    Raises:
        FileFormatError: if there are none.
    """
    if not isinstance(name, str) and name >= 0 and name == int(name):
        return int(name)
    digits = re.findall(r"[0-9]+", IMAGE_SUFFIX.sub("", name)) if isinstance(name, str) else []
    if not digits or len(digits[-1].lstrip("0")) > MOST_DIGITS:
        raise FileFormatError(
            f"{where}: no frame number in {str(name)[:60]!r}: expected one such as 12 or 'walk_000012.jpg'"
        )
    return int(digits[-1])
