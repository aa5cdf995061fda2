"""Half hidden people are told by where they stand, once the camera is known."""

from dataclasses import replace

import numpy as np
import pytest
from association_samples import MODEL, Sample, scene

from vip_factors.associate.associate import Association, add_left_over, associate, make_context
from vip_factors.associate.features import Context
from vip_factors.associate.place import left_over
from vip_factors.associate.settings import AssociationSettings
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.detections import Detections

HIDDEN_FROM = 40  # video frame


def half_hidden(detections: Detections, which: np.ndarray, seen: tuple[str, ...]) -> Detections:
    """Only some joints of some detections are seen."""
    keep = np.array([name.split("_")[-1] in seen for name in detections.keypoints.keypoints])
    gone = which[:, None] & ~keep
    confidence = np.where(gone, 0.0, detections.confidence)
    return replace(detections, confidence=confidence, pixels=np.where(gone[..., None], np.nan, detections.pixels))


@pytest.fixture(scope="module")
def sample() -> Sample:
    return scene(seconds=2.5, common_world=True)


@pytest.fixture(scope="module")
def context(sample: Sample) -> Context:
    return make_context(sample.detections, MODEL, sample.motions, sample.camera, None)


def sure(sample: Sample) -> np.ndarray:
    """The wearers are known up to some frame."""
    return np.where(sample.detections.frame < HIDDEN_FROM, sample.wearer, -1)


def given(context: Context, sample: Sample, pixels: Array | None = None, weight: Array | None = None) -> np.ndarray:
    rays = context.rays if pixels is None else MODEL.normalise(pixels)
    seen = context.weight if weight is None else weight
    return left_over(replace(context, rays=rays, weight=seen), sample.camera, sure(sample))


def test_half_hidden_wearers_are_found_where_they_stand() -> None:
    whole = scene(seconds=2.5, common_world=True)
    hidden = whole.detections.frame >= HIDDEN_FROM
    detections = half_hidden(whole.detections, hidden, ("shoulder", "elbow"))
    by_motion, by_place = (
        associate(detections, MODEL, whole.motions, AssociationSettings(by_place=use), whole.camera)
        for use in (False, True)
    )
    theirs = hidden & (whole.wearer >= 0)
    assert not np.any(by_motion.wearer[theirs] >= 0)
    assert np.mean(by_place.wearer[theirs] == whole.wearer[theirs]) > 0.95
    assert np.all(by_place.wearer[hidden & (whole.wearer < 0)] == -1)
    assert np.array_equal(by_place.by_place, by_place.wearer != by_motion.wearer)
    assert np.all(by_place.confidence[by_place.by_place] > 0)
    assert np.isfinite(by_place.p_camera_world[by_place.by_place]).all()


def test_all_others_are_strangers(context: Context, sample: Sample) -> None:
    assert np.array_equal(given(context, sample), sample.wearer)


def test_a_detection_with_joints_of_two_people_is_nobody_s(context: Context, sample: Sample) -> None:
    pixels = sample.detections.pixels.copy()
    upper = np.array([name.split("_")[-1] in ("shoulder", "elbow", "wrist") for name in context.names])
    merged = np.flatnonzero((sample.wearer == 0) & (sample.detections.frame >= HIDDEN_FROM))
    others = np.flatnonzero((sample.wearer == 1) & (sample.detections.frame >= HIDDEN_FROM))
    pixels[np.ix_(merged, upper)] = pixels[np.ix_(others, upper)]
    assert np.all(given(context, sample, pixels)[merged] == -1)


def test_of_two_who_stand_where_the_wearer_is_none_is_taken(context: Context, sample: Sample) -> None:
    pixels = sample.detections.pixels.copy()
    late = sample.detections.frame >= HIDDEN_FROM
    wearer, stranger = (np.flatnonzero(late & (sample.wearer == w)) for w in (0, -1))
    beside = stranger[np.unique(sample.detections.frame[stranger], return_index=True)[1]]
    pixels[beside] = pixels[wearer] + 3.0
    found = given(context, sample, pixels)
    assert np.all(found[np.concatenate([wearer, beside])] == -1)


def test_three_joints_are_too_few(context: Context, sample: Sample) -> None:
    weight = context.weight.copy()
    late = sample.detections.frame >= HIDDEN_FROM
    weight[np.ix_(late, np.cumsum(context.weight[0] > 0) > 3)] = 0.0
    assert np.all(given(context, sample, weight=weight)[late] == -1)


def test_a_wearer_who_was_hardly_ever_seen_has_no_place(context: Context, sample: Sample) -> None:
    seldom = np.where(sample.detections.frame < 5, sample.wearer, -1)
    assert np.array_equal(left_over(context, sample.camera, seldom), seldom)


def test_those_left_over_are_added_when_places_are_known_better(sample: Sample) -> None:
    N = len(sample.detections)
    R, p = np.tile(np.eye(3), (N, 1, 1)), np.full((N, 3), np.nan)
    before = Association(sure(sample), np.where(sure(sample) >= 0, 0.95, 0.0), R, p, np.full(N, np.nan))
    found = add_left_over(before, sample.detections, MODEL, sample.motions, sample.camera)
    assert np.array_equal(found.wearer, sample.wearer)
    assert np.array_equal(found.by_place, before.wearer != found.wearer)
    kept = add_left_over(
        before, sample.detections, MODEL, sample.motions, sample.camera, AssociationSettings(by_place=False)
    )
    assert kept is before
