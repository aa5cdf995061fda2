"""How fast the video's clock drifts from the sensors': offsets in stretches of the recording, and a line through them.

Each stretch has its own curve of agreement over offsets (see :mod:`clock_correlation`). The line along which they agree
best together is searched for first, so that a stretch whose own best offset is a step off does not count; then each
stretch's peak beside that line is one measurement of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.initialise.clock_correlation import correlation_curve, peak_vertex
from vip_factors.initialise.clock_signals import ImageTrack
from vip_factors.sensors.scene import Camera, Scene

OFFSETS_S = 0.35  # either side of the offset that was found for the whole
GRID_S = 0.008  # between lines, at their ends: a tenth of a peak's width
FIT_S = 0.05  # over which a peak is a parabola
LEAST_STRETCHES = 3  # that make a line
BESIDE_S = 0.06  # from the line, where a stretch has its own peak


@dataclass(frozen=True)
class ClockDrift:
    """A line through the offsets of stretches.

    Attributes:
        per_second: seconds more to add in every second of the video.
        sigma: its standard deviation.
        middle: of the video's times, where the line has the offset ``seconds``.
        seconds: to add there to the video's times to get the sensors'.
        duration: of the video, seconds.
        stretches: how many of them tell it.
    """

    per_second: float
    sigma: float
    middle: float
    seconds: float
    duration: float
    stretches: int

    @property
    def matters(self) -> bool:
        """Whether the drift is surely there, and more than 10 ms over the video."""
        return abs(self.per_second) > 4 * self.sigma and abs(self.per_second) * self.duration > 0.010


def find_drift(
    scene: Scene,
    camera: Camera,
    tracks: Sequence[ImageTrack],
    seconds: float,
    stretch: float = 20.0,
    most: float = 2e-3,
) -> ClockDrift | None:
    """The drift about the offset of the whole; None where too few stretches tell one.

    Args:
        scene, camera, tracks: as for the offset.
        seconds: the offset of the whole.
        stretch: seconds of one: enough steps to tell an offset to some milliseconds.
        most: seconds a second; a rate told as 30 for 29.97 Hz is half of it, quartz clocks are a hundred times better.
    """
    start, end = min(track.time[0] for track in tracks), max(track.time[-1] for track in tracks)
    count = int((end - start) // stretch)
    if count < LEAST_STRETCHES:
        return None
    edges, middle = np.linspace(start, end, count + 1), (start + end) / 2
    reach = OFFSETS_S + most * (end - start) / 2
    when, curves, offset = [], [], np.zeros(0)
    for first, last in pairwise(edges.tolist()):
        cut = [part for track in tracks if (part := between(track, first, last, seconds)) is not None]
        if cut:
            curve = correlation_curve(scene, camera, cut, reach)
            when.append((first + last) / 2 - middle)
            curves.append(np.maximum(curve.gain, 0.0))
            offset = curve.offset
    if len(curves) < LEAST_STRETCHES:
        return None
    time, gain = np.array(when), np.stack(curves)
    line = _best_line(offset, gain, time, (end - start) / 2, most)
    measured = _fitted(offset, gain, time, line)
    if measured is None:
        return None
    offset_at_middle, drift, sigma, used = measured
    return ClockDrift(drift, sigma, float(middle), seconds + offset_at_middle, float(end - start), used)


def between(track: ImageTrack, first: float, last: float, seconds: float) -> ImageTrack | None:
    """What of a track lies in a stretch, its times put forward; None for hardly anything."""
    inside = (track.time >= first) & (track.time <= last)
    if inside.sum() < 2:
        return None
    return replace(track, time=track.time[inside] + seconds, pixels=track.pixels[inside], size=track.size[inside])


def _best_line(offset: Array, gain: Array, time: Array, half: float, most: float) -> tuple[float, float]:
    """Offset in the middle and drift of the line ``o + d t`` along which all curves together are highest."""
    at_middle = offset[np.abs(offset) <= OFFSETS_S]
    best, line = -1.0, (0.0, 0.0)
    steps = int(np.ceil(most * half / GRID_S))
    for drift in np.linspace(-most, most, 2 * steps + 1):
        along = [
            np.interp(at_middle + drift * t, offset, curve, left=0.0, right=0.0)
            for t, curve in zip(time, gain, strict=True)
        ]
        total = np.sum(along, axis=0)
        place = int(np.argmax(total))
        if total[place] > best:
            best, line = float(total[place]), (float(at_middle[place]), float(drift))
    return line


def _fitted(
    offset: Array, gain: Array, time: Array, line: tuple[float, float]
) -> tuple[float, float, float, int] | None:
    """Offset, drift, its standard deviation, and how many stretches told: each by its peak beside the line."""
    least_gain = 10.0  # nats of a stretch that counts
    rows = []
    for t, curve in zip(time, gain, strict=True):
        near = np.flatnonzero(np.abs(offset - (line[0] + line[1] * t)) <= BESIDE_S)
        if len(near) and curve[near].max() >= least_gain:
            rows.append((t, *peak_vertex(offset, curve, int(near[np.argmax(curve[near])]), FIT_S)))
    if len(rows) < LEAST_STRETCHES:
        return None
    t, peak, weight = np.array(rows).T
    A = np.stack([np.ones_like(t), t], axis=1)
    information = (A.T * weight) @ A
    offset_at_middle, drift = np.linalg.solve(information, (A.T * weight) @ peak)
    left = peak - offset_at_middle - drift * t
    # Beside what the curves' widths promise, stretches scatter by what limbs and detectors do differently in each.
    scatter = float(np.sum(weight * left**2) / max(len(t) - 2, 1))
    sigma = np.sqrt(np.linalg.inv(information)[1, 1] * max(scatter, 1.0))
    return float(offset_at_middle), float(drift), float(sigma), len(rows)
