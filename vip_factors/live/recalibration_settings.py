"""When a stream's calibration is found anew, and how much of it is believed."""

from dataclasses import dataclass, field

from vip_factors.settings import CalibrationSettings


@dataclass(frozen=True)
class RecalibrationSettings:
    """When a stream's calibration is found anew, and how much of it is believed."""

    use: bool = True
    first_s: float = 5.0  # of data: less shows no more than the start does
    growth: float = 2.0  # each time with so many times as much data: what is left to learn halves with it
    longest_s: float = 40.0  # of data, the most recent: headings of a minute ago are no longer today's
    # s of the stream between the last of that data and the first answer that has it, at least: on a core of its own the
    # batch stages need less for five seconds, and a replay gives the same answers on any machine.
    delay_s: float = 3.0
    # Standard deviations are taken so many times as large: on foreign scenes mountings are off by 1.4 sigma.
    inflation: float = 2.0
    frames: int = 30  # that tracking goes on from
    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
