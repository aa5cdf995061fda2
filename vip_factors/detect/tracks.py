"""People in a video: searched for in the whole image and in smaller squares, then followed from frame to frame.

In smaller squares small people are large enough for the detector. Each person has a square of its own, and is looked
for again where it was lost.
"""

import os
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.detect.blazepose import (
    DetectedPerson,
    LandmarkModel,
    LiteModel,
    PersonDetector,
    PersonLandmarks,
    Square,
)
from vip_factors.detect.model_files import BlazePoseFiles
from vip_factors.detect.settings import DetectSettings


def tiles(width: int, height: int, levels: int) -> list[Square]:
    """Upright squares that cover an image: all of it, then as wide as its shorter side, then half as wide …"""
    found = [Square(width / 2, height / 2, max(width, height))]
    shorter = min(width, height)
    for level in range(levels):
        side = shorter / 2**level
        if side >= found[0].side:
            continue  # a square image: seen already
        columns, rows = (_starts(length, side) for length in (width, height))
        found += [Square(x + side / 2, y + side / 2, side) for y in rows for x in columns]
    return found


def _starts(length: float, side: float) -> np.ndarray:
    overlap = 0.5  # of neighbouring squares: whoever is half as high as a square is whole in one of them
    count = 1 + int(np.ceil((length - side) / (side * (1 - overlap)) - 1e-9))
    return np.linspace(0, max(length - side, 0), max(count, 1))


def search(image: np.ndarray, detector: PersonDetector, parts: list[Square]) -> list[DetectedPerson]:
    """Everybody in an image, once each; those who are surest first. The first part is the whole image."""
    largest = 1.5  # side of a person's square, in sides of a tile: whoever is larger is only partly in it
    found = [
        one
        for number, part in enumerate(parts)
        for one in detector.find(image, part)
        if number == 0 or one.square.side < largest * part.side
    ]
    kept: list[DetectedPerson] = []
    for one in sorted(found, key=lambda person: -person.score):
        if not any(same_place(one.square, other.square) for other in kept):
            kept.append(one)
    return kept


def same_place(a: Square, b: Square) -> bool:
    """Whether two squares may be of one person."""
    like_size = 2.0  # and of which size they may differ
    same_hip = 0.15  # distance of the hips' middles, in sides, below which two finds are of one person
    side = max(a.side, b.side)
    near = np.linalg.norm(a.centre - b.centre) < same_hip * side
    return bool(near and side < like_size * min(a.side, b.side))


# Mean distance of two poses' landmarks, in sides of their squares, below which they are of one person. A side is 1.25
# times a person's height and more, so this is a shoulder's width: nobody stands so near another without hiding him.
SAME_PERSON = 0.1


@dataclass
class Track:
    """One person.

    Attributes:
        number: of the track.
        seen: in the last frame.
        time: of that frame, seconds.
        confirmed: whether the person detector has found the person again since the track began.
        missed: how often it has not, since then.
    """

    number: int
    seen: PersonLandmarks
    time: float
    confirmed: bool = False
    missed: int = 0


class Tracker:
    """Follows everybody through a video."""

    def __init__(self, detector: PersonDetector, landmarks: LandmarkModel, settings: DetectSettings) -> None:
        self._detector, self._landmarks, self._settings = detector, landmarks, settings
        self._tracks: list[Track] = []
        self._lost: list[Track] = []
        self._searched = -np.inf
        self._count = 0
        self.given_up: set[int] = set()  # numbers of tracks that turned out to be of nobody

    def step(self, image: np.ndarray, time: float) -> list[Track]:
        """Everybody in the next frame.

        Args:
            image: ``(height, width, 3)``, red first, bytes.
            time: seconds, increasing.
        """
        lost_s = 1.0  # that a person may be out of sight and keep the track's number, if found about where lost
        before, self._tracks = self._tracks, []
        for track in before:
            seen = self._landmarks.look(image, track.seen.following)
            if self._is_person(seen):
                self._tracks.append(replace(track, seen=seen, time=time))
            else:
                self._lost.append(track)
        self._lost = [one for one in self._lost if time - one.time <= lost_s]
        self._drop_doubles()
        due = time - self._searched >= self._settings.search_s
        if due or len(self._tracks) < len(before) or not self._tracks:
            self._search(image, time, self._settings.tile_levels if due else 0)
            self._searched = time if due else self._searched
        return list(self._tracks)

    def _is_person(self, seen: PersonLandmarks) -> bool:
        least_presence = 0.5  # of the landmark model, that its square shows a person; MediaPipe's own
        return seen.presence >= least_presence and seen.following.side > 0

    def _search(self, image: np.ndarray, time: float, levels: int) -> None:
        height, width = image.shape[:2]
        found_people = search(image, self._detector, tiles(width, height, levels))
        if levels == self._settings.tile_levels:
            self._confirm([one.square for one in found_people])
        for found in found_people:
            if any(same_place(found.square, one.seen.following) for one in self._tracks):
                continue
            seen = self._landmarks.look(image, found.square)
            if self._is_person(seen):  # the detector's square is rough: look again where the landmarks say
                seen = self._landmarks.look(image, seen.following)
            if not self._is_person(seen) or any(self._same(seen, one.seen) for one in self._tracks):
                continue
            self._tracks.append(self._began(seen, time))

    def _confirm(self, squares: list[Square]) -> None:
        """Give up tracks that the detector, which sees another image of them each time, never finds again."""
        # Searches that may miss a new track before it is nobody's: things that look like people seldom do so twice
        chances = 2
        for track in self._tracks:
            track.confirmed |= any(same_place(one, track.seen.following) for one in squares)
            track.missed += not track.confirmed
        wrong = [one for one in self._tracks if one.missed >= chances]
        self.given_up |= {one.number for one in wrong}
        self._tracks = [one for one in self._tracks if one not in wrong]

    def _began(self, seen: PersonLandmarks, time: float) -> Track:
        """A new track, or that of somebody lost about there."""
        for one in sorted(self._lost, key=lambda lost: -lost.time):
            if same_place(one.seen.following, seen.square):
                self._lost.remove(one)
                return replace(one, seen=seen, time=time)
        self._count += 1
        return Track(self._count, seen, time)

    def _drop_doubles(self) -> None:
        """Where two tracks have come to follow one person, the older one stays."""
        kept: list[Track] = []
        for track in sorted(self._tracks, key=lambda one: one.number):
            if not any(self._same(track.seen, other.seen) for other in kept):
                kept.append(track)
        self._tracks = kept

    def _same(self, a: PersonLandmarks, b: PersonLandmarks) -> bool:
        enough = 4  # landmarks that both poses must have for that
        sure = 0.5  # confidence of a landmark that counts when two poses are compared
        both = (a.confidence > sure) & (b.confidence > sure)
        if both.sum() < enough:
            return same_place(a.following, b.following)
        distance = np.linalg.norm(a.pixels[both] - b.pixels[both], axis=1).mean()
        return bool(distance < SAME_PERSON * min(a.following.side, b.following.side))


def usual_threads() -> int:
    """As many as there are processors for us, up to four."""
    most_threads = 4  # more gain nothing on models of this size
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(most_threads, there)


def blazepose_tracker(files: BlazePoseFiles, settings: DetectSettings, threads: int) -> Tracker:
    """A tracker that finds and follows people with BlazePose."""
    detector = PersonDetector(LiteModel(files.detector, threads))
    return Tracker(detector, LandmarkModel(LiteModel(files.landmarks, threads)), settings)
