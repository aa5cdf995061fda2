"""What a person sees while waiting, on stderr: bars at a terminal, elsewhere (a pipe, a log) a line now and then."""

import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.live import Live

Tell = Callable[[str, float], None]
"""Called with the name of a stage and the fraction of it that is done."""

# C0 and C1 controls (ESC moves cursors and sets titles), separators of lines, marks that turn text round, surrogates.
CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
LINE_S = 5.0  # between plain lines: often enough to see that it lives, and a minute fits on a screen
STREAM_LINE_S = 10.0  # of a stream, which may run for hours
MOST_SHARE = 0.99  # of a stage that goes on
SURE_S = 2.0  # before, a stage's pace is a guess
MINUTES_S = 120.0  # from here on times are told in minutes


def printable(text: str) -> str:
    """One line of text with its control characters escaped, ``\\x1b`` say: names from files never steer a terminal."""
    return CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)


class Stages:
    """The stages of some work, as they are told: the one that goes on, how far it is, and for how long yet.

    It is never wholly done: then another stage begins, or the work is over. A stage that is gone through again (a
    calibration, with feet found anew) is a stage of its own, and has a number.

    Args:
        frames: of what is worked on, if they are known.
    """

    def __init__(self, frames: int = 0) -> None:
        self._frames = f", {frames:,} frames" if frames else ""
        self._often = Counter[str]()
        self._stage, self._share, self._begun, self._told = "", 0.0, 0.0, 0.0

    def update(self, stage: str, share: float) -> None:
        """Take in how far a stage is."""
        if stage != self._stage or (self._share >= 1.0 > share):
            self._often[stage] += 1
            self._stage, self._share, self._begun = stage, 0.0, time.monotonic()
        if share > self._share:
            self._share, self._told = share, time.monotonic()

    @property
    def name(self) -> str:
        """Of the stage that goes on."""
        again = self._often[self._stage]
        if not self._stage:
            return "starting"
        return f"{self._stage}{f' {again}' if again > 1 else ''}{self._frames}"

    @property
    def share(self) -> float:
        """That is done of it, below 1; 0 as long as nothing is known."""
        return min(self._share, MOST_SHARE)

    @property
    def left(self) -> str:
        """Time until its end, if the rest goes as fast; nothing as long as that is a guess."""
        took = self._told - self._begun
        if not 0 < self._share < 1 or took < SURE_S:
            return ""
        return f"{duration(took * (1 - self._share) / self._share - (time.monotonic() - self._told))} left"

    def __str__(self) -> str:
        return ", ".join(
            part for part in (self.name, f"{int(100 * self.share)} %" * (self.share > 0), self.left) if part
        )


def duration(seconds: float) -> str:
    """As one says it: ``40 s``, ``12 min``."""
    return f"{max(seconds, 1.0):.0f} s" if seconds < MINUTES_S else f"{seconds / 60:.0f} min"


@contextmanager
def progress_bar(frames: int = 0) -> Iterator[Tell]:
    """A bar of the stage that goes on, gone when all is done; where stderr is no terminal, lines of the same.

    Args:
        frames: of what is worked on, if they are known.
    """
    stages = Stages(frames)
    if not sys.stderr.isatty():
        with _speaking(stages.__str__):
            yield stages.update
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    left = TextColumn("{task.fields[left]}")
    with Progress(*columns, TimeElapsedColumn(), left, console=Console(stderr=True), transient=True) as bars:
        bar = bars.add_task("starting", total=1.0, left="")

        def update(stage: str, share: float) -> None:
            stages.update(stage, share)
            bars.update(bar, description=stages.name, completed=stages.share, left=stages.left)

        yield update


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """A spinner for work whose length nobody knows; where stderr is no terminal, lines now and then."""
    if not sys.stderr.isatty():
        with _speaking(lambda: what):
            yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


@contextmanager
def _speaking(text: Callable[[], str]) -> Iterator[None]:
    """Say every :data:`LINE_S` seconds what is going on, from a thread: a stage may take long without a word."""
    over, begun = Event(), time.monotonic()

    def speak() -> None:
        while not over.wait(LINE_S):
            try:
                print(f"{printable(text())} ({time.monotonic() - begun:.0f} s)", file=sys.stderr, flush=True)
            except (OSError, ValueError):  # nobody reads it any more
                return

    thread = Thread(target=speak, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def note(text: str) -> None:
    """A remark that is not a result, on stderr."""
    print(printable(text), file=sys.stderr)


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

            self._live.update(Text(printable(text), no_wrap=True, overflow="ellipsis"), refresh=True)
        elif self.shown:
            self._spoken = time.monotonic()
            note(text)

    def note(self, text: str) -> None:
        """A remark on a line of its own."""
        if self._live is not None:
            self._live.console.print(printable(text), markup=False, highlight=False, soft_wrap=True)
        else:
            note(text)
