"""2D poses of any known format as :class:`~vip_factors.sensors.detections.Detections`."""

import warnings
from os import PathLike
from pathlib import Path

import numpy as np

from vip_factors.body.keypoints import KEYPOINT_SETS, KeypointSet, keypoint_set
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.detections.formats import DetectedPeople, read_people
from vip_factors.sensors.detections import Detections

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
    people = read_people(path)
    first = people.first_number if first_frame is None else first_frame
    count = _frame_count(people, first, frames)
    rows = _rows(people)
    chosen = _which_keypoints(path, rows.shape[1], people.names, rows, keypoints) if len(rows) else None
    if chosen is None:
        chosen = keypoint_set(keypoints or "coco17")
        rows = np.zeros((0, len(chosen), 3))
    rows = rows[:, : len(chosen)]
    frame = np.array(people.numbers, dtype=int) - first
    order = np.argsort(frame, kind="stable")
    pixels, confidence = _cleaned(rows[order])
    someone = np.any(confidence > 0, axis=1)
    _check_pixels(path, pixels[someone])
    time = np.arange(count) / rate if rate is not None else _times(people, first, count)
    return Detections(chosen, time, frame[order][someone], pixels[someone], confidence[someone])


def _times(people: DetectedPeople, first: int, count: int) -> Array:
    """``(count,)`` seconds of the frames, as the file tells them."""
    missing = [number for number in range(first, first + count) if number not in people.time]
    if missing or not count:
        raise InputError(
            f"{people.path}: 2D poses come without times: give the video's rate in Hz, or the video itself"
        )
    time = np.array([people.time[number] for number in range(first, first + count)])
    if np.any(np.diff(time) <= 0):
        raise FileFormatError(f"{people.path}: times of the frames do not increase: give the video's rate in Hz")
    return time


def _check_pixels(path: Path, pixels: Array) -> None:
    if len(pixels) and np.nanmax(np.abs(pixels)) <= FRACTION:
        raise FileFormatError(
            f"{path}: coordinates lie between {np.nanmin(pixels):.2f} and {np.nanmax(pixels):.2f}: expected pixels, "
            "not fractions of the image; have the detector write pixels (OpenPose: --keypoint_scale 0)"
        )


def _frame_count(people: DetectedPeople, first: int, frames: int | None) -> int:
    if not people.listed:
        return frames or 0
    low, high = people.listed[0] - first, people.listed[-1] - first
    if low < 0:
        raise InputError(f"{people.path}: frame {people.listed[0]} lies before the first frame, {first} (first_frame)")
    if high >= MOST_FRAMES:
        raise FileFormatError(
            f"{people.path}: frame number {people.listed[-1]}: expected the numbers of a video's frames, not other "
            "names of images"
        )
    if frames is not None and high >= frames:
        raise InputError(
            f"{people.path}: there are people in frame {people.listed[-1]}, but the video has {frames} frames: "
            "it is shorter than its detections; give the video that they were made from"
        )
    return high + 1 if frames is None else frames


def _rows(people: DetectedPeople) -> Array:
    """``(N, J, 3)``, all people with as many keypoints."""
    if not people.rows:
        return np.zeros((0, 0, 3))
    sizes = np.array([len(row) for row in people.rows])
    if np.any(sizes != sizes[0]):
        odd = int(np.flatnonzero(sizes != sizes[0])[0])
        raise FileFormatError(
            f"{people.where[odd]}: {sizes[odd] // 3} keypoints: expected {sizes[0] // 3}, as {people.where[0]} has"
        )
    if sizes[0] == 0:
        raise FileFormatError(f"{people.where[0]}: no keypoints: expected x, y, confidence of every keypoint")
    return np.array(people.rows).reshape(len(sizes), -1, 3)


def _cleaned(rows: Array) -> tuple[Array, Array]:
    """Pixels and confidences, NaN and 0 where a keypoint was not found."""
    pixels, confidence = rows[..., :2].copy(), rows[..., 2].copy()
    with np.errstate(invalid="ignore"):
        lost = ~np.all(np.isfinite(rows), axis=-1) | (confidence <= 0) | np.all(pixels == 0, axis=-1)
    pixels[lost], confidence[lost] = np.nan, 0.0
    highest = float(np.quantile(confidence[~lost], SPREAD)) if not np.all(lost) else 0.0
    return pixels, np.minimum(confidence / max(1.0, highest), 1.0)


# Number of keypoints → sets that have as many, the usual one first.
OF_COUNT = {
    count: [name for name, one in KEYPOINT_SETS.items() if len(one) == count]
    for count in sorted({len(one) for one in KEYPOINT_SETS.values()})
}
# Whole-body orders begin with one of ours: COCO-WholeBody, Halpe.
WHOLE_BODY = {133: "coco17", 136: "halpe26"}
# Points that lie close together on everybody, in whatever pose: what tells one order from another.
CLOSE = (
    ("nose", "left_eye"), ("nose", "right_eye"), ("left_eye", "left_ear"), ("right_eye", "right_ear"),
    ("left_ankle", "left_heel"), ("right_ankle", "right_heel"), ("left_heel", "left_big_toe"),
    ("right_heel", "right_big_toe"),
)  # fmt: skip
PLAUSIBLE_CLOSE = (
    0.15  # of a person's extent in the image; measured 0.03 in the right order, 0.43 and more in the other
)


class DetectionsWarning(UserWarning):
    """Something in a file of 2D poses was guessed or changed, and what it was."""


def _which_keypoints(path: Path, count: int, names: tuple[str, ...], rows: Array, given: str | None) -> KeypointSet:
    """The keypoint set of people with ``count`` keypoints.

    Args:
        path: of the file, for complaints.
        count: keypoints per person in the file.
        names: the keypoints' names as the file tells them, or none.
        rows: ``(N, count, 3)`` x, y, confidence.
        given: name of the set, if the user said it.

    Raises:
        InputError: for an unknown name.
        FileFormatError: if no set fits.
    """
    known = ", ".join(f"{name} ({len(one)})" for name, one in KEYPOINT_SETS.items())
    if given is not None:
        chosen = keypoint_set(given)
        if len(chosen) != count and WHOLE_BODY.get(count) != given:
            raise FileFormatError(
                f"{path}: people have {count} keypoints, but {given} has {len(chosen)}: known {known}"
            )
    elif count in WHOLE_BODY:
        chosen = keypoint_set(WHOLE_BODY[count])
        _warn(path, f"of {count} whole-body keypoints, the first {len(chosen)} are read, as {chosen.name}")
    elif count in OF_COUNT:
        chosen = keypoint_set(OF_COUNT[count][0])
    else:
        raise FileFormatError(f"{path}: people have {count} keypoints: no known set has as many; known are {known}")
    _check_names(path, chosen, names)
    return _most_plausible(path, chosen, OF_COUNT.get(count, []), rows, given)


def _check_names(path: Path, chosen: KeypointSet, names: tuple[str, ...]) -> None:
    told = names[: len(chosen)]
    for index, (name, ours) in enumerate(zip(told, chosen.keypoints, strict=False)):
        if name in chosen.keypoints and name != ours:
            raise FileFormatError(
                f"{path}: keypoint {index} is '{name}', but '{ours}' in {chosen.name}: another order of keypoints; "
                f"known are {', '.join(KEYPOINT_SETS)}"
            )
    if told and 2 * len(set(told) & set(chosen.keypoints)) < len(told):
        raise FileFormatError(
            f"{path}: keypoints {', '.join(told[:6])} … are not those of {chosen.name}, which has as many: "
            f"known orders are {', '.join(KEYPOINT_SETS)}"
        )


def _most_plausible(
    path: Path, chosen: KeypointSet, candidates: list[str], rows: Array, given: str | None
) -> KeypointSet:
    """Of sets with as many keypoints, the one in which eyes are at noses and heels at ankles."""
    if len(candidates) < 2:
        return chosen
    apart = {name: _apart(keypoint_set(name), rows) for name in candidates}
    best = min(apart, key=lambda name: apart[name])
    count = rows.shape[1]
    if best == chosen.name or not (apart[best] < PLAUSIBLE_CLOSE < apart[chosen.name]):
        if given is None and not apart[chosen.name] < PLAUSIBLE_CLOSE:
            others = ", ".join(name for name in candidates if name != chosen.name)
            _warn(path, f"{count} keypoints are taken as {chosen.name}; if they are {others}, say so (keypoints)")
        return chosen
    if given is not None:
        _warn(path, f"read as {given}, as asked, but people look like {best}: eyes and heels are in the wrong places")
        return chosen
    _warn(path, f"{count} keypoints are taken as {best}, not {chosen.name}: so eyes are at noses and heels at ankles")
    return keypoint_set(best)


def _apart(keypoints: KeypointSet, rows: Array) -> float:
    """Median distance of points that should lie close together, in extents of their person; infinite if unseen."""
    seen = np.all(np.isfinite(rows), axis=-1) & (rows[..., 2] > 0)
    points = np.where(seen[..., None], rows[..., :2], np.nan)
    enough = seen.sum(axis=1) > rows.shape[1] // 2
    points = points[enough]
    if not len(points):
        return np.inf
    extent = np.linalg.norm(np.nanmax(points, axis=1) - np.nanmin(points, axis=1), axis=-1)
    index = {name: at for at, name in enumerate(keypoints.keypoints)}
    pairs = [(index[a], index[b]) for a, b in CLOSE if a in index and b in index]
    distance = np.array([np.linalg.norm(points[:, a] - points[:, b], axis=-1) / extent for a, b in pairs])
    return float(np.nanmedian(distance)) if np.any(np.isfinite(distance)) else np.inf


def _warn(path: Path, sentence: str) -> None:
    warnings.warn(DetectionsWarning(f"{path}: {sentence}"), stacklevel=4)
