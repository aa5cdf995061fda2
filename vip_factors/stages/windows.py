"""The frames of an estimate: in step with the video, in overlapping windows, and the stretches that calibrate."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np

from vip_factors.errors import InputError, RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import frame_count
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import SceneSource, shared_interval
from vip_factors.settings import Settings

MapFn = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]
"""As :func:`map`; it may have the calls made elsewhere, and ahead of when they are asked for."""
LEAST_FRAMES = 3


@dataclass(frozen=True)
class WindowPlan:
    """The frames of a recording and its windows.

    Attributes:
        start, rate: seconds of the first frame, and frames per second.
        frames: how many.
        factor: every ``factor``-th frame is used for calibration.
        window, overlap: frames; both whole numbers of coarse ones.
        stretches, stretch: how many calibrate, and coarse frames of each.
        all_calibrate: whether all coarse frames do, and each window starts from their solution.
    """

    start: float
    rate: float
    frames: int
    factor: int
    window: int
    overlap: int
    stretches: int
    stretch: int
    all_calibrate: bool = True

    @classmethod
    def of(cls, name: str, interval: tuple[float, float], settings: Settings, whole: bool = False) -> "WindowPlan":
        """For samples from one instant to another, as :func:`~vip_factors.sensors.frames.resample` places frames.

        Args:
            name: of the recording.
            interval: seconds.
            settings: of all rooms.
            whole: whether to take all frames as one window, however many there are.

        Raises:
            InputError: for a rate that is not positive.
            RecordingError: if the samples cover less than three frames, or more than a day.
        """
        (start, end), rate = interval, settings.frame_rate
        factor = settings.coarse_factor if settings.acceleration else 1
        if not rate > 0:
            raise InputError(f"frame rate {rate:g} Hz: expected a positive number")
        count = frame_count(start, end, rate)
        if ceil(count / factor) < LEAST_FRAMES:
            raise RecordingError(f"recording '{name}' is {end - start:.3f} s long: expected three frames or more")
        plan = cls.one_window(start, rate, count, factor)
        if whole or not settings.windows.use:
            return plan
        if is_long(interval, settings):
            return plan.in_stretches(settings).in_windows(settings)
        return plan.in_windows(settings) if settings.acceleration else plan

    @classmethod
    def one_window(cls, start: float, rate: float, frames: int, factor: int) -> "WindowPlan":
        """All frames together, all of which calibrate."""
        return cls(start, rate, frames, factor, frames, 0, 1, ceil(frames / factor))

    def in_stretches(self, settings: Settings, together: bool = False) -> "WindowPlan":
        """The same frames, of which stretches calibrate; they follow one another if they are to be ``together``."""
        own, rate = settings.windows, self.rate / self.factor
        stretches, seconds = own.calibration_stretches, own.calibration_stretch_s
        if together:
            stretches, seconds = 1, stretches * seconds
        stretch = max(round(seconds * rate), LEAST_FRAMES)
        return replace(self, stretches=stretches, stretch=stretch, all_calibrate=False)

    def in_windows(self, settings: Settings) -> "WindowPlan":
        """The same frames in windows."""
        own, rate, factor = settings.windows, self.rate, self.factor
        window, overlap = (factor * max(round(s * rate / factor), 2) for s in (own.window_s, own.overlap_s))
        if self.all_calibrate and self.frames > window:  # no longer than they need be
            count = ceil((self.frames - overlap) / (window - overlap))
            window = factor * ceil((self.frames + (count - 1) * overlap) / count / factor)
        return replace(self, window=window, overlap=overlap)

    @property
    def all_coarse_time(self) -> Array:
        """Seconds of all coarse frames."""
        return self.coarse_time(slice(0, ceil(self.frames / self.factor)))

    @property
    def is_one_window(self) -> bool:
        """Whether all frames are solved together, and all of them calibrate."""
        return self.all_calibrate and self.frames <= self.window

    def windows(self) -> list[slice]:
        """Frames of each window: as evenly spaced as coarse frames allow, each over the next by the overlap or more."""
        if self.frames <= self.window:
            return [slice(0, self.frames)]
        count = ceil((self.frames - self.overlap) / (self.window - self.overlap))
        last = self.frames - self.window
        starts = [self.factor * round(start / self.factor) for start in np.linspace(0, last, count)]
        # One frame more, so that the last one is coarse too.
        return [*(slice(one, one + self.window + 1) for one in starts[:-1]), slice(starts[-1], self.frames)]

    def calibrating(self) -> list[slice]:
        """Coarse frames of each stretch; all of them together, where that is not more."""
        count = ceil(self.frames / self.factor)
        if self.stretches * self.stretch >= count:
            return [slice(0, count)]
        starts = np.linspace(0, count - self.stretch, self.stretches) if self.stretches > 1 else np.zeros(1)
        return [slice(one, one + self.stretch) for one in np.round(starts).astype(int).tolist()]

    def time(self, frames: slice) -> Array:
        """Seconds ``(n,)`` of a slice of frames."""
        return self.start + np.arange(frames.start, frames.stop) / self.rate

    def coarse_time(self, frames: slice) -> Array:
        """Seconds ``(n,)`` of a slice of coarse frames."""
        return self.start + np.arange(frames.start, frames.stop) / (self.rate / self.factor)


def is_long(interval: tuple[float, float], settings: Settings) -> bool:
    """Whether only some stretches of a recording from one instant to another (seconds) calibrate."""
    return settings.windows.use and interval[1] - interval[0] > settings.windows.above_s


def plan_windows(source: SceneSource, settings: Settings, whole: bool = False) -> WindowPlan:
    """The frames of wearers in front of a camera, or of one whom no camera sees, and their windows.

    Args:
        source: of the scene.
        settings: of all rooms.
        whole: whether to take all frames as one window, however many there are.

    Raises:
        InputError: for a rate that is not positive.
        RecordingError: if the samples cover less than three frames, or more than a day.
    """
    if source.head.cameras:
        return scene_plan(source, settings, whole or settings.calibration.from_truth)
    (recording,) = source.wearers
    return WindowPlan.of(recording.head.name, recording.interval, settings, whole)


def coarse_times(source: SceneSource, settings: Settings) -> list[Array]:
    """Seconds ``(T,)`` of each wearer's coarse frames in a short scene, if they are solved as it stands; else none.

    Raises:
        InputError, RecordingError: as :func:`plan_windows`.
    """
    if any(is_long(wearer.interval, settings) for wearer in source.wearers):
        return []
    if source.head.cameras and settings.fusion.use_camera:
        return [scene_plan(source, settings, whole=True).all_coarse_time] * len(source.wearers)
    return [
        WindowPlan.of(wearer.head.name, wearer.interval, settings, whole=True).all_coarse_time
        for wearer in source.wearers
    ]


def scene_plan(source: SceneSource, settings: Settings, whole: bool = False) -> WindowPlan:
    """Frames over the time that all wearers' sensors cover, in step with the video, and their windows.

    A whole number of frames goes to each video frame (or of video frames to each frame), at about the settings'
    ``frame_rate``, and the frames meet the video's: what the camera saw then need not be interpolated.

    Args:
        source: of the scene.
        settings: of all rooms.
        whole: whether to take all frames as one window, however many there are.

    Raises:
        RecordingError: if the wearers share less than four coarse frames, or more than a day.
    """
    video_rate_s = 10.0  # of a long video that tell its rate
    interval, factor = shared_interval(source), settings.coarse_factor
    if whole or not is_long(interval, settings):
        plan = WindowPlan.one_window(*_in_step(source.between(), interval, settings.frame_rate, factor), factor)
        return plan if whole or not settings.windows.use else plan.in_windows(settings)
    look = source.video_start if np.isfinite(source.video_start) else interval[0]
    video = source.between(look, look + video_rate_s)
    plan = WindowPlan.one_window(*_in_step(video, interval, settings.frame_rate, factor), factor)
    return plan.in_stretches(settings, together=True).in_windows(settings)


def _in_step(
    scene: Scene, interval: tuple[float, float], frame_rate: float, coarse_factor: int
) -> tuple[float, float, int]:
    """Frames within an interval (seconds) as :func:`scene_plan` places them: the first's seconds, rate and count.

    Args:
        scene: whose first camera's first video frames the frames are to meet.
        interval: to cover.
        frame_rate: Hz, about.
        coarse_factor: every so many frames is a coarse one, which is to meet a video frame, not to lie between two.

    Raises:
        RecordingError: for less than four coarse frames, or more than a day.
    """
    start, end = interval
    rate, phase = frame_rate, start
    if scene.camera is not None and scene.camera.detections.rate > 0:
        video = scene.camera.detections.rate
        ratio = frame_rate / video
        rate = video * round(ratio) if ratio >= 1 else video / round(1 / ratio)
        phase = float(scene.camera.timed_detections.time[0])
    first = phase + float(np.ceil((start - phase) * rate - 1e-6)) / rate
    if scene.camera is not None:  # coarse frames are to meet video frames, not to lie between them
        first += ((-round((first - phase) * rate)) % coarse_factor) / rate
    count = frame_count(first, end, rate)
    if count < 3 * coarse_factor + 1:
        raise RecordingError(
            f"scene '{scene.name}': the sensors of all wearers together cover {max(end - start, 0.0):.2f} s: expected "
            f"{(3 * coarse_factor + 1) / rate:.2f} s or more"
        )
    return first, rate, count
