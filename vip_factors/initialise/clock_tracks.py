"""Who is who from frame to frame, by nearness alone: good enough to see limbs move, whoever they belong to."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.geometry.rotations import Array
from vip_factors.ranges import NotNegativeInt, Share
from vip_factors.sensors.detections import Detections


@dataclass(frozen=True)
class TrackSettings:
    """How detections are joined.

    Attributes:
        least_confidence: keypoints below are not used: what detectors say below is mostly guessed.
        reach: mean shift of the keypoints over their spread, from one frame to the next; a runner's is 0.1.
        doubt: two candidates whose shifts differ by less than this factor end the track: better short than mixed.
        longest_gap: seconds that a track survives without a detection.
        shortest: seconds of a track that is worth using.
        most: tracks used at most, the longest: bystanders come and go in thousands.
    """

    least_confidence: Share = 0.2
    reach: float = 0.35
    doubt: float = 1.5
    longest_gap: float = 0.25
    shortest: float = 2.0
    most: NotNegativeInt = 40


@dataclass(frozen=True)
class ImageTrack:
    """One body in consecutive video frames.

    Attributes:
        time: ``(n,)`` seconds on the video's clock, increasing; frames without it are absent.
        pixels: ``(n, K, 2)``, NaN where a keypoint is not seen.
        size: ``(n,)`` pixels, the spread of the keypoints, smoothed over a second or two.
    """

    time: Array
    pixels: Array
    size: Array


def simple_tracks(detections: Detections, settings: TrackSettings | None = None) -> list[ImageTrack]:
    """Tracks of a video, the longest first."""
    settings = settings or TrackSettings()
    pixels = np.where((detections.confidence >= settings.least_confidence)[..., None], detections.pixels, np.nan)
    rows = _joined(detections, pixels, settings)
    tracks = []
    for one in rows:
        time = detections.time[detections.frame[one]]
        if time[-1] - time[0] >= settings.shortest:
            tracks.append(ImageTrack(time, pixels[one], _smooth_size(time, _spread(pixels[one]))))
    tracks.sort(key=lambda track: len(track.time), reverse=True)
    return tracks[: settings.most]


def _joined(detections: Detections, pixels: Array, settings: TrackSettings) -> list[list[int]]:
    """Indices of the detections of each track."""
    done: list[list[int]] = []
    alive: list[list[int]] = []
    for frame in np.unique(detections.frame):
        here = np.arange(*detections.of_frame(int(frame)).indices(len(detections)))
        now = detections.time[frame]
        fresh = [now - detections.time[detections.frame[one[-1]]] <= settings.longest_gap for one in alive]
        done += [one for one, young in zip(alive, fresh, strict=True) if not young]
        alive = [one for one, young in zip(alive, fresh, strict=True) if young]
        taken: set[int] = set()
        if alive:
            shift = _shifts(pixels[[one[-1] for one in alive]], pixels[here])
            ended = []
            for row, column in zip(*linear_sum_assignment(np.minimum(shift, 1e3)), strict=True):
                if shift[row, column] > settings.reach:
                    continue
                rivals = [*np.delete(shift[row], column), *np.delete(shift[:, column], row)]
                if min(rivals, default=np.inf) < settings.doubt * shift[row, column]:
                    ended.append(row)
                    continue
                alive[row].append(int(here[column]))
                taken.add(int(column))
            done += [alive[row] for row in ended]
            alive = [one for row, one in enumerate(alive) if row not in ended]
        alive += [[int(index)] for column, index in enumerate(here) if column not in taken]
    return done + alive


def _shifts(before: Array, after: Array) -> Array:
    """Median distance of common keypoints over their spread ``(A, B)``; infinite for less than four."""
    distance = np.linalg.norm(before[:, None] - after[None], axis=-1)
    common = np.isfinite(distance)
    filled = np.sort(np.where(common, distance, np.inf), axis=-1)
    count = common.sum(axis=-1)
    middle = np.take_along_axis(filled, np.maximum(count // 2, 0)[..., None].clip(max=filled.shape[-1] - 1), axis=-1)
    size = np.fmax(_spread(before), 1.0)
    return np.where(count >= 4, middle[..., 0] / size[:, None], np.inf)


def _spread(pixels: Array) -> Array:
    """Diagonal of the keypoints' bounding box ``(n,)``; 0 where fewer than two are seen."""
    seen = np.isfinite(pixels)
    low = np.where(seen, pixels, np.inf).min(axis=1)
    high = np.where(seen, pixels, -np.inf).max(axis=1)
    return np.linalg.norm(np.where(np.isfinite(low), high - low, 0.0), axis=-1)


def _smooth_size(time: Array, size: Array, window: float = 2.0) -> Array:
    """Large quantile over a window: arms that rise and fall must not look like coming nearer."""
    knots = np.arange(time[0], time[-1] + window / 2, window / 2)
    first, last = np.searchsorted(time, knots - window / 2), np.searchsorted(time, knots + window / 2, side="right")
    values = [np.quantile(size[a:b], 0.8) if b > a else np.nan for a, b in zip(first, last, strict=True)]
    good = np.isfinite(values)
    return np.maximum(np.interp(time, knots[good], np.array(values)[good]), 1.0)
