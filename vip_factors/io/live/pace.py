"""How fast a sender is read: who sends more than is allowed has to wait."""

import time
from collections.abc import Callable

LEAST_S = 0.02  # a shorter wait costs more than it spares


class Pace:
    """Counts messages against a rate; a second's worth may come at once.

    Args:
        rate: messages a second.
        clock: monotonic seconds.
    """

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate
        self._clock = clock
        self._due = -float("inf")  # when those until now would have come at that rate

    def take(self, messages: int = 1) -> float:
        """Count messages; the seconds to wait before the next are read, 0 if none."""
        now = self._clock()
        self._due = max(self._due, now - 1.0) + messages / self._rate
        return self._due - now if self._due - now >= LEAST_S else 0.0
