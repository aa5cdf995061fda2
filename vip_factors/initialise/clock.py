"""How far the video's clock is off the sensors': found from how people move, or from a clap or stamp."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from vip_factors.errors import InputError, RecordingError
from vip_factors.findings import Finding
from vip_factors.initialise.clock_correlation import CorrelationCurve, correlation_curve, peak_vertex
from vip_factors.initialise.clock_drift import ClockDrift, DriftSettings, between, find_drift
from vip_factors.initialise.clock_events import (
    EventMatch,
    Events,
    EventSettings,
    claps_in_image,
    jolts_of_clap,
    jolts_of_stamp,
    match_events,
    stamps_in_image,
)
from vip_factors.initialise.clock_signals import ImageTrack, Smoothing, TrackSettings, simple_tracks
from vip_factors.sensors.camera_model import VideoClock
from vip_factors.sensors.imu_stream import ImuStream, with_orientation
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene

UNDETERMINED = "undetermined"
PEAK_S = 0.35  # around a peak of the curve: a half step lasts 0.5 s
FIT_S = 0.05  # over which a peak is a parabola
LIMB_S = 0.15  # around the common peak, where each limb has its own
# True duration over the stated one, where a film's rate was taken for another's: 25, 30, 50, 60, 120 frames a second.
STRETCHES = (0.25, 0.5, 0.8, 5 / 6, 1.2, 1.25, 2.0, 4.0)
STRETCHED_S = 30.0  # of film that tells
# A stretch's agreement over that of the film as it is: at most 0.48 at right rates, above 2 at wrong ones.
LIKELIER = 1.3
# Of a limb's motion in the image, explained by its sensor: 0.37–0.64 in 17 films of the wearer, in twenty others' up to
# 0.38 (once 0.44), or nats that they gain: up to 156. Where both are less, both halves of the film, if they last so
# long, have to gain some nats at the offset: wearers' gain 52 and more, of others' films one half gains less than 20.
# Of fewer limbs nothing is said: with eight keypoints the sensors explain 14 % of the wearer's film.
EXPLAINED, SURE_GAIN, HALF_GAIN, HALF_S, FEWEST_LIMBS = 0.4, 160.0, 20.0, 2.5, 8


@dataclass(frozen=True)
class ClockSettings:
    """How the offset is looked for.

    Attributes:
        method: how people move, an event, or whichever tells.
        max_offset: seconds either way: what two people pressing buttons, or two clocks set by network, differ by.
        independent: independent instants in one width of the smoothing Gaussian: 1 over twice the root of pi.
        slow_width: seconds; motions are compared once more so smoothed: what is slow tells one step from the next.
        rival: the second-best offset must have less than this share of the best one's agreement.
        least_gain: nats; what chance alone gives a few limbs over a thousand offsets stays below 20.
        least_sigma: seconds; exposure and rolling shutter of a camera blur its clock by some milliseconds.
        inflation: of sigma: limbs that follow one another are not independent.
    """

    method: Literal["auto", "motion", "clap", "stamp"] = "auto"
    max_offset: float = 10.0
    independent: float = 0.28
    slow_width: float = 0.3
    rival: float = 0.8
    least_gain: float = 30.0
    least_sigma: float = 0.003
    inflation: float = 1.5
    smoothing: Smoothing = field(default_factory=Smoothing)
    tracks: TrackSettings = field(default_factory=TrackSettings)
    events: EventSettings = field(default_factory=EventSettings)
    drift: DriftSettings = field(default_factory=DriftSettings)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.max_offset) and self.max_offset > 0):
            raise InputError(f"max_offset of {self.max_offset} s: expected seconds above 0")


@dataclass(frozen=True)
class ClockOffset:
    """What was found.

    Attributes:
        seconds: to add to the video's times to get the sensors'; the best guess if undetermined.
        sigma: standard deviation in seconds; infinite if undetermined.
        method: ``"motion"``, ``"clap"``, ``"stamp"``, a pair of them that agree, or ``"undetermined"``.
        score: 0 to 1, how much worse the second-best offset is.
        alternatives: other offsets and their agreement relative to the best one's.
        sentence: what was found and how sure it is, for people.
        curve: agreement over all offsets, if motions were compared.
        drift: of the clock about that offset, if stretches of the recording tell it.
        clock: from the video's clock to the sensors': with the drift, where it matters.
        findings: why it is undetermined although motions agree: a wrong frame rate, another film.
    """

    seconds: float
    sigma: float
    method: str
    score: float
    alternatives: tuple[tuple[float, float], ...]
    sentence: str
    curve: CorrelationCurve | None = None
    drift: ClockDrift | None = None
    clock: VideoClock = field(default_factory=VideoClock)
    findings: tuple[Finding, ...] = ()

    @property
    def determined(self) -> bool:
        """Whether the offset can be relied upon."""
        return self.method != UNDETERMINED


@dataclass(frozen=True)
class _Candidate:
    method: str
    seconds: float
    sigma: float
    distinct: bool
    score: float
    alternatives: tuple[tuple[float, float], ...]
    evidence: str


def find_clock_offset(scene: Scene, settings: ClockSettings | None = None) -> ClockOffset:
    """Seconds to add to the video's times to get the sensors'; an offset that the scene says already is not used.

    It needs no association: bodies are followed through the image by nearness, and compared with every wearer.

    Raises:
        RecordingError: if the scene has no camera, or nobody is seen for long enough.
    """
    settings = settings or ClockSettings()
    camera = scene.camera
    if camera is None:
        raise RecordingError(f"scene '{scene.name}' has no camera: there is no clock to compare")
    scene = replace(scene, wearers=tuple(_oriented(one) for one in scene.wearers))
    tracks = simple_tracks(camera.detections, settings.tracks)
    if not tracks:
        raise RecordingError(
            f"scene '{scene.name}': nobody is seen for {settings.tracks.shortest:g} s without a break: expected "
            "detections of people in consecutive video frames"
        )
    curve = None
    candidates = []
    if settings.method in ("auto", "motion"):
        curve = _motion_curve(scene, camera, tracks, settings)
        candidates.append(_from_motion(curve, settings))
    if settings.method in ("auto", "clap"):
        claps = claps_in_image(tracks, camera.detections.keypoints, settings.events)
        candidates.append(_from_events("clap", claps, scene, camera, jolts_of_clap, settings))
    if settings.method in ("auto", "stamp"):
        stamps = stamps_in_image(tracks, camera.detections.keypoints, settings.events)
        candidates.append(_from_events("stamp", stamps, scene, camera, jolts_of_stamp, settings))
    found = _doubted(_decided(candidates, curve, settings), scene, camera, tracks, settings)
    return _with_drift(found, scene, camera, tracks, settings)


def _doubted(
    offset: ClockOffset, scene: Scene, camera: Camera, tracks: Sequence[ImageTrack], settings: ClockSettings
) -> ClockOffset:
    """The same; undetermined, with a finding, if the film has another rate or is another one."""
    if offset.curve is None:
        return offset
    found = _other_rate(scene, camera, tracks, settings)
    if found is None and offset.method == "motion":
        index = int(np.argmin(np.abs(offset.curve.offset - offset.seconds)))
        if _belongs(offset.curve, index, scene, camera, tracks, settings) is False:
            percent = 100 * offset.curve.explained(index)
            found = Finding("another film", numbers={"seconds": offset.seconds, "percent": percent})
    if found is None:
        return offset
    return replace(offset, sigma=np.inf, method=UNDETERMINED, sentence=str(found), findings=(found,))


def _other_rate(
    scene: Scene, camera: Camera, tracks: Sequence[ImageTrack], settings: ClockSettings
) -> Finding | None:  # fmt: skip
    """Whether the film's beginning agrees much better with the sensors if it runs faster or slower."""
    begin, first = float(camera.detections.time[0]), min(float(one.time[0]) for one in tracks)
    cut = [one for track in tracks if (one := between(track, first, first + STRETCHED_S, 0.0)) is not None]
    stated = float(_motion_curve(scene, camera, cut, settings).gain.max())
    best, found = max(LIKELIER * stated, settings.least_gain), None
    for stretch in STRETCHES:
        # Its first frame stays where it is: somebody who comes later comes later or earlier by so much.
        moved = replace(settings, max_offset=settings.max_offset + abs(stretch - 1) * (first - begin))
        stretched = [replace(one, time=begin + stretch * (one.time - begin)) for one in cut]
        curve = _motion_curve(scene, camera, stretched, moved)
        index = int(np.argmax(curve.gain))
        if curve.gain[index] > best and _belongs(curve, index, scene, camera, stretched, moved):
            best, rate = float(curve.gain[index]), camera.detections.rate
            found = Finding(
                "video rate", numbers={"better": rate / stretch, "stated": rate, "nats": best - max(stated, 0.0)}
            )
    return found


def _belongs(
    curve: CorrelationCurve, index: int, scene: Scene, camera: Camera, tracks: Sequence[ImageTrack],
    settings: ClockSettings,
) -> bool | None:  # fmt: skip
    """Whether sensors explain enough of the film at an offset, or some of both halves; None if too short to tell."""
    if curve.explained(index) >= EXPLAINED or curve.gain[index] >= SURE_GAIN:
        return True
    start, end = min(one.time[0] for one in tracks), max(one.time[-1] for one in tracks)
    if end - start < 2 * HALF_S or max(len(one) for one in curve.tracks) < FEWEST_LIMBS:
        return None
    near = np.abs(curve.offset - curve.offset[index]) <= LIMB_S
    for first, last in ((start, (start + end) / 2), ((start + end) / 2, end)):
        half = [one for track in tracks if (one := between(track, first, last, 0.0)) is not None]
        if not half or _motion_curve(scene, camera, half, settings).gain[near].max() < HALF_GAIN:
            return False
    return True


def _with_drift(
    offset: ClockOffset, scene: Scene, camera: Camera, tracks: Sequence[ImageTrack], settings: ClockSettings
) -> ClockOffset:
    """The same with the drift that stretches of the recording tell; the offset is that of the middle then."""
    offset = replace(offset, clock=VideoClock(offset.seconds))
    if not (offset.determined and settings.drift.use):
        return offset
    independent_hz = settings.independent / settings.smoothing.width
    drift = find_drift(scene, camera, tracks, offset.seconds, independent_hz, settings.smoothing, settings.drift)
    if drift is None or not drift.matters(settings.drift):
        return replace(offset, drift=drift)
    ms, ppm = 1e3 * drift.per_second * drift.duration, 1e6 * drift.per_second
    sentence = (
        f"{offset.sentence}; it drifts by {ms:+.0f} ms from the video's start to its end ({ppm:+.0f} ± "
        f"{1e6 * drift.sigma:.0f} ppm, from {drift.stretches} stretches), and is {drift.seconds:+.3f} s in between"
    )
    clock = VideoClock(drift.seconds - drift.per_second * drift.middle, drift.per_second)
    return replace(offset, seconds=drift.seconds, sentence=sentence, drift=drift, clock=clock)


def _oriented(recording: Recording) -> Recording:
    """With the orientation of every sensor that has or can have one: found once, not for every track."""

    def one(stream: ImuStream) -> ImuStream:
        try:
            return with_orientation(stream)
        except RecordingError:
            return stream

    return replace(recording, imus={name: one(stream) for name, stream in recording.imus.items()})


def _motion_curve(
    scene: Scene, camera: Camera, tracks: Sequence[ImageTrack], settings: ClockSettings
) -> CorrelationCurve:
    """Quick motion, which is exact, plus slow motion, which does not repeat with every step."""

    def curve(smoothing: Smoothing) -> CorrelationCurve:
        independent_hz = settings.independent / smoothing.width
        return correlation_curve(scene, camera, tracks, settings.max_offset, independent_hz, smoothing)

    quick, slow = curve(settings.smoothing), curve(replace(settings.smoothing, width=settings.slow_width))
    return replace(quick, gain=quick.gain + slow.gain)


def _from_motion(curve: CorrelationCurve, settings: ClockSettings) -> _Candidate:
    gain = curve.gain
    best = int(np.argmax(gain))
    peaks = _peaks(curve)
    others = [index for index in peaks if abs(curve.offset[index] - curve.offset[best]) > PEAK_S]
    alternatives = tuple(
        (peak_vertex(curve.offset, gain, index, FIT_S)[0], float(gain[index] / gain[best])) for index in others
    )
    seconds, curvature = peak_vertex(curve.offset, gain, best, FIT_S)
    if gain[best] < settings.least_gain:
        evidence = "no limb moves in the image as a sensor tells"
        return _Candidate("motion", seconds, np.inf, False, 0.0, alternatives[:4], evidence)
    second = alternatives[0][1] if alternatives else 0.0
    sigma, limbs = _limb_scatter(curve, best, seconds)
    sigma = float(np.sqrt((settings.inflation * np.hypot(sigma, curvature**-0.5)) ** 2 + settings.least_sigma**2))
    evidence = f"{limbs} limbs move as their sensors tell"
    at_edge = min(best, len(gain) - 1 - best) < 3
    return _Candidate(
        "motion", seconds, sigma, second < settings.rival and not at_edge, 1 - second, alternatives[:4], evidence
    )


def _peaks(curve: CorrelationCurve) -> list[int]:
    """Indices of the curve's peaks, the highest first; of those close together the highest only."""
    from scipy.signal import find_peaks

    step = float(curve.offset[1] - curve.offset[0])
    found, _ = find_peaks(np.r_[-1.0, curve.gain, -1.0], distance=max(1, round(PEAK_S / step)))
    found = found[curve.gain[found - 1] > 0] - 1
    return [int(index) for index in found[np.argsort(-curve.gain[found])]]


def _limb_scatter(curve: CorrelationCurve, best: int, seconds: float) -> tuple[float, int]:
    """Standard deviation of the mean of the limbs' own peaks, and how many limbs agree."""
    reach = round(LIMB_S / (curve.offset[1] - curve.offset[0]))
    first = max(best - reach, 0)
    shift, weight, names = [], [], set()
    for limb in curve.limbs_at(best):
        own = first + int(np.argmax(limb.gain[first : best + reach + 1]))
        top, curvature = peak_vertex(curve.offset, limb.gain, own, FIT_S)
        shift.append(top - seconds)
        weight.append(curvature)
        names.add((limb.wearer, limb.sensor))
    if len(shift) < 2:
        return LIMB_S / 2, len(names)
    w, d = np.array(weight), np.array(shift)
    return float(np.sqrt(np.sum((w * d) ** 2)) / np.sum(w)), len(names)


def _from_events(
    kind: str,
    seen: Events,
    scene: Scene,
    camera: Camera,
    jolts: Callable[..., Events],
    settings: ClockSettings,
) -> _Candidate:
    matches: list[EventMatch] = []
    felt = 0
    for recording in scene.wearers:
        events = jolts(recording, settings.events)
        felt += len(events.time)
        match = match_events(seen, events, settings.max_offset, camera.detections.rate, settings.events)
        matches += [match] if match is not None else []
    if not matches:
        evidence = f"{len(seen.time)} {kind}s seen, {felt} felt"
        return _Candidate(kind, 0.0, np.inf, False, 0.0, (), evidence)
    best = max(matches, key=lambda match: match.pairs)
    alternatives = tuple(zip(best.offsets[1:], best.votes[1:], strict=True))
    evidence = f"{best.pairs} {kind}{'s' if best.pairs > 1 else ''} seen and felt"
    second = best.votes[1] if len(best.votes) > 1 else 0.0
    # Everybody steps: one step seen and felt is no stamp, unless the user says so.
    distinct = best.distinct and (kind != "stamp" or best.pairs > 1 or settings.method == "stamp")
    return _Candidate(kind, best.offsets[0], best.sigma, distinct, 1 - second, alternatives, evidence)


def _decided(
    candidates: list[_Candidate], curve: CorrelationCurve | None, settings: ClockSettings
) -> ClockOffset:  # fmt: skip
    distinct = [one for one in candidates if one.distinct]
    if not distinct:
        best = candidates[0]
        offers = ", ".join(f"{seconds:+.2f} s ({100 * share:.0f} %)" for seconds, share in best.alternatives[:2])
        sentence = (
            f"the offset is undetermined: {'; '.join(one.evidence for one in candidates)}"
            + (f"; {best.seconds:+.2f} s fits best, but nearly as well do {offers}" if offers else "")
            + "; clap once, well in view, or record something that is not repeated"
        )
        return ClockOffset(best.seconds, np.inf, UNDETERMINED, best.score, best.alternatives, sentence, curve)
    best = distinct[0]
    best = _refined(best, curve, settings)
    agreeing = [one for one in distinct[1:] if _agree(one, best)]
    against = [one for one in distinct[1:] if not _agree(one, best)]
    method = " and ".join(dict.fromkeys([best.method, *(one.method for one in agreeing)]))
    sentence = f"video {best.seconds:+.3f} s ± {1e3 * best.sigma:.0f} ms, from {method}: " + "; ".join(
        one.evidence for one in [best, *agreeing]
    )
    for one in against:
        sentence += f"; but {one.evidence} at {one.seconds:+.3f} s: check it"
    return ClockOffset(best.seconds, best.sigma, method, best.score, best.alternatives, sentence, curve)


def _agree(one: _Candidate, other: _Candidate) -> bool:
    return abs(one.seconds - other.seconds) <= max(4 * float(np.hypot(one.sigma, other.sigma)), 0.05)


def _refined(event: _Candidate, curve: CorrelationCurve | None, settings: ClockSettings) -> _Candidate:
    """An event tells which peak of an ambiguous curve is meant; the peak tells the offset more exactly."""
    if curve is None or event.method == "motion":
        return event
    top = float(curve.gain.max())
    near = [index for index in _peaks(curve) if abs(curve.offset[index] - event.seconds) < 4 * event.sigma]
    if not near or curve.gain[near[0]] < max(settings.least_gain, settings.rival * top):
        return event
    seconds, curvature = peak_vertex(curve.offset, curve.gain, near[0], FIT_S)
    scatter, limbs = _limb_scatter(curve, near[0], seconds)
    sigma = float(np.hypot(settings.inflation * np.hypot(scatter, curvature**-0.5), settings.least_sigma))
    if sigma > event.sigma:
        return event
    return replace(
        event, seconds=seconds, sigma=sigma, method=f"{event.method} and motion",
        evidence=f"{event.evidence}, and {limbs} limbs move as their sensors tell",
    )  # fmt: skip
