"""Offset and drift of the video's clock relative to the sensors', estimated from the motion of people."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import scipy

from vip_factors.errors import InputError, RecordingError
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.clock_correlation import QUICK_S, CorrelationCurve, correlation_curve, peak_vertex
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.detections import SHORTEST_TRACK_S, ImageTrack, simple_tracks
from vip_factors.sensors.imu_stream import ImuStream, with_orientation
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.settings import MAX_OFFSET_S

OFFSETS_S = 0.35  # on either side of the offset of the whole video
FIT_S = 0.05  # half-width of the parabola fitted to a peak
LEAST_STRETCHES = 3  # for a line


@dataclass(frozen=True)
class ClockDrift:
    """Line through the clock offsets of stretches.

    Attributes:
        per_second: drift, seconds per second of the video.
        sigma: standard deviation of the drift.
        middle: middle of the video, seconds on its clock.
        seconds: offset there, to add to the video's times to get the sensors'.
        duration: of the video, seconds.
        stretches: number of stretches used.
    """

    per_second: float
    sigma: float
    middle: float
    seconds: float
    duration: float
    stretches: int

    @property
    def matters(self) -> bool:
        """True if the drift is significant and more than 10 ms over the video."""
        return abs(self.per_second) > 4 * self.sigma and abs(self.per_second) * self.duration > 0.010


def find_drift(
    scene: Scene,
    camera: Camera,
    tracks: Sequence[ImageTrack],
    seconds: float,
    stretch: float = 20.0,
    max_drift: float = 2e-3,
) -> ClockDrift | None:
    """Estimate the drift about the offset of the whole video; None if too few stretches have an offset.

    Stretches of ``stretch`` seconds give an offset to some milliseconds. ``max_drift`` is the largest drift in seconds
    per second; 29.97 Hz declared as 30 Hz is half of it.
    """
    start, end = min(track.time[0] for track in tracks), max(track.time[-1] for track in tracks)
    count = int((end - start) // stretch)
    if count < LEAST_STRETCHES:
        return None
    edges, middle = np.linspace(start, end, count + 1), (start + end) / 2
    reach = OFFSETS_S + max_drift * (end - start) / 2
    when, curves, offset = [], [], np.zeros(0)
    for begin, finish in pairwise(edges.tolist()):
        cut = _cut(tracks, begin, finish, seconds)
        if cut:
            curve = correlation_curve(scene, camera, cut, reach)
            when.append((begin + finish) / 2 - middle)
            curves.append(np.maximum(curve.gain, 0.0))
            offset = curve.offset
    if len(curves) < LEAST_STRETCHES:
        return None
    time, gain = np.array(when), np.stack(curves)
    line = _best_line(offset, gain, time, (end - start) / 2, max_drift)
    measured = _fitted(offset, gain, time, line)
    if measured is None:
        return None
    at_middle, drift, sigma, used = measured
    return ClockDrift(drift, sigma, float(middle), seconds + at_middle, float(end - start), used)


def _cut(tracks: Sequence[ImageTrack], start: float, end: float, seconds: float = 0.0) -> list[ImageTrack]:
    """Pieces of the tracks in a stretch, of two frames or more, with ``seconds`` added to their times."""
    pieces = []
    for track in tracks:
        inside = (track.time >= start) & (track.time <= end)
        if inside.sum() >= 2:
            time = track.time[inside] + seconds
            pieces.append(replace(track, time=time, pixels=track.pixels[inside], size=track.size[inside]))
    return pieces


def _best_line(offset: Array, gain: Array, time: Array, half: float, max_drift: float) -> tuple[float, float]:
    """Offset in the middle and drift of the line ``o + d t`` with the largest sum of all curves."""
    grid_s = 0.008  # between lines at their ends: a tenth of a peak's width
    at_middle = offset[np.abs(offset) <= OFFSETS_S]
    highest, line = -1.0, (0.0, 0.0)
    steps = int(np.ceil(max_drift * half / grid_s))
    for drift in np.linspace(-max_drift, max_drift, 2 * steps + 1):
        along = [
            np.interp(at_middle + drift * t, offset, curve, left=0.0, right=0.0)
            for t, curve in zip(time, gain, strict=True)
        ]
        total = np.sum(along, axis=0)
        place = int(np.argmax(total))
        if total[place] > highest:
            highest, line = float(total[place]), (float(at_middle[place]), float(drift))
    return line


def _fitted(
    offset: Array, gain: Array, time: Array, line: tuple[float, float]
) -> tuple[float, float, float, int] | None:
    """Fit offset, drift and its standard deviation to the peaks near the line; also returns their number."""
    beside_s = 0.06  # largest distance of a stretch's peak from the line
    least_gain = 10.0  # nats of a peak that is used
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
    residual = peak - offset_at_middle - drift * t
    # stretches scatter by more than the curves' widths
    scatter = float(np.sum(weight * residual**2) / max(len(t) - 2, 1))
    sigma = np.sqrt(np.linalg.inv(information)[1, 1] * max(scatter, 1.0))
    return float(offset_at_middle), float(drift), float(sigma), len(rows)


PEAK_S = 0.35  # least distance of two peaks: a half step lasts 0.5 s
LIMB_S = 0.15  # largest distance of a limb's peak from the common one


@dataclass(frozen=True)
class ClockOffset:
    """Offset of the video's clock.

    Attributes:
        seconds: to add to the video's times to get the sensors'; the best guess if undetermined.
        sigma: standard deviation in seconds; infinite if undetermined.
        alternatives: other offsets and their agreement relative to the best one's.
        sentence: offset and uncertainty in words.
        curve: agreement over all offsets.
        drift: of the clock about that offset, if it is determined.
        clock: map from the video's clock to the sensors', with the drift if it matters.
        finding: set if the video seems to be of another session.
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
        """True if the offset is determined."""
        return bool(np.isfinite(self.sigma))


def find_clock_offset(scene: Scene, max_offset: float = MAX_OFFSET_S, number: int = 0) -> ClockOffset:
    """Estimate the offset of a camera's clock, up to ``max_offset`` seconds either way; ``number`` is the camera.

    The scene's declared offset is not used. No association is needed: bodies are tracked in the image and compared with
    every wearer.

    Raises:
        InputError: if ``max_offset`` is not above 0.
        RecordingError: if the scene has no camera, or nobody is visible for long enough.
    """
    film = _comparison(scene, max_offset, number)
    offset = _best_offset(film)
    return _with_drift(offset, film) if offset.determined else offset


def film_finding(scene: Scene) -> Finding | None:
    """Check whether the video is of another session than the sensors' samples; None if not.

    Raises:
        RecordingError: as :func:`find_clock_offset`.
    """
    return _best_offset(_comparison(scene, MAX_OFFSET_S, 0)).finding


@dataclass(frozen=True)
class _Comparison:
    """Body tracks of a camera to compare with the sensors of a scene."""

    scene: Scene
    camera: Camera
    tracks: Sequence[ImageTrack]
    max_offset: float

    def curve(self, tracks: Sequence[ImageTrack]) -> CorrelationCurve:
        """Agreement of quick motion, which is precise, plus that of slow motion, which does not repeat every step."""
        slow_s = 0.3  # width of the smoothing for slow motion
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
            f"scene '{scene.name}': nobody is visible for {SHORTEST_TRACK_S:g} s without a gap: expected detections of "
            "people in consecutive video frames"
        )
    scene = replace(scene, wearers=tuple(_oriented(wearer) for wearer in scene.wearers))
    return _Comparison(scene, camera, tracks, max_offset)


def _oriented(recording: Recording) -> Recording:
    """Compute missing orientations once, not for every track."""

    def oriented(stream: ImuStream) -> ImuStream:
        try:
            return with_orientation(stream)
        except RecordingError:
            return stream

    return replace(recording, imus={name: oriented(stream) for name, stream in recording.imus.items()})


def _best_offset(film: _Comparison) -> ClockOffset:
    """Offset of the curve's highest peak.

    Undetermined if the peak is low, at the edge, or has a rival; with a finding, if the video is of another session.
    """
    least_gain = 30.0  # nats; chance gives less than 20
    rival = 0.8  # largest agreement of the second-best offset relative to the best
    curve = film.curve(film.tracks)
    offset, gain = curve.offset, curve.gain
    top_index = int(np.argmax(gain))
    other_peaks = [index for index in _peaks(curve) if abs(offset[index] - offset[top_index]) > PEAK_S][:4]
    alternatives = tuple(
        (peak_vertex(offset, gain, index, FIT_S)[0], float(gain[index] / gain[top_index])) for index in other_peaks
    )
    seconds, curvature = peak_vertex(offset, gain, top_index, FIT_S)
    if gain[top_index] < least_gain:
        evidence, is_distinct, sigma = "no limb moves in the image as a sensor tells", False, np.inf
    else:
        scatter, limbs = _limb_scatter(curve, top_index, seconds)
        # limbs are not independent; exposure and rolling shutter blur a clock by milliseconds
        inflation, least = 1.5, 0.003  # s
        sigma = float(np.sqrt((inflation * np.hypot(scatter, curvature**-0.5)) ** 2 + least**2))
        evidence = f"{limbs} limbs move as their sensors measure"
        at_edge = min(top_index, len(gain) - 1 - top_index) < 3
        is_distinct = (alternatives[0][1] if alternatives else 0.0) < rival and not at_edge
    if is_distinct:
        sentence = f"video {seconds:+.3f} s ± {1e3 * sigma:.0f} ms, from motion: {evidence}"
        finding = _other_session(curve, seconds, film)
        if finding is not None:
            sigma, sentence = np.inf, str(finding)
        return ClockOffset(seconds, sigma, alternatives, sentence, curve, finding=finding)
    offers = ", ".join(f"{time:+.2f} s ({100 * share:.0f} %)" for time, share in alternatives[:2])
    sentence = (
        f"the offset is undetermined: {evidence}"
        + (f"; {seconds:+.2f} s fits best, but nearly as well do {offers}" if offers else "")
        + "; record something that is not repeated, in full view"
    )
    return ClockOffset(seconds, np.inf, alternatives, sentence, curve)


def _peaks(curve: CorrelationCurve) -> list[int]:
    """Indices of the curve's peaks, the highest first; of close peaks only the highest."""
    step = float(curve.offset[1] - curve.offset[0])
    peaks, _ = scipy.signal.find_peaks(np.r_[-1.0, curve.gain, -1.0], distance=max(1, round(PEAK_S / step)))
    peaks = peaks[curve.gain[peaks - 1] > 0] - 1
    return [int(index) for index in peaks[np.argsort(-curve.gain[peaks])]]


def _limb_scatter(curve: CorrelationCurve, top_index: int, seconds: float) -> tuple[float, int]:
    """Standard deviation of the mean of the limbs' peaks, and the number of limbs."""
    reach = round(LIMB_S / (curve.offset[1] - curve.offset[0]))
    start = max(top_index - reach, 0)
    shift, weight, names = [], [], set()
    agreeing = [limb for pair in curve.pairs if pair.chosen[top_index] for limb in curve.limbs_of(pair)]
    for limb in (limb for limb in agreeing if limb.gain[top_index] > 0):
        peak = start + int(np.argmax(limb.gain[start : top_index + reach + 1]))
        top, curvature = peak_vertex(curve.offset, limb.gain, peak, FIT_S)
        shift.append(top - seconds)
        weight.append(curvature)
        names.add((limb.wearer, limb.sensor))
    if len(shift) < 2:
        return LIMB_S / 2, len(names)
    w, d = np.array(weight), np.array(shift)
    return float(np.sqrt(np.sum((w * d) ** 2)) / np.sum(w)), len(names)


def _other_session(curve: CorrelationCurve, seconds: float, film: _Comparison) -> Finding | None:
    """Check whether the sensors explain the video at its best offset."""
    index = int(np.argmin(np.abs(curve.offset - seconds)))
    if _belongs(curve, index, film):
        return None
    numbers = {"seconds": seconds, "percent": 100 * curve.explained(index)}
    reason = (
        f"it seems to be of another session: at its best offset ({seconds:+.2f} s) the sensors explain "
        f"{numbers['percent']:.0f} % of how limbs move in the picture, where 35 to 60 are usual, and its halves do not "
        "agree: check the file, and which sensor sits where"
    )
    return Finding("video mismatch", numbers=numbers, words={"reason": reason})


def _belongs(curve: CorrelationCurve, index: int, film: _Comparison) -> bool:
    """Test if the sensors explain the video at an offset, or both its halves; True if it is too short to decide.

    Sensors explain 0.37–0.64 of limbs' motion in videos of the wearer, up to 0.44 in others, where at least one half
    gains less than 20 nats. With few limbs the shares are smaller, and nothing is decided.
    """
    enough_explained, sure_gain, half_gain, half_s, fewest_limbs = 0.4, 160.0, 20.0, 2.5, 8
    if curve.explained(index) >= enough_explained or curve.gain[index] >= sure_gain:
        return True
    start, end = min(track.time[0] for track in film.tracks), max(track.time[-1] for track in film.tracks)
    if end - start < 2 * half_s or max(len(limbs) for limbs in curve.tracks) < fewest_limbs:
        return True
    near = np.abs(curve.offset - curve.offset[index]) <= LIMB_S
    middle = (start + end) / 2
    halves = (_cut(film.tracks, *half) for half in ((start, middle), (middle, end)))
    return all(half and film.curve(half).gain[near].max() >= half_gain for half in halves)


def _with_drift(offset: ClockOffset, film: _Comparison) -> ClockOffset:
    """Add the drift; with a drift that matters the offset refers to the middle of the video."""
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
