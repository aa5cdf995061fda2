"""The clocks of sensors and cameras, which may leap, and who still sends: which sensors a frame waits for, how long."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vip_factors.findings import Finding, FindingLog
from vip_factors.settings import AssemblySettings

# s of samples in a row from a clock that has jumped, after which it is believed to have started again: a lone bad stamp
# never lasts, and a sensor switched off and on is back within the second.
RESTART_S = 0.5


@dataclass
class _Refused:
    """Samples refused in a row: the first and the newest time on the source's clock, ahead of the stream or behind.

    Of strays without any order only the latest are in a row; ``since`` and ``count`` are of all of them.
    """

    first: float
    newest: float
    ahead: bool
    leap: tuple[float, float]  # s, from when to when its clock jumped
    present_before: float  # s, the stream's newest before the first
    others_before: int  # samples accepted from anybody before the first
    since: float  # s, the stream's newest before the first of all
    count: int = 0
    told: bool = False

    def finding(self, kind: str = "clocks disagree", done: str = "such samples are refused") -> Finding:
        """That the clock has jumped, and what is done about it."""
        before, after = self.leap
        words = {"off": f"jumped from {before:.2f} s to {after:.2f} s", "others": "", "done": done}
        return Finding(kind, numbers={"before": before, "after": after}, words=words)


class Admitted(NamedTuple):
    """A sample's time on the stream's clock, None if refused; and what has happened to its clock, if anything."""

    time: float | None
    finding: Finding | None = None


class StreamClocks:
    """Maps times of sources onto the stream's clock: sensors first, cameras behind them.

    A sample that lies more than a step *before* its own source's newest, or *ahead* of it and of all sensors, is
    refused, and so is a sensor's that is older than the longest pause. If that lasts, the source's clock has jumped:
    its time goes on from the stream's newest, and one remark says so. But if nobody else went on meanwhile, all were
    silent, and the time ahead is believed.
    """

    def __init__(self, sensors: int, cameras: int, settings: AssemblySettings) -> None:
        self.present = -math.inf  # s, of the newest sample of any sensor
        self._sensors = sensors
        self._settings = settings
        self._newest = [-math.inf] * (sensors + cameras)
        self._offset = [0.0] * (sensors + cameras)
        self._refused: list[_Refused | None] = [None] * (sensors + cameras)
        self._accepted = 0

    def admit(self, source: int, time: float, alive: Sequence[bool]) -> Admitted:
        """The time of a sample, ``time`` on its source's clock.

        Args:
            source: number of the sensor, or of the camera behind the sensors.
            time: seconds.
            alive: of each sensor, whether it is waited for.
        """
        settings, camera = self._settings, source >= self._sensors
        moment = time + self._offset[source]
        newest = self._newest[source]
        # Nobody begins far from the others; but a slow detector's frames are seconds old, and need not wait for IMUs.
        if newest == -math.inf:
            tolerance = settings.longest_pause if camera else settings.jump
            behind = self.present - tolerance
        else:
            # Sensors may lag far behind the video, whose frames, if they are few, are then all ahead.
            tolerance = settings.jump if camera else settings.step
            behind = newest - settings.step
            if not camera:
                behind = max(behind, self.present - settings.longest_pause)
            refused = self._refused[source]
            if refused is not None and not refused.ahead:  # until it has caught up, or that has lasted
                behind = max(behind, newest if camera else self.present - settings.step)
        ahead = max(newest, self.present) + tolerance
        if moment < behind:
            return self._refuse(source, time, alive, is_ahead=False)
        if math.isfinite(ahead) and moment > ahead:
            return self._refuse(source, time, alive, is_ahead=True)
        return self._accept(source, moment)

    def _accept(self, source: int, moment: float, finding: Finding | None = None) -> Admitted:
        refused = self._refused[source]
        if refused is not None and finding is None and not refused.told:
            back = (refused.newest + self._offset[source] - moment) * (1 if refused.ahead else -1)
            # Else the others have followed, and it was right.
            finding = refused.finding() if back > self._settings.step else None
        self._refused[source] = None
        self._newest[source] = max(self._newest[source], moment)
        if source < self._sensors:
            self.present = max(self.present, moment)
            self._accepted += 1
        return Admitted(moment, finding)

    def _refuse(self, source: int, time: float, alive: Sequence[bool], is_ahead: bool) -> Admitted:
        refused, moment = self._refused[source], time + self._offset[source]
        now = max(self._newest[source], self.present)
        if refused is None or refused.ahead != is_ahead or abs(time - refused.newest) > self._settings.jump:
            fresh = _Refused(time, time, is_ahead, (now, moment), self.present, self._accepted, self.present)
            if refused is not None:
                fresh.since, fresh.count, fresh.told = refused.since, refused.count, refused.told
            refused = self._refused[source] = fresh
        refused.newest = max(refused.newest, time)
        refused.count += 1
        lasts = refused.newest - refused.first >= RESTART_S
        if not is_ahead and moment >= self._newest[source] - self._settings.step:
            # Its own time goes on, far behind the others': a backlog comes in faster than time passes.
            lasts &= self.present - refused.present_before >= RESTART_S / 2
        if is_ahead and self._all_were_silent(source, moment, alive, lasts):
            self._refused = [None if one is not None and one.ahead else one for one in self._refused]  # as right as it
            return self._accept(source, moment)
        if not lasts:
            return Admitted(None, self._strays(refused))
        self._offset[source] = self._new_offset(source, time, now)
        new = time + self._offset[source]
        done = f"it goes on from there, its {time:.2f} s are taken for {new:.2f} s"
        return self._accept(source, new, refused.finding("clock corrected", done))

    def _strays(self, refused: _Refused) -> Finding | None:
        """What is to be said, once, of a clock that neither comes back nor goes on from anywhere; mostly nothing."""
        strays = 1000  # refused in a row without any order: told, even if nobody's time goes on
        lasts = self.present - refused.since >= self._settings.dead_after or refused.count >= strays
        if refused.told or not lasts:
            return None
        refused.told = True
        return refused.finding()

    def _all_were_silent(self, source: int, moment: float, alive: Sequence[bool], lasts: bool) -> bool:
        """Whether the time ahead is right, because nobody else went on."""
        refused = self._refused[source]
        assert refused is not None
        if self._others_went_on(refused):
            return False
        if lasts:
            return True
        if source >= self._sensors:
            return False
        others = [number for number in range(self._sensors) if alive[number] and number != source]
        if not others:
            return moment - self.present <= self._settings.longest_pause
        for number in others:
            other = self._refused[number]
            if other is None or not other.ahead:
                return False
            if abs(other.newest + self._offset[number] - moment) > self._settings.jump:
                return False
        return True

    def _others_went_on(self, refused: _Refused) -> bool:
        """Whether sensors have been heard since: as long as not, a leap ahead may be the end of a common silence."""
        return self._accepted > refused.others_before

    def _new_offset(self, source: int, time: float, now: float) -> float:
        """So that time goes on from ``now``: clocks that start again together keep their common time."""
        shared_offset = 0.5  # s: a clock that starts again this near to another's new time has started with it
        candidates = {0.0, *self._offset}
        nearest = min(candidates, key=lambda offset: abs(time + offset - now))
        # After a small step its old offset is near, too.
        limit = min(shared_offset, abs(time + self._offset[source] - now) / 2)
        return nearest if abs(time + nearest - now) <= limit else now - time


class SensorPresence:
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
        self._slowest = 0  # sensor that frames waited for last
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

    def report_missing(self, present: float) -> None:
        """The first frame is to be made: say who has not begun."""
        for sensor, reached in enumerate(self._reached):
            if reached == -math.inf:
                self._away[sensor] = "sends now"
                self._report_silent(sensor, "has sent nothing yet")

    def find_silent(self, present: float) -> None:
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
            what = f"{'has come too late' if late else 'has been silent'} for {silent:.1f} s"
            if self._lost_at >= max(reached, self._resumed):
                what = f"is without samples for {silent:.1f} s, as the tracker did not keep up and some were dropped"
            self._report_silent(sensor, what)

    def _report_silent(self, sensor: int, what: str) -> None:
        words = {"what": what, "then": "going on without it"}
        self._log.add(Finding("silent", subject=self._labels[sensor], words=words))

    def complete_until(self) -> float:
        """Frames up to this time (s) wait for nobody: all awaited sensors are there, or patience is at its end.

        Patience is measured on the newest sample of any sensor; where many send, on the second newest, so that one
        sensor whose clock runs ahead does not make all others late.
        """
        enough = 4  # sensors from which on a single one whose clock runs ahead cannot make all others late
        awaited = [sensor for sensor, awaited in enumerate(self.awaited) if awaited]
        if not awaited:
            return max(self._reached) - self._settings.patience
        # Of those that are as far, the last one: mostly they arrive in order, and it is looked at instead of all.
        self._slowest = min(reversed(awaited), key=self._reached.__getitem__)
        reached = sorted([self._reached[sensor] for sensor in awaited])
        pace = reached[-1 if len(reached) < enough else -2]
        return max(reached[0] - self._settings.reordering, pace - self._settings.patience)

    def waits(self, time: float, present: float) -> bool:
        """Whether a frame at ``time`` still waits for the sensor that frames waited for last: a look at one of many."""
        patient = time > present - self._settings.patience
        reached = self._reached[self._slowest] - self._settings.reordering
        return patient and self.awaited[self._slowest] and time > reached

    def _welcome(self, sensor: int) -> None:
        self.awaited[sensor] = True
        if sensor in self._away:
            words = {"what": self._away.pop(sensor)}
            self._log.add(Finding("recovered", subject=self._labels[sensor], words=words))
