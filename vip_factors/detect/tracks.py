"""Detection of people in the whole image and in smaller squares, and tracking from frame to frame.

In smaller squares small people are large enough for the detector. Each tracked person has a square, in which it is
sought again after it was lost.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vip_factors.detect.blazepose import (
    DetectedPerson,
    LandmarkModel,
    LiteModel,
    PersonDetector,
    PersonLandmarks,
    Square,
)
from vip_factors.detect.settings import DetectSettings


def tiles(width: int, height: int, levels: int) -> list[Square]:
    """Upright squares that cover an image: all of it, then as wide as its shorter side, then half as wide …"""
    squares = [Square(width / 2, height / 2, max(width, height))]
    shorter = min(width, height)
    for level in range(levels):
        side = shorter / 2**level
        if side >= squares[0].side:
            continue  # a square image, which is the first region
        columns, rows = (_starts(length, side) for length in (width, height))
        squares += [Square(x + side / 2, y + side / 2, side) for y in rows for x in columns]
    return squares


def _starts(length: float, side: float) -> np.ndarray:
    overlap = 0.5  # of neighbouring squares, so that people up to half a square's height are entirely in one of them
    count = 1 + int(np.ceil((length - side) / (side * (1 - overlap)) - 1e-9))
    return np.linspace(0, max(length - side, 0), max(count, 1))


def search(image: np.ndarray, detector: PersonDetector, regions: list[Square]) -> list[DetectedPerson]:
    """All people in an image, once each, by decreasing score. The first region is the whole image."""
    largest = 1.5  # side of a person's square, in sides of a region, above which the person is only partly in it
    people = list[DetectedPerson]()
    for number, region in enumerate(regions):
        limit = np.inf if number == 0 else largest * region.side
        people += [person for person in detector.find(image, region) if person.square.side < limit]
    distinct: list[DetectedPerson] = []
    for person in sorted(people, key=lambda person: -person.score):
        if not any(same_place(person.square, previous.square) for previous in distinct):
            distinct.append(person)
    return distinct


def same_place(a: Square, b: Square) -> bool:
    """Whether two squares may show one person."""
    like_size = 2.0  # largest ratio of their sizes
    same_hip = 0.15  # distance of the hips' middles, in sides
    side = max(a.side, b.side)
    near = np.linalg.norm(a.centre - b.centre) < same_hip * side
    return bool(near and side < like_size * min(a.side, b.side))


# Mean distance of two poses' landmarks, in sides of their squares, below which they show one person. A side is at least
# 1.25 times a person's height, so this is a shoulder's width: a nearer person would be hidden.
SAME_PERSON = 0.1


@dataclass
class Track:
    """Track of one person.

    Attributes:
        number: number of the track.
        landmarks: landmarks in the last frame.
        time: seconds of that frame.
        confirmed: whether the person detector has found the person again since the track began.
        missed: number of searches since then without that.
    """

    number: int
    landmarks: PersonLandmarks
    time: float
    confirmed: bool = False
    missed: int = 0


class Tracker:
    """Tracks all people through a video."""

    def __init__(self, detector: PersonDetector, landmarks: LandmarkModel, settings: DetectSettings) -> None:
        self._detector, self._landmarks, self._settings = detector, landmarks, settings
        self._tracks: list[Track] = []
        self._lost: list[Track] = []
        self._searched_at = -np.inf
        self._count = 0
        self.given_up: set[int] = set()  # numbers of tracks that turned out to show no person

    def step(self, image: np.ndarray, time: float) -> list[Track]:
        """Track all people into the next frame ``(height, width, 3)``, red first, bytes; at increasing seconds."""
        lost_s = 1.0  # for which a lost person keeps the track's number, if found near the same place
        previous_tracks, self._tracks = self._tracks, []
        for track in previous_tracks:
            landmarks = self._landmarks.look(image, track.landmarks.following)
            if self._is_person(landmarks):
                self._tracks.append(replace(track, landmarks=landmarks, time=time))
            else:
                self._lost.append(track)
        self._lost = [track for track in self._lost if time - track.time <= lost_s]
        distinct: list[Track] = []  # the older of two tracks that follow one person
        for track in sorted(self._tracks, key=lambda track: track.number):
            if not any(self._same(track.landmarks, older.landmarks) for older in distinct):
                distinct.append(track)
        self._tracks = distinct
        due = time - self._searched_at >= self._settings.search_s
        if due or len(self._tracks) < len(previous_tracks) or not self._tracks:
            self._search(image, time, self._settings.tile_levels if due else 0)
            self._searched_at = time if due else self._searched_at
        return list(self._tracks)

    def _is_person(self, landmarks: PersonLandmarks) -> bool:
        least_presence = 0.5  # probability of a person in its square according to the landmark model; MediaPipe's value
        return landmarks.presence >= least_presence and landmarks.following.side > 0

    def _search(self, image: np.ndarray, time: float, levels: int) -> None:
        height, width = image.shape[:2]
        found_people = search(image, self._detector, tiles(width, height, levels))
        if levels == self._settings.tile_levels:
            self._confirm([person.square for person in found_people])
        for person in found_people:
            if any(same_place(person.square, track.landmarks.following) for track in self._tracks):
                continue
            landmarks = self._landmarks.look(image, person.square)
            if self._is_person(landmarks):  # the detector's square is approximate: look again in the landmarks' square
                landmarks = self._landmarks.look(image, landmarks.following)
            if not self._is_person(landmarks) or any(self._same(landmarks, track.landmarks) for track in self._tracks):
                continue
            self._tracks.append(self._start_track(landmarks, time))

    def _confirm(self, squares: list[Square]) -> None:
        """Give up tracks that the detector does not find again in other frames."""
        # Searches that may miss a new track: false detections rarely occur twice.
        chances = 2
        for track in self._tracks:
            track.confirmed |= any(same_place(square, track.landmarks.following) for square in squares)
            track.missed += not track.confirmed
        wrong = [track for track in self._tracks if track.missed >= chances]
        self.given_up |= {track.number for track in wrong}
        self._tracks = [track for track in self._tracks if track not in wrong]

    def _start_track(self, landmarks: PersonLandmarks, time: float) -> Track:
        """A new track, or that of a lost person near the same place."""
        for track in sorted(self._lost, key=lambda track: -track.time):
            if same_place(track.landmarks.following, landmarks.square):
                self._lost.remove(track)
                return replace(track, landmarks=landmarks, time=time)
        self._count += 1
        return Track(self._count, landmarks, time)

    def _same(self, a: PersonLandmarks, b: PersonLandmarks) -> bool:
        least_landmarks = 4  # for the comparison
        sure = 0.5  # confidence of a landmark that is compared
        is_sure = (a.confidence > sure) & (b.confidence > sure)
        if is_sure.sum() < least_landmarks:
            return same_place(a.following, b.following)
        distance = np.linalg.norm(a.pixels[is_sure] - b.pixels[is_sure], axis=1).mean()
        return bool(distance < SAME_PERSON * min(a.following.side, b.following.side))


def usual_threads() -> int:
    """Number of available processors, at most four."""
    most_threads = 4  # more do not speed up models of this size
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(most_threads, processors)


def blazepose_tracker(files: tuple[Path, Path], settings: DetectSettings, threads: int) -> Tracker:
    """A tracker that finds and follows people with BlazePose's detector and landmark model."""
    detector, landmarks = (LiteModel(path, threads) for path in files)
    return Tracker(PersonDetector(detector), LandmarkModel(landmarks), settings)
