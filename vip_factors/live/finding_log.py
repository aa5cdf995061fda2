"""Findings of a stream, each kind told once in a while however often it happens."""

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

from vip_factors.findings import Finding

MOST_WAITING = 1000  # findings that nobody has taken: beyond, new ones are lost rather than memory
OFTEN = 10  # tellings of a kind, after which it is told now and then only
GATHER_S = 0.3  # of the stream, in which all clocks that leap together are found to have leapt


@dataclass
class _Tally:
    finding: Callable[[int], Finding]  # of how often it has happened since it was told last
    count: int = 0
    told: float = -math.inf
    tellings: int = 0
    due: float = math.inf  # when what was gathered is to be told


class FindingLog:
    """Collects findings until they are taken.

    Memory stays bounded as long as the keys of :meth:`tally` and :meth:`gather` do.
    """

    def __init__(self, repeat_after: float) -> None:
        self._repeat_after = repeat_after
        self._tallies: dict[Hashable, _Tally] = {}
        self._waiting: list[Finding] = []

    def add(self, finding: Finding) -> None:
        """Tell this."""
        if len(self._waiting) < MOST_WAITING:
            self._waiting.append(finding)

    def tally(self, key: Hashable, now: float, finding: Callable[[int], Finding]) -> None:
        """Something of the kind ``key`` has happened once more: ``finding(count)`` is told now or later.

        Args:
            key: of what happens again and again.
            now: seconds of the stream.
            finding: made from how often it has happened since it was told last.
        """
        tally = self._tallies.setdefault(key, _Tally(finding))
        tally.count += 1
        tally.finding = finding
        if now - tally.told >= self._repeat_after or not math.isfinite(tally.told):
            self._add(tally, now)

    def gather(self, key: Hashable, now: float, finding: Finding) -> None:
        """Tell this a moment later, together with what others of the kind ``key`` do by then.

        What happens ever again is told now and then only.

        Args:
            key: of what many sources do at the same time.
            now: seconds of the stream.
            finding: about this one; its word ``others`` is to count them.
        """
        tally = self._tallies.setdefault(key, _Tally(lambda _: finding))
        if not tally.count:
            tally.finding = lambda count: _with_others(finding, count - 1)
            tally.due = now + GATHER_S
            if tally.tellings >= OFTEN:
                tally.due = max(tally.due, tally.told + self._repeat_after)
        tally.count += 1

    def close(self) -> None:
        """Tell the counts that were still held back."""
        for tally in self._tallies.values():
            if tally.count:
                self._add(tally, tally.told)

    def take(self, now: float = -math.inf) -> tuple[Finding, ...]:
        """All findings since the last time, in order; and what has been gathered for long enough."""
        for tally in self._tallies.values():
            if now >= tally.due:
                self._add(tally, now)
        taken = tuple(self._waiting)
        self._waiting.clear()
        return taken

    def _add(self, tally: _Tally, now: float) -> None:
        self.add(tally.finding(tally.count))
        tally.count, tally.told, tally.due = 0, now, math.inf
        tally.tellings += 1


def _with_others(finding: Finding, others: int) -> Finding:
    return replace(finding, words={**finding.words, "others": f"; so did {others} more" if others else ""})
