"""What all live sources have in common: a thread that reads, a queue, and an orderly end."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from threading import Condition, Event, Thread
from types import TracebackType
from typing import Self

from vip_factors.errors import InputError
from vip_factors.io.live.queue import MOST_FINDINGS, LiveQueue
from vip_factors.io.live.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.live import LiveFinding, LiveItem, LiveSetup

POLL = 0.1  # seconds after which a waiting thread looks whether it is still wanted: Ctrl-C should feel immediate
JOIN = 2.0  # seconds that the end waits for the thread: it looks every POLL seconds


class LiveSource(ABC):
    """A context manager: it opens and closes the source; ``setup`` comes first, then samples by iteration.

    The thread holds the interpreter for microseconds a sample, so that it gets its turn even beside a busy tracker.
    An interrupt (Ctrl-C) while waiting passes through, and leaving the context closes everything.

    Args:
        name: for sentences.
        settings: limits.
        drops: whether samples that wait for too long are dropped; False makes the reader wait instead.
        tell: gets the findings that come before the header, at once; without it they begin the iteration.
    """

    def __init__(
        self,
        name: str,
        settings: LiveSourceSettings = DEFAULT,
        drops: bool = True,
        tell: Callable[[LiveFinding], None] | None = None,
    ) -> None:
        self.name = name
        self._settings = settings
        self._tell = tell
        self._queue = LiveQueue(settings.queue_limit, drops)
        self._stop = Event()
        self._changed = Condition()
        self._early: list[LiveFinding] = []  # before the set-up is known
        self._setup: LiveSetup | None = None
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
    def listens(self) -> str:
        """Where it listens and who can send, in words, once open; empty if it does not listen."""
        return ""

    @property
    def setup(self) -> LiveSetup:
        """What the stream is about, waiting for its header.

        Raises:
            InputError: if the source ends without one.
        """
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._setup or self._ended or (self._tell and self._early))
                early = self._early if self._tell else []
                self._early = [] if self._tell else self._early
                setup, ended = self._setup, self._ended
            for finding in early:
                if self._tell is not None:
                    self._tell(finding)
            if setup is not None:
                return setup
            if ended and not self._early:
                raise self._error or InputError(f"{self.name} ended without a header")
            if ended:
                raise self._error or InputError(self._early[-1].sentence)

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

    def _announce(self, setup: LiveSetup) -> None:
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
        """Take hold of what is read.

        Raises:
            InputError: if that is not possible.
        """

    @abstractmethod
    def _read(self) -> None:
        """Announce the set-up, put samples and findings, return at the end or soon after ``_stop`` is set."""

    def _close(self) -> None:  # noqa: B027
        """Let go of what was opened; wakes the reader if it waits for longer than POLL."""
