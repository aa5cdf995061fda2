"""What limbs do, once as the image shows it and once as the sensors tell it, on one even grid of time.

A limb's direction in space, seen by a camera that stands still, is a linear map of that direction (parallel
projection; the size of the person in the image is divided out). So the difference of its two keypoints follows the
three components of the direction that its IMU measures, whatever the sensor's heading and wherever the camera stands:
six numbers that a least-squares fit finds. If the camera moves and carries an IMU, the direction is turned into the
camera's frame first, and one heading is all that is unknown. Both sides are passed through the same derivative of a
Gaussian, which removes what lasts (perspective, wrong mountings, a panning camera) and delays neither.

Bodies are followed through the image by nearness alone (:func:`simple_tracks`): good enough to see limbs move, whoever
they belong to.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import RecordingError
from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream, with_orientation
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import CameraMount

GRID_HZ = 60.0  # of all signals: twice a usual video's rate
SHORTEST_TRACK_S = 2.0


@dataclass(frozen=True)
class ImageTrack:
    """One body in consecutive video frames.

    Attributes:
        time: ``(n,)`` seconds on the video's clock, increasing; frames without it are absent.
        pixels: ``(n, K, 2)``, NaN where a keypoint is not seen.
        size: ``(n,)`` pixels, the spread of the keypoints, smoothed over a second or two.
    """

    time: Array
    pixels: Array
    size: Array


def simple_tracks(detections: Detections) -> list[ImageTrack]:
    """Bodies followed through a video, the longest tracks first."""
    least_confidence = 0.2  # what detectors say below is mostly guessed
    most = 40  # bystanders come and go in thousands
    pixels = np.where((detections.confidence >= least_confidence)[..., None], detections.pixels, np.nan)
    tracks = []
    for rows in _joined(detections, pixels):
        time = detections.time[detections.frame[rows]]
        if time[-1] - time[0] >= SHORTEST_TRACK_S:
            tracks.append(ImageTrack(time, pixels[rows], _smooth_size(time, _spread(pixels[rows]))))
    tracks.sort(key=lambda track: len(track.time), reverse=True)
    return tracks[:most]


def _joined(detections: Detections, pixels: Array) -> list[list[int]]:
    """Indices of the detections of each track."""
    reach = 0.35  # mean shift of the keypoints over their spread, from one frame to the next; a runner's is 0.1
    doubt = 1.5  # two candidates whose shifts differ by less than this factor end the track: better short than mixed
    longest_gap_s = 0.25  # that a track survives without a detection
    done: list[list[int]] = []
    alive: list[list[int]] = []
    for frame in np.unique(detections.frame):
        here = np.arange(*detections.of_frame(int(frame)).indices(len(detections)))
        now = detections.time[frame]
        fresh = [now - detections.time[detections.frame[rows[-1]]] <= longest_gap_s for rows in alive]
        done += [rows for rows, young in zip(alive, fresh, strict=True) if not young]
        alive = [rows for rows, young in zip(alive, fresh, strict=True) if young]
        taken: set[int] = set()
        if alive:
            shift = _shifts(pixels[[rows[-1] for rows in alive]], pixels[here])
            ended = []
            for row, column in zip(*scipy.optimize.linear_sum_assignment(np.minimum(shift, 1e3)), strict=True):
                if shift[row, column] > reach:
                    continue
                rivals = [*np.delete(shift[row], column), *np.delete(shift[:, column], row)]
                if min(rivals, default=np.inf) < doubt * shift[row, column]:
                    ended.append(row)
                    continue
                alive[row].append(int(here[column]))
                taken.add(int(column))
            done += [alive[row] for row in ended]
            alive = [rows for row, rows in enumerate(alive) if row not in ended]
        alive += [[int(index)] for column, index in enumerate(here) if column not in taken]
    return done + alive


def _shifts(before: Array, after: Array) -> Array:
    """Median distance of common keypoints over their spread ``(A, B)``; infinite for less than four."""
    distance = np.linalg.norm(before[:, None] - after[None], axis=-1)
    common = np.isfinite(distance)
    filled = np.sort(np.where(common, distance, np.inf), axis=-1)
    count = common.sum(axis=-1)
    middle = np.take_along_axis(filled, np.maximum(count // 2, 0)[..., None].clip(max=filled.shape[-1] - 1), axis=-1)
    size = np.fmax(_spread(before), 1.0)
    return np.where(count >= 4, middle[..., 0] / size[:, None], np.inf)


def _spread(pixels: Array) -> Array:
    """Diagonal of the keypoints' bounding box ``(n,)``; 0 where fewer than two are seen."""
    seen = np.isfinite(pixels)
    low = np.where(seen, pixels, np.inf).min(axis=1)
    high = np.where(seen, pixels, -np.inf).max(axis=1)
    return np.linalg.norm(np.where(np.isfinite(low), high - low, 0.0), axis=-1)


def _smooth_size(time: Array, size: Array) -> Array:
    """Large quantile over a window: arms that rise and fall must not look like coming nearer."""
    window = 2.0  # s
    knots = np.arange(time[0], time[-1] + window / 2, window / 2)
    first, last = np.searchsorted(time, knots - window / 2), np.searchsorted(time, knots + window / 2, side="right")
    values = [np.quantile(size[a:b], 0.8) if b > a else np.nan for a, b in zip(first, last, strict=True)]
    good = np.isfinite(values)
    return np.maximum(np.interp(time, knots[good], np.array(values)[good]), 1.0)


_SIDED = {
    "shoulder": ("shoulder", "elbow"),
    "elbow": ("elbow", "wrist"),
    "hip": ("hip", "knee"),
    "knee": ("knee", "ankle"),
    "ankle": ("ankle", "big_toe"),
}
# Bone → the two keypoints that show its direction.
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
    """Values ``(T, D)`` on the grid, and where they are valid ``(T,)``; zero elsewhere."""

    values: Array
    valid: np.ndarray


def limb_in_image(track: ImageTrack, limb: tuple[int, int], grid: Array, width: float) -> Signal:
    """Rate of the difference of two keypoints over the person's size ``(T, 2)`` in 1/s; the grid is on video time.

    ``width`` is that of the smoothing Gaussian, seconds, here and below.
    """
    near, far = limb
    values = (track.pixels[:, far] - track.pixels[:, near]) / track.size[:, None]
    return _rate(track.time, _without_jumps(values), grid, width)


def middle_in_image(track: ImageTrack, focal: tuple[float, float], grid: Array, width: float) -> Signal:
    """Rate of the middle of the trunk in the image ``(T, 2)`` in rad/s, as a turning camera moves it."""
    return _rate(track.time, np.nanmedian(track.pixels, axis=1) / np.array(focal), grid, width)


def limb_indices(keypoints: KeypointSet, bone: str) -> tuple[int, int] | None:
    """Indices of the keypoints that show a bone's direction, if the set has them."""
    names = LIMBS.get(bone, ("", ""))
    if any(name not in keypoints.keypoints for name in names):
        return None
    return keypoints.keypoints.index(names[0]), keypoints.keypoints.index(names[1])


def limb_directions(recording: Recording, grid: Array) -> dict[str, Signal]:
    """Direction of each limb that has a sensor and keypoints, in the sensor's inertial frame ``(T, 3)``; by sensor.

    Not yet differentiated, so that it may be turned into a camera's frame. Sensors without orientation whose
    orientation cannot be found are left out.
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


def camera_rotation(mount: CameraMount, grid: Array) -> tuple[Array, np.ndarray] | None:
    """``R_camera_inertial (T, 3, 3)`` from the IMU on the camera, and where it is valid.

    None without orientation, or if nobody told how it sits.
    """
    turned = rotations_on(mount.imu, grid) if mount.is_declared else None
    if turned is None:
        return None
    R_inertial_imu, valid = turned
    return mount.R_camera_imu @ np.swapaxes(R_inertial_imu, -1, -2), valid


def rotations_on(stream: ImuStream, grid: Array) -> tuple[Array, np.ndarray] | None:
    """``R_inertial_sensor (T, 3, 3)`` on the grid (IMU time), and where it was measured; None if it cannot be had."""
    try:
        R = with_orientation(stream).R_inertial_sensor
    except RecordingError:
        return None
    assert R is not None
    return interpolate_rotations(stream.time, R, grid), _near_samples(stream.time, grid)


def rate_of(values: Array, valid: np.ndarray, width: float) -> Signal:
    """The smoothed derivative of what is already on the grid; not valid within its width of what is missing."""
    sigma = width * GRID_HZ
    rate = scipy.ndimage.gaussian_filter1d(values, sigma, axis=0, order=1, mode="nearest") * GRID_HZ
    # The kernel's ends count little: what is missing within one and a half widths would be seen.
    missing = scipy.ndimage.maximum_filter1d((~valid).astype(np.uint8), 2 * round(1.5 * sigma) + 1, mode="constant")
    whole = missing == 0
    return Signal(np.where(whole[:, None], rate, 0.0), whole)


def smoothed(values: Array, valid: np.ndarray, width: float) -> Signal:
    """The same smoothing without derivative, for what is a rate already."""
    values = scipy.ndimage.gaussian_filter1d(values, width * GRID_HZ, axis=0, mode="nearest")
    return Signal(np.where(valid[:, None], values, 0.0), valid)


def _rate(time: Array, values: Array, grid: Array, width: float) -> Signal:
    good = np.all(np.isfinite(values), axis=1)
    if good.sum() < 2:
        return Signal(np.zeros((len(grid), values.shape[1])), np.zeros(len(grid), bool))
    time, values = time[good], values[good]
    even = interpolate_points(time, values, grid)
    return rate_of(even, _near_samples(time, grid), width)


def _near_samples(time: Array, grid: Array) -> np.ndarray:
    """Whether the samples on both sides of each grid time are near enough to interpolate."""
    longest_gap_s = 0.12
    right = np.searchsorted(time, grid)
    inside = (grid >= time[0]) & (grid <= time[-1])
    right = np.clip(right, 1, len(time) - 1) if len(time) > 1 else np.zeros_like(right)
    return inside & (time[right] - time[right - 1] <= longest_gap_s)


def _without_jumps(values: Array) -> Array:
    """NaN where a limb jumps to somewhere and back within few frames: left taken for right."""
    before = np.abs(values - np.roll(values, 1, axis=0)).max(axis=1)
    jump = np.flatnonzero(before[1:] > 0.25) + 1
    clean = values.copy()
    for index in jump:
        clean[index - 1 : index + 1] = np.nan
    return clean


def _axis(bone: str, p_parent_joint: Array) -> Array:
    """Unit vector along the limb in the bone's frame, as its keypoints lie at rest."""
    far = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}
    side, _, joint = bone.partition("_")
    if joint in far:
        p = p_parent_joint[joint_index(f"{side}_{far[joint]}")]
        return p / np.linalg.norm(p)
    return FORWARD if joint == "ankle" else LEFT
