"""How many of a stream's frames are solved: fewer while the tracker is behind, and all again after that."""

from vip_factors.findings import Finding
from vip_factors.live.settings import PaceSettings


class SolvePace:
    """Widens the stretch between updates while samples wait, and narrows it again when they have not for a while.

    No frame is left out: those between updates are predicted, and answered, and count in the next one. What decides is
    the shortest wait of late, as where queues are kept short (CoDel, RFC 8289): a burst of packets is no lack of
    time. That tracking begins behind, since its start takes longer than a frame, is made up for without a word.

    Attributes:
        solve_every: frames to each update.
    """

    def __init__(self, usual: int, frame_rate: float, settings: PaceSettings) -> None:
        self.solve_every = self._usual = usual
        self._rate, self._settings = frame_rate, settings
        self._steady_from: float | None = None  # s; since when it has been behind, or in time, without a change
        self._is_behind = False
        self._begun: float | None = None  # s, when the first frame came
        self._has_been_in_time = False
        self._told_from: float | None = None  # s, from when on fewer are solved, as was told
        self._widest = usual

    def step(self, time: float, behind_s: float) -> list[Finding]:
        """One frame more, at ``time`` seconds of the stream, whose last sample had waited ``behind_s``."""
        own, is_behind = self._settings, behind_s > self._settings.behind_s
        self._begun = time if self._begun is None else self._begun
        self._has_been_in_time |= not is_behind or time - self._begun >= own.recover_s
        if is_behind != self._is_behind or self._steady_from is None:
            self._is_behind, self._steady_from = is_behind, time
        if is_behind and self.solve_every < own.widest and time - self._steady_from >= own.after_s:
            self.solve_every, self._steady_from = self.solve_every + 1, time
        elif not is_behind and self.solve_every > self._usual and time - self._steady_from >= own.recover_s:
            self.solve_every, self._steady_from = self.solve_every - 1, time
        self._widest = max(self._widest, self.solve_every)
        return self._findings(time, behind_s)

    def _findings(self, time: float, behind_s: float) -> list[Finding]:
        """What is to be said: that fewer are solved, once, and when that is over."""
        rate = self._rate / self.solve_every
        if self.solve_every == self._usual:
            begin, least = self._told_from, self._rate / self._widest
            self._told_from, self._widest = None, self._usual
            numbers = {"begin": begin or 0.0, "end": time, "rate": rate, "least": least}
            return [] if begin is None else [Finding("frames solved again", numbers=numbers)]
        if self._told_from is None and self._has_been_in_time and self._is_behind:
            self._told_from = time
            return [Finding("fewer frames solved", numbers={"begin": time, "rate": rate, "behind": behind_s})]
        return []
