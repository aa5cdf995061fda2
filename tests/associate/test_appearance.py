"""Clothes help where motion does not decide, and say nothing where all are dressed alike."""

from dataclasses import replace

import numpy as np
import pytest
from association_samples import MODEL, Sample, scene

from vip_factors.associate.appearance import SURELY, clothes_odds
from vip_factors.associate.associate import associate, make_context
from vip_factors.associate.features import Context
from vip_factors.associate.settings import AssociationSettings
from vip_factors.geometry.rotations import Array

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
    odds = clothes_odds(context, dressed(np.where(sample.wearer < 0, 2, sample.wearer)), known)
    later = sample.detections.frame >= 70  # within the window of no sure one
    for w in range(2):
        assert np.median(odds[w, later & (sample.wearer == w)]) > 1
        assert np.median(odds[w, later & (sample.wearer != w)]) < -2
    assert np.abs(odds).max() <= SURELY


def test_clothes_alike_tell_nothing(sample: Sample, context: Context) -> None:
    odds = clothes_odds(context, dressed(np.zeros(len(sample.wearer), int)), sample.wearer)
    assert np.abs(odds).max() < 0.5


def test_torsos_that_nobody_saw_tell_nothing(sample: Sample, context: Context) -> None:
    assert not clothes_odds(context, np.full((len(sample.wearer), 4), np.nan), sample.wearer).any()


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
