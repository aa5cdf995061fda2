"""When a stream's calibration is found anew, and how much of it is believed."""

from dataclasses import dataclass, field

from vip_factors.ranges import NotNegative
from vip_factors.settings import CalibrationSettings


@dataclass(frozen=True)
class RecalibrationSettings:
    """When a stream's calibration is found anew, and how much of it is believed."""

    use: bool = True
    # s of data: a start of one second is 60–120 mm off on foreign scenes, and with two it is half as wrong.
    first_s: float = 2.5
    growth: float = 2.0  # each time with so many times as much data: what is left to learn halves with it
    # of data, the most recent: headings of a minute ago are no longer today's. So often it is found anew from then on.
    longest_s: float = 40.0
    # s of the stream between the last of that data and the first answer that has it, at least: on a core of its own the
    # batch stages need about as long for the first of it. A replay waits, and gives the same answers on any machine.
    delay_s: NotNegative = 2.0
    # Standard deviations are taken so many times as large: on foreign scenes mountings are off by 1.4 sigma.
    inflation: float = 2.0
    frames: int = 30  # that tracking goes on from
    # Constant headings: the tracker goes on from the last of them, and follows them by itself.
    calibration: CalibrationSettings = field(default_factory=lambda: CalibrationSettings(heading_knot_s=None))
