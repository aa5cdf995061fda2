"""How many of a stream's frames are solved: fewer while samples wait, and all again when they do not."""

from collections import deque

from vip_factors.findings import Finding


class SolvePace:
    """Widens the stretch between updates in proportion to what samples have waited, frame by frame.

    No frame is left out: those between updates are predicted, and answered, and count in the next one. So the wait
    settles where updates and predictions fill the time that there is, whatever each of them takes and whoever else
    wants the processor: it is looked at before every update, and falls behind by one of them at most. That tracking
    begins behind, since its start takes longer than a frame, is made up for without a word.

    Attributes:
        solve_every: frames to each update, now.
    """

    FRAME_WAIT_S = 0.025  # a sample's wait for each frame more to an update: longer than an update takes
    WIDEST = 6  # frames to each update, at most: 10 solved each second, on 15 frames of the lag
    REPORT_S = 2.0  # over which the reported rate is counted; a shorter stretch is not worth a finding
    RECOVER_S = 5.0  # with all frames solved, before that is reported
    LEAST_SHARE = 0.8  # of the frames that are solved usually: a hiccup now and then is not worth a finding

    def __init__(self, usual: int, frame_rate: float) -> None:
        self.solve_every = self._usual = usual
        self._rate = frame_rate
        self._recent = deque[bool](maxlen=max(1, round(self.REPORT_S * frame_rate)))  # whether frames were solved
        self._begun: float | None = None  # s, when the first frame came
        self._late_at = 0.0  # s, when fewer were solved last
        self._told_from: float | None = None  # s, from when on they are, as was told
        self._least = frame_rate  # solved a second since then

    def step(self, time: float, behind_s: float, solved: bool) -> list[Finding]:
        """One frame more.

        Args:
            time: seconds of the stream.
            behind_s: that its last sample had waited.
            solved: whether the frame before was.
        """
        self._begun = time if self._begun is None else self._begun
        self.solve_every = min(self._usual + int(behind_s / self.FRAME_WAIT_S), max(self.WIDEST, self._usual))
        is_late = self.solve_every > self._usual
        self._late_at = time if is_late else self._late_at
        if self._recent or not is_late or time - self._begun >= self.RECOVER_S:
            self._recent.append(solved)
        return self._findings(time, behind_s)

    def _findings(self, time: float, behind_s: float) -> list[Finding]:
        """What is to be said: that fewer are solved, once, and when that is over."""
        if len(self._recent) < (self._recent.maxlen or 0):
            return []
        rate, begin = self._rate * sum(self._recent) / len(self._recent), self._told_from
        self._least = min(self._least, rate)
        if begin is None and rate < self.LEAST_SHARE * self._rate / self._usual:
            self._told_from, self._least = time, rate
            return [Finding("fewer frames solved", numbers={"begin": time, "rate": rate, "behind": behind_s})]
        if begin is not None and time - self._late_at >= self.RECOVER_S:
            self._told_from = None
            numbers = {"begin": begin, "end": time, "rate": rate, "least": self._least}
            return [Finding("frames solved again", numbers=numbers)]
        return []
