"""Detections of each wearer, resampled onto the estimate's frames."""

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.factor_settings import ReprojectionSettings
from vip_factors.geometry.rotations import Array
from vip_factors.problem.scene import KeypointView
from vip_factors.problem.state import CameraState, WearerState
from vip_factors.problem.wearer import BodyPoint
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.detections import Detections
from vip_factors.terms.reprojection import PAPERS_WIDTH, adaptive_biweight

# The square root of a person's area in the image over the height they would have there standing: people fill about
# half of a box that is 0.35 as wide as high.
AREA_OF_HEIGHT = 0.43
SPEED_REACH = 0.15  # s before and after: a step's swing is thrice as long


def keypoint_view(
    detections: Detections,
    chosen: np.ndarray,
    skeleton: Skeleton,
    time: Array,
    scale: Array,
    spread: float,
    settings: ReprojectionSettings,
    predicted: Array | None = None,
    image_width: float = PAPERS_WIDTH,
) -> KeypointView:
    """One wearer's keypoints at the frames.

    Args:
        detections: with times on the recording's clock.
        chosen: ``(N,)`` bool, which of them are the wearer's: one for each video frame at most.
        skeleton: the wearer's.
        time: ``(T,)`` of the frames.
        scale: ``(T,)`` square root of the wearer's area in pixels.
        spread: scatter of a fully confident keypoint in OKS sigmas.
        settings: of the reprojection factor.
        predicted: ``(T, K, 2)`` where the keypoints on the body would be seen by the body before, for the biweight.
        image_width: pixels, for the biweight too.
    """
    used, points = points_on_body(detections.keypoints, skeleton)
    track, confidence = _track(detections, chosen)
    track, confidence = track[:, used], confidence[:, used]
    pixels, sureness = _at_frames(detections.time, track, confidence, time)
    is_seen = (sureness >= settings.least_confidence) & np.all(np.isfinite(pixels), axis=2)
    oks = detections.keypoints.sigmas[used]
    if settings.biweight.use and predicted is not None:
        weight = adaptive_biweight(pixels, predicted, oks, scale, image_width, settings.biweight)
        is_seen, sureness = is_seen & (weight > 0), sureness * weight
    sureness = np.where(is_seen, np.minimum(sureness, 1.0), 0.0)
    metre = scale[:, None] / (AREA_OF_HEIGHT * stature_of(skeleton))
    sigma, oks_px = pixel_sigma(oks * scale[:, None], sureness, is_seen, spread, metre, settings)
    speed = _speed(detections.time, track, time)
    names = tuple(detections.keypoints.keypoints[k] for k in used)
    frames_apart = max(1.0, _period(detections.time) / _period(time)) if len(time) > 1 else 1.0
    return KeypointView(
        points,
        np.where(is_seen[..., None], pixels, 0.0),
        sigma,
        oks_px,
        is_seen,
        speed,
        sureness,
        names=names,
        frames_apart=frames_apart,
    )


def predicted_pixels(
    keypoints: KeypointSet, skeleton: Skeleton, wearer: WearerState, camera: CameraState, model: CameraModel
) -> Array:
    """Project the keypoints on a wearer's body at the frames, ``(T, K, 2)`` pixels."""
    body = forward_kinematics(skeleton, wearer.R_parent_child, wearer.p_world_pelvis)
    poses = camera.at_frames(slice(0, len(body.p_world_joint)))
    _, points = points_on_body(keypoints, skeleton)
    p = np.stack([point.of(body) for point in points], axis=1)
    return model.project((p - poses.p_world_camera[:, None]) @ poses.R_world_camera)


def pixel_sigma(
    size: Array,
    confidence: Array,
    is_seen: np.ndarray,
    spread: float,
    metre: Array | float,
    settings: ReprojectionSettings,
) -> tuple[Array, Array]:
    """Standard deviations of keypoints in pixels, and in pixels one OKS sigma as sure as the detector is; else one.

    Args:
        size: of one OKS sigma of each keypoint in pixels; all arrays have one shape, or broadcast to it.
        confidence: of the detector.
        is_seen: whether they count.
        spread: scatter of a fully confident keypoint in OKS sigmas.
        metre: how many pixels a metre has where the keypoints are.
        settings: of the reprojection factor.
    """
    with np.errstate(divide="ignore"):
        unsure = 1 / np.sqrt(np.minimum(confidence, 1.0))
    scattered = unsure * (settings.persistence * spread * size if settings.fixed_px is None else settings.fixed_px)
    sigma = np.hypot(np.maximum(scattered, settings.least_px), settings.point_sigma * metre)
    return np.where(is_seen, sigma, 1.0), np.where(is_seen, size * unsure, 1.0)


def image_scale(skeleton: Skeleton, wearer: WearerState, camera: CameraState, model: CameraModel) -> Array:
    """Square root of a wearer's area in pixels at each frame ``(T,)``, by the depth of the middle of the body."""
    nearest = 0.5  # m
    body = forward_kinematics(skeleton, wearer.R_parent_child, wearer.p_world_pelvis)
    centre = body.p_world_joint[:, joint_index("spine2")]
    poses = camera.at_frames(slice(0, len(centre)))
    depth = np.einsum("ti,ti->t", centre - poses.p_world_camera, poses.R_world_camera[:, :, 2])
    return AREA_OF_HEIGHT * model.focal[1] * stature_of(skeleton) / np.maximum(depth, nearest)


def scatter(residual: Array, view: KeypointView, otherwise: float) -> float:
    """Robust spread of the detections about the skeleton per image axis, in OKS sigmas.

    Args:
        residual: ``(T, K, 2)`` whitened by the view's sigmas.
        view: whose residuals these are.
        otherwise: where nothing was seen.
    """
    rayleigh_median = 1.1774  # median length of a vector of two normal numbers
    if not view.seen.any():
        return otherwise
    away = np.linalg.norm(residual, axis=2) * view.sigma / view.oks_px
    return float(np.median(away[view.seen])) / rayleigh_median


def points_on_body(keypoints: KeypointSet, skeleton: Skeleton) -> tuple[np.ndarray, tuple[BodyPoint, ...]]:
    """Indices of the keypoints that the skeleton has, and where it has them."""
    places = keypoints.on_body(skeleton)
    used = np.array([k for k, place in enumerate(places) if place is not None], dtype=int)
    return used, tuple(BodyPoint(place.bone, place.p_bone_point) for place in places if place is not None)


def _track(detections: Detections, chosen: np.ndarray) -> tuple[Array, Array]:
    """Pixels ``(F, K, 2)`` and confidence ``(F, K)`` by video frame; NaN and zero where there is nothing."""
    F, K = len(detections.time), len(detections.keypoints)
    pixels, confidence = np.full((F, K, 2), np.nan), np.zeros((F, K))
    rows = np.flatnonzero(chosen)
    frames, is_seen = detections.frame[rows], detections.seen[rows]
    pixels[frames] = np.where(is_seen[..., None], detections.pixels[rows], np.nan)
    confidence[frames] = np.where(is_seen, detections.confidence[rows], 0.0)
    return pixels, confidence


def _period(time: Array) -> float:
    """Median seconds from one instant to the next; 1 of a single one."""
    return float(np.median(np.diff(time))) if len(time) > 1 else 1.0


def _at_frames(video: Array, pixels: Array, confidence: Array, time: Array) -> tuple[Array, Array]:
    """The track at the frames: each video frame speaks once, to the frame nearest to it."""
    bridged_gaps = 1.5  # video frame periods over which a keypoint is interpolated
    same_instant = 2e-3  # s: a video frame so near to a frame of the estimate is taken as it is
    period = _period(video)
    previous = np.clip(np.searchsorted(video, time, side="right") - 1, 0, max(len(video) - 2, 0))
    following = np.minimum(previous + 1, len(video) - 1)
    nearest = np.where(np.abs(video[following] - time) < np.abs(video[previous] - time), following, previous)
    share = np.clip((time - video[previous]) / np.maximum(video[following] - video[previous], 1e-9), 0.0, 1.0)[:, None]
    exact = np.abs(video[nearest] - time) <= same_instant
    bridged = (video[following] - video[previous] <= bridged_gaps * period) & (time >= video[0]) & (time <= video[-1])
    interpolated = (1 - share)[..., None] * pixels[previous] + share[..., None] * pixels[following]
    sure = np.where(bridged[:, None], np.minimum(confidence[previous], confidence[following]), 0.0)
    interpolated = np.where(exact[:, None, None], pixels[nearest], interpolated)
    sure = np.where(exact[:, None], confidence[nearest], sure)
    # Only the frame nearest to its video frame has its measurement: finer frames would repeat it
    gap = np.abs(video[nearest] - time)
    least = np.full(len(video), np.inf)
    np.minimum.at(least, nearest, gap)
    return interpolated, np.where((gap <= least[nearest] + 1e-9)[:, None], sure, 0.0)


def _speed(video: Array, pixels: Array, time: Array) -> Array:
    """Speed of the keypoints at the frames, ``(T, K, 2)`` pixels per second; zero where unknown.

    The slope of a straight line through the video frames within ``SPEED_REACH`` of each: the difference of two noisy
    detections would mostly be noise, and what is regressed on noise comes out too small.
    """
    if len(video) < 3:
        return np.zeros((len(time), *pixels.shape[1:]))
    period = _period(video)
    size = 2 * max(1, round(SPEED_REACH / period)) + 1
    is_measured = np.isfinite(pixels)
    p = np.where(is_measured, pixels, 0.0)
    t = np.where(is_measured, (video - video[0])[:, None, None], 0.0)

    def mean(values: Array) -> Array:
        return np.asarray(uniform_filter1d(values, size, axis=0, mode="constant"))

    share = np.maximum(mean(is_measured.astype(float)), 1e-9)
    mean_t, mean_p = mean(t) / share, mean(p) / share
    spread = mean(t * t) / share - mean_t**2
    is_spread = (spread > (0.5 * period) ** 2) & is_measured
    slope = np.where(is_spread, (mean(t * p) / share - mean_t * mean_p) / np.where(is_spread, spread, 1.0), 0.0)
    nearest = np.clip(np.searchsorted((video[1:] + video[:-1]) / 2, time), 0, len(video) - 1)
    return np.asarray(slope[nearest])
