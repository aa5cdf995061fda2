"""Files of 2D poses: those of detectors' programs as detections, and our own detector's, in MMPose's format.

Beyond MMPose's fields, ``meta_info`` names the keypoint set and describes the detector, a frame has ``time_s`` and an
instance ``track_id``.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.body.keypoints import KEYPOINT_SETS, OFFSET_KEYPOINTS, KeypointSet, keypoint_set
from vip_factors.errors import FileFormatError, InputError, nearest
from vip_factors.factor_settings import LearnedOffsets
from vip_factors.geometry.rotations import Array
from vip_factors.io.detection_formats import DetectedPeople, read_people, warn
from vip_factors.io.typed_files import Vector, check_keys, convert, read_toml
from vip_factors.sensors.detections import Detections

MOST_FRAMES = 2_000_000  # nine hours at 60 Hz: beyond it the numbers are no frame numbers
FRACTION = 1.5  # no image is so small: coordinates up to here are fractions of it, or slightly outside
SPREAD = 0.99  # share of confidences that shall not exceed one
# Whole-body orders begin with one of ours: COCO-WholeBody, Halpe.
WHOLE_BODY = {133: "coco17", 136: "halpe26"}
# Points that lie close together on everybody, in any pose: they tell orders of keypoints apart.
CLOSE = tuple(
    (pair[0] if pair[0] == "nose" else f"{side}_{pair[0]}", f"{side}_{pair[1]}")
    for pair in (("nose", "eye"), ("eye", "ear"), ("ankle", "heel"), ("heel", "big_toe"))
    for side in ("left", "right")
)
PLAUSIBLE_CLOSE = 0.15  # of a person's extent in the image; 0.03 in the right order, 0.43 and more in the other


def read_detections(
    path: str | PathLike[str],
    rate: float | None,
    keypoints: str | None = None,
    first_frame: int | None = None,
) -> Detections:
    """Everybody that a 2D pose detector found in a video, times on the video's own clock (its first frame at 0 s).

    The content determines the format. A point with confidence 0, at (0, 0) or not finite is missing; people without
    any point are left out. Confidences that exceed one (heat maps) are scaled so that 99 % of them do not, and the
    rest are cut off there. A :class:`DetectionsWarning` reports a guess.

    Args:
        path: of OpenPose's folder, or AlphaPose's, MMPose's or COCO's file.
        rate: video frames per second; None for the times in the file, which ours have.
        keypoints: name of the keypoint set; by the number of keypoints if None.
        first_frame: number that the video's first frame has in the file; the format's usual one if None.

    Raises:
        InputError: for a missing file, an unknown keypoint set, a frame before the first, or no rate where the file
            has no times.
        FileFormatError: for unexpected content; the message names file, entry and the expected content.
    """
    path = Path(path)
    if rate is not None and (not rate > 0 or not np.isfinite(rate)):
        raise InputError(f"video rate {rate} Hz: expected a positive number of frames per second")
    people = read_people(path)
    first_number = people.first_number if first_frame is None else first_frame
    count = _frame_count(people, first_number)
    rows = _rows(people)
    chosen = _which_keypoints(people, rows, keypoints) if len(rows) else keypoint_set(keypoints or "coco17")
    rows = rows[:, : len(chosen)] if len(rows) else np.zeros((0, len(chosen), 3))
    frame = np.array(people.numbers, dtype=int) - first_number
    order = np.argsort(frame, kind="stable")
    pixels, confidence = rows[order, :, :2], rows[order, :, 2]
    with np.errstate(invalid="ignore"):
        lost = ~np.all(np.isfinite(rows[order]), axis=-1) | (confidence <= 0) | np.all(pixels == 0, axis=-1)
    pixels[lost], confidence[lost] = np.nan, 0.0
    highest = float(np.quantile(confidence[~lost], SPREAD)) if not np.all(lost) else 0.0
    confidence = np.minimum(confidence / max(1.0, highest), 1.0)
    someone = np.any(confidence > 0, axis=1)
    if np.any(someone) and np.nanmax(np.abs(pixels)) <= FRACTION:
        raise FileFormatError(
            f"{path}: coordinates lie between {np.nanmin(pixels):.2f} and {np.nanmax(pixels):.2f}: expected pixels, "
            "not fractions of the image; have the detector write pixels (OpenPose: --keypoint_scale 0)"
        )
    time = np.arange(count) / rate if rate is not None else _times(people, first_number, count)
    return Detections(chosen, time, frame[order][someone], pixels[someone], confidence[someone])


def _times(people: DetectedPeople, first_number: int, count: int) -> Array:
    """``(count,)`` seconds of the frames, from the file."""
    numbers = range(first_number, first_number + count)
    if not count or not all(number in people.time for number in numbers):
        raise InputError(
            f"{people.path}: 2D poses come without times: give the video's rate in Hz, or the video itself"
        )
    time = np.array([people.time[number] for number in numbers])
    if np.any(np.diff(time) <= 0):
        raise FileFormatError(f"{people.path}: times of the frames do not increase: give the video's rate in Hz")
    return time


def _frame_count(people: DetectedPeople, first_number: int) -> int:
    """Number of frames up to the last one that the file lists."""
    if not people.listed:
        return 0
    low, high = min(people.listed), max(people.listed)
    if low < first_number:
        raise InputError(f"{people.path}: frame {low} lies before the first frame, {first_number} (first_frame)")
    if high - first_number >= MOST_FRAMES:
        raise FileFormatError(f"{people.path}: frame number {high}: expected the numbers of a video's frames")
    return high - first_number + 1


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


def _which_keypoints(people: DetectedPeople, rows: Array, requested: str | None) -> KeypointSet:
    """The keypoint set of people ``(N, J, 3)``: the requested one, or by number and distances of the keypoints."""
    path, count = people.path, rows.shape[1]
    of_count = [name for name, keypoints in KEYPOINT_SETS.items() if len(keypoints) == count]
    whole_body = WHOLE_BODY.get(count)
    name = requested or whole_body or next(iter(of_count), None)
    if name is None or (len(keypoint_set(name)) != count and name != whole_body):
        sets = ", ".join(f"{name} ({len(keypoints)})" for name, keypoints in KEYPOINT_SETS.items())
        has = f", but {requested} has {len(keypoint_set(requested))}" if requested else ": no known set has as many"
        raise FileFormatError(f"{path}: people have {count} keypoints{has}: known are {sets}")
    chosen = keypoint_set(name)
    if requested is None and whole_body is not None:
        warn(path, f"of {count} whole-body keypoints, the first {len(chosen)} are read, as {name}")
    _check_names(path, chosen, people.names[: len(chosen)])
    if len(of_count) < 2:
        return chosen
    # Of sets with as many keypoints, the one in which eyes are at noses and heels at ankles.
    distances = {name: _close_distance(keypoint_set(name), rows) for name in of_count}
    nearest_name = min(distances, key=distances.__getitem__)
    is_plausible = distances[name] < PLAUSIBLE_CLOSE
    if nearest_name == name or is_plausible or distances[nearest_name] >= PLAUSIBLE_CLOSE:
        if requested is None and not is_plausible:
            alternatives = ", ".join(alternative for alternative in of_count if alternative != name)
            warn(path, f"{count} keypoints are taken as {name}; if they are {alternatives}, say so (keypoints)")
        return chosen
    if requested is not None:
        doubt = f"people look like {nearest_name}: eyes and heels are in the wrong places"
        warn(path, f"read as {name}, as asked, but {doubt}")
        return chosen
    warn(path, f"{count} keypoints are taken as {nearest_name}, not {name}: so eyes are at noses and heels at ankles")
    return keypoint_set(nearest_name)


def _check_names(path: Path, chosen: KeypointSet, names: tuple[str, ...]) -> None:
    for index, (name, expected) in enumerate(zip(names, chosen.keypoints, strict=False)):
        if name in chosen.keypoints and name != expected:
            raise FileFormatError(
                f"{path}: keypoint {index} is '{name}', but '{expected}' in {chosen.name}: another order of keypoints; "
                f"known are {', '.join(KEYPOINT_SETS)}"
            )
    if names and 2 * len(set(names) & set(chosen.keypoints)) < len(names):
        raise FileFormatError(
            f"{path}: keypoints {', '.join(names[:6])} … are not those of {chosen.name}, which has as many: "
            f"known orders are {', '.join(KEYPOINT_SETS)}"
        )


def _close_distance(keypoints: KeypointSet, rows: Array) -> float:
    """Median distance of points that should lie close together, in extents of their person; infinite without any."""
    is_detected = np.all(np.isfinite(rows), axis=-1) & (rows[..., 2] > 0)
    points = np.where(is_detected[..., None], rows[..., :2], np.nan)
    points = points[is_detected.sum(axis=1) > rows.shape[1] // 2]
    if not len(points):
        return np.inf
    extent = np.linalg.norm(np.nanmax(points, axis=1) - np.nanmin(points, axis=1), axis=-1)
    index = {name: number for number, name in enumerate(keypoints.keypoints)}
    pairs = [(index[a], index[b]) for a, b in CLOSE if a in index and b in index]
    distance = np.array([np.linalg.norm(points[:, a] - points[:, b], axis=-1) / extent for a, b in pairs])
    return float(np.nanmedian(distance)) if np.any(np.isfinite(distance)) else np.inf


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
    metadata: Mapping[str, Any],
    overwrite: bool = False,
) -> None:
    """Write the poses of all ``F`` frames of a video, frames without people included, whole or not at all.

    ``time`` is ``(F,)`` seconds of the frames after the first; ``metadata`` describes the video, the model …

    Raises:
        InputError: if the file exists, or its folder is missing or read-only.
    """
    meta = {
        "dataset_name": keypoints.name,
        "num_keypoints": len(keypoints),
        "keypoint_id2name": {str(index): name for index, name in enumerate(keypoints.keypoints)},
        **metadata,
    }
    with atomic_open(path, "w", overwrite) as file:
        file.write(f'{{"meta_info": {json.dumps(meta)},\n"instance_info": [\n')
        for index, people in enumerate(frames):
            entry = {
                "frame_id": index + 1,  # as MMPose counts
                "time_s": round(float(time[index]), 6),
                "instances": [_instance(pose) for pose in people],
            }
            file.write(json.dumps(entry) + (",\n" if index + 1 < len(frames) else "\n"))
        file.write("]}\n")


def _instance(pose: TrackedPose) -> dict[str, Any]:
    is_seen = pose.confidence > 0
    pixels = np.where(is_seen[:, None], pose.pixels, 0.0).astype(float)
    box = np.concatenate([pixels[is_seen].min(axis=0), pixels[is_seen].max(axis=0)] if np.any(is_seen) else [[0.0] * 4])
    return {
        "track_id": pose.track,
        "keypoints": pixels.round(2).tolist(),
        "keypoint_scores": pose.confidence.astype(float).round(4).tolist(),
        "bbox": [box.round(2).tolist()],
        "bbox_score": round(float(pose.score), 4),
    }


class _Offset(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    mean_m: Vector
    sigma_m: Vector


class _Set(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    offsets: dict[str, _Offset]
    people: int = 0


def read_keypoint_offsets(path: Path) -> LearnedOffsets:
    """Read a TOML file of offsets of detectors' keypoints from the joints, learnt from recordings of known motion.

    ::

        provenance = "walk.mcap run.mcap"

        [body25]                       # a keypoint set, as its detector writes it
        people = 2

        [body25.offsets]               # metres in bone axes, of the left side: x to the left, y up, z forward
        shoulder = { mean_m = [0.0, -0.012, 0.004], sigma_m = [0.008, 0.009, 0.008] }

    Raises:
        FileFormatError: if it is no TOML file.
        InputError: for an invalid value.
    """
    content = read_toml(path, dict[str, object], "a file of keypoint offsets")
    convert(path, "provenance", content.pop("provenance", ""), str)
    for name in content:
        if name not in KEYPOINT_SETS:
            raise InputError(f"{path}: unknown key '{name}'{nearest(name, KEYPOINT_SETS)}")
    farthest, widest = 0.15, 0.2  # m: beyond which it is no keypoint of that joint
    offsets = {}
    for name, table in convert(path, "", content, dict[str, _Set]).items():
        check_keys(path, f"{name}.offsets", table.offsets, OFFSET_KEYPOINTS)
        rows = [table.offsets[keypoint] for keypoint in OFFSET_KEYPOINTS]
        mean, sigma = np.array([row.mean_m for row in rows]), np.array([row.sigma_m for row in rows])
        if np.abs(mean).max() > farthest or not 0 < sigma.min() <= sigma.max() <= widest:
            raise InputError(
                f"{path}: {name}.offsets: expected means up to {farthest:g} m and sigmas above zero, up to {widest:g} m"
            )
        offsets[name] = mean.tolist(), sigma.tolist()
    return LearnedOffsets(path, offsets)
