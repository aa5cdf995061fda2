"""How samples are gathered into frames; every default has its reason beside it."""

from dataclasses import dataclass, fields

from vip_factors.errors import InputError
from vip_factors.ranges import NotNegative


@dataclass(frozen=True)
class AssemblySettings:
    """Waiting, silences, clocks; all in seconds of the stream's own time."""

    # Before the first frame: sensors switched on together have all begun by then (radio links take 0.1 s), and the
    # tracker wants a second of samples before its first pose anyway.
    settle: NotNegative = 0.5
    # A frame waits so long for a sensor that has fallen behind the others: three packets at 60 Hz, which is what
    # radio links repeat; a fifth of the lag of a quarter of a second. Sensors slower than 20 Hz need a longer one.
    patience: NotNegative = 0.05
    # A sensor's sample counts as arrived in order, once a sample so much newer has arrived: 0, because TCP, files and
    # drivers keep the order of each sensor. Of sources over UDP, one frame or more: all answers are so much later.
    reordering: NotNegative = 0.0
    # Without a sample for so long a sensor is no longer waited for: longer than a body blocks the radio (0.25 s).
    dead_after: float = 1.0
    # A silence of all sensors: after a longer one nobody knows where the wearers are, and tracking begins anew.
    longest_pause: float = 2.5
    # A step of a clock, between sources or ahead of all others, that no delay explains.
    jump: float = 1.0
    # A smaller one, of a sensor that was there: back behind its own newest sample, as packets seldom overtake one
    # another by more than three, or ahead of it and of all others. Less shows in nothing but the poses.
    step: float = 0.2
    # Samples from such a clock, in a row, after which it is believed to have started again: a lone bad stamp never
    # lasts, and a sensor switched off and on is back within the second.
    restart_after: float = 0.5
    # The same finding about the same sensor is told at most so often.
    repeat_after: float = 10.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            zero_allowed = one.name in ("settle", "reordering", "repeat_after")
            if not (0 <= value < float("inf")) or (value == 0 and not zero_allowed):
                raise InputError(
                    f"assembly setting {one.name} = {value:g} s: expected a finite number, "
                    + ("0 or more" if zero_allowed else "above 0")
                )
        if not self.patience <= self.dead_after <= self.longest_pause:
            raise InputError(
                f"assembly settings: patience {self.patience:g} s, dead_after {self.dead_after:g} s and longest_pause "
                f"{self.longest_pause:g} s: expected each to be no longer than the next"
            )
