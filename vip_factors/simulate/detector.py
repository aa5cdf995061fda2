"""A simulated 2D pose detector: people in front of a camera become detections, with a detector's errors.

Of one person at a time: keypoints off their place, unsure, or missed. Of several: left for right, one person's limbs
for another's, nobody for somebody.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.simulate.detector_view import Person, View, look
from vip_factors.simulate.recording import gauss_markov, lasting_chance
from vip_factors.simulate.settings import DetectorSettings

# The square root of a person's area in the image, over the height at which their whole stature would appear: COCO's
# areas are those of masks, and a standing body fills about 0.2 of height squared.
ROOT_AREA_PER_HEIGHT = 0.45

WHITE_ERROR = 0.10  # units, from frame to frame
EVENT_S = 0.25  # ours: bursts of several frames, as one sees them in OpenPose's videos
LEAST_CONFIDENCE = 0.05  # OpenPose's own default for drawing a keypoint


@dataclass
class DetectedPeople:
    """``P`` people as the detector has them in ``F`` frames: ``pixels`` ``(P, F, K, 2)`` and ``confidence`` ``(P, F,
    K)``, 0 where a keypoint is not detected.
    """

    pixels: Array
    confidence: Array


def single_people(
    view: View, keypoints: KeypointSet, step: float, settings: DetectorSettings, random: np.random.Generator
) -> DetectedPeople:
    """Everybody, as if nobody could be taken for somebody else."""
    # Each image axis, in units: measured as what lasts (0.41 with the bias, depending on pose and view), what
    # forgets (0.28), and what changes from frame to frame (0.10, second differences). The first two are taken by 0.7:
    # measured errors have long tails, which are doubt's here, and together they have the measured RMS again.
    drift_error, drift_time_s = 0.26, 3.0  # measured, 0.3 to 0.75 s apart
    slow_error, slow_time_s = 0.20, 0.14
    # Doubt is how unsure the detector is of a keypoint, 0 if sure: confidence falls with exp(−doubt), errors grow with
    # 1 + 4 doubt. Measured RMS error by confidence: 0.65: 0.4 units, 0.45: 0.65, 0.35: 1.2, 0.25: 2.1, 0.15: 3.0.
    # Below 0 is none: in plain sight, with this spread, 16 % of the time. Measured confidence is below 0.3 for 3 % of
    # all keypoints. Who is behind somebody else is ours: mostly a guess.
    plain_doubt, hidden_doubt, behind_doubt, doubt_spread, error_by_doubt = -0.4, 0.3, 1.2, 0.4, 4.0
    doubt_time_s = 0.5  # as long as limbs take to come forth
    # Of a keypoint without doubt: measured median 0.63, 5 to 95 %: 0.38 to 0.71; within a keypoint 0.07, 0.47 of it
    # after 0.1 s.
    usual_confidence, confidence_spread = 0.64, 0.07
    # Shares of keypoints. In plain sight measured 0 to 2 % by camera, behind the own body an open side of the cameras;
    # behind somebody else is ours: detectors mostly leave them out.
    plain_missed, hidden_missed, behind_missed = 0.005, 0.05, 0.6
    P, F, K = view.hidden.shape
    unit = keypoints.sigmas * ROOT_AREA_PER_HEIGHT * view.height[..., None]

    def per_point(sigma: float, time_constant: float, axes: int) -> Array:
        """Gauss–Markov processes ``(P, F, K, axes)``."""
        return gauss_markov(random, F, step, sigma, time_constant, P * K * axes).reshape(F, P, K, axes).swapaxes(0, 1)

    mean = np.where(view.behind, behind_doubt, np.where(view.hidden, hidden_doubt, plain_doubt))
    doubt = settings.doubt * np.maximum(mean + per_point(doubt_spread, doubt_time_s, 1)[..., 0], 0.0)
    error = per_point(drift_error, drift_time_s, 2) + per_point(slow_error, slow_time_s, 2)
    error += WHITE_ERROR * random.standard_normal((P, F, K, 2))
    error *= settings.error * (1 + error_by_doubt * doubt[..., None])
    pixels = view.aimed + error * unit[..., None]
    sure = usual_confidence + per_point(confidence_spread, slow_time_s, 1)[..., 0]
    confidence = np.clip((1 - settings.doubt + settings.doubt * sure) * np.exp(-doubt), 1e-3, 1.0)

    share = np.where(view.behind, behind_missed, np.where(view.hidden, hidden_missed, plain_missed))
    chance = lasting_chance(random, F, step, EVENT_S, axes=P * K).reshape(F, P, K).swapaxes(0, 1)
    missed = chance < settings.missed * share
    # A point is found only where it is in the image itself: nobody's detector points beside the picture.
    is_detected = np.all(np.isfinite(view.pixels), axis=3) & np.all(np.isfinite(pixels), axis=3) & ~missed
    return DetectedPeople(np.where(is_detected[..., None], pixels, np.nan), np.where(is_detected, confidence, 0.0))


def swapped_sides(
    people: DetectedPeople,
    view: View,
    keypoints: KeypointSet,
    step: float,
    settings: DetectorSettings,
    random: np.random.Generator,
) -> DetectedPeople:
    """Left and right arms or legs exchanged for a while, mostly when seen from the side or from behind."""
    front, back = 0.5, -0.5  # cosines of the facing angle: 60 degrees to either side are front and back
    P, F, _ = people.confidence.shape
    # Measured: 0.5 % of limb keypoints, nearly all knees. PoseFix (Moon et al. 2019) trains with 3 % at arms and 6 % at
    # legs for COCO's pictures. Between the two; by view is ours.
    from_front, from_side, from_back = 0.005, 0.04, 0.02
    share = np.where(view.facing > front, from_front, np.where(view.facing < back, from_back, from_side))
    pixels, confidence = people.pixels.copy(), people.confidence.copy()
    arms, legs = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle", "heel", "toe")
    for words in (arms, legs):
        group = np.array([any(word in name for word in words) for name in keypoints.keypoints])
        chance = lasting_chance(random, F, step, EVENT_S, P).T
        swapped = chance < settings.swapped * share
        source = np.where(group, keypoints.mirrored, np.arange(len(keypoints)))
        pixels[swapped] = pixels[swapped][:, source]
        confidence[swapped] = confidence[swapped][:, source]
    return DetectedPeople(pixels, confidence)


def mixed_people(
    people: DetectedPeople,
    view: View,
    keypoints: KeypointSet,
    step: float,
    settings: DetectorSettings,
    random: np.random.Generator,
) -> tuple[DetectedPeople, np.ndarray]:
    """Overlapping people with limbs of each other.

    Returns:
        The people, and ``(P, F)`` whether somebody has been merged into somebody else and is gone.
    """
    second_share = 0.35  # of the limbs in a mixed detection, that are the other person's
    overlap_depth = 0.6  # and whose heights in the image differ by no more than this factor
    overlap = 0.12  # of the nearer one's height in the image: people whose middles are nearer than this overlap
    # Ours, to see what an estimator makes of it: no real recording of several people was measured.
    merged_share, exchanged_share = 0.15, 0.10  # of the time that two people overlap
    P, F, _ = people.confidence.shape
    limb = _limbs(keypoints)
    pixels, confidence = people.pixels.copy(), people.confidence.copy()
    absent = np.zeros((P, F), bool)
    finite = np.all(np.isfinite(view.aimed), axis=3)
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN without keypoints
        middle = np.where(finite[..., None], view.aimed, 0.0).sum(axis=2) / finite.sum(axis=2)[..., None]
    for a, b in combinations(range(P), 2):
        chances = lasting_chance(random, F, step, EVENT_S, 2)
        is_exchanged_limb = lasting_chance(random, F, step, EVENT_S, int(limb.max()) + 1) < second_share
        near = np.where(view.depth[a] <= view.depth[b], view.height[a], view.height[b])
        with np.errstate(invalid="ignore"):
            close = np.linalg.norm(middle[a] - middle[b], axis=1) < overlap * near
            close &= np.abs(np.log(view.height[a] / view.height[b])) < overlap_depth
        merged = close & (chances[:, 0] < settings.mixed * merged_share)
        exchanged = close & (chances[:, 1] < settings.mixed * exchanged_share)
        moves = (merged | exchanged)[:, None] & is_exchanged_limb[:, limb]
        for values in (pixels, confidence):
            old = values[a][moves].copy()
            values[a][moves] = values[b][moves]
            values[b][moves] = old
        # The nearer of the two is the one that the detector has; its limbs may be the other's now.
        hidden_person = np.where(view.depth[a] <= view.depth[b], b, a)
        frames = np.flatnonzero(merged)
        absent[hidden_person[frames], frames] = True
    return DetectedPeople(pixels, confidence), absent


def false_people(
    view: View,
    model: CameraModel,
    keypoints: KeypointSet,
    step: float,
    settings: DetectorSettings,
    random: np.random.Generator,
) -> DetectedPeople:
    """Detections of nobody (furniture, shadows, pictures on walls): shapes of real people elsewhere, in part."""
    false_time_s = 0.5  # that they last on average
    false_confidence, false_keypoints = 0.3, 0.5  # of detections of nobody: mean confidence, share of keypoints
    F, K = view.height.shape[1], len(keypoints)
    a_frame = 0.03  # detections, ours
    count = random.poisson(settings.people * a_frame * F * step / false_time_s)
    pixels, confidence = np.full((count, F, K, 2), np.nan), np.zeros((count, F, K))
    visible = np.argwhere(np.all(np.isfinite(view.height)[..., None], axis=2))
    if not len(visible):
        return DetectedPeople(pixels, confidence)
    time = step * np.arange(F)
    for number in range(count):
        start, lasts = random.uniform(0, F * step), random.exponential(false_time_s)
        frames = (time >= start) & (time < start + lasts)
        person, frame = visible[random.integers(len(visible))]
        shape = view.aimed[person, frame] - np.nanmean(view.aimed[person, frame], axis=0)
        size = random.uniform(0.3, 1.0)
        place = random.uniform([0, 0], [model.width, model.height])
        jitter = keypoints.sigmas[:, None] * ROOT_AREA_PER_HEIGHT * view.height[person, frame] * size
        has_keypoint = random.random(K) < false_keypoints
        shaking = random.standard_normal((F, K, 2)) * WHITE_ERROR + random.standard_normal((K, 2))
        pixels[number] = np.where(
            frames[:, None, None] & has_keypoint[:, None], place + size * shape + jitter * shaking, np.nan
        )
        sure = np.clip(false_confidence * random.uniform(0.5, 1.5, (F, K)), 0.05, 1.0)
        confidence[number] = np.where(np.isfinite(pixels[number, ..., 0]), sure, 0.0)
    return DetectedPeople(pixels, confidence)


def _limbs(keypoints: KeypointSet) -> np.ndarray:
    """Number ``(K,)`` of the limb of each keypoint: 0 head and trunk, then the four limbs."""
    number = np.zeros(len(keypoints), int)
    for k, name in enumerate(keypoints.keypoints):
        for limb, words in enumerate((("elbow", "wrist"), ("knee", "ankle", "heel", "toe"))):
            if any(word in name for word in words):
                number[k] = 1 + 2 * limb + (name.startswith("right"))
    return number


def detect(
    people: Sequence[Person],
    camera: CameraPath,
    model: CameraModel,
    keypoints: KeypointSet,
    settings: DetectorSettings,
    seed: int,
    bias_seed: int | None = None,
) -> tuple[Detections, np.ndarray, Array]:
    """What a detector finds in the video, of people and a camera at its ``F`` frames; each error has its own stream.

    ``bias_seed`` is that of its idea of where keypoints are on people, which is the same in all cameras.

    Returns:
        The ``N`` detections, in random order within a frame; the person ``(N,)`` who has most keypoints of each, at
        least seven of the major joints, or −1; and where that person's keypoints really are, ``(N, K, 2)`` pixels,
        NaN out of the image.
    """
    least_height_px = 60.0  # of a person to be found; COCO's small people
    overlooked_share = 0.01  # of the time that a person is in sight, ours
    least_keypoints = 4  # fewer do not make a person; OpenPose asks for 3 or 4
    names = ("bias", "errors", "sides", "mixed", "people", "false", "order")
    children = np.random.SeedSequence([seed, 0xDE7EC7]).spawn(len(names))
    if bias_seed is not None:
        children[0] = np.random.SeedSequence([bias_seed, 0xDE7EC7]).spawn(1)[0]
    random = {name: np.random.default_rng(child) for name, child in zip(names, children, strict=True)}
    step = float(np.median(np.diff(camera.time))) if len(camera) > 1 else 1.0

    bias = settings.bias_m * random["bias"].standard_normal((len(people), len(keypoints), 3))
    view = look(people, camera, model, keypoints, bias)
    detected = single_people(view, keypoints, step, settings, random["errors"])
    detected = swapped_sides(detected, view, keypoints, step, settings, random["sides"])
    detected, absent = mixed_people(detected, view, keypoints, step, settings, random["mixed"])
    overlooked = lasting_chance(random["people"], len(camera), step, EVENT_S, len(people)).T
    absent |= overlooked < settings.people * overlooked_share
    absent |= ~(view.height >= least_height_px)
    detected.confidence[absent] = 0
    false = false_people(view, model, keypoints, step, settings, random["false"])
    pixels = np.concatenate([detected.pixels, false.pixels])
    confidence = np.concatenate([detected.confidence, false.confidence])
    confidence = np.where(model.inside(pixels), confidence, 0.0)
    confidence[confidence < LEAST_CONFIDENCE] = 0
    person, frame = np.nonzero(np.sum(confidence > 0, axis=2) >= least_keypoints)
    order = np.lexsort((random["order"].random(len(frame)), frame))
    person, frame = person[order], frame[order]
    confidence = confidence[person, frame]
    pixels = np.where(confidence[..., None] > 0, pixels[person, frame], np.nan)
    detections = Detections(keypoints, camera.time, frame, pixels, confidence)
    owner = owners(detections, view, keypoints)
    truth = np.where((owner >= 0)[:, None, None], view.pixels[owner, frame], np.nan)
    return detections, owner, truth


def owners(detections: Detections, view: View, keypoints: KeypointSet) -> np.ndarray:
    """The person ``(N,)`` who has most major keypoints of each detection, at least seven, or −1."""
    # A keypoint is right within half a head's length (the PCKh@0.5 of Andriluka et al. 2014), 0.13 of stature
    # (Drillis & Contini); it must also be nearer to this person's keypoint than to anybody else's.
    right_within = 0.065
    least_correct = 7
    joints = ("neck", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")  # major ones (thesis 4.4.3)
    major = np.array([name.split("_")[-1] in joints for name in keypoints.keypoints])
    true_pixels = view.pixels[:, detections.frame]
    with np.errstate(invalid="ignore"):
        distance = np.nan_to_num(np.linalg.norm(detections.pixels - true_pixels, axis=3), nan=np.inf)
        right = distance <= right_within * view.height[:, detections.frame, None]
    right &= (distance <= distance.min(axis=0)) & major
    count = right.sum(axis=2)
    owner = count.argmax(axis=0)
    return np.where(count.max(axis=0) >= least_correct, owner, -1)
