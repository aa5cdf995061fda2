"""Looking for people in a whole image: in all of it, and in smaller squares, where small people are large enough."""

import numpy as np

from vip_factors.detect.person_detector import FoundPerson, PersonDetector
from vip_factors.detect.square import Square

OVERLAP = 0.5  # of neighbouring squares: whoever is half as high as a square is whole in one of them
SAME_HIP = 0.15  # distance of the hips' middles, in sides, below which two finds are of one person
LARGEST = 1.5  # side of a person's square, in sides of a tile: whoever is larger is only partly in it
LIKE_SIZE = 2.0  # and of which size they may differ


def whole(width: int, height: int) -> Square:
    """The upright square around an image."""
    return Square(width / 2, height / 2, max(width, height))


def tiles(width: int, height: int, levels: int) -> list[Square]:
    """Upright squares that cover an image: all of it, then as wide as its shorter side, then half as wide …"""
    found = [whole(width, height)]
    shorter = min(width, height)
    for level in range(levels):
        side = shorter / 2**level
        if side >= found[0].side:
            continue  # a square image: seen already
        columns, rows = (_starts(length, side) for length in (width, height))
        found += [Square(x + side / 2, y + side / 2, side) for y in rows for x in columns]
    return found


def _starts(length: float, side: float) -> np.ndarray:
    count = 1 + int(np.ceil((length - side) / (side * (1 - OVERLAP)) - 1e-9))
    return np.linspace(0, max(length - side, 0), max(count, 1))


def search(image: np.ndarray, detector: PersonDetector, parts: list[Square]) -> list[FoundPerson]:
    """Everybody in an image, once each; those who are surest first. The first part is the whole image."""
    found = [
        one
        for number, part in enumerate(parts)
        for one in detector.find(image, part)
        if number == 0 or one.square.side < LARGEST * part.side
    ]
    kept: list[FoundPerson] = []
    for one in sorted(found, key=lambda person: -person.score):
        if not any(same_place(one.square, other.square) for other in kept):
            kept.append(one)
    return kept


def same_place(a: Square, b: Square) -> bool:
    """Whether two squares may be of one person."""
    side = max(a.side, b.side)
    near = np.linalg.norm(a.centre - b.centre) < SAME_HIP * side
    return bool(near and side < LIKE_SIZE * min(a.side, b.side))
