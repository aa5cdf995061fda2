"""People followed from frame to frame: each with a square of its own, looked for again where it was lost."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from vip_factors.detect.landmarks import PersonLandmarks
from vip_factors.detect.person_detector import PersonDetector
from vip_factors.detect.search import same_place, search, tiles
from vip_factors.detect.settings import DetectSettings
from vip_factors.detect.square import Square

SURE = 0.5  # confidence of a landmark that counts when two poses are compared
ENOUGH = 4  # landmarks that both poses must have for that


class Looker(Protocol):
    """What :class:`~vip_factors.detect.landmarks.LandmarkModel` does."""

    def look(self, image: np.ndarray, square: Square) -> PersonLandmarks:
        """Landmarks of the person in a square."""
        ...


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
    """Follows everybody through a video.

    Args:
        detector: finds people.
        landmarks: finds their landmarks.
        settings: thresholds and periods.
    """

    def __init__(self, detector: PersonDetector, landmarks: Looker, settings: DetectSettings) -> None:
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
        before, self._tracks = self._tracks, []
        for track in before:
            seen = self._landmarks.look(image, track.seen.following)
            if self._is_person(seen):
                self._tracks.append(replace(track, seen=seen, time=time))
            else:
                self._lost.append(track)
        self._lost = [one for one in self._lost if time - one.time <= self._settings.lost_s]
        self._drop_doubles()
        due = time - self._searched >= self._settings.search_s
        if due or len(self._tracks) < len(before) or not self._tracks:
            self._search(image, time, self._settings.tile_levels if due else 0)
            self._searched = time if due else self._searched
        return list(self._tracks)

    def _is_person(self, seen: PersonLandmarks) -> bool:
        return seen.presence >= self._settings.least_presence and seen.following.side > 0

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
        for track in self._tracks:
            track.confirmed |= any(same_place(one, track.seen.following) for one in squares)
            track.missed += not track.confirmed
        wrong = [one for one in self._tracks if one.missed >= self._settings.chances]
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
        both = (a.confidence > SURE) & (b.confidence > SURE)
        if both.sum() < ENOUGH:
            return same_place(a.following, b.following)
        distance = np.linalg.norm(a.pixels[both] - b.pixels[both], axis=1).mean()
        return bool(distance < self._settings.same_person * min(a.following.side, b.following.side))
