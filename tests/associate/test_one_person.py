"""A wearer's tracklet speaks against choices of others while it lasts."""

import numpy as np

from vip_factors.associate.one_person import contradicted, passing

FRAMES = np.repeat(np.arange(30), 2)  # two people in each, one tracklet each
TRACKS = np.tile([0, 1], 30)


def test_somebody_else_in_between_was_a_mistake() -> None:
    wearer = np.where(TRACKS == 0, 0, -1)
    swapped = (FRAMES >= 10) & (FRAMES < 15)
    wearer[swapped] = np.where(TRACKS[swapped] == 1, 0, -1)
    assert np.array_equal(contradicted(FRAMES, TRACKS, wearer), swapped & (TRACKS == 1))


def test_a_tracklet_that_has_a_gap_is_there_all_the_same() -> None:
    wearer = np.where((TRACKS == 0) & (FRAMES != 12), 0, -1)
    wearer[(TRACKS == 1) & (FRAMES == 12)] = 0
    kept = ~((TRACKS == 0) & (FRAMES == 12))  # a blink of the detector
    wrong = contradicted(FRAMES[kept], TRACKS[kept], wearer[kept])
    assert FRAMES[kept][wrong].tolist() == [12]


def test_tracklets_one_after_the_other_do_not_contradict() -> None:
    frame, track = np.arange(30), np.repeat([0, 1], [25, 5])
    assert not contradicted(frame, track, np.zeros(30, int)).any()


def test_two_wearers_and_an_even_choice_are_left_alone() -> None:
    assert not contradicted(FRAMES, TRACKS, TRACKS).any()
    half = np.where((FRAMES >= 15) == TRACKS, 0, -1)  # nobody can say which of the two is right
    assert not contradicted(FRAMES, TRACKS, half).any()


def test_nobody() -> None:
    none = np.zeros(0, int)
    assert len(contradicted(none, none, none)) == 0


def test_nobody_is_a_wearer_for_a_moment() -> None:
    weight = np.ones((60, 17))
    wearer = np.where((TRACKS == 1) & (FRAMES < 4), 0, -1)
    wearer[(TRACKS == 0) & (FRAMES >= 10)] = 0
    assert np.array_equal(passing(TRACKS, wearer, weight, 10.0), TRACKS * (FRAMES < 4) > 0)
    weight[(TRACKS == 1) & (FRAMES >= 4), 5:] = 0  # who then is half hidden
    assert not passing(TRACKS, wearer, weight, 10.0).any()


def test_who_is_found_nowhere_else_is_kept() -> None:
    wearer = np.where((TRACKS == 1) & (FRAMES < 4), 0, -1)
    assert not passing(TRACKS, wearer, np.ones((60, 17)), 10.0).any()
    assert len(passing(TRACKS[:0], wearer[:0], np.ones((0, 17)), 10.0)) == 0
