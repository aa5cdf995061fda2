"""COCO's results: a list of ``{"image_id": 12, "category_id": 1, "keypoints": [x, y, score, …], "score": …}``.

``image_id`` is taken as the number of the video frame, counted from 0.
"""

from pathlib import Path

from vip_factors.errors import FileFormatError
from vip_factors.io.detections.found_people import FoundPeople, entry_of, frame_number, keypoint_row, load_json

FORMAT = "coco"
PERSON = 1  # COCO's category


def matches(path: Path) -> bool:
    """Whether a file is such a list."""
    if not path.is_file() or path.suffix.lower() != ".json":
        return False
    content = load_json(path)
    first = content[0] if isinstance(content, list) and content else None
    return isinstance(first, dict) and "keypoints" in first and isinstance(first.get("image_id"), int)


def read(path: Path) -> FoundPeople:
    """Everybody in all frames that have people.

    Raises:
        FileFormatError: for an entry that is not of this form.
    """
    return read_list(path, FORMAT)


def read_list(path: Path, format_name: str) -> FoundPeople:
    """A list with an entry for every person; the order of the frames does not matter.

    Raises:
        FileFormatError: for an entry that is not of this form.
    """
    content = load_json(path)
    if not isinstance(content, list):
        raise FileFormatError(f"{path}: the content is {type(content).__name__}: expected a list of people")
    found = FoundPeople(format_name, path)
    for index, entry in enumerate(content):
        where = f"{path}, entry {index}"
        person = entry_of(entry, where, ["image_id", "keypoints"])
        if person.get("category_id", PERSON) != PERSON:
            continue
        found.add(frame_number(person["image_id"], where), keypoint_row(person["keypoints"], where), where)
    found.listed = sorted(set(found.numbers))
    return found
