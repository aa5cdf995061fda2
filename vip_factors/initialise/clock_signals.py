"""Motion of limbs in the image and by their sensors, on a common grid of time.

The image of a limb's direction in a static camera is a linear map of that direction (parallel projection, with the
person's size in the image divided out): six coefficients for any heading and camera pose. For a moving camera with an
IMU, the direction is transformed to the camera's frame first, and only a heading is unknown. Both signals pass through
the same derivative of a Gaussian, which removes constant errors (perspective, mountings) without a delay.

Bodies are tracked in the image by proximity alone (:func:`simple_tracks`).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from vip_factors.body.skeleton import joint_index
from vip_factors.errors import RecordingError
from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream, with_orientation
from vip_factors.sensors.recording import Recording

GRID_HZ = 60.0  # of all signals: twice a usual video's rate
SHORTEST_TRACK_S = 2.0


@dataclass(frozen=True)
class ImageTrack:
    """One body in consecutive video frames."""

    time: Array  # (n,) seconds on the video's clock, increasing; frames without the body are absent
    pixels: Array  # (n, K, 2), NaN if a keypoint is not detected
    size: Array  # (n,) pixels, smoothed spread of the keypoints


def simple_tracks(detections: Detections) -> list[ImageTrack]:
    """Track bodies in a video; the longest tracks come first."""
    least_confidence = 0.2  # of keypoints that are used
    max_tracks = 40  # bystanders may have thousands
    pixels = np.where((detections.confidence >= least_confidence)[..., None], detections.pixels, np.nan)
    tracks = []
    for rows in _linked(detections, pixels):
        time = detections.time[detections.frame[rows]]
        if time[-1] - time[0] >= SHORTEST_TRACK_S:
            tracks.append(ImageTrack(time, pixels[rows], _smooth_size(time, _spread(pixels[rows]))))
    tracks.sort(key=lambda track: len(track.time), reverse=True)
    return tracks[:max_tracks]


def _linked(detections: Detections, pixels: Array) -> list[list[int]]:
    """Link detections to tracks; returns the detections' indices of each track."""
    reach = 0.35  # largest shift of the keypoints between frames over their spread; a runner's is 0.1
    doubt = 1.5  # ratio of two candidates' shifts below which a track ends: ambiguous
    longest_gap_s = 0.25  # without a detection
    done: list[list[int]] = []
    alive: list[list[int]] = []
    for frame in np.unique(detections.frame):
        indices = np.arange(*detections.of_frame(int(frame)).indices(len(detections)))
        time = detections.time[frame]
        fresh = [time - detections.time[detections.frame[rows[-1]]] <= longest_gap_s for rows in alive]
        done += [rows for rows, young in zip(alive, fresh, strict=True) if not young]
        alive = [rows for rows, young in zip(alive, fresh, strict=True) if young]
        matched: set[int] = set()
        if alive:
            shift = _shifts(pixels[[rows[-1] for rows in alive]], pixels[indices])
            ended = []
            for row, column in zip(*scipy.optimize.linear_sum_assignment(np.minimum(shift, 1e3)), strict=True):
                if shift[row, column] > reach:
                    continue
                rivals = [*np.delete(shift[row], column), *np.delete(shift[:, column], row)]
                if min(rivals, default=np.inf) < doubt * shift[row, column]:
                    ended.append(row)
                    continue
                alive[row].append(int(indices[column]))
                matched.add(int(column))
            done += [alive[row] for row in ended]
            alive = [rows for row, rows in enumerate(alive) if row not in ended]
        alive += [[int(index)] for column, index in enumerate(indices) if column not in matched]
    return done + alive


def _shifts(pixels: Array, next_pixels: Array) -> Array:
    """Median distance ``(A, B)`` of common keypoints over their spread; infinite for less than four."""
    distance = np.linalg.norm(pixels[:, None] - next_pixels[None], axis=-1)
    common = np.isfinite(distance)
    filled = np.sort(np.where(common, distance, np.inf), axis=-1)
    count = common.sum(axis=-1)
    middle = np.take_along_axis(filled, np.maximum(count // 2, 0)[..., None].clip(max=filled.shape[-1] - 1), axis=-1)
    size = np.fmax(_spread(pixels), 1.0)
    return np.where(count >= 4, middle[..., 0] / size[:, None], np.inf)


def _spread(pixels: Array) -> Array:
    """Diagonal ``(n,)`` of the keypoints' bounding box; 0 with fewer than two keypoints."""
    is_finite = np.isfinite(pixels)
    low = np.where(is_finite, pixels, np.inf).min(axis=1)
    high = np.where(is_finite, pixels, -np.inf).max(axis=1)
    return np.linalg.norm(np.where(np.isfinite(low), high - low, 0.0), axis=-1)


def _smooth_size(time: Array, size: Array) -> Array:
    """Large quantile over a window, so that raised arms do not change the size."""
    window = 2.0  # s
    knots = np.arange(time[0], time[-1] + window / 2, window / 2)
    starts, ends = np.searchsorted(time, knots - window / 2), np.searchsorted(time, knots + window / 2, side="right")
    values = [np.quantile(size[a:b], 0.8) if b > a else np.nan for a, b in zip(starts, ends, strict=True)]
    good = np.isfinite(values)
    return np.maximum(np.interp(time, knots[good], np.array(values)[good]), 1.0)


_SIDED = {
    "shoulder": ("shoulder", "elbow"),
    "elbow": ("elbow", "wrist"),
    "hip": ("hip", "knee"),
    "knee": ("knee", "ankle"),
    "ankle": ("ankle", "big_toe"),
}
# The two keypoints that define the direction of each bone.
LIMBS: dict[str, tuple[str, str]] = {
    **{
        f"{side}_{bone}": (f"{side}_{near}", f"{side}_{far}")
        for bone, (near, far) in _SIDED.items()
        for side in ("left", "right")
    },
    "pelvis": ("right_hip", "left_hip"),
    "spine3": ("right_shoulder", "left_shoulder"),
    "spine2": ("right_shoulder", "left_shoulder"),
    "head": ("right_ear", "left_ear"),
}
LEFT, FORWARD = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])


@dataclass(frozen=True)
class Signal:
    """Values ``(T, D)`` on the grid and their validity ``(T,)``; invalid values are zero."""

    values: Array
    valid: np.ndarray


def limb_in_image(track: ImageTrack, limb: tuple[int, int], grid: Array, width: float) -> Signal:
    """Rate ``(T, 2)`` in 1/s of the difference of two keypoints over the person's size; the grid is on video time.

    ``width`` is that of the smoothing Gaussian, seconds.
    """
    near, far = limb
    values = (track.pixels[:, far] - track.pixels[:, near]) / track.size[:, None]
    jump = np.flatnonzero(np.abs(np.diff(values, axis=0)).max(axis=1) > 0.25)  # of a limb: swapped sides
    values[jump] = values[jump + 1] = np.nan
    return image_rate(track.time, values, grid, width)


def limb_directions(recording: Recording, grid: Array) -> dict[str, Signal]:
    """Directions ``(T, 3)`` of limbs with keypoints in the sensors' inertial frames, by sensor, not differentiated.

    Sensors whose orientation is missing and cannot be computed are left out.
    """
    skeleton = recording.subject.body()
    directions = {}
    for sensor in recording.placed:
        site = recording.placement.site(sensor)
        if site.bone not in LIMBS:
            continue
        axis = _axis(site.bone, skeleton.p_parent_joint)
        turned = rotations_on(recording.imus[sensor], grid)
        if turned is not None:
            R, valid = turned
            directions[sensor] = Signal(R @ (site.R_bone_sensor.T @ axis), valid)
    return directions


def rotations_on(stream: ImuStream, grid: Array) -> tuple[Array, np.ndarray] | None:
    """Rotations ``R_inertial_sensor`` ``(T, 3, 3)`` on the grid (IMU time) and their validity; None if unavailable."""
    try:
        R = with_orientation(stream).R_inertial_sensor
    except RecordingError:
        return None
    assert R is not None
    return interpolate_rotations(stream.time, R, grid), _near_samples(stream.time, grid)


def rate_of(values: Array, valid: np.ndarray, width: float) -> Signal:
    """Smoothed derivative of values on the grid; not valid near missing values."""
    sigma = width * GRID_HZ
    rate = scipy.ndimage.gaussian_filter1d(values, sigma, axis=0, order=1, mode="nearest") * GRID_HZ
    # values beyond one and a half widths have little weight
    missing = scipy.ndimage.maximum_filter1d((~valid).astype(np.uint8), 2 * round(1.5 * sigma) + 1, mode="constant")
    is_complete = missing == 0
    return Signal(np.where(is_complete[:, None], rate, 0.0), is_complete)


def smoothed(values: Array, valid: np.ndarray, width: float) -> Signal:
    """Smooth as :func:`rate_of`, without derivative, for signals that are rates."""
    values = scipy.ndimage.gaussian_filter1d(values, width * GRID_HZ, axis=0, mode="nearest")
    return Signal(np.where(valid[:, None], values, 0.0), valid)


def image_rate(time: Array, values: Array, grid: Array, width: float) -> Signal:
    """Smoothed derivative on the grid of values ``(n, 2)`` at frames; frames with NaN are left out."""
    good = np.all(np.isfinite(values), axis=1)
    if good.sum() < 2:
        return Signal(np.zeros((len(grid), values.shape[1])), np.zeros(len(grid), bool))
    time, values = time[good], values[good]
    even = interpolate_points(time, values, grid)
    return rate_of(even, _near_samples(time, grid), width)


def _near_samples(time: Array, grid: Array) -> np.ndarray:
    """Test at which grid times the samples on both sides are near enough to interpolate."""
    longest_gap_s = 0.12
    right = np.searchsorted(time, grid)
    inside = (grid >= time[0]) & (grid <= time[-1])
    right = np.clip(right, 1, len(time) - 1) if len(time) > 1 else np.zeros_like(right)
    return inside & (time[right] - time[right - 1] <= longest_gap_s)


def _axis(bone: str, p_parent_joint: Array) -> Array:
    """Unit vector along the limb in the bone's frame, from its keypoints at rest."""
    far = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}
    side, _, joint = bone.partition("_")
    if joint in far:
        p = p_parent_joint[joint_index(f"{side}_{far[joint]}")]
        return p / np.linalg.norm(p)
    return FORWARD if joint == "ankle" else LEFT
