"""What a detector takes for something else: left for right, one person's limbs for another's, nobody for somebody."""

from itertools import combinations

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.simulate.chance import lasting_chance
from vip_factors.simulate.detector_errors import Found
from vip_factors.simulate.detector_settings import ROOT_AREA_PER_HEIGHT, DetectorSettings
from vip_factors.simulate.detector_view import View

GROUPS = {
    "arms": ("shoulder", "elbow", "wrist"),
    "legs": ("hip", "knee", "ankle", "heel", "toe"),
}
FRONT, BACK = 0.5, -0.5  # cosines of the facing angle: 60 degrees to either side are front and back
OVERLAP = 0.12  # of the nearer one's height in the image: people whose middles are nearer than this overlap
OVERLAP_DEPTH = 0.6  # and whose heights in the image differ by no more than this factor
SECOND_SHARE = 0.35  # of the limbs in a mixed detection, that are the other person's
FALSE_CONFIDENCE, FALSE_KEYPOINTS = 0.3, 0.5  # of detections of nobody: mean confidence, share of keypoints


def swapped_sides(
    found: Found, view: View, keypoints: KeypointSet, step: float, settings: DetectorSettings,
    random: np.random.Generator,
) -> Found:  # fmt: skip
    """Left and right arms or legs exchanged for a while, mostly when seen from the side or from behind."""
    P, F, _ = found.confidence.shape
    share = np.where(view.facing > FRONT, settings.swap_front, settings.swap_side)
    share = np.where(view.facing < BACK, settings.swap_back, share)
    pixels, confidence = found.pixels.copy(), found.confidence.copy()
    for words in GROUPS.values():
        group = np.array([any(word in name for word in words) for name in keypoints.keypoints])
        chance = lasting_chance(random, F, step, settings.event_time_s, P).T
        swapped = chance < share
        source = np.where(group, keypoints.mirrored, np.arange(len(keypoints)))
        pixels[swapped] = pixels[swapped][:, source]
        confidence[swapped] = confidence[swapped][:, source]
    return Found(pixels, confidence)


def mixed_people(
    found: Found, view: View, keypoints: KeypointSet, step: float, settings: DetectorSettings,
    random: np.random.Generator,
) -> tuple[Found, np.ndarray]:  # fmt: skip
    """Overlapping people with limbs of each other.

    Returns:
        The people, and ``(P, F)`` whether somebody has been merged into somebody else and is gone.
    """
    P, F, _ = found.confidence.shape
    limb = _limbs(keypoints)
    pixels, confidence = found.pixels.copy(), found.confidence.copy()
    absent = np.zeros((P, F), bool)
    middle = _middles(view)
    for a, b in combinations(range(P), 2):
        both = lasting_chance(random, F, step, settings.event_time_s, 2)
        theirs = lasting_chance(random, F, step, settings.event_time_s, int(limb.max()) + 1) < SECOND_SHARE
        near = np.where(view.depth[a] <= view.depth[b], view.height[a], view.height[b])
        with np.errstate(invalid="ignore"):
            close = np.linalg.norm(middle[a] - middle[b], axis=1) < OVERLAP * near
            close &= np.abs(np.log(view.height[a] / view.height[b])) < OVERLAP_DEPTH
        merged, exchanged = close & (both[:, 0] < settings.merge), close & (both[:, 1] < settings.exchange)
        moves = (merged | exchanged)[:, None] & theirs[:, limb]
        for values in (pixels, confidence):
            old = values[a][moves].copy()
            values[a][moves] = values[b][moves]
            values[b][moves] = old
        # The nearer of the two is the one that the detector has; its limbs may be the other's now.
        gone = np.where(view.depth[a] <= view.depth[b], b, a)
        frames = np.flatnonzero(merged)
        absent[gone[frames], frames] = True
    return Found(pixels, confidence), absent


def false_people(
    view: View, model: CameraModel, keypoints: KeypointSet, step: float, settings: DetectorSettings,
    random: np.random.Generator,
) -> Found:  # fmt: skip
    """Detections of nobody (furniture, shadows, pictures on walls): shapes of real people elsewhere, in part."""
    F, K = view.height.shape[1], len(keypoints)
    count = random.poisson(settings.false_people * F * step / settings.false_time_s)
    pixels, confidence = np.full((count, F, K, 2), np.nan), np.zeros((count, F, K))
    whole = np.argwhere(np.all(np.isfinite(view.height)[..., None], axis=2))
    if not len(whole):
        return Found(pixels, confidence)
    time = step * np.arange(F)
    for one in range(count):
        start, lasts = random.uniform(0, F * step), random.exponential(settings.false_time_s)
        frames = (time >= start) & (time < start + lasts)
        person, frame = whole[random.integers(len(whole))]
        shape = view.aimed[person, frame] - np.nanmean(view.aimed[person, frame], axis=0)
        size = random.uniform(0.3, 1.0)
        place = random.uniform([0, 0], [model.width, model.height])
        jitter = keypoints.sigmas[:, None] * ROOT_AREA_PER_HEIGHT * view.height[person, frame] * size
        kept = random.random(K) < FALSE_KEYPOINTS
        shaking = random.standard_normal((F, K, 2)) * settings.white_error + random.standard_normal((K, 2))
        pixels[one] = np.where(frames[:, None, None] & kept[:, None], place + size * shape + jitter * shaking, np.nan)
        sure = np.clip(FALSE_CONFIDENCE * random.uniform(0.5, 1.5, (F, K)), 0.05, 1.0)
        confidence[one] = np.where(np.isfinite(pixels[one, ..., 0]), sure, 0.0)
    return Found(pixels, confidence)


def _limbs(keypoints: KeypointSet) -> np.ndarray:
    """Number ``(K,)`` of the limb of each keypoint: 0 head and trunk, then the four limbs."""
    number = np.zeros(len(keypoints), int)
    for k, name in enumerate(keypoints.keypoints):
        for one, words in enumerate((("elbow", "wrist"), ("knee", "ankle", "heel", "toe"))):
            if any(word in name for word in words):
                number[k] = 1 + 2 * one + (name.startswith("right"))
    return number


def _middles(view: View) -> Array:
    """Middle ``(P, F, 2)`` of each person's keypoints, NaN if there are none."""
    finite = np.all(np.isfinite(view.aimed), axis=3)
    total = np.where(finite[..., None], view.aimed, 0.0).sum(axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(total / finite.sum(axis=2)[..., None])
