"""Sentences for the user, each kind told once in a while however often it happens."""

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass

MOST_WAITING = 1000  # sentences that nobody has taken: beyond, new ones are lost rather than memory
OFTEN = 10  # tellings of a kind, after which it is told now and then only
GATHER_S = 0.3  # of the stream, in which all clocks that leap together are found to have leapt


@dataclass
class _Tally:
    count: int = 0
    told: float = -math.inf
    tellings: int = 0
    sentence: Callable[[int], str] = str
    due: float = math.inf  # when what was gathered is to be told


class FindingLog:
    """Collects sentences until they are taken.

    Memory stays bounded as long as the keys of :meth:`tally` and :meth:`gather` do.
    """

    def __init__(self, repeat_after: float) -> None:
        self._repeat_after = repeat_after
        self._tallies: dict[Hashable, _Tally] = {}
        self._waiting: list[str] = []

    def say(self, sentence: str) -> None:
        """Tell this."""
        if len(self._waiting) < MOST_WAITING:
            self._waiting.append(sentence)

    def tally(self, key: Hashable, now: float, sentence: Callable[[int], str]) -> None:
        """Something of the kind ``key`` has happened once more: ``sentence(count)`` is told now or later.

        Args:
            key: of what happens again and again.
            now: seconds of the stream.
            sentence: made from how often it has happened since it was told last.
        """
        tally = self._tallies.setdefault(key, _Tally())
        tally.count += 1
        tally.sentence = sentence
        if now - tally.told >= self._repeat_after or not math.isfinite(tally.told):
            self._tell(tally, now)

    def gather(self, key: Hashable, now: float, sentence: str) -> None:
        """Tell this a moment later, together with what others of the kind ``key`` do by then.

        What happens ever again is told now and then only.

        Args:
            key: of what many sources do at the same time.
            now: seconds of the stream.
            sentence: about this one.
        """
        tally = self._tallies.setdefault(key, _Tally())
        if not tally.count:
            first = sentence
            tally.sentence = lambda count: f"{first}; so did {count - 1} more" if count > 1 else first
            tally.due = now + GATHER_S
            if tally.tellings >= OFTEN:
                tally.due = max(tally.due, tally.told + self._repeat_after)
        tally.count += 1

    def close(self) -> None:
        """Tell the counts that were still held back."""
        for tally in self._tallies.values():
            if tally.count:
                self._tell(tally, tally.told)

    def take(self, now: float = -math.inf) -> tuple[str, ...]:
        """All sentences since the last time, in order; and what has been gathered for long enough."""
        for tally in self._tallies.values():
            if now >= tally.due:
                self._tell(tally, now)
        taken = tuple(self._waiting)
        self._waiting.clear()
        return taken

    def _tell(self, tally: _Tally, now: float) -> None:
        self.say(tally.sentence(tally.count))
        tally.count, tally.told, tally.due = 0, now, math.inf
        tally.tellings += 1


def counted(count: int, noun: str) -> str:
    """``1 sample``, ``2 samples``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
