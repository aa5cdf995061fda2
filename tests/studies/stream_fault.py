"""What is done to a live stream, and when."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from vip_factors.sensors.live import LiveSample

Samples = Iterable[LiveSample]


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        name: for people and for the command line.
        begin: seconds from the start of the stream.
        end: when it is over; infinite if what has changed stays so.
        change: the stream with the fault.
        overload_s: seconds that each update takes from begin to end; 0: the tracker keeps up.
        restart: whether tracking is begun anew at ``end`` by a program that knows nothing of before.
        jump: seconds that the clocks of all samples leap at ``begin``.
    """

    name: str
    begin: float
    end: float
    change: Callable[[Samples], Iterator[LiveSample]]
    overload_s: float = 0.0
    restart: bool = False
    jump: float = 0.0

    @property
    def lasts(self) -> bool:
        """Whether it never ends."""
        return not np.isfinite(self.end)
