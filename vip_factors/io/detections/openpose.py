"""OpenPose: a folder with one JSON file a frame, ``{"people": [{"pose_keypoints_2d": [x, y, c, …]}]}``.

Frames without people have files too, so the lowest number is the video's first frame: 0 as OpenPose counts, 1 where
the frames were numbered by another tool. Any order of keypoints; OpenPose's own default is BODY_25.
"""

from pathlib import Path

from vip_factors.errors import FileFormatError
from vip_factors.io.detections.found_people import FoundPeople, entry_of, frame_number, keypoint_row, list_of, load_json

FORMAT = "openpose"
KEYS = ("pose_keypoints_2d", "pose_keypoints")  # the second up to OpenPose 1.2


def matches(path: Path) -> bool:
    """Whether a path is a folder of such files, or one of them."""
    if path.is_dir():
        files = sorted(path.glob("*.json"))
        return bool(files) and _is_frame(load_json(files[0]))
    return path.is_file() and path.suffix.lower() == ".json" and _is_frame(load_json(path))


def _is_frame(content: object) -> bool:
    return isinstance(content, dict) and "people" in content


def read(path: Path) -> FoundPeople:
    """Everybody in all frames.

    Raises:
        FileFormatError: for a file that is not of this form, or two of the same frame.
    """
    files = sorted(path.glob("*.json")) if path.is_dir() else [path]
    found = FoundPeople(FORMAT, path)
    of_number: dict[int, Path] = {}
    for file in files:
        number = frame_number(file.stem.removesuffix("_keypoints"), str(file))
        if number in of_number:
            raise FileFormatError(
                f"{path}: {of_number[number].name} and {file.name} are both frame {number}: expected the frames of one "
                "video; give each camera a folder of its own"
            )
        of_number[number] = file
        people = list_of(entry_of(load_json(file), str(file), ["people"])["people"], str(file), "people")
        for index, person in enumerate(people):
            if person == {}:
                continue  # as tools that sort people leave a place empty
            where = f"{file}, person {index}"
            key = next((one for one in KEYS if isinstance(person, dict) and one in person), KEYS[0])
            row = keypoint_row(entry_of(person, where, [key])[key], where)
            if len(row):  # empty: only a face or a hand was found
                found.add(number, row, where)
    found.listed = sorted(of_number)
    found.first_number = 1 if found.listed and found.listed[0] == 1 else 0
    return found
