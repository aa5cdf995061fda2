"""A scene's samples through the tracker: what it answered, and when."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.studies.faults import Fault
from vip_factors.io.live.queue import LiveQueue
from vip_factors.io.live.settings import LiveSourceSettings
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveFinding, LiveLoss, LiveSample, LiveSetup


@dataclass(frozen=True)
class StreamRun:
    """What came of a stream.

    Attributes:
        answers: in order.
        arrival: of each answer, the scene's own time (s) when it was given.
        told: sentences of the queue, with when.
        clock_shift_s: by which the answers' times lag behind the scene's at the end.
    """

    answers: tuple[LiveEstimate, ...]
    arrival: tuple[float, ...]
    told: tuple[tuple[float, str], ...] = ()
    clock_shift_s: float = 0.0

    @property
    def findings(self) -> list[tuple[float, str]]:
        """All sentences with the time at which they were said."""
        said = [
            (time, sentence)
            for answer, time in zip(self.answers, self.arrival, strict=True)
            for sentence in answer.findings
        ]
        return sorted([*said, *self.told], key=lambda one: one[0])

    def latency(self, start: float, end: float) -> float:
        """How old the newest pose was at most, seconds, of answers given from ``start`` to ``end``."""
        ages = [
            arrival - one.time
            for one, arrival in zip(self.answers, self.arrival, strict=True)
            if start <= arrival < end and one.wearers[0].smoothed is not None
        ]
        return max(ages, default=float("nan"))


def run_stream(
    samples: Iterable[LiveSample], setup: LiveSetup, settings: LiveSettings, fault: Fault | None
) -> StreamRun:
    """Track a stream, with a fault if there is one.

    Args:
        samples: undisturbed, in the order of their times.
        setup: of the stream.
        settings: of the tracker.
        fault: what is done to the samples, and to the tracker.
    """
    sent = _Sent(samples)
    changed = iter(sent) if fault is None else fault.change(sent)
    if fault is not None and fault.overload_s:
        return _overloaded(list(changed), setup, settings, fault)
    tracker, again = FixedLagTracker(setup, settings), fault is not None and fault.restart
    answers: list[LiveEstimate] = []
    arrival: list[float] = []
    for sample in changed:
        if fault is not None and again and sample.time >= fault.end:
            again = False
            answers += (rest := tracker.finish())
            arrival += [sent.now] * len(rest)
            tracker = FixedLagTracker(_unposed(setup), settings)
        new = tracker.push(sample)
        answers += new
        arrival += [sent.now] * len(new)
    rest = tracker.finish()
    run = StreamRun((*answers, *rest), (*arrival, *[sent.now] * len(rest)))
    return _on_the_scenes_clock(run, fault) if fault is not None and fault.jump else run


class _Sent:
    """Undisturbed samples; ``now`` is the newest one's time, when what a fault makes of it comes."""

    def __init__(self, samples: Iterable[LiveSample]) -> None:
        self._samples, self.now = samples, 0.0

    def __iter__(self) -> Iterator[LiveSample]:
        for sample in self._samples:
            self.now = max(self.now, sample.time)
            yield sample


def _unposed(setup: LiveSetup) -> LiveSetup:
    return replace(setup, wearers=tuple(replace(one, initial_pose="none") for one in setup.wearers))


def _on_the_scenes_clock(run: StreamRun, fault: Fault) -> StreamRun:
    """Answers after a leap of all clocks, at the times of what they show: a stream cannot know how long it took."""
    ages = np.array([arrival - one.time for one, arrival in zip(run.answers, run.arrival, strict=True)])
    arrival = np.array(run.arrival)
    before, after = arrival < fault.begin, arrival > fault.begin + 2
    shift = float(np.median(ages[after]) - np.median(ages[before])) if after.any() and before.any() else 0.0
    moved = tuple(
        _moved(one, shift) if time >= fault.begin else one
        for one, time in zip(run.answers, run.arrival, strict=True)
    )  # fmt: skip
    return replace(run, answers=moved, clock_shift_s=shift)


def _moved(answer: LiveEstimate, shift: float) -> LiveEstimate:
    wearers = tuple(
        replace(
            one,
            newest=replace(one.newest, time=one.newest.time + shift),
            smoothed=None if one.smoothed is None else replace(one.smoothed, time=one.smoothed.time + shift),
        )
        for one in answer.wearers
    )
    return replace(answer, time=answer.time + shift, wearers=wearers)


def _overloaded(samples: Sequence[LiveSample], setup: LiveSetup, settings: LiveSettings, fault: Fault) -> StreamRun:
    """The queue between a source and a tracker that takes its time, on a clock that is made: any machine gives this."""
    now = 0.0
    queue = LiveQueue(LiveSourceSettings().queue_limit, clock=lambda: now)
    tracker = FixedLagTracker(setup, settings)
    answers: list[LiveEstimate] = []
    arrival: list[float] = []
    told: list[tuple[float, str]] = []
    waiting: Iterator[LiveSample] = iter(samples)
    coming = next(waiting, None)
    while coming is not None or len(queue):
        if not len(queue) and coming is not None:
            now = max(now, coming.time)
        while coming is not None and coming.time <= now:
            queue.put(coming)
            coming = next(waiting, None)
        item = queue.get()
        if isinstance(item, LiveLoss):
            tracker.note_loss()
            told += [] if item.again else [(now, item.sentence)]
        elif isinstance(item, LiveFinding):
            told.append((now, item.sentence))
        elif item is not None:
            new = tracker.push(item)
            slow = fault.begin <= now < fault.end
            now += len(new) * (fault.overload_s if slow else 0.2 / settings.frame_rate)
            answers += new
            arrival += [now] * len(new)
    rest = tracker.finish()
    return StreamRun((*answers, *rest), (*arrival, *[now] * len(rest)), tuple(told))
