"""A sentence that repeats itself is told once a second, with the number of times."""

import time
from collections.abc import Callable

from vip_factors.sensors.live import LiveFinding

TELL_EVERY = 1.0  # seconds: a person reads them


class Throttle:
    """Keeps one sender's endless mistake from flooding the terminal.

    Args:
        tell: gets the findings.
        clock: monotonic seconds.
    """

    def __init__(self, tell: Callable[[LiveFinding], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._tell = tell
        self._clock = clock
        self._told: dict[str, float] = {}
        self._held: dict[str, tuple[str, int]] = {}

    def tell(self, kind: str, sentence: str) -> None:
        """Tell a sentence, or hold it if one of its kind was told less than a second ago."""
        if self._clock() - self._told.get(kind, -float("inf")) < TELL_EVERY:
            _, times = self._held.get(kind, ("", 0))
            self._held[kind] = (sentence, times + 1)
        else:
            self._say(kind, sentence, self._held.pop(kind, ("", 0))[1])

    def flush(self, every: bool = False) -> None:
        """Tell what has been held for a second, or (with ``every``) all that is held."""
        if not self._held:
            return
        now = self._clock()
        for kind in [kind for kind in self._held if every or now - self._told[kind] >= TELL_EVERY]:
            sentence, times = self._held.pop(kind)
            self._say(kind, sentence, times - 1)

    def _say(self, kind: str, sentence: str, more: int) -> None:
        self._told[kind] = self._clock()
        self._tell(LiveFinding(f"{sentence} (and {more} more of this kind)" if more else sentence))
