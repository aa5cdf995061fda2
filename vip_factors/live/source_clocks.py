"""Clocks of sensors and cameras, which may jump, and presence of sensors: which of them a frame waits for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vip_factors.findings import Finding, FindingLog
from vip_factors.settings import AssemblySettings

# Seconds of samples after a jump, after which the clock counts as restarted. A single bad stamp does not last so long.
RESTART_S = 0.5


@dataclass
class _RefusedSamples:
    """Consecutive refused samples of one source: first and newest time on its clock, ahead of the stream or behind.

    Where refused times have no order, a new series begins; ``since_time`` and ``count`` then cover all series.
    """

    first_time: float
    newest: float
    is_ahead: bool
    leap: tuple[float, float]  # s, times before and after the jump of its clock
    present_before: float  # s, newest time of the stream before the first refusal
    accepted_before: int  # samples accepted from all sensors before the first refusal
    since_time: float  # s, newest time of the stream before the first refusal of all series
    count: int
    is_reported: bool

    def finding(self, kind: str = "clocks disagree", done: str = "such samples are refused") -> Finding:
        """Report the jump of the clock and the reaction to it."""
        jump_from, jump_to = self.leap
        words = {"off": f"jumped from {jump_from:.2f} s to {jump_to:.2f} s", "others": "", "done": done}
        return Finding(kind, numbers={"before": jump_from, "after": jump_to}, words=words)


Admitted = tuple[float | None, Finding | None]
"""Time of a sample on the stream's clock, None if refused, and a finding about its clock."""


class StreamClocks:
    """Maps times of sources onto the stream's clock. Sources are numbered, cameras after sensors.

    A sample is refused if it lies more than a step *before* the newest one of its source, or *ahead* of it and of all
    sensors, or if a sensor's sample is older than the longest pause. If that lasts, the source's clock has jumped: its
    time continues from the newest one of the stream, and one finding reports it. If no other sensor has sent
    meanwhile, all were silent, and the time ahead is accepted.
    """

    def __init__(self, sensors: int, cameras: int, settings: AssemblySettings) -> None:
        self.present = -math.inf  # s, newest sample of any sensor
        self._sensors = sensors
        self._settings = settings
        self._newest = [-math.inf] * (sensors + cameras)
        self._offset = [0.0] * (sensors + cameras)
        self._refused: list[_RefusedSamples | None] = [None] * (sensors + cameras)
        self._accepted = 0

    def admit(self, source: int, time: float, alive: Sequence[bool]) -> Admitted:
        """Accept or refuse a sample.

        Args:
            source: number of the sensor, or of the camera after all sensors.
            time: seconds on the clock of the source.
            alive: for each sensor, whether frames wait for it.
        """
        settings, camera = self._settings, source >= self._sensors
        moment = time + self._offset[source]
        newest = self._newest[source]
        # A new source starts near the others. Frames of a slow detector are seconds old and may precede all IMUs.
        if newest == -math.inf:
            tolerance = settings.longest_pause if camera else settings.jump
            behind = self.present - tolerance
        else:
            # Sensors may lag far behind the video, whose frames are then all ahead.
            tolerance = settings.jump if camera else settings.step
            behind = newest - settings.step
            if not camera:
                behind = max(behind, self.present - settings.longest_pause)
            refused = self._refused[source]
            if refused is not None and not refused.is_ahead:  # until it has caught up, or counts as restarted
                behind = max(behind, newest if camera else self.present - settings.step)
        ahead = max(newest, self.present) + tolerance
        if moment < behind:
            return self._refuse(source, time, alive, is_ahead=False)
        if math.isfinite(ahead) and moment > ahead:
            return self._refuse(source, time, alive, is_ahead=True)
        return self._accept(source, moment)

    def _accept(self, source: int, moment: float, finding: Finding | None = None) -> Admitted:
        refused = self._refused[source]
        if refused is not None and finding is None and not refused.is_reported:
            back = (refused.newest + self._offset[source] - moment) * (1 if refused.is_ahead else -1)
            # If the difference is small, the other sources have followed, and this clock was right.
            finding = refused.finding() if back > self._settings.step else None
        self._refused[source] = None
        self._newest[source] = max(self._newest[source], moment)
        if source < self._sensors:
            self.present = max(self.present, moment)
            self._accepted += 1
        return moment, finding

    def _refuse(self, source: int, time: float, alive: Sequence[bool], is_ahead: bool) -> Admitted:
        refused, moment = self._refused[source], time + self._offset[source]
        stream_time = max(self._newest[source], self.present)
        if refused is None or refused.is_ahead != is_ahead or abs(time - refused.newest) > self._settings.jump:
            since, count, is_reported, jump = self.present, 0, False, (stream_time, moment)
            if refused is not None:
                since, count, is_reported = refused.since_time, refused.count, refused.is_reported
            refused = self._refused[source] = _RefusedSamples(
                time, time, is_ahead, jump, self.present, self._accepted, since, count, is_reported
            )
        refused.newest = max(refused.newest, time)
        refused.count += 1
        lasts = refused.newest - refused.first_time >= RESTART_S
        if not is_ahead and moment >= self._newest[source] - self._settings.step:
            # Its time advances, far behind the others: a backlog arrives faster than time passes.
            lasts &= self.present - refused.present_before >= RESTART_S / 2
        if is_ahead and self._all_were_silent(source, refused, moment, alive, lasts):
            # The others that are ahead are as right as this one.
            self._refused = [None if other is not None and other.is_ahead else other for other in self._refused]
            return self._accept(source, moment)
        if not lasts:
            # A clock that neither returns nor continues from a new time is reported once.
            strays = 1000  # refused samples without order that are reported even if no time passes
            is_stray = self.present - refused.since_time >= self._settings.dead_after or refused.count >= strays
            if refused.is_reported or not is_stray:
                return None, None
            refused.is_reported = True
            return None, refused.finding()
        self._offset[source] = self._new_offset(source, time, stream_time)
        new = time + self._offset[source]
        done = f"it goes on from there, its {time:.2f} s are taken for {new:.2f} s"
        return self._accept(source, new, refused.finding("clock corrected", done))

    def _all_were_silent(
        self, source: int, refused: _RefusedSamples, moment: float, alive: Sequence[bool], lasts: bool
    ) -> bool:
        """Whether the time ahead is right, because all other sensors were silent."""
        others_went_on = self._accepted > refused.accepted_before
        if others_went_on or lasts or source >= self._sensors:
            return lasts and not others_went_on
        other_sensors = [number for number in range(self._sensors) if alive[number] and number != source]
        if not other_sensors:
            return moment - self.present <= self._settings.longest_pause
        return all(
            (refusal := self._refused[number]) is not None
            and refusal.is_ahead
            and abs(refusal.newest + self._offset[number] - moment) <= self._settings.jump
            for number in other_sensors
        )

    def _new_offset(self, source: int, time: float, stream_time: float) -> float:
        """Offset with which time continues from ``stream_time``; clocks that restart together keep a common time."""
        shared_offset = 0.5  # s: clocks that restart within this time of each other share an offset
        candidates = {0.0, *self._offset}
        nearest = min(candidates, key=lambda offset: abs(time + offset - stream_time))
        # After a small step the old offset is near as well.
        limit = min(shared_offset, abs(time + self._offset[source] - stream_time) / 2)
        return nearest if abs(time + nearest - stream_time) <= limit else stream_time - time


class SensorPresence:
    """Progress of each sensor.

    Attributes:
        is_awaited: for each sensor, whether frames wait for it.
        resumed: seconds, end of the last silence of all sensors.
        lost_at: seconds, when samples were dropped in transmission last; their sensors are unknown.
    """

    def __init__(self, labels: Sequence[str], settings: AssemblySettings, log: FindingLog) -> None:
        self.is_awaited = [False] * len(labels)
        self._labels = labels
        self._settings = settings
        self._log = log
        self._reached = [-math.inf] * len(labels)  # s, newest sample that could be used
        self._arrived = [-math.inf] * len(labels)  # s, newest sample
        self.resumed = self.lost_at = -math.inf
        self._checked_at = -math.inf
        self._slowest = 0  # sensor that frames waited for last
        self._away: dict[int, str] = {}  # sensors reported as silent or late, with the text for their return

    def note(self, sensor: int, time: float, present: float, begun: bool) -> None:
        """Note a sample that can be used."""
        if time > self._reached[sensor]:
            self._reached[sensor] = time
        self._arrived[sensor] = max(self._arrived[sensor], time)
        if not self.is_awaited[sensor] and (not begun or time >= present - self._settings.patience):
            self._welcome(sensor)

    def note_late(self, sensor: int, time: float, present: float) -> None:
        """Note a sample that came too late; if longer waiting would have saved it, frames wait for the sensor again."""
        self._arrived[sensor] = max(self._arrived[sensor], time)
        if not self.is_awaited[sensor] and time >= present - self._settings.patience:
            self._reached[sensor] = max(self._reached[sensor], time)
            self._welcome(sensor)

    def report_missing(self) -> None:
        """Report the sensors without a sample before the first frame."""
        for sensor, reached in enumerate(self._reached):
            if reached == -math.inf:
                self._away[sensor] = "sends now"
                self._report_silent(sensor, "has sent nothing yet")

    def find_silent(self, present: float) -> None:
        """Report sensors that have fallen silent; checked at intervals."""
        if present - self._checked_at < self._settings.patience:
            return
        self._checked_at = present
        for sensor, reached in enumerate(self._reached):
            silent_from = max(reached, self.resumed)
            silent = present - silent_from
            if not self.is_awaited[sensor] or silent < self._settings.dead_after:
                continue
            self.is_awaited[sensor] = False
            self._away[sensor] = "is back"
            late = self._arrived[sensor] > silent_from
            what = f"{'has come too late' if late else 'has been silent'} for {silent:.1f} s"
            if self.lost_at >= silent_from:
                what = f"is without samples for {silent:.1f} s, as the tracker did not keep up and dropped some"
            self._report_silent(sensor, what)

    def _report_silent(self, sensor: int, what: str) -> None:
        words = {"what": what, "then": "going on without it"}
        self._log.add(Finding("silent", subject=self._labels[sensor], words=words))

    def complete_until(self) -> float:
        """Time (s) up to which frames are due: all awaited sensors have reached it, or patience has run out.

        Patience counts from the newest sample of any sensor; with many sensors from the second newest, so that one
        clock that runs ahead does not make all other sensors late.
        """
        many_sensors = 4
        awaited = [sensor for sensor, is_awaited in enumerate(self.is_awaited) if is_awaited]
        if not awaited:
            return max(self._reached) - self._settings.patience
        # Samples mostly arrive in the order of sensors: of equally slow ones the last decides for :meth:`waits`.
        self._slowest = min(reversed(awaited), key=self._reached.__getitem__)
        reached = sorted([self._reached[sensor] for sensor in awaited])
        pace = reached[-1 if len(reached) < many_sensors else -2]
        return max(reached[0] - self._settings.reordering, pace - self._settings.patience)

    def waits(self, time: float, present: float) -> bool:
        """Whether a frame at ``time`` still waits for the sensor that the last frame waited for (a quick check)."""
        patient = time > present - self._settings.patience
        reached = self._reached[self._slowest] - self._settings.reordering
        return patient and self.is_awaited[self._slowest] and time > reached

    def _welcome(self, sensor: int) -> None:
        self.is_awaited[sensor] = True
        if sensor in self._away:
            words = {"what": self._away.pop(sensor)}
            self._log.add(Finding("recovered", subject=self._labels[sensor], words=words))
