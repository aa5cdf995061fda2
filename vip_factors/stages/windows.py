"""Frames of an estimate: synchronous with the video, in overlapping windows, and in stretches for calibration."""

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
"""Signature of :func:`map`; calls may run elsewhere and ahead of time."""
LEAST_FRAMES = 3


@dataclass(frozen=True)
class WindowPlan:
    """Frames of a recording and their division into windows.

    Attributes:
        start, rate: seconds of the first frame, and frames per second.
        frames: number of frames.
        factor: every ``factor``-th frame is a coarse frame, used for calibration.
        window, overlap: frames per window and per overlap; both multiples of ``factor``.
        stretches, stretch: number of stretches for calibration, and coarse frames per stretch.
        uses_all_frames: whether all coarse frames calibrate, and each window starts from their solution.
    """

    start: float
    rate: float
    frames: int
    factor: int
    window: int
    overlap: int
    stretches: int
    stretch: int
    uses_all_frames: bool = True

    @classmethod
    def of(
        cls, name: str, interval: tuple[float, float], settings: Settings, single_window: bool = False
    ) -> "WindowPlan":
        """Plan the samples of an interval, with frames as :func:`~vip_factors.sensors.frames.resample` places them.

        Args:
            name: name of the recording.
            interval: first and last instant in seconds.
            settings: settings of all rooms.
            single_window: whether to put all frames into one window.

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
        if single_window or not settings.windows.use:
            return plan
        if is_long(interval, settings):
            return plan.in_stretches(settings).in_windows(settings)
        return plan.in_windows(settings) if settings.acceleration else plan

    @classmethod
    def one_window(cls, start: float, rate: float, frames: int, factor: int) -> "WindowPlan":
        """Plan all frames as one window, all of which calibrate."""
        return cls(start, rate, frames, factor, frames, 0, 1, ceil(frames / factor))

    def in_stretches(self, settings: Settings, consecutive: bool = False) -> "WindowPlan":
        """Calibrate on stretches of the same frames, ``consecutive`` or spread over the recording."""
        options, rate = settings.windows, self.rate / self.factor
        stretches, seconds = options.calibration_stretches, options.calibration_stretch_s
        if consecutive:
            stretches, seconds = 1, stretches * seconds
        stretch = max(round(seconds * rate), LEAST_FRAMES)
        return replace(self, stretches=stretches, stretch=stretch, uses_all_frames=False)

    def in_windows(self, settings: Settings) -> "WindowPlan":
        """Divide the same frames into windows."""
        options, rate, factor = settings.windows, self.rate, self.factor
        window, overlap = (factor * max(round(s * rate / factor), 2) for s in (options.window_s, options.overlap_s))
        if self.uses_all_frames and self.frames > window:  # as short as the count of windows allows
            count = ceil((self.frames - overlap) / (window - overlap))
            window = factor * ceil((self.frames + (count - 1) * overlap) / count / factor)
        return replace(self, window=window, overlap=overlap)

    @property
    def all_coarse_time(self) -> Array:
        """Seconds of all coarse frames."""
        return self.coarse_time(slice(0, ceil(self.frames / self.factor)))

    @property
    def is_one_window(self) -> bool:
        """True if all frames are solved in one window and calibrate."""
        return self.uses_all_frames and self.frames <= self.window

    def windows(self) -> list[slice]:
        """Frames of each window, evenly spaced up to coarse frames, overlapping the next by ``overlap`` or more."""
        if self.frames <= self.window:
            return [slice(0, self.frames)]
        count = ceil((self.frames - self.overlap) / (self.window - self.overlap))
        last_start = self.frames - self.window
        starts = [self.factor * round(start / self.factor) for start in np.linspace(0, last_start, count)]
        # One frame more, so that the last one is coarse too.
        return [*(slice(start, start + self.window + 1) for start in starts[:-1]), slice(starts[-1], self.frames)]

    def calibration_stretches(self) -> list[slice]:
        """Coarse frames of each stretch; a single one if the stretches cover all frames."""
        count = ceil(self.frames / self.factor)
        if self.stretches * self.stretch >= count:
            return [slice(0, count)]
        starts = np.linspace(0, count - self.stretch, self.stretches) if self.stretches > 1 else np.zeros(1)
        return [slice(start, start + self.stretch) for start in np.round(starts).astype(int).tolist()]

    def time(self, frames: slice) -> Array:
        """Seconds ``(n,)`` of a slice of frames."""
        return self.start + np.arange(frames.start, frames.stop) / self.rate

    def coarse_time(self, frames: slice) -> Array:
        """Seconds ``(n,)`` of a slice of coarse frames."""
        return self.start + np.arange(frames.start, frames.stop) / (self.rate / self.factor)


def is_long(interval: tuple[float, float], settings: Settings) -> bool:
    """Return True if only some stretches of a recording with this interval (seconds) calibrate."""
    return settings.windows.use and interval[1] - interval[0] > settings.windows.above_s


def plan_windows(source: SceneSource, settings: Settings, single_window: bool = False) -> WindowPlan:
    """Plan frames and windows of wearers in front of cameras, or of one wearer without a camera.

    Args:
        source: the scene.
        settings: settings of all rooms.
        single_window: whether to put all frames into one window.

    Raises:
        InputError: for a rate that is not positive.
        RecordingError: if the samples cover less than three frames, or more than a day.
    """
    if source.head.cameras:
        return plan_scene(source, settings, single_window or settings.calibration.from_truth)
    (recording,) = source.wearers
    return WindowPlan.of(recording.head.name, recording.interval, settings, single_window)


def coarse_times(source: SceneSource, settings: Settings) -> list[Array]:
    """Seconds ``(T,)`` of each wearer's coarse frames in a short scene; empty for a long one.

    Raises:
        InputError, RecordingError: as :func:`plan_windows`.
    """
    if any(is_long(wearer.interval, settings) for wearer in source.wearers):
        return []
    if source.head.cameras and settings.fusion.use_camera:
        return [plan_scene(source, settings, single_window=True).all_coarse_time] * len(source.wearers)
    return [
        WindowPlan.of(wearer.head.name, wearer.interval, settings, single_window=True).all_coarse_time
        for wearer in source.wearers
    ]


def plan_scene(source: SceneSource, settings: Settings, single_window: bool = False) -> WindowPlan:
    """Plan frames and windows over the time that all wearers' sensors cover, synchronous with the video.

    The rate is a multiple or an integer fraction of the video's, close to the setting ``frame_rate``, so that keypoints
    need not be interpolated.

    Args:
        source: the scene.
        settings: settings of all rooms.
        single_window: whether to put all frames into one window.

    Raises:
        RecordingError: if the wearers share less than four coarse frames, or more than a day.
    """
    video_rate_s = 10.0  # part of a long video from which its rate is measured
    interval, factor = shared_interval(source), settings.coarse_factor
    if single_window or not is_long(interval, settings):
        plan = WindowPlan.one_window(
            *_synchronise_frames(source.between(), interval, settings.frame_rate, factor), factor
        )
        return plan if single_window or not settings.windows.use else plan.in_windows(settings)
    look = source.video_start if np.isfinite(source.video_start) else interval[0]
    video = source.between(look, look + video_rate_s)
    plan = WindowPlan.one_window(*_synchronise_frames(video, interval, settings.frame_rate, factor), factor)
    return plan.in_stretches(settings, consecutive=True).in_windows(settings)


def _synchronise_frames(
    scene: Scene, interval: tuple[float, float], frame_rate: float, coarse_factor: int
) -> tuple[float, float, int]:
    """Time of the first frame, frame rate and frame count in an interval (seconds), as :func:`plan_scene` places them.

    Args:
        scene: scene whose first camera's video frames coincide with frames.
        interval: interval to cover.
        frame_rate: approximate rate, Hz.
        coarse_factor: frames per coarse frame; coarse frames coincide with video frames.

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
    first_time = phase + float(np.ceil((start - phase) * rate - 1e-6)) / rate
    if scene.camera is not None:  # coarse frames coincide with video frames
        first_time += ((-round((first_time - phase) * rate)) % coarse_factor) / rate
    count = frame_count(first_time, end, rate)
    if count < 3 * coarse_factor + 1:
        raise RecordingError(
            f"scene '{scene.name}': the sensors of all wearers have {max(end - start, 0.0):.2f} s in common: expected "
            f"{(3 * coarse_factor + 1) / rate:.2f} s or more"
        )
    return first_time, rate, count
