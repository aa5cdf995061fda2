"""A simulated 2D pose detector: people in front of a camera become detections, with a detector's errors."""

from collections.abc import Sequence

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.simulate.chance import lasting_chance
from vip_factors.simulate.detector_confusion import false_people, mixed_people, swapped_sides
from vip_factors.simulate.detector_errors import Found, single_people
from vip_factors.simulate.detector_settings import DetectorSettings
from vip_factors.simulate.detector_view import Person, View, look

# Whose keypoints count when a detection is given to a person (thesis 4.4.3: "major body joints", at least seven).
MAJOR = ("neck", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
LEAST_CORRECT = 7
# A keypoint is right within half a head's length (the PCKh@0.5 of Andriluka et al. 2014), 0.13 of stature
# (Drillis & Contini); it must also be nearer to this person's keypoint than to anybody else's.
RIGHT_WITHIN = 0.065


def detect(
    people: Sequence[Person], camera: CameraPath, model: CameraModel, keypoints: KeypointSet,
    settings: DetectorSettings, seed: int, bias_seed: int | None = None,
) -> tuple[Detections, np.ndarray, Array]:  # fmt: skip
    """What a detector finds in the video.

    Args:
        people: everybody, with their poses at the video's ``F`` frames.
        camera: its ``F`` poses; their times become those of the detections.
        model: its intrinsics.
        keypoints: the detector's set.
        settings: its errors.
        seed: of them; each kind of error draws from its own stream.
        bias_seed: of its idea of where keypoints are on people, which is the same in all cameras; ``seed`` if None.

    Returns:
        The ``N`` detections, in random order within a frame; the person ``(N,)`` who has most keypoints of each, at
        least seven of the major joints, or −1; and where that person's keypoints really are, ``(N, K, 2)`` pixels,
        NaN out of the image.
    """
    names = ("bias", "errors", "sides", "mixed", "people", "false", "order")
    children = np.random.SeedSequence([seed, 0xDE7EC7]).spawn(len(names))
    if bias_seed is not None:
        children[0] = np.random.SeedSequence([bias_seed, 0xDE7EC7]).spawn(1)[0]
    random = {name: np.random.default_rng(child) for name, child in zip(names, children, strict=True)}
    step = float(np.median(np.diff(camera.time))) if len(camera) > 1 else 1.0

    bias = settings.bias_m * random["bias"].standard_normal((len(people), len(keypoints), 3))
    view = look(people, camera, model, keypoints, bias)
    found = single_people(view, keypoints, step, settings, random["errors"])
    found = swapped_sides(found, view, keypoints, step, settings, random["sides"])
    found, absent = mixed_people(found, view, keypoints, step, settings, random["mixed"])
    overlooked = lasting_chance(random["people"], len(camera), step, settings.event_time_s, len(people)).T
    absent |= overlooked < settings.missed_person
    absent |= ~(view.height >= settings.least_height_px)
    found.confidence[absent] = 0
    found = found.joined(false_people(view, model, keypoints, step, settings, random["false"]))
    return _listed(found, view, camera, model, keypoints, settings, random["order"])


def _listed(
    found: Found, view: View, camera: CameraPath, model: CameraModel, keypoints: KeypointSet,
    settings: DetectorSettings, random: np.random.Generator,
) -> tuple[Detections, np.ndarray, Array]:  # fmt: skip
    """The detections of all frames in one list, and whose they are."""
    confidence = np.where(model.inside(found.pixels), found.confidence, 0.0)
    confidence[confidence < settings.least_confidence] = 0
    person, frame = np.nonzero(np.sum(confidence > 0, axis=2) >= max(1, settings.least_keypoints))
    order = np.lexsort((random.random(len(frame)), frame))
    person, frame = person[order], frame[order]
    confidence = confidence[person, frame]
    pixels = np.where(confidence[..., None] > 0, found.pixels[person, frame], np.nan)
    detections = Detections(keypoints, camera.time, frame, pixels, confidence)
    owner = owners(detections, view, keypoints)
    truth = np.where((owner >= 0)[:, None, None], view.pixels[owner, frame], np.nan)
    return detections, owner, truth


def owners(detections: Detections, view: View, keypoints: KeypointSet) -> np.ndarray:
    """The person ``(N,)`` who has most major keypoints of each detection, at least seven, or −1."""
    major = np.array([name.split("_")[-1] in MAJOR for name in keypoints.keypoints])
    there = view.pixels[:, detections.frame]
    with np.errstate(invalid="ignore"):
        distance = np.nan_to_num(np.linalg.norm(detections.pixels - there, axis=3), nan=np.inf)
        right = distance <= RIGHT_WITHIN * view.height[:, detections.frame, None]
    right &= (distance <= distance.min(axis=0)) & major
    count = right.sum(axis=2)
    best = count.argmax(axis=0)
    return np.where(count.max(axis=0) >= LEAST_CORRECT, best, -1)
