"""Base of all live sources: a queue with limits, a reading thread, findings, and an orderly end."""

import time
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterator
from threading import Condition, Event, Thread
from types import TracebackType
from typing import Self

from vip_factors.errors import InputError
from vip_factors.findings import Finding, FindingLog, bare
from vip_factors.io.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.live import ImuSample, LiveFinding, LiveItem, LiveLoss, VideoFrame
from vip_factors.sensors.scene import Scene

KEPT_SHARE = 8  # one of so many IMU samples stays where they must be dropped, so that a late tracker catches up
MOST_FINDINGS = 1000  # that wait: a client that errs all the time must not fill the memory
LOSS_EVERY_S = 1.0  # seconds between losses reported to the tracker, which must know the reason of a gap
LOSS_TEXT_EVERY_S = 10.0  # seconds between losses reported to people
PAUSE_S = 0.008  # of a reader whose tracker is behind: larger reads cost less
REPORT_EVERY_S = 1.0  # seconds between findings of one kind about one sender

QueueItem = LiveItem | Scene
"""The set-up of a stream, its samples, or a finding."""


class LiveQueue:
    """Items of one source in the order of their arrival, with the newest thousand findings.

    When more than ``limit`` samples wait, the reader waits too, or the oldest video frame is dropped. Without a video
    frame, the oldest IMU samples are dropped. A finding reports the numbers.

    Args:
        limit: of waiting samples.
        drops: False makes :meth:`put` wait instead of dropping.
        clock: monotonic seconds.

    Attributes:
        waited_s: seconds that the last item had waited; 0 if the reader waits as well.
    """

    def __init__(self, limit: int, drops: bool = True, clock: Callable[[], float] = time.monotonic) -> None:
        self._limit = limit
        self._drops = drops
        self._clock = clock
        self._changed = Condition()
        self._items: deque[tuple[float, QueueItem]] = deque()  # each with the time of its arrival
        self._waiting: Counter[type[QueueItem]] = Counter()
        self._lost: Counter[type[QueueItem]] = Counter()  # since the last report to people
        self.waited_s = 0.0
        self._has_loss = False  # since the last report to the tracker
        self._noticed_at = self._reported_at = -float("inf")
        self._finished = False
        self._closed = False

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: QueueItem) -> None:
        """Append an item; does nothing once the queue is closed."""
        with self._changed:
            if not self._drops and not isinstance(item, LiveFinding):
                self._changed.wait_for(lambda: self._closed or self._samples < self._limit)
            if self._closed:
                return
            self._items.append((self._clock(), item))
            self._waiting[type(item)] += 1
            if self._waiting[LiveFinding] > MOST_FINDINGS:
                self._drop(LiveFinding, MOST_FINDINGS)
            elif self._samples > self._limit and self._waiting[VideoFrame]:
                self._drop(VideoFrame, self._waiting[VideoFrame] - 1)
            elif self._samples > self._limit:
                self._drop(ImuSample, max(1, self._limit // KEPT_SHARE))
            self._changed.notify_all()

    def get(self) -> QueueItem | None:
        """The next item, waiting for one; None after the last."""
        with self._changed:
            self._changed.wait_for(lambda: len(self) > 0 or self._finished or self._closed)
            if self._closed:
                return None
            finding = self._loss()
            if finding is not None or not self._items:
                return finding
            arrived, item = self._items.popleft()
            self._waiting[type(item)] -= 1
            self.waited_s = self._clock() - arrived if self._drops else 0.0
            self._changed.notify_all()
            return item

    def finish(self) -> None:
        """Mark the end of the source: :meth:`get` returns None after the last item."""
        with self._changed:
            self._finished = True
            self._changed.notify_all()

    def close(self) -> None:
        """Discard all items and wake all waiting threads."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def is_behind(self) -> bool:
        """True if the oldest sample has waited longer than a pause."""
        with self._changed:
            arrivals = (arrived for arrived, item in self._items if isinstance(item, ImuSample | VideoFrame))
            oldest = next(arrivals, None)
            return self._drops and oldest is not None and self._clock() - oldest > PAUSE_S

    @property
    def _samples(self) -> int:
        return self._waiting[VideoFrame] + self._waiting[ImuSample]

    def _drop(self, kind: type[QueueItem], limit: int) -> None:
        """Drop the oldest items of a kind until ``limit`` remain."""
        remaining: deque[tuple[float, QueueItem]] = deque()
        for entry in self._items:
            if self._waiting[kind] > limit and isinstance(entry[1], kind):
                self._waiting[kind] -= 1
                self._lost[kind] += 1
            else:
                remaining.append(entry)
        self._items = remaining
        self._has_loss = self._has_loss or kind is not LiveFinding

    def _loss(self) -> LiveLoss | None:
        """Report samples dropped since the last report, if one is due."""
        now = self._clock()
        lost = {"video frames": self._lost[VideoFrame], "IMU samples": self._lost[ImuSample]}
        is_for_people = any(lost.values()) and (now - self._reported_at >= LOSS_TEXT_EVERY_S or self._finished)
        if not is_for_people and not (self._has_loss and now - self._noticed_at >= LOSS_EVERY_S):
            return None
        self._noticed_at, self._has_loss = now, False
        if is_for_people:
            self._reported_at = now
            self._lost.clear()
        what = " and ".join(f"{number} {name}" for name, number in lost.items() if number)
        return LiveLoss(
            f"the tracker does not keep up: {what} were dropped; this machine is too slow, or busy: use fewer frames "
            "per second (--frame-rate), fewer wearers, fewer cameras or a shorter lag",
            is_repeat=not is_for_people,
        )


class FindingReporter:
    """Reports problems of a sender or a file; those of one kind at most once a second, with their number.

    Args:
        name: of the sender or the file, before each sentence.
        put: gets the findings.
    """

    def __init__(self, name: str, put: Callable[[LiveFinding], None]) -> None:
        self._name, self._put = name, put
        self._log = FindingLog(REPORT_EVERY_S)

    def report(self, kind: str, sentence: str) -> None:
        """Report a sentence, or count it if another of its kind was reported a moment ago."""

        def finding(count: int) -> Finding:
            number = f" (and {count - 1} more of this kind)" if count > 1 else ""
            return bare(f"{self._name}: {sentence}{number}")

        self._log.tally(kind, time.monotonic(), finding)
        self._put_findings()

    def close(self, sentence: str = "") -> None:
        """Report what was only counted, and a last sentence."""
        self._log.close()
        if sentence:
            self._log.add(bare(f"{self._name}: {sentence}"))
        self._put_findings()

    def _put_findings(self) -> None:
        for finding in self._log.take():
            self._put(LiveFinding(str(finding)))


POLL = 0.1  # seconds between checks of a waiting thread: Ctrl-C should feel immediate
JOIN = 2.0  # seconds to wait for a thread at the end


class LiveSource(ABC):
    """A source of live samples: a context manager with ``setup`` first, then samples by iteration.

    An interrupt (Ctrl-C) while waiting passes through; leaving the context closes everything.

    Args:
        name: for sentences.
        settings: limits.
        drops: whether samples that wait for too long are dropped; False makes the reader wait instead.

    Attributes:
        on_finding: gets the findings that come before the header, at once; while it is None they begin the iteration.
        is_played: whether it is a recording that is played as fast as possible.
        listens: address and permitted senders, once open; empty if it does not listen.
    """

    def __init__(self, name: str, settings: LiveSourceSettings = DEFAULT, drops: bool = True) -> None:
        self.name = name
        self.on_finding: Callable[[LiveFinding], None] | None = None
        self.is_played, self.listens = False, ""
        self._settings = settings
        self._queue = LiveQueue(settings.queue_limit, drops)
        self._stop = Event()
        self._setup: Scene | None = None
        self._early: deque[LiveFinding] = deque(maxlen=MOST_FINDINGS)  # before the set-up, and not yet passed on
        self._error: Exception | None = None
        self._thread = Thread(target=self._run, name=f"reader of {name}", daemon=True)

    def __enter__(self) -> Self:
        self._open()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stop.set()
        self._queue.close()
        self._close()
        self._thread.join(JOIN)

    @property
    def waited_s(self) -> float:
        """Seconds that the last item had waited."""
        return self._queue.waited_s

    @property
    def awaits(self) -> str:
        """Description of the expected header, without a token."""
        return f"the header of {self.name}"

    @property
    def setup(self) -> Scene:
        """Wearers and cameras of the stream; waits for its header.

        Raises:
            InputError: if the source ends without one.
        """
        while self._setup is None:
            item = self._queue.get()
            if item is None:
                reason = self._early[-1].sentence if self._early else f"{self.name} ended without a header"
                raise self._error or InputError(reason)
            if isinstance(item, Scene):
                self._setup = item
                break
            assert isinstance(item, LiveFinding)  # samples come after the set-up
            if self.on_finding is None or isinstance(item, LiveLoss):
                self._early.append(item)
            else:
                self.on_finding(item)
        return self._setup

    def __iter__(self) -> Iterator[LiveItem]:
        """Samples and findings in the order of their arrival, until the source ends.

        Raises:
            InputError: if it ends without a header.
        """
        self.setup  # noqa: B018  waits for it
        while self._early:
            yield self._early.popleft()
        while (item := self._queue.get()) is not None:
            if not isinstance(item, Scene):
                yield item
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            self._read()
        except Exception as error:  # whatever it is, it is raised in the thread that iterates
            if not self._stop.is_set():
                self._error = error
        finally:
            self._queue.finish()

    def _open(self) -> None:  # noqa: B027  not every source has something to open
        """Open the source.

        Raises:
            InputError: if that is not possible.
        """

    @abstractmethod
    def _read(self) -> None:
        """Queue the set-up, samples and findings; return at the end or soon after ``_stop`` is set."""

    def _close(self) -> None:  # noqa: B027
        """Close the source, and wake a reader that waits longer than POLL."""
