"""The frames of an estimate: in step with the video, in overlapping windows, and the stretches that calibrate."""

from dataclasses import dataclass
from math import ceil

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import frame_count
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings

LEAST_FRAMES = 3


@dataclass(frozen=True)
class WindowPlan:
    """The frames of a recording and its windows.

    Attributes:
        start, rate: seconds of the first frame, and frames per second.
        frames: how many.
        factor: every so-manieth frame is a coarse one.
        window, overlap: frames; both whole numbers of coarse ones.
        stretches, stretch: how many calibrate, and coarse frames of each.
    """

    start: float
    rate: float
    frames: int
    factor: int
    window: int
    overlap: int
    stretches: int
    stretch: int

    @classmethod
    def of(cls, interval: tuple[float, float], settings: Settings) -> "WindowPlan":
        """For samples from one instant to another, as :func:`~vip_factors.sensors.frames.resample` places frames.

        Raises:
            RecordingError: if they cover less than three frames, or more than a day.
        """
        (start, end), rate, own = interval, settings.frame_rate, settings.windows
        factor = settings.coarse_factor if settings.acceleration else 1
        count = frame_count(start, end, rate)
        if count < LEAST_FRAMES * factor:
            raise RecordingError(f"the recording is {end - start:.3f} s long: expected {LEAST_FRAMES} frames or more")
        window, overlap = (factor * max(round(s * rate / factor), 2) for s in (own.window_s, own.overlap_s))
        stretch = max(round(own.calibration_stretch_s * rate / factor), LEAST_FRAMES)
        return cls(start, rate, count, factor, window, overlap, own.calibration_stretches, stretch)

    def windows(self) -> list[slice]:
        """Frames of each window: as evenly spaced as coarse frames allow, each over the next by the overlap or more."""
        count = max(1, ceil((self.frames - self.overlap) / (self.window - self.overlap)))
        if count == 1:
            return [slice(0, self.frames)]
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


@dataclass(frozen=True)
class SceneFrames:
    """Instants of the estimate, in seconds: ``fine`` ``(T,)``, and every ``factor``-th of them, ``coarse``."""

    fine: Array
    factor: int

    @property
    def coarse(self) -> Array:
        """The instants on which the calibration is found."""
        return self.fine[:: self.factor]


def scene_frames(scene: Scene, frame_rate: float, coarse_factor: int) -> SceneFrames:
    """Frames over the time that all wearers' sensors cover.

    A whole number of frames goes to each video frame (or of video frames to each frame), at about ``frame_rate`` Hz,
    and the frames meet the video's: what the camera saw then need not be interpolated.

    Raises:
        RecordingError: if the wearers share less than four coarse frames, or more than a day.
    """
    intervals = [wearer.interval for wearer in scene.wearers]
    interval = max(one[0] for one in intervals), min(one[1] for one in intervals)
    first, rate, count = in_step(scene, interval, frame_rate, coarse_factor)
    return SceneFrames(first + np.arange(count) / rate, coarse_factor)


def in_step(
    scene: Scene, interval: tuple[float, float], frame_rate: float, coarse_factor: int
) -> tuple[float, float, int]:
    """Frames within an interval (seconds) as :func:`scene_frames` places them: the first's seconds, rate and count.

    Args:
        scene: whose first camera's first video frames the frames are to meet.
        interval: to cover.
        frame_rate: Hz, about.
        coarse_factor: every so-manieth frame is a coarse one: these are to meet video frames, not to lie between them.

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
