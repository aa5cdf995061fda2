"""A wearer's tracklet speaks against choices of others while it lasts."""

import numpy as np

from vip_factors.associate.tracklets import brief_choices, contradicted

FRAMES = np.repeat(np.arange(30), 2)  # two people in each, one tracklet each
TRACKS = np.tile([0, 1], 30)


def wrong(wearer: np.ndarray, odds: float | np.ndarray = 5.0, kept: np.ndarray | None = None) -> np.ndarray:
    which = np.ones(len(wearer), bool) if kept is None else kept
    each = np.broadcast_to(odds, wearer.shape)[which]
    return contradicted(FRAMES[which], TRACKS[which], wearer[which], each)


def test_somebody_else_in_between_was_a_mistake() -> None:
    wearer = np.where(TRACKS == 0, 0, -1)
    swapped = (FRAMES >= 10) & (FRAMES < 15)
    wearer[swapped] = np.where(TRACKS[swapped] == 1, 0, -1)
    assert np.array_equal(wrong(wearer), swapped & (TRACKS == 1))


def test_who_stands_beside_the_wearer_later_was_not_the_wearer_before() -> None:
    # Tracklet 0 begins late: before, the other one was taken for the wearer, as unsurely as where all hold one pose.
    wearer = np.where((FRAMES < 18) == TRACKS, 0, -1)
    late = (TRACKS == 1) | (FRAMES >= 18)
    unsure = np.where(TRACKS == 1, 0.0, 8.0)
    assert np.array_equal(wrong(wearer, unsure, late), ((TRACKS == 1) & (FRAMES < 18))[late])


def test_tracklets_one_after_the_other_do_not_contradict() -> None:
    frame, track = np.arange(30), np.repeat([0, 1], [25, 5])
    assert not contradicted(frame, track, np.zeros(30, int), np.ones(30)).any()


def test_two_wearers_and_an_even_choice_are_left_alone() -> None:
    assert not wrong(TRACKS).any()
    half = np.where((FRAMES >= 15) == TRACKS, 0, -1)  # nobody can say which of the two is right
    assert not wrong(half).any()


def test_nobody() -> None:
    none = np.zeros(0, int)
    assert len(contradicted(none, none, none, np.zeros(0))) == 0


def test_nobody_is_a_wearer_for_a_moment() -> None:
    weight = np.ones((60, 17))
    wearer = np.where((TRACKS == 1) & (FRAMES < 4), 0, -1)
    wearer[(TRACKS == 0) & (FRAMES >= 10)] = 0
    assert np.array_equal(brief_choices(TRACKS, wearer, weight, 10.0), TRACKS * (FRAMES < 4) > 0)
    weight[(TRACKS == 1) & (FRAMES >= 4), 5:] = 0  # who then is half hidden
    assert not brief_choices(TRACKS, wearer, weight, 10.0).any()


def test_who_is_found_nowhere_else_is_kept() -> None:
    wearer = np.where((TRACKS == 1) & (FRAMES < 4), 0, -1)
    assert not brief_choices(TRACKS, wearer, np.ones((60, 17)), 10.0).any()
    assert len(brief_choices(TRACKS[:0], wearer[:0], np.ones((0, 17)), 10.0)) == 0
