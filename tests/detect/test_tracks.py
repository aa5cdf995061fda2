"""People keep their numbers from frame to frame."""

import numpy as np
import pytest
from detect.stub_people import IMAGE, People

from vip_factors.detect.blazepose import DetectedPerson, Square
from vip_factors.detect.settings import DetectSettings
from vip_factors.detect.tracks import Tracker, search, tiles

SETTINGS = DetectSettings()


def follow(tracker: Tracker, time: float) -> dict[int, float]:
    """Where each number is, from the left."""
    return {one.number: one.landmarks.following.x for one in tracker.step(IMAGE, time)}


def test_two_people_keep_their_numbers() -> None:
    people = People({"a": (200, 240), "b": (800, 240)})
    tracker = Tracker(people, people, SETTINGS)
    first = follow(tracker, 0.0)
    assert sorted(first.values()) == [200, 800]
    for frame in range(1, 40):
        people.places = {"a": (200 + 10 * frame, 240), "b": (800 - 2 * frame, 240)}
        now = follow(tracker, frame / 30)
        assert set(now) == set(first)
    a = next(number for number, x in first.items() if x == 200)
    assert now[a] == 200 + 10 * 39


def test_somebody_who_comes_in_is_found_by_the_next_search() -> None:
    people = People({"a": (200, 240)})
    tracker = Tracker(people, people, SETTINGS)
    follow(tracker, 0.0)
    people.places["b"] = (800, 240)
    assert len(follow(tracker, 0.1)) == 1
    assert len(follow(tracker, SETTINGS.search_s)) == 2


def test_lost_for_a_moment_the_number_stays_and_for_long_it_is_new() -> None:
    people = People({"a": (200, 240), "b": (800, 240)})
    tracker = Tracker(people, people, SETTINGS)
    first = follow(tracker, 0.0)
    gone = people.places.pop("b")
    assert len(follow(tracker, 0.1)) == 1
    people.places["b"] = gone
    assert set(follow(tracker, 0.6)) == set(first)
    people.places.pop("b")
    for time in (0.7, 1.2, 1.8):
        assert len(follow(tracker, time)) == 1
    people.places["b"] = gone
    assert len(set(follow(tracker, 2.5)) - set(first)) == 1


def test_two_tracks_of_one_person_become_one() -> None:
    people = People({"a": (400, 240), "b": (560, 240)})
    tracker = Tracker(people, people, SETTINGS)
    assert len(follow(tracker, 0.0)) == 2
    people.places = {"a": (480, 240)}  # both squares now show the same person
    assert list(follow(tracker, 0.1)) == [1]


def test_what_the_detector_never_finds_again_is_given_up() -> None:
    people = People({"a": (200, 240), "post": (800, 240)})
    tracker = Tracker(people, people, SETTINGS)
    first = follow(tracker, 0.0)
    post = next(number for number, x in first.items() if x == 800)
    people.missed.add("post")
    follow(tracker, 0.6)
    assert post in follow(tracker, 0.7)  # one search may miss anybody
    assert post not in follow(tracker, 1.2)
    assert tracker.given_up == {post}


def test_whom_the_detector_has_found_twice_it_may_miss() -> None:
    people = People({"a": (200, 240)})
    tracker = Tracker(people, people, SETTINGS)
    follow(tracker, 0.0)
    follow(tracker, 0.6)
    people.missed.add("a")
    for time in (1.2, 1.8, 2.4, 3.0):
        assert list(follow(tracker, time)) == [1]
    assert not tracker.given_up


@pytest.mark.parametrize("size", [(1920, 1080), (1080, 1920), (640, 640), (1000, 300)])
def test_whoever_is_half_as_high_as_a_tile_is_whole_in_one(size: tuple[int, int]) -> None:
    width, height = size
    for part in (squares := tiles(width, height, 2)):
        assert part.side <= max(size)
    smallest = min(one.side for one in squares)
    assert smallest == min(size) / 2
    small = [one for one in squares if one.side == smallest]
    for x in np.linspace(0, width - smallest / 2, 23):
        for y in np.linspace(0, height - smallest / 2, 19):
            assert any(
                one.x - one.side / 2 <= x + 1e-6
                and one.x + one.side / 2 >= x + smallest / 2 - 1e-6
                and one.y - one.side / 2 <= y + 1e-6
                and one.y + one.side / 2 >= y + smallest / 2 - 1e-6
                for one in small
            )


class Finding:
    """A detector that finds some people in every part."""

    def __init__(self, *people: DetectedPerson) -> None:
        self.people = list(people)

    def find(self, image: np.ndarray, part: Square) -> list[DetectedPerson]:
        return self.people


def test_everybody_once_and_the_surest_first() -> None:
    near = [DetectedPerson(Square(100, 100, 200), 0.6), DetectedPerson(Square(110, 100, 210), 0.9)]
    other = DetectedPerson(Square(400, 100, 200), 0.7)
    found = search(np.zeros((300, 600, 3), np.uint8), Finding(*near, other), tiles(600, 300, 1))
    assert found == [near[1], other]
