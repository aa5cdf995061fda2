"""Clothes help where motion does not decide, and say nothing where all are dressed alike."""

from dataclasses import replace

import numpy as np
import pytest
from association_samples import MODEL, Sample, scene

from vip_factors.associate.associate import Association, add_by_position, associate, make_context
from vip_factors.associate.cues import SURELY, assign_by_position, clothes_log_odds
from vip_factors.associate.features import Context
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.detections import Detections
from vip_factors.settings import AssociationSettings

SHIRTS = np.array([[0.9, 0.1, 0.0, 0.0], [0.0, 0.8, 0.2, 0.0], [0.0, 0.0, 0.3, 0.7]])


@pytest.fixture(scope="module")
def sample() -> Sample:
    return scene(common_world=True)


@pytest.fixture(scope="module")
def context(sample: Sample) -> Context:
    return make_context(sample.detections, MODEL, sample.motions, sample.camera, None)


def dressed(shirt: np.ndarray, seed: int = 0) -> Array:
    """Looks ``(N, 4)`` at shirts, each a little different; every third only."""
    random = np.random.default_rng(seed)
    looks = np.maximum(SHIRTS[shirt] + 0.05 * random.standard_normal((len(shirt), 4)), 0)
    looks /= looks.sum(axis=1, keepdims=True)
    looks[np.arange(len(shirt)) % 3 > 0] = np.nan
    return looks


def test_clothes_tell_wearers_from_strangers(sample: Sample, context: Context) -> None:
    known = np.where(sample.detections.frame < 60, sample.wearer, -1)
    odds = clothes_log_odds(context, dressed(np.where(sample.wearer < 0, 2, sample.wearer)), known)
    later = sample.detections.frame >= 70  # within the window of no sure one
    for w in range(2):
        assert np.median(odds[w, later & (sample.wearer == w)]) > 1
        assert np.median(odds[w, later & (sample.wearer != w)]) < -2
    assert np.abs(odds).max() <= SURELY


def test_clothes_alike_tell_nothing(sample: Sample, context: Context) -> None:
    odds = clothes_log_odds(context, dressed(np.zeros(len(sample.wearer), int)), sample.wearer)
    assert np.abs(odds).max() < 0.5


def test_torsos_that_nobody_saw_tell_nothing(sample: Sample, context: Context) -> None:
    assert not clothes_log_odds(context, np.full((len(sample.wearer), 4), np.nan), sample.wearer).any()


def test_a_stranger_who_moves_as_the_wearer_is_told_by_clothes() -> None:
    # Late in the recording somebody in other clothes does as the wearer does, and the detector sees him better.
    sample = scene(wearers=1, seconds=3.0)
    d = sample.detections
    late = np.flatnonzero((sample.wearer == 0) & (d.frame >= 60))
    own = d.pixels.copy()
    own[late] += 2.0 * np.random.default_rng(1).standard_normal(own[late].shape)
    order = np.argsort(np.concatenate([d.frame, d.frame[late]]), kind="stable")
    pixels = np.concatenate([own, d.pixels[late] - [250.0, 0.0]])[order]
    who = np.concatenate([sample.wearer, np.full(len(late), -2)])[order]
    both = replace(
        d, frame=np.concatenate([d.frame, d.frame[late]])[order], pixels=pixels,
        confidence=np.concatenate([d.confidence, d.confidence[late]])[order],
        torso_colour=dressed(np.where(who == 0, 0, np.where(who == -2, 1, 2))),
    )  # fmt: skip
    motion, clothes = (
        associate(both, MODEL, sample.motions, AssociationSettings(by_clothes=use)) for use in (False, True)
    )
    assert np.mean(motion.wearer[who == -2] == 0) > 0.5
    assert np.mean(clothes.wearer[who == -2] == 0) < 0.1
    assert np.mean(clothes.wearer[(who == 0) & (both.frame >= 60)] == 0) > 0.8
    assert (motion.by_clothes, clothes.by_clothes) == (False, True)


HIDDEN_FROM = 40  # video frame


def half_hidden(detections: Detections, which: np.ndarray, seen: tuple[str, ...]) -> Detections:
    """Only some joints of some detections are seen."""
    keep = np.array([name.split("_")[-1] in seen for name in detections.keypoints.keypoints])
    gone = which[:, None] & ~keep
    confidence = np.where(gone, 0.0, detections.confidence)
    return replace(detections, confidence=confidence, pixels=np.where(gone[..., None], np.nan, detections.pixels))


@pytest.fixture(scope="module")
def three_wearers() -> Sample:
    return scene(seconds=2.5, common_world=True)


@pytest.fixture(scope="module")
def known_context(three_wearers: Sample) -> Context:
    return make_context(three_wearers.detections, MODEL, three_wearers.motions, three_wearers.camera, None)


def sure(three_wearers: Sample) -> np.ndarray:
    """The wearers are known up to some frame."""
    return np.where(three_wearers.detections.frame < HIDDEN_FROM, three_wearers.wearer, -1)


def given(
    known_context: Context, three_wearers: Sample, pixels: Array | None = None, weight: Array | None = None
) -> np.ndarray:
    rays = known_context.rays if pixels is None else MODEL.normalise(pixels)
    seen = known_context.weight if weight is None else weight
    return assign_by_position(replace(known_context, rays=rays, weight=seen), three_wearers.camera, sure(three_wearers))


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


def test_all_others_are_strangers(known_context: Context, three_wearers: Sample) -> None:
    assert np.array_equal(given(known_context, three_wearers), three_wearers.wearer)


def test_a_detection_with_joints_of_two_people_is_nobody_s(known_context: Context, three_wearers: Sample) -> None:
    pixels = three_wearers.detections.pixels.copy()
    upper = np.array([name.split("_")[-1] in ("shoulder", "elbow", "wrist") for name in known_context.names])
    merged = np.flatnonzero((three_wearers.wearer == 0) & (three_wearers.detections.frame >= HIDDEN_FROM))
    others = np.flatnonzero((three_wearers.wearer == 1) & (three_wearers.detections.frame >= HIDDEN_FROM))
    pixels[np.ix_(merged, upper)] = pixels[np.ix_(others, upper)]
    assert np.all(given(known_context, three_wearers, pixels)[merged] == -1)


def test_of_two_who_stand_where_the_wearer_is_none_is_taken(known_context: Context, three_wearers: Sample) -> None:
    pixels = three_wearers.detections.pixels.copy()
    late = three_wearers.detections.frame >= HIDDEN_FROM
    wearer, stranger = (np.flatnonzero(late & (three_wearers.wearer == w)) for w in (0, -1))
    beside = stranger[np.unique(three_wearers.detections.frame[stranger], return_index=True)[1]]
    pixels[beside] = pixels[wearer] + 3.0
    found = given(known_context, three_wearers, pixels)
    assert np.all(found[np.concatenate([wearer, beside])] == -1)


def test_three_joints_are_too_few(known_context: Context, three_wearers: Sample) -> None:
    weight = known_context.weight.copy()
    late = three_wearers.detections.frame >= HIDDEN_FROM
    weight[np.ix_(late, np.cumsum(known_context.weight[0] > 0) > 3)] = 0.0
    assert np.all(given(known_context, three_wearers, weight=weight)[late] == -1)


def test_a_wearer_who_was_hardly_ever_seen_has_no_place(known_context: Context, three_wearers: Sample) -> None:
    seldom = np.where(three_wearers.detections.frame < 5, three_wearers.wearer, -1)
    assert np.array_equal(assign_by_position(known_context, three_wearers.camera, seldom), seldom)


def test_those_left_over_are_added_when_places_are_known_better(three_wearers: Sample) -> None:
    N = len(three_wearers.detections)
    R, p = np.tile(np.eye(3), (N, 1, 1)), np.full((N, 3), np.nan)
    before = Association(sure(three_wearers), np.where(sure(three_wearers) >= 0, 0.95, 0.0), R, p, np.full(N, np.nan))
    found = add_by_position(before, three_wearers.detections, MODEL, three_wearers.motions, three_wearers.camera)
    assert np.array_equal(found.wearer, three_wearers.wearer)
    assert np.array_equal(found.by_place, before.wearer != found.wearer)
    off = AssociationSettings(by_place=False)
    arguments = three_wearers.detections, MODEL, three_wearers.motions, three_wearers.camera
    assert add_by_position(before, *arguments, off) is before
