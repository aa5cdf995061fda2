"""What every reader of 2D poses hands back, and how it reads JSON: the same complaints for all formats."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

DIGITS = re.compile(r"\d+")


@dataclass
class FoundPeople:
    """People as a file lists them.

    Attributes:
        format: name of the format.
        path: of the file or folder.
        first_number: what the format calls the first frame of a video.
        listed: numbers of all frames that the file speaks of, those without people included.
        numbers: the frame's number of each person.
        rows: each person's keypoints, flat ``(3 J,)``: x, y, confidence.
        where: of each person, as a complaint names it.
        names: the keypoints' names in order, if the file tells them.
        time: seconds of each listed frame by its number, if the file tells them.
    """

    format: str
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


def keypoint_row(values: Any, where: str) -> Array:
    """One person's flat list x, y, confidence … as an array.

    Raises:
        FileFormatError: if it is no list of numbers, three per keypoint.
    """
    if not isinstance(values, list) or len(values) % 3:
        found = f"{len(values)} numbers" if isinstance(values, list) else type(values).__name__
        raise FileFormatError(f"{where}: keypoints are {found}: expected x, y, confidence of every keypoint")
    row = number_row(values, where)
    if row.ndim != 1:
        raise FileFormatError(f"{where}: keypoints are lists in a list: expected one flat list x, y, confidence, …")
    return row


def number_row(values: Any, where: str) -> Array:
    """A (nested) list of numbers as an array; null and NaN become NaN.

    Raises:
        FileFormatError: if it is none.
    """
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise FileFormatError(f"{where}: keypoints are not all numbers ({error})") from error


def entry_of(entry: Any, where: str, needed: Sequence[str]) -> Mapping[str, Any]:
    """An entry that has all of the fields.

    Raises:
        FileFormatError: if it does not.
    """
    missing = [name for name in needed if name not in entry] if isinstance(entry, dict) else list(needed)
    if missing:
        raise FileFormatError(f"{where}: {', '.join(missing)} missing: expected fields {', '.join(needed)}")
    kept: Mapping[str, Any] = entry
    return kept


def list_of(entries: Any, where: str, what: str) -> list[Any]:
    """Entries that are a list.

    Raises:
        FileFormatError: if they are not.
    """
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
    found = DIGITS.findall(re.sub(r"\.[A-Za-z]\w*$", "", name)) if isinstance(name, str) else []
    if not found:
        raise FileFormatError(f"{where}: no frame number in {name!r}: expected one such as 12 or 'walk_000012.jpg'")
    return int(found[-1])
