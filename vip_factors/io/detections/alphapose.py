"""AlphaPose: one list of ``{"image_id": "12.jpg", "keypoints": [x, y, c, …], "score": …}``, frames counted from 0.

Confidences are heights of a heat map and may exceed one.
"""

from pathlib import Path

from vip_factors.io.detections.coco_results import read_list
from vip_factors.io.detections.found_people import FoundPeople, load_json

FORMAT = "alphapose"


def matches(path: Path) -> bool:
    """Whether a file is such a list, told from COCO's by images that are named, not numbered."""
    if not path.is_file() or path.suffix.lower() != ".json":
        return False
    content = load_json(path)
    first = content[0] if isinstance(content, list) and content else None
    return isinstance(first, dict) and "keypoints" in first and isinstance(first.get("image_id"), str)


def read(path: Path) -> FoundPeople:
    """Everybody in all frames that have people.

    Raises:
        FileFormatError: for an entry that is not of this form.
    """
    return read_list(path, FORMAT)
