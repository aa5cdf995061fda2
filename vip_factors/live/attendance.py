"""Who still sends: which sensors a frame waits for, and for how long."""

import math
from collections.abc import Sequence

from vip_factors.live.assembly_settings import AssemblySettings
from vip_factors.live.finding_log import FindingLog

ENOUGH = 4  # sensors from which on a single one whose clock runs ahead cannot make all others late


class Attendance:
    """How far each sensor has come.

    Attributes:
        awaited: of each sensor, whether frames wait for it.
    """

    def __init__(self, labels: Sequence[str], settings: AssemblySettings, log: FindingLog) -> None:
        self.awaited = [False] * len(labels)
        self._labels = labels
        self._settings = settings
        self._log = log
        self._reached = [-math.inf] * len(labels)  # s, of the newest sample that was of use
        self._arrived = [-math.inf] * len(labels)  # s, of the newest sample at all
        self._resumed = -math.inf  # s: before it all were silent, which no sensor is to blame for
        self._lost_at = -math.inf  # s, when samples were dropped last
        self._watched = -math.inf
        self._away: dict[int, str] = {}  # told to be silent or late: what to say when it sends again

    def note(self, sensor: int, time: float, present: float, begun: bool) -> None:
        """A sample of use has come."""
        if time > self._reached[sensor]:
            self._reached[sensor] = time
        self._arrived[sensor] = max(self._arrived[sensor], time)
        if not self.awaited[sensor] and (not begun or time >= present - self._settings.patience):
            self._welcome(sensor)

    def note_late(self, sensor: int, time: float, present: float) -> None:
        """A sample has come, but too late. One that waiting would have saved is worth waiting for again."""
        self._arrived[sensor] = max(self._arrived[sensor], time)
        if not self.awaited[sensor] and time >= present - self._settings.patience:
            self._reached[sensor] = max(self._reached[sensor], time)
            self._welcome(sensor)

    def resume(self, time: float) -> None:
        """All sensors were silent until now."""
        self._resumed = time

    def note_loss(self, present: float) -> None:
        """Samples were sent, but dropped on their way here: nobody knows whose."""
        self._lost_at = present

    def call(self, present: float) -> None:
        """The first frame is to be made: say who has not begun."""
        for sensor, reached in enumerate(self._reached):
            if reached == -math.inf:
                self._away[sensor] = "sends now"
                self._log.say(f"{self._labels[sensor]} has sent nothing yet: going on without it")

    def watch(self, present: float) -> None:
        """Find those who have fallen silent, now and then."""
        if present - self._watched < self._settings.patience:
            return
        self._watched = present
        for sensor, reached in enumerate(self._reached):
            silent = present - max(reached, self._resumed)
            if not self.awaited[sensor] or silent < self._settings.dead_after:
                continue
            self.awaited[sensor] = False
            self._away[sensor] = "is back"
            late = self._arrived[sensor] > max(reached, self._resumed)
            what = f"has come too late for {silent:.1f} s" if late else f"has been silent for {silent:.1f} s"
            if self._lost_at >= max(reached, self._resumed):
                what = f"is without samples for {silent:.1f} s, as the tracker did not keep up and some were dropped"
            self._log.say(f"{self._labels[sensor]} {what}: going on without it")

    def known_until(self) -> float:
        """Frames up to this time (s) wait for nobody: all awaited sensors are there, or patience is at its end.

        Patience is measured on the newest sample of any sensor; where many send, on the second newest, so that one
        sensor whose clock runs ahead does not make all others late.
        """
        reached = sorted(time for time, awaited in zip(self._reached, self.awaited, strict=True) if awaited)
        if not reached:
            return max(self._reached) - self._settings.patience
        pace = reached[-1 if len(reached) < ENOUGH else -2]
        return max(reached[0] - self._settings.reordering, pace - self._settings.patience)

    def _welcome(self, sensor: int) -> None:
        self.awaited[sensor] = True
        if sensor in self._away:
            self._log.say(f"{self._labels[sensor]} {self._away.pop(sensor)}")
