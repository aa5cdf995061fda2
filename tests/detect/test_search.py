"""Squares that are searched for people."""

import numpy as np
import pytest

from vip_factors.detect.person_detector import FoundPerson
from vip_factors.detect.search import search, tiles
from vip_factors.detect.square import Square


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


def test_no_level_is_the_whole_image_only() -> None:
    assert tiles(1920, 1080, 0) == [Square(960, 540, 1920)]


class Finding:
    """A detector that finds some people in every part."""

    def __init__(self, *people: FoundPerson) -> None:
        self.people = list(people)

    def find(self, image: np.ndarray, part: Square) -> list[FoundPerson]:
        return self.people


def test_everybody_once_and_the_surest_first() -> None:
    near = [FoundPerson(Square(100, 100, 200), 0.6), FoundPerson(Square(110, 100, 210), 0.9)]
    other = FoundPerson(Square(400, 100, 200), 0.7)
    found = search(np.zeros((300, 600, 3), np.uint8), Finding(*near, other), tiles(600, 300, 1))
    assert found == [near[1], other]


def test_somebody_larger_than_a_tile_is_left_to_larger_parts() -> None:
    large = FoundPerson(Square(300, 150, 590), 0.9)
    image = np.zeros((300, 600, 3), np.uint8)
    parts = tiles(600, 300, 1)
    assert search(image, Finding(large), parts) == [large]

    class OnlyInTiles(Finding):
        def find(self, image: np.ndarray, part: Square) -> list[FoundPerson]:
            return self.people if part.side < 600 else []

    assert search(image, OnlyInTiles(large), parts) == []
