"""Agreement of image and sensors for every offset of their clocks, as a log-likelihood curve.

The image of a limb's direction in a static camera is a linear map of that direction (parallel projection, with the
person's size in the image divided out): six coefficients for any heading and camera pose. For a moving camera with an
IMU, the direction is transformed to the camera's frame first, and only a heading is unknown. Both signals pass through
the same derivative of a Gaussian, which removes constant errors (perspective, mountings) without a delay.

For every track and limb, the share R² of the limb's image motion that its sensor explains is computed for all offsets
at once by Fourier transforms. ``−n log(1 − R²)`` is the gain in log-likelihood over "this body is somebody else", with
n independent instants. Gains of limbs are added; each track is one wearer or nobody.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from vip_factors.body.skeleton import joint_index
from vip_factors.errors import RecordingError
from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.detections import ImageTrack
from vip_factors.sensors.imu_stream import ImuStream, with_orientation
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene

GRID_HZ = 60.0  # of all signals: twice a usual video's rate
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


LEAST_SAMPLES = 30  # of common grid time for a linear map
QUICK_S = 0.07  # wider than a detector's jitter, narrower than a step of 0.4 s


@dataclass(frozen=True)
class LimbCurve:
    """Agreement of a wearer's limb with a track: log-likelihood gain and number of independent instants ``(L,)``."""

    wearer: int
    sensor: str
    gain: Array
    instants: Array


@dataclass(frozen=True)
class Pair:
    """Track and wearer, and the offsets ``(L,)`` at which they are assigned to each other."""

    track: int
    wearer: int
    chosen: np.ndarray


@dataclass(frozen=True)
class CorrelationCurve:
    """Agreement over offsets.

    Attributes:
        offset: ``(L,)`` seconds to add to the video's times, evenly spaced.
        gain: ``(L,)`` log-likelihood gain in nats, over all tracks.
        tracks: for every track, the curves of all limbs of all wearers.
        pairs: assignments of tracks to wearers.
    """

    offset: Array
    gain: Array
    tracks: Sequence[Sequence[LimbCurve]] = ()
    pairs: tuple[Pair, ...] = ()

    def explained(self, index: int) -> float:
        """Share of limbs' image motion that sensors explain at an offset: mean R² of the best track."""
        pairs = [self.limbs_of(pair) for pair in self.pairs if pair.chosen[index]]
        sums = [
            (sum(limb.gain[index] for limb in limbs), sum(limb.instants[index] for limb in limbs)) for limbs in pairs
        ]
        gain, instants = max(sums, default=(0.0, 1.0))
        return float(1 - np.exp(-max(gain, 0.0) / max(instants, 1.0)))

    def limbs_of(self, pair: Pair) -> list[LimbCurve]:
        """Curves of the wearer's limbs with the track."""
        return [limb for limb in self.tracks[pair.track] if limb.wearer == pair.wearer]


def peak_vertex(offset: Array, gain: Array, index: int, reach_s: float) -> tuple[float, float]:
    """Vertex of the parabola within ``reach_s`` of a peak, and its (positive) curvature in nats/s²."""
    reach = max(2, round(reach_s / (offset[1] - offset[0])))
    window = slice(max(index - reach, 0), index + reach + 1)
    a, b, _ = np.polyfit(offset[window] - offset[index], gain[window], 2)
    if a >= 0:
        return float(offset[index]), 1e-6
    return float(offset[index] + np.clip(-b / (2 * a), -reach_s, reach_s)), float(max(-2 * a, 1e-6))


def correlation_curve(
    scene: Scene,
    camera: Camera,
    tracks: Sequence[ImageTrack],
    max_offset: float,
    width: float = QUICK_S,
) -> CorrelationCurve:
    """Compute the agreement of tracks with the sensors of a scene for all offsets up to ``max_offset`` s either way.

    The IMU of a moving camera is used. ``width`` is that of the smoothing Gaussian, seconds.
    """
    lags = round(2 * max_offset * GRID_HZ) + 1
    offset: Array = (np.arange(lags, dtype=float) - (lags - 1) / 2) / GRID_HZ
    turning, every = np.zeros(lags), []
    for track in tracks:
        count = int(np.ceil((track.time[-1] - track.time[0]) * GRID_HZ)) + 1
        video = track.time[0] + np.arange(count) / GRID_HZ
        imu = track.time[0] + offset[0] + np.arange(count + lags - 1) / GRID_HZ
        every.append(_limb_curves(scene, camera, track, video, imu, width))
        turning = np.maximum(turning, _camera_curve(camera, track, video, imu, width))
    pairs, gain = _assign_tracks(tracks, every, lags)
    return CorrelationCurve(offset, gain + turning, every, pairs)


def _assign_tracks(
    tracks: Sequence[ImageTrack], every: Sequence[Sequence[LimbCurve]], lags: int
) -> tuple[tuple[Pair, ...], Array]:
    """Assign tracks to wearers greedily at each offset; returns the pairs and the summed gain ``(L,)``.

    A track is at most one wearer, and a wearer has one track at a time: people who walk in step must not count.
    """
    common_seconds = 0.2  # possible overlap of two tracks of one person: double detections
    candidates = [(t, w) for t, curves in enumerate(every) for w in sorted({curve.wearer for curve in curves})]
    if not candidates:
        return (), np.zeros(lags)
    gain = np.stack([np.sum([curve.gain for curve in every[t] if curve.wearer == w], axis=0) for t, w in candidates])
    track, wearer = np.array(candidates).T
    start = np.array([tracks[t].time[0] for t in track])
    end = np.array([tracks[t].time[-1] for t in track])
    overlap = np.minimum(end[:, None], end) - np.maximum(start[:, None], start)
    excluded = (track[:, None] == track) | ((wearer[:, None] == wearer) & (overlap > common_seconds))
    free, total, chosen = gain > 0, np.zeros(lags), np.zeros(gain.shape, bool)
    for _ in range(len(tracks)):
        value = np.where(free, gain, 0.0)
        choice = np.argmax(value, axis=0)
        has_gain = value[choice, np.arange(lags)] > 0
        if not np.any(has_gain):
            break
        total += value[choice, np.arange(lags)]
        chosen[choice[has_gain], np.flatnonzero(has_gain)] = True
        free &= ~excluded[choice].T
    return tuple(Pair(t, w, row) for (t, w), row in zip(candidates, chosen, strict=True)), total


def _limb_curves(
    scene: Scene, camera: Camera, track: ImageTrack, video: Array, imu: Array, width: float
) -> list[LimbCurve]:
    least_seconds = 2.0  # of common time that a limb must show
    mount = camera.mount
    turned = rotations_on(mount.imu, imu) if camera.moving and mount is not None and mount.is_declared else None
    if turned is not None and mount is not None:
        turned = mount.R_camera_imu @ np.swapaxes(turned[0], -1, -2), turned[1]
    images, names = dict[tuple[int, int], Signal](), camera.detections.keypoints.keypoints
    curves = []
    for number, recording in enumerate(scene.wearers):
        for sensor, direction in limb_directions(recording, imu).items():
            near, far = LIMBS[recording.placement.site(sensor).bone]
            if near not in names or far not in names:
                continue
            limb = names.index(near), names.index(far)
            if limb not in images:
                images[limb] = limb_in_image(track, limb, video, width)
            image = images[limb]
            if image.valid.sum() < least_seconds * GRID_HZ:
                continue
            features = _features(direction, turned, width)
            curves.append(LimbCurve(number, sensor, *_gain(image, features, width)))
    return curves


def _features(direction: Signal, turned: tuple[Array, np.ndarray] | None, width: float) -> list[Signal]:
    """Regressors of the image motion: one signal for both axes, or one for each with a common map."""
    if turned is None:
        return [rate_of(direction.values, direction.valid, width)]
    R_camera_inertial, valid = turned
    x, y, z = direction.values.T
    # a heading between the inertial frames maps (x, y) to (c x − s y, s x + c y), linear in c and s
    basis = np.stack([np.stack([x, y, 0 * z], 1), np.stack([-y, x, 0 * z], 1), np.stack([0 * x, 0 * y, z], 1)], axis=-1)
    in_camera = R_camera_inertial @ basis
    return [rate_of(in_camera[:, row], valid & direction.valid, width) for row in (0, 1)]


def _camera_curve(camera: Camera, track: ImageTrack, video: Array, imu: Array, width: float) -> Array:
    """Agreement of the bodies' motion in the image with the camera's gyroscope."""
    none = np.zeros(len(imu) - len(video) + 1)
    if not camera.moving or camera.mount is None or camera.mount.imu.angular_rate is None:
        return none
    stream = camera.mount.imu
    rate = interpolate_points(stream.time, camera.mount.imu.angular_rate, imu)
    turn = smoothed(rate, (imu >= stream.time[0]) & (imu <= stream.time[-1]), width)
    # the body's middle, as a turning camera moves it, rad/s
    image = image_rate(track.time, np.nanmedian(track.pixels, axis=1) / np.array(camera.model.focal), video, width)
    return np.maximum(_gain(image, [turn], width)[0], 0.0) if np.any(image.valid) else none


def _gain(image: Signal, features: Sequence[Signal], width: float) -> tuple[Array, Array]:
    """Log-likelihood gain ``(L,)`` of image motion ``(T, 2)`` as a linear map of features ``(T + L − 1, 3)``.

    Also returns the number of independent instants ``(L,)``.
    """
    most_explained = 0.98  # limits the weight of a limb that fits by chance
    ridge = 1e-2  # relative to the mean square: planar motion leaves one direction undetermined
    independent = 0.28 / width / GRID_HZ  # independent instants per sample: 1 / (2 √π) per width
    size = scipy.fft.next_fast_len(len(features[0].values), real=True)
    lags = len(features[0].values) - len(image.values) + 1

    def transform(values: np.ndarray) -> np.ndarray:
        return scipy.fft.rfft(values, size, axis=0)

    mask = np.conj(transform(image.valid.astype(float)))
    x = np.conj(transform(image.values))
    square = np.conj(transform(np.sum(image.values**2, axis=1)))
    valid = transform(features[0].valid.astype(float))
    f = [transform(feature.values) for feature in features]
    if len(features) == 1:  # a map for each axis
        cross = [x[:, row, None] * f[0] for row in (0, 1)]
    else:  # one map for both
        cross = [x[:, 0, None] * f[0] + x[:, 1, None] * f[1]]
    products = sum(transform(np.einsum("ti,tj->tij", feature.values, feature.values)) for feature in features)
    common = scipy.fft.irfft(mask * valid, size)[:lags]
    power = scipy.fft.irfft(square * valid, size)[:lags]
    S = scipy.fft.irfft(mask[:, None, None] * products, size, axis=0)[:lags]
    S = S + (ridge * np.trace(S, axis1=1, axis2=2)[:, None, None] + 1e-12) * np.eye(3)
    explained = np.zeros(lags)
    for spectrum in cross:
        s = scipy.fft.irfft(spectrum, size, axis=0)[:lags]
        explained += np.einsum("li,li->l", s, np.linalg.solve(S, s[..., None])[..., 0])
    is_sufficient = common > LEAST_SAMPLES
    share = np.where(is_sufficient & (power > 0), explained / np.where(power > 0, power, 1.0), 0.0)
    share = np.clip(share, 0.0, most_explained)
    parameters = 3 * len(cross)
    instants = np.where(is_sufficient, independent * common, 0.0)
    return np.where(is_sufficient, -instants * np.log1p(-share) - parameters, 0.0), instants
