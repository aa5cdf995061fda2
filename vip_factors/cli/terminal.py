"""What a person sees while waiting, on stderr: bars at a terminal, elsewhere (a pipe, a log) a line now and then."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.live import Live

Tell = Callable[[str, float], None]
"""Called with the name of a stage and the fraction of it that is done."""

LINE_S = 5.0  # between plain lines: often enough to see that it lives, and a minute fits on a screen
STREAM_LINE_S = 10.0  # of a stream, which may run for hours


@contextmanager
def progress_bar() -> Iterator[Tell]:
    """A bar per stage, gone when all is done; where stderr is no terminal, lines of stage and share."""
    if not sys.stderr.isatty():
        with _speaking("starting") as said:

            def say(stage: str, fraction: float) -> None:
                said.text = f"{stage}, {100 * min(max(fraction, 0.0), 1.0):.0f} %"

            yield say
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def tell(stage: str, fraction: float) -> None:
            if stage not in tasks:
                for task in tasks.values():  # a new stage: those before it are done
                    bars.update(task, completed=1.0)
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=min(max(fraction, 0.0), 1.0))

        yield tell


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """A spinner for work whose length nobody knows; where stderr is no terminal, lines now and then."""
    if not sys.stderr.isatty():
        with _speaking(what):
            yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


class _Said:
    """What is going on, to be read by the thread that speaks."""

    def __init__(self, text: str) -> None:
        self.text = text


@contextmanager
def _speaking(text: str) -> Iterator[_Said]:
    """Say every :data:`LINE_S` seconds what is going on, from a thread: a stage may take long without a word."""
    said, over, begun = _Said(text), Event(), time.monotonic()

    def speak() -> None:
        while not over.wait(LINE_S):
            try:
                print(f"{said.text} ({time.monotonic() - begun:.0f} s)", file=sys.stderr, flush=True)
            except (OSError, ValueError):  # nobody reads it any more
                return

    thread = Thread(target=speak, daemon=True)
    thread.start()
    try:
        yield said
    finally:
        over.set()
        thread.join()


def note(text: str) -> None:
    """A remark that is not a result, on stderr."""
    print(text, file=sys.stderr)


class StatusLine:
    """One line that changes in place, with remarks scrolling above it; where stderr is no terminal, it is printed anew
    every :data:`STREAM_LINE_S` seconds.

    A context manager; the line is gone at its end.

    Args:
        wanted: False for remarks only.
    """

    def __init__(self, wanted: bool = True) -> None:
        self._live: Live | None = None
        self._wanted, self._spoken = wanted, time.monotonic()
        if wanted and sys.stderr.isatty():
            from rich.console import Console
            from rich.live import Live as RichLive

            # Drawn when told to, not by a thread of its own: nothing may get between the caller's updates.
            self._live = RichLive(console=Console(stderr=True), auto_refresh=False, transient=True)

    def __enter__(self) -> "StatusLine":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    @property
    def shown(self) -> bool:
        """Whether anybody would see the line now."""
        due = self._wanted and time.monotonic() - self._spoken >= STREAM_LINE_S
        return self._live is not None or due

    def show(self, text: str) -> None:
        """Put another text into the line, cut at the terminal's width."""
        if self._live is not None:
            from rich.text import Text

            self._live.update(Text(text, no_wrap=True, overflow="ellipsis"), refresh=True)
        elif self.shown:
            self._spoken = time.monotonic()
            note(text)

    def note(self, text: str) -> None:
        """A remark on a line of its own."""
        if self._live is not None:
            self._live.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            note(text)
