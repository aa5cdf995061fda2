"""Which frames of a long recording are solved together: overlapping windows, and stretches for its calibration."""

from dataclasses import dataclass
from math import ceil

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import frame_count
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
