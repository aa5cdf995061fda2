"""Claps and stamps: what sensors feel as a jolt, the image shows as hands or a foot that stop at once.

A stop is a kink of a curve over time. Its second derivative, smoothed by a Gaussian, is that Gaussian, centred on the
kink: so a stop is found to a fraction of a video frame, and the height is the jump in speed. Clapping to synchronise
video and sensors: Pons-Moll et al. 2010, as used for 3DPW (thesis 4.4.3).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.clock_signals import ImageTrack
from vip_factors.ranges import NotNegativeInt
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording

ARMS, LEGS = ("elbow", "wrist", "hand"), ("knee", "ankle", "foot")  # bones whose sensors feel a clap, a stamp
GRID_HZ = 120.0


@dataclass(frozen=True)
class EventSettings:
    """What counts as an event.

    Attributes:
        clap_jolt: m/s² at both arms beyond the smooth motion; quick gestures have 5–10, claps 20–100.
        stamp_jolt: m/s² at a foot or shank; steps have 10–30.
        together: seconds between the jolts of both arms.
        jolt_width: seconds; what lasts longer is no jolt.
        clap_speed, stamp_speed: jump in speed in the image, person sizes (keypoints' diagonal) per second: 1 m/s.
        hands_apart: of a clap, person sizes: wrists of hands that meet are up to 0.25 m apart.
        stop_width: seconds, of the Gaussian that finds a stop: one and a half frames of a usual video.
        apart: seconds between two events.
        agree: seconds within which two pairs of events tell the same offset.
        rival: the second-best offset must have less than this share of the best one's votes.
        most: strongest events used, on either side.
    """

    clap_jolt: float = 15.0
    stamp_jolt: float = 25.0
    together: float = 0.05
    jolt_width: float = 0.06
    clap_speed: float = 0.6
    stamp_speed: float = 0.6
    hands_apart: float = 0.2
    stop_width: float = 0.05
    apart: float = 0.2
    agree: float = 0.03
    rival: float = 0.7
    most: NotNegativeInt = 30


@dataclass(frozen=True)
class Events:
    """Times in seconds ``(n,)`` and strengths ``(n,)``."""

    time: Array
    strength: Array

    def strongest(self, most: int) -> "Events":
        """At most so many events, in the order of time."""
        keep = np.sort(np.argsort(-self.strength)[:most])
        return Events(self.time[keep], self.strength[keep])


@dataclass(frozen=True)
class EventMatch:
    """Offsets that pairs of events vote for, the best first.

    Attributes:
        offsets: seconds to add to the video's times.
        votes: relative to the best one's, which is 1.
        pairs: how many pairs of events support the best.
        sigma: seconds, of the best.
        distinct: whether the second-best is clearly worse.
    """

    offsets: tuple[float, ...]
    votes: tuple[float, ...]
    pairs: int
    sigma: float
    distinct: bool


def jolts_of_clap(recording: Recording, settings: EventSettings) -> Events:
    """When both arms' sensors of a wearer felt a jolt at the same time."""
    left, right = (_jolts(_streams(recording, ARMS, side), settings.clap_jolt, settings) for side in ("left", "right"))
    if not len(left.time) or not len(right.time):
        return Events(np.zeros(0), np.zeros(0))
    nearest = np.abs(left.time[:, None] - right.time).argmin(axis=1)
    both = np.abs(left.time - right.time[nearest]) <= settings.together
    time = (left.time + right.time[nearest])[both] / 2
    return Events(time, np.minimum(left.strength, right.strength[nearest])[both])


def jolts_of_stamp(recording: Recording, settings: EventSettings) -> Events:
    """When a leg's sensor of a wearer felt a jolt."""
    sides = [_jolts(_streams(recording, LEGS, side), settings.stamp_jolt, settings) for side in ("left", "right")]
    return _merged(sides)


def claps_in_image(tracks: Sequence[ImageTrack], keypoints: KeypointSet, settings: EventSettings) -> Events:
    """When the wrists of anybody met and stopped; video time."""
    found = []
    for track in tracks:
        wrists = [track.pixels[:, _index(keypoints, f"{side}_wrist")] for side in ("left", "right")]
        apart = np.linalg.norm(wrists[0] - wrists[1], axis=1) / track.size
        stops = _stops(track.time, apart, settings.clap_speed, settings)
        good = np.isfinite(apart)
        met = np.interp(stops.time, track.time[good], apart[good]) < settings.hands_apart if np.any(good) else []
        found.append(Events(stops.time[met], stops.strength[met]) if len(stops.time) else stops)
    return _merged(found)


def stamps_in_image(tracks: Sequence[ImageTrack], keypoints: KeypointSet, settings: EventSettings) -> Events:
    """When an ankle of anybody moved down and stopped; video time."""
    found = []
    for track in tracks:
        for side in ("left", "right"):
            down = track.pixels[:, _index(keypoints, f"{side}_ankle"), 1] / track.size
            found.append(_stops(track.time, -down, settings.stamp_speed, settings))
    return _merged(found)


def match_events(
    image: Events, sensors: Events, max_offset: float, video_rate: float, settings: EventSettings
) -> EventMatch | None:
    """The offset that most pairs of events, weighted by their strengths, agree upon; None without any pair."""
    image, sensors = image.strongest(settings.most), sensors.strongest(settings.most)
    if not len(image.time) or not len(sensors.time):
        return None
    offset = (sensors.time[None, :] - image.time[:, None]).ravel()
    weight = np.sqrt(np.outer(image.strength / image.strength.max(), sensors.strength / sensors.strength.max())).ravel()
    near = np.abs(offset) <= max_offset
    offset, weight = offset[near], weight[near]
    if not len(offset):
        return None
    votes = np.exp(-0.5 * ((offset[:, None] - offset) / settings.agree) ** 2) @ weight
    best: list[int] = []
    for index in np.argsort(-votes):
        if all(abs(offset[index] - offset[other]) > 5 * settings.agree for other in best):
            best.append(int(index))
    supporters = np.abs(offset - offset[best[0]]) <= 2 * settings.agree
    centre = float(np.average(offset[supporters], weights=weight[supporters]))
    pairs = int(min(supporters.sum(), len(image.time), len(sensors.time)))
    # A stop is seen to a third of a frame; hands deform, and wrists stop a little after palms meet: 15 ms for all.
    one = 0.35 / max(video_rate, 1.0)
    sigma = float(np.hypot(max(one, float(np.std(offset[supporters]))) / np.sqrt(pairs), 0.015))
    relative = tuple(float(votes[index] / votes[best[0]]) for index in best[:5])
    distinct = len(best) < 2 or relative[1] < settings.rival
    return EventMatch((centre, *(float(offset[i]) for i in best[1:5])), relative, pairs, sigma, distinct)


def _index(keypoints: KeypointSet, name: str) -> int:
    return keypoints.keypoints.index(name)


def _streams(recording: Recording, bones: tuple[str, ...], side: str) -> list[ImuStream]:
    wanted = {f"{side}_{bone}" for bone in bones}
    streams = [recording.imus[name] for name in recording.placed if recording.placement.site(name).bone in wanted]
    return [stream for stream in streams if stream.specific_force is not None and len(stream) > 2]


def _jolts(streams: Sequence[ImuStream], least: float, settings: EventSettings) -> Events:
    found = []
    for stream in streams:
        assert stream.specific_force is not None
        smooth = scipy.ndimage.gaussian_filter1d(
            stream.specific_force, settings.jolt_width * stream.rate, axis=0, mode="nearest"
        )
        jolt = np.linalg.norm(stream.specific_force - smooth, axis=1)
        peaks, _ = scipy.signal.find_peaks(jolt, height=least, distance=max(1, round(settings.apart * stream.rate)))
        found.append(Events(stream.time[peaks], jolt[peaks]))
    return _merged(found)


def _stops(time: Array, values: Array, least: float, settings: EventSettings) -> Events:
    """Where values that fell stop falling."""
    good = np.isfinite(values)
    if good.sum() < 5:
        return Events(np.zeros(0), np.zeros(0))
    time, values = time[good], values[good]
    grid = np.arange(time[0], time[-1], 1 / GRID_HZ)
    sigma = settings.stop_width * GRID_HZ
    even = np.interp(grid, time, values)
    bend = scipy.ndimage.gaussian_filter1d(even, sigma, order=2, mode="nearest") * GRID_HZ**2
    jump = bend * settings.stop_width * np.sqrt(2 * np.pi)
    peaks, _ = scipy.signal.find_peaks(jump, height=least, distance=max(1, round(settings.apart * GRID_HZ)))
    peaks = peaks[(peaks > 0) & (peaks < len(grid) - 1)]
    before = np.interp(grid[peaks] - 2 * settings.stop_width, grid, even) - even[peaks]
    peaks = peaks[before > 0.5 * least * 2 * settings.stop_width]
    low, here, high = jump[peaks - 1], jump[peaks], jump[peaks + 1]
    curve = low - 2 * here + high
    shift = np.where(curve < 0, 0.5 * (low - high) / np.where(curve < 0, curve, -1.0), 0.0)
    return Events(grid[peaks] + shift / GRID_HZ, here)


def _merged(parts: Sequence[Events]) -> Events:
    if not parts:
        return Events(np.zeros(0), np.zeros(0))
    time = np.concatenate([one.time for one in parts])
    order = np.argsort(time)
    return Events(time[order], np.concatenate([one.strength for one in parts])[order])
