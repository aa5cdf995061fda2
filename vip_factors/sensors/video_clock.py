"""What lies between a video's clock and the sensors'."""

from dataclasses import dataclass

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

FARTHEST_S = 1e10  # three centuries: one clock may count from 1970 and the other from its start
FASTEST = 0.5  # what drifts more is no clock of the same time


@dataclass(frozen=True)
class VideoClock:
    """The sensors' time at an instant ``t`` of the video's own clock: ``t + offset + drift t``, in seconds.

    Attributes:
        offset: seconds to add at the video's time 0.
        drift: seconds more in every second of the video: two quartz clocks differ by some 1e-5, a rate that was told
            as 30 for 29.97 Hz by 1e-3.
    """

    offset: float = 0.0
    drift: float = 0.0

    def __post_init__(self) -> None:
        if not (abs(self.offset) < FARTHEST_S and abs(self.drift) < FASTEST):
            raise InputError(
                f"video's clock off by {self.offset:g} s and {self.drift:g} s a second: expected seconds between two "
                f"clocks that show the same time, and a drift below {FASTEST:g}"
            )

    def late(self, time: float) -> float:
        """Seconds to add at an instant of the video."""
        return self.offset + self.drift * time

    def at(self, time: Array) -> Array:
        """The sensors' times at the video's."""
        return time + self.offset + self.drift * time

    def corrected(self, seconds: float, drift: float, middle: float) -> "VideoClock":
        """Put forward by seconds at an instant of the sensors' clock, and by ``drift`` seconds a second from there."""
        offset = self.offset + seconds + drift * (self.offset - middle)
        return VideoClock(offset, self.drift + drift * (1 + self.drift))
