"""MMPose: ``{"meta_info": …, "instance_info": [{"frame_id": 1, "instances": […]}]}``, or that list alone.

An instance has ``keypoints`` [[x, y], …] and ``keypoint_scores`` [c, …]. Frames are counted from 1, and all are listed.
"""

from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.io.detections.found_people import FoundPeople, entry_of, frame_number, list_of, load_json, number_row

FORMAT = "mmpose"
TIME = "time_s"  # of a frame; our own detector writes it


def matches(path: Path) -> bool:
    """Whether a file is of this form."""
    if not path.is_file() or path.suffix.lower() != ".json":
        return False
    content = load_json(path)
    if isinstance(content, dict):
        return "instance_info" in content
    return isinstance(content, list) and bool(content) and isinstance(content[0], dict) and "instances" in content[0]


def read(path: Path) -> FoundPeople:
    """Everybody in all frames.

    Raises:
        FileFormatError: for a frame or an instance that is not of this form.
    """
    content = load_json(path)
    frames = content["instance_info"] if isinstance(content, dict) else content
    frames = list_of(frames, str(path), "instance_info")
    found = FoundPeople(FORMAT, path, names=_names(content.get("meta_info") if isinstance(content, dict) else None))
    for index, frame in enumerate(frames):
        where = f"{path}, frame entry {index}"
        entry = entry_of(frame, where, ["frame_id", "instances"])
        number = frame_number(entry["frame_id"], where)
        found.listed.append(number)
        if TIME in entry:
            found.time[number] = _seconds(entry[TIME], where)
        for one, instance in enumerate(list_of(entry["instances"], where, "instances")):
            _add(found, number, instance, f"{where}, instance {one}")
    found.listed = sorted(set(found.listed))
    found.first_number = 0 if found.listed and found.listed[0] == 0 else 1
    return found


def _add(found: FoundPeople, number: int, instance: Any, where: str) -> None:
    given = entry_of(instance, where, ["keypoints", "keypoint_scores"])
    points, scores = number_row(given["keypoints"], where), number_row(given["keypoint_scores"], where)
    if points.ndim != 2 or points.shape[1] != 2 or scores.shape != points.shape[:1]:
        raise FileFormatError(
            f"{where}: keypoints {points.shape} and scores {scores.shape}: expected (J, 2) and (J,), in pixels"
        )
    found.add(number, np.column_stack([points, scores]).ravel(), where)


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
