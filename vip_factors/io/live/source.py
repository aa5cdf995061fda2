"""Base of all live sources: a queue with limits, a reading thread, and an orderly end."""

import time
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterator
from threading import Condition, Event, Thread
from types import TracebackType
from typing import Self

from vip_factors.errors import InputError
from vip_factors.io.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.live import ImuSample, LiveFinding, LiveItem, LiveLoss, VideoFrame
from vip_factors.sensors.scene import Scene

KEPT_SHARE = 8  # one of so many IMU samples stays where they must be dropped, so that a late tracker catches up
MOST_FINDINGS = 1000  # that wait: a client that errs all the time must not fill the memory
LOSS_EVERY_S = 1.0  # seconds between losses reported to the tracker, which must know the reason of a gap
LOSS_TEXT_EVERY_S = 10.0  # seconds between losses reported to people
PAUSE_S = 0.008  # of a reader whose tracker is behind: larger reads cost less


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
        self._items: deque[tuple[float, LiveItem]] = deque()  # each with the time of its arrival
        self._waiting: Counter[type[LiveItem]] = Counter()
        self._lost: Counter[type[LiveItem]] = Counter()  # since the last report to people
        self.waited_s = 0.0
        self._has_loss = False  # since the last report to the tracker
        self._noticed_at = self._reported_at = -float("inf")
        self._finished = False
        self._closed = False

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: LiveItem) -> None:
        """Append an item; does nothing once the queue is closed."""
        kind = LiveFinding if isinstance(item, LiveFinding) else type(item)
        with self._changed:
            if not self._drops and kind is not LiveFinding:
                self._changed.wait_for(lambda: self._closed or self._samples < self._limit)
            if self._closed:
                return
            self._items.append((self._clock(), item))
            self._waiting[kind] += 1
            if self._waiting[LiveFinding] > MOST_FINDINGS:
                self._drop(LiveFinding, MOST_FINDINGS)
            elif self._samples > self._limit and self._waiting[VideoFrame]:
                self._drop(VideoFrame, self._waiting[VideoFrame] - 1)
            elif self._samples > self._limit:
                self._drop(ImuSample, max(1, self._limit // KEPT_SHARE))
            self._changed.notify_all()

    def get(self) -> LiveItem | None:
        """The next item, waiting for one; None after the last."""
        with self._changed:
            self._changed.wait_for(lambda: len(self) > 0 or self._finished or self._closed)
            if self._closed:
                return None
            finding = self._loss()
            if finding is not None or not self._items:
                return finding
            arrived, item = self._items.popleft()
            self._waiting[LiveFinding if isinstance(item, LiveFinding) else type(item)] -= 1
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
        """Is true if the oldest sample has waited longer than a pause."""
        with self._changed:
            arrivals = (arrived for arrived, entry in self._items if not isinstance(entry, LiveFinding))
            oldest = next(arrivals, None)
            return self._drops and oldest is not None and self._clock() - oldest > PAUSE_S

    @property
    def _samples(self) -> int:
        return self._waiting[VideoFrame] + self._waiting[ImuSample]

    def _drop(self, kind: type[LiveItem], limit: int) -> None:
        """Drop the oldest items of a kind until ``limit`` remain."""
        remaining: deque[tuple[float, LiveItem]] = deque()
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
        self._changed = Condition()
        self._early: list[LiveFinding] = []  # before the set-up is known
        self._setup: Scene | None = None
        self._ended = False
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
        on_finding = self.on_finding
        while True:
            early: list[LiveFinding] = []
            with self._changed:
                self._changed.wait_for(lambda: self._setup or self._ended or (on_finding and self._early))
                if on_finding is not None:
                    early, self._early = self._early, []
                setup, ended = self._setup, self._ended
            if on_finding is not None:
                for finding in early:
                    on_finding(finding)
            if setup is not None:
                return setup
            if ended:
                reason = self._early[-1].sentence if self._early else f"{self.name} ended without a header"
                raise self._error or InputError(reason)

    def __iter__(self) -> Iterator[LiveItem]:
        """Samples and findings in the order of their arrival, until the source ends.

        Raises:
            InputError: if it ends without a header.
        """
        self.setup  # noqa: B018  waits for it
        with self._changed:
            early, self._early = self._early, []
        yield from early
        while (item := self._queue.get()) is not None:
            yield item
        if self._error is not None:
            raise self._error

    def _pause(self) -> None:
        """Called by the reader before it reads on."""
        if self._queue.is_behind:
            self._stop.wait(PAUSE_S)

    def _announce(self, setup: Scene) -> None:
        """Called by the reader, once, before the first sample."""
        with self._changed:
            self._setup = setup
            self._changed.notify_all()

    def _put(self, item: LiveItem) -> None:
        """Called by the reader."""
        if self._setup is None and isinstance(item, LiveFinding):
            with self._changed:
                del self._early[: 1 - MOST_FINDINGS]  # that nobody has taken
                self._early.append(item)
                self._changed.notify_all()
        else:
            self._queue.put(item)

    def _run(self) -> None:
        try:
            self._read()
        except Exception as error:  # whatever it is, it is raised in the thread that iterates
            if not self._stop.is_set():
                self._error = error
        finally:
            self._queue.finish()
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _open(self) -> None:  # noqa: B027  not every source has something to open
        """Open the source.

        Raises:
            InputError: if that is not possible.
        """

    @abstractmethod
    def _read(self) -> None:
        """Announce the set-up, put samples and findings, return at the end or soon after ``_stop`` is set."""

    def _close(self) -> None:  # noqa: B027
        """Close the source, and wake a reader that waits longer than POLL."""
