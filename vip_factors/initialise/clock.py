"""How far the video's clock is off the sensors', found from how people move."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import scipy

from vip_factors.errors import InputError, RecordingError
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.clock_correlation import QUICK_S, CorrelationCurve, correlation_curve, peak_vertex
from vip_factors.initialise.clock_signals import SHORTEST_TRACK_S, ImageTrack, simple_tracks
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.imu_stream import ImuStream, with_orientation
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.settings import MAX_OFFSET_S

OFFSETS_S = 0.35  # either side of the offset that was found for the whole
FIT_S = 0.05  # over which a peak is a parabola
LEAST_STRETCHES = 3  # that make a line


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
    grid_s = 0.008  # between lines, at their ends: a tenth of a peak's width
    at_middle = offset[np.abs(offset) <= OFFSETS_S]
    best, line = -1.0, (0.0, 0.0)
    steps = int(np.ceil(most * half / grid_s))
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
    beside_s = 0.06  # from the line, where a stretch has its own peak
    least_gain = 10.0  # nats of a stretch that counts
    rows = []
    for t, curve in zip(time, gain, strict=True):
        near = np.flatnonzero(np.abs(offset - (line[0] + line[1] * t)) <= beside_s)
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


PEAK_S = 0.35  # around a peak of the curve: a half step lasts 0.5 s
LIMB_S = 0.15  # around the common peak, where each limb has its own


@dataclass(frozen=True)
class ClockOffset:
    """Offset of the video's clock.

    Attributes:
        seconds: to add to the video's times to get the sensors'; the best guess if undetermined.
        sigma: standard deviation in seconds; infinite if undetermined.
        alternatives: other offsets and their agreement relative to the best one's.
        sentence: the offset and how sure it is, for people.
        curve: agreement over all offsets.
        drift: of the clock about that offset, if stretches of the recording tell it.
        clock: from the video's clock to the sensors': with the drift, where it matters.
        finding: why it is undetermined although motions agree: another film.
    """

    seconds: float
    sigma: float
    alternatives: tuple[tuple[float, float], ...]
    sentence: str
    curve: CorrelationCurve
    drift: ClockDrift | None = None
    clock: VideoClock = field(default_factory=VideoClock)
    finding: Finding | None = None

    @property
    def determined(self) -> bool:
        """Whether the offset can be relied upon."""
        return bool(np.isfinite(self.sigma))


def find_clock_offset(scene: Scene, max_offset: float = MAX_OFFSET_S, number: int = 0) -> ClockOffset:
    """Find the seconds to add to the video's times of the camera of a number to get the sensors', up to ``max_offset``
    either way.

    An offset that the scene says already is not used. No association is needed: bodies are followed through the image
    by nearness, and compared with every wearer.

    Raises:
        InputError: if ``max_offset`` is not above 0.
        RecordingError: if the scene has no camera, or nobody is seen for long enough.
    """
    film = _comparison(scene, max_offset, number)
    offset = _checked(_best_offset(film.curve(film.tracks)), film)
    return _with_drift(offset, film) if offset.determined else offset


def film_finding(scene: Scene) -> Finding | None:
    """Find out whether the film is of another session than the sensors' samples.

    Raises:
        RecordingError: as :func:`find_clock_offset`.
    """
    film = _comparison(scene, MAX_OFFSET_S, 0)
    return _checked(_best_offset(film.curve(film.tracks)), film).finding


@dataclass(frozen=True)
class _Comparison:
    """Bodies in the image of a camera beside the sensors of a scene."""

    scene: Scene
    camera: Camera
    tracks: Sequence[ImageTrack]
    max_offset: float

    def curve(self, tracks: Sequence[ImageTrack]) -> CorrelationCurve:
        """Agreement by quick motion, which is exact, plus slow motion, which does not repeat with every step."""
        slow_s = 0.3  # motions are compared once more so smoothed: what is slow tells one step from the next
        quick, slow = (
            correlation_curve(self.scene, self.camera, tracks, self.max_offset, width) for width in (QUICK_S, slow_s)
        )
        return replace(quick, gain=quick.gain + slow.gain)


def _comparison(scene: Scene, max_offset: float, number: int) -> _Comparison:
    if not (np.isfinite(max_offset) and max_offset > 0):
        raise InputError(f"max_offset of {max_offset} s: expected seconds above 0")
    if number >= len(scene.cameras):
        raise RecordingError(f"scene '{scene.name}' has no camera: there is no clock to compare")
    camera = scene.cameras[number]
    tracks = simple_tracks(camera.detections)
    if not tracks:
        raise RecordingError(
            f"scene '{scene.name}': nobody is seen for {SHORTEST_TRACK_S:g} s without a break: expected detections of "
            "people in consecutive video frames"
        )
    scene = replace(scene, wearers=tuple(_oriented(wearer) for wearer in scene.wearers))
    return _Comparison(scene, camera, tracks, max_offset)


def _oriented(recording: Recording) -> Recording:
    """The recording with all orientations that can be found: once, not for every track."""

    def oriented(stream: ImuStream) -> ImuStream:
        try:
            return with_orientation(stream)
        except RecordingError:
            return stream

    return replace(recording, imus={name: oriented(stream) for name, stream in recording.imus.items()})


def _best_offset(curve: CorrelationCurve) -> ClockOffset:
    """Offset of the curve's highest peak; undetermined if the peak is low, at the edge, or has a rival."""
    least_gain = 30.0  # nats; what chance alone gives a few limbs over a thousand offsets stays below 20
    rival = 0.8  # share of the best offset's agreement that the second-best stays below
    offset, gain = curve.offset, curve.gain
    best = int(np.argmax(gain))
    others = [index for index in _peaks(curve) if abs(offset[index] - offset[best]) > PEAK_S][:4]
    alternatives = tuple(
        (peak_vertex(offset, gain, index, FIT_S)[0], float(gain[index] / gain[best])) for index in others
    )
    seconds, curvature = peak_vertex(offset, gain, best, FIT_S)
    if gain[best] < least_gain:
        evidence, is_distinct, sigma = "no limb moves in the image as a sensor tells", False, np.inf
    else:
        scatter, limbs = _limb_scatter(curve, best, seconds)
        # Limbs that follow one another are not independent; exposure and rolling shutter blur a clock by milliseconds.
        inflation, least = 1.5, 0.003  # s
        sigma = float(np.sqrt((inflation * np.hypot(scatter, curvature**-0.5)) ** 2 + least**2))
        evidence = f"{limbs} limbs move as their sensors tell"
        at_edge = min(best, len(gain) - 1 - best) < 3
        is_distinct = (alternatives[0][1] if alternatives else 0.0) < rival and not at_edge
    if is_distinct:
        sentence = f"video {seconds:+.3f} s ± {1e3 * sigma:.0f} ms, from motion: {evidence}"
        return ClockOffset(seconds, sigma, alternatives, sentence, curve)
    offers = ", ".join(f"{time:+.2f} s ({100 * share:.0f} %)" for time, share in alternatives[:2])
    sentence = (
        f"the offset is undetermined: {evidence}"
        + (f"; {seconds:+.2f} s fits best, but nearly as well do {offers}" if offers else "")
        + "; record something that is not repeated, in full view"
    )
    return ClockOffset(seconds, np.inf, alternatives, sentence, curve)


def _peaks(curve: CorrelationCurve) -> list[int]:
    """Indices of the curve's peaks, the highest first; of those close together the highest only."""
    step = float(curve.offset[1] - curve.offset[0])
    peaks, _ = scipy.signal.find_peaks(np.r_[-1.0, curve.gain, -1.0], distance=max(1, round(PEAK_S / step)))
    peaks = peaks[curve.gain[peaks - 1] > 0] - 1
    return [int(index) for index in peaks[np.argsort(-curve.gain[peaks])]]


def _limb_scatter(curve: CorrelationCurve, best: int, seconds: float) -> tuple[float, int]:
    """Standard deviation of the mean of the limbs' own peaks, and how many limbs agree."""
    reach = round(LIMB_S / (curve.offset[1] - curve.offset[0]))
    first = max(best - reach, 0)
    shift, weight, names = [], [], set()
    for limb in curve.limbs_at(best):
        peak = first + int(np.argmax(limb.gain[first : best + reach + 1]))
        top, curvature = peak_vertex(curve.offset, limb.gain, peak, FIT_S)
        shift.append(top - seconds)
        weight.append(curvature)
        names.add((limb.wearer, limb.sensor))
    if len(shift) < 2:
        return LIMB_S / 2, len(names)
    w, d = np.array(weight), np.array(shift)
    return float(np.sqrt(np.sum((w * d) ** 2)) / np.sum(w)), len(names)


def _checked(offset: ClockOffset, film: _Comparison) -> ClockOffset:
    """The offset; undetermined, with a finding, if the film is another one."""
    if not offset.determined:
        return offset
    index = int(np.argmin(np.abs(offset.curve.offset - offset.seconds)))
    if _belongs(offset.curve, index, film):
        return offset
    numbers = {"seconds": offset.seconds, "percent": 100 * offset.curve.explained(index)}
    reason = (
        f"it seems to be of another session: at its best offset ({offset.seconds:+.2f} s) the sensors explain "
        f"{numbers['percent']:.0f} % of how limbs move in the picture, where 35 to 60 are usual, and its halves do not "
        "agree: check the file, and which sensor sits where"
    )
    finding = Finding("video mismatch", numbers=numbers, words={"reason": reason})
    return replace(offset, sigma=np.inf, sentence=str(finding), finding=finding)


def _belongs(curve: CorrelationCurve, index: int, film: _Comparison) -> bool:
    """Whether sensors explain enough of the film at an offset, or some of both halves, or too little is there to tell.

    Of a limb's motion in the image, sensors explained 0.37–0.64 in 17 films of the wearer, in twenty others' up to
    0.38 (once 0.44), or gained up to 156 nats. Where both are less, both halves of the film have to gain some nats at
    the offset: wearers' gain 52 and more, of others' films one half gains less than 20. Of fewer limbs nothing is
    said: with eight keypoints the sensors explain 14 % of the wearer's film.
    """
    enough_explained, sure_gain, half_gain, half_s, fewest_limbs = 0.4, 160.0, 20.0, 2.5, 8
    if curve.explained(index) >= enough_explained or curve.gain[index] >= sure_gain:
        return True
    start, end = min(track.time[0] for track in film.tracks), max(track.time[-1] for track in film.tracks)
    if end - start < 2 * half_s or max(len(limbs) for limbs in curve.tracks) < fewest_limbs:
        return True
    near = np.abs(curve.offset - curve.offset[index]) <= LIMB_S
    middle = (start + end) / 2
    return all(_gain_between(film, *half, near) >= half_gain for half in ((start, middle), (middle, end)))


def _gain_between(film: _Comparison, first: float, last: float, near: Array) -> float:
    """Largest gain at the offsets ``near`` ``(L,)`` in a stretch of the film; 0 where nobody is seen."""
    parts = [part for track in film.tracks if (part := between(track, first, last, 0.0)) is not None]
    return float(film.curve(parts).gain[near].max()) if parts else 0.0


def _with_drift(offset: ClockOffset, film: _Comparison) -> ClockOffset:
    """The offset with the drift that stretches of the recording tell; then it is that of the middle."""
    offset = replace(offset, clock=VideoClock(offset.seconds))
    drift = find_drift(film.scene, film.camera, film.tracks, offset.seconds)
    if drift is None or not drift.matters:
        return replace(offset, drift=drift)
    ms, ppm = 1e3 * drift.per_second * drift.duration, 1e6 * drift.per_second
    sentence = (
        f"{offset.sentence}; it drifts by {ms:+.0f} ms from the video's start to its end ({ppm:+.0f} ± "
        f"{1e6 * drift.sigma:.0f} ppm, from {drift.stretches} stretches), and is {drift.seconds:+.3f} s in between"
    )
    clock = VideoClock(drift.seconds - drift.per_second * drift.middle, drift.per_second)
    return replace(offset, seconds=drift.seconds, sentence=sentence, drift=drift, clock=clock)
