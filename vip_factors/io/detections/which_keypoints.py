"""Which keypoint set a file has: by the number of keypoints, by names where it tells them, and by looking at people."""

import warnings
from pathlib import Path

import numpy as np

from vip_factors.body.keypoints import KEYPOINT_SETS, KeypointSet, keypoint_set
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array

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


def which_keypoints(path: Path, count: int, names: tuple[str, ...], rows: Array, given: str | None) -> KeypointSet:
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
    return _looked_at(path, chosen, OF_COUNT.get(count, []), rows, given)


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


def _looked_at(path: Path, chosen: KeypointSet, candidates: list[str], rows: Array, given: str | None) -> KeypointSet:
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
