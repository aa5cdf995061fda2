"""2D poses of any known format as :class:`~vip_factors.sensors.detections.Detections`."""

from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.detections.found_people import FoundPeople, load_json
from vip_factors.io.detections.which_keypoints import which_keypoints
from vip_factors.sensors.detections import Detections

FORMATS = ("openpose", "mmpose", "alphapose", "coco")
_MODULES = {name: f"vip_factors.io.detections.{name}" for name in FORMATS} | {
    "coco": "vip_factors.io.detections.coco_results"
}
MOST_FRAMES = 2_000_000  # nine hours at 60 Hz: beyond it the numbers are no frame numbers
FRACTION = 1.5  # no image is so small: coordinates up to here are fractions of it, or slightly outside
SPREAD = 0.99  # share of confidences that shall not exceed one


def read_detections(
    path: str | PathLike[str],
    rate: float | None,
    keypoints: str | None = None,
    frames: int | None = None,
    first_frame: int | None = None,
) -> Detections:
    """Everybody that a 2D pose detector found in a video, times on the video's own clock (its first frame at 0 s).

    The format is told by content. A point with confidence 0, at (0, 0) or not finite was not found; people without
    any point are left out. Confidences that exceed one (heat maps) are scaled so that 99 % of them do not, and the
    rest are cut off there. A guess is told as a :class:`DetectionsWarning`.

    Args:
        path: of OpenPose's folder, or AlphaPose's, MMPose's or COCO's file.
        rate: video frames per second; None for the times that the file itself tells, as ours do.
        keypoints: name of the keypoint set; by the number of keypoints if None.
        frames: number of frames of the video; up to the last one with people (or listed) if None.
        first_frame: number that the video's first frame has in the file; the format's usual one if None.

    Raises:
        InputError: for a missing file, an unknown keypoint set, a frame before the first, or no rate where the file
            tells no times.
        FileFormatError: for content that is not as expected: file, entry and what was expected are named.
    """
    path = Path(path)
    if rate is not None and (not rate > 0 or not np.isfinite(rate)):
        raise InputError(f"video rate {rate} Hz: expected a positive number of frames per second")
    found: FoundPeople = _reader(path).read(path)
    first = found.first_number if first_frame is None else first_frame
    count = _frame_count(found, first, frames)
    rows = _rows(found)
    chosen = which_keypoints(path, rows.shape[1], found.names, rows, keypoints) if len(rows) else None
    if chosen is None:
        from vip_factors.body.keypoints import keypoint_set

        chosen = keypoint_set(keypoints or "coco17")
        rows = np.zeros((0, len(chosen), 3))
    rows = rows[:, : len(chosen)]
    frame = np.array(found.numbers, dtype=int) - first
    order = np.argsort(frame, kind="stable")
    pixels, confidence = _cleaned(rows[order])
    someone = np.any(confidence > 0, axis=1)
    _check_pixels(path, pixels[someone])
    time = np.arange(count) / rate if rate is not None else _told_times(found, first, count)
    return Detections(chosen, time, frame[order][someone], pixels[someone], confidence[someone])


def _told_times(found: FoundPeople, first: int, count: int) -> Array:
    """``(count,)`` seconds of the frames, as the file tells them."""
    missing = [number for number in range(first, first + count) if number not in found.time]
    if missing or not count:
        raise InputError(f"{found.path}: 2D poses come without times: give the video's rate in Hz, or the video itself")
    time = np.array([found.time[number] for number in range(first, first + count)])
    if np.any(np.diff(time) <= 0):
        raise FileFormatError(f"{found.path}: times of the frames do not increase: give the video's rate in Hz")
    return time


def _check_pixels(path: Path, pixels: Array) -> None:
    if len(pixels) and np.nanmax(np.abs(pixels)) <= FRACTION:
        raise FileFormatError(
            f"{path}: coordinates lie between {np.nanmin(pixels):.2f} and {np.nanmax(pixels):.2f}: expected pixels, "
            "not fractions of the image; have the detector write pixels (OpenPose: --keypoint_scale 0)"
        )


def _reader(path: Path) -> Any:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder of 2D poses")
    for name in FORMATS:
        module = import_module(_MODULES[name])
        if module.matches(path):
            return module
    if path.is_dir():
        expected = "a folder with OpenPose's JSON files, one a frame"
    elif path.suffix.lower() == ".json" and load_json(path) == []:
        expected = "people; the list is empty"
    else:
        expected = "2D poses as OpenPose (a folder), AlphaPose, MMPose or COCO's results (a .json file)"
    raise FileFormatError(f"{path}: expected {expected}")


def _frame_count(found: FoundPeople, first: int, frames: int | None) -> int:
    if not found.listed:
        return frames or 0
    low, high = found.listed[0] - first, found.listed[-1] - first
    if low < 0:
        raise InputError(f"{found.path}: frame {found.listed[0]} lies before the first frame, {first} (first_frame)")
    if high >= MOST_FRAMES:
        raise FileFormatError(
            f"{found.path}: frame number {found.listed[-1]}: expected the numbers of a video's frames, not other names "
            "of images"
        )
    if frames is not None and high >= frames:
        raise InputError(
            f"{found.path}: there are people in frame {found.listed[-1]}, but the video has {frames} frames: "
            "it is shorter than its detections; give the video that they were made from"
        )
    return high + 1 if frames is None else frames


def _rows(found: FoundPeople) -> Array:
    """``(N, J, 3)``, all people with as many keypoints."""
    if not found.rows:
        return np.zeros((0, 0, 3))
    sizes = np.array([len(row) for row in found.rows])
    if np.any(sizes != sizes[0]):
        odd = int(np.flatnonzero(sizes != sizes[0])[0])
        raise FileFormatError(
            f"{found.where[odd]}: {sizes[odd] // 3} keypoints: expected {sizes[0] // 3}, as {found.where[0]} has"
        )
    if sizes[0] == 0:
        raise FileFormatError(f"{found.where[0]}: no keypoints: expected x, y, confidence of every keypoint")
    return np.array(found.rows).reshape(len(sizes), -1, 3)


def _cleaned(rows: Array) -> tuple[Array, Array]:
    """Pixels and confidences, NaN and 0 where a keypoint was not found."""
    pixels, confidence = rows[..., :2].copy(), rows[..., 2].copy()
    with np.errstate(invalid="ignore"):
        lost = ~np.all(np.isfinite(rows), axis=-1) | (confidence <= 0) | np.all(pixels == 0, axis=-1)
    pixels[lost], confidence[lost] = np.nan, 0.0
    highest = float(np.quantile(confidence[~lost], SPREAD)) if not np.all(lost) else 0.0
    return pixels, np.minimum(confidence / max(1.0, highest), 1.0)
