"""A command at a terminal: results on stdout, progress on stderr as bars or lines, and the signals that end it."""

import os
import re
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import StringIO
from types import FrameType
from typing import TYPE_CHECKING, Self, TypeVar

from vip_factors.display import ProgressCallback
from vip_factors.errors import naming_file

if TYPE_CHECKING:
    from rich.live import Live

    from vip_factors.tables import Table

T = TypeVar("T")

# C0 and C1 controls (ESC moves cursors and sets titles), separators of lines, marks that turn text round, surrogates.
CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
LINE_S = 5.0  # between plain lines: often enough to see that it lives, and a minute fits on a screen
STREAM_LINE_S = 10.0  # of a stream, which may run for hours
UNBROKEN = 10_000  # characters, where no terminal breaks lines
STANDARD_OUTPUT = "standard output"  # in errors of writing there


def printable(text: str) -> str:
    """One line of text with its control characters escaped, ``\\x1b`` say: names from files never steer a terminal."""
    return CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)


@contextmanager
def progress_bar() -> Iterator[ProgressCallback]:
    """Show the stages of some work as bars, which are gone at its end; where stderr is no terminal, as lines."""
    if not sys.stderr.isatty():
        yield _progress_lines()
        return
    from rich import progress as bars
    from rich.console import Console

    title = bars.TextColumn("{task.description}", markup=False)
    times = bars.TimeElapsedColumn(), bars.TimeRemainingColumn()
    columns = (title, bars.BarColumn(), bars.TaskProgressColumn(), *times)
    # Results stay on standard output, which may be a pipe.
    with bars.Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as progress:
        task = progress.add_task("starting", total=1.0)

        def update(stage: str, share: float) -> None:
            if progress.tasks[task].description != printable(stage):
                progress.reset(task, description=printable(stage))
            progress.update(task, completed=share)

        yield update


def _progress_lines() -> ProgressCallback:
    begin = spoken = time.monotonic()

    def update(stage: str, share: float) -> None:
        nonlocal spoken
        moment = time.monotonic()
        if moment - spoken >= LINE_S:
            spoken = moment
            with suppress(OSError):  # nobody reads it any more
                note(f"{stage}, {100 * share:.0f} % ({moment - begin:.0f} s)")

    return update


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """Show a spinner for work whose length nobody knows; nothing where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status(Text(printable(what))):
        yield


def say(result: object) -> None:
    """Print a result, of one line or several, on standard output."""
    with naming_file(STANDARD_OUTPUT):
        print("\n".join(map(printable, str(result).split("\n"))), flush=True)


def note(remark: object) -> None:
    """A remark that is not a result, on stderr."""
    print(printable(str(remark)), file=sys.stderr)


def print_tables(tables: Iterable["Table"]) -> None:
    """Print the tables, as wide as the terminal is; where stdout is none, no line is broken."""
    say(terminal_text(tables, shutil.get_terminal_size().columns if sys.stdout.isatty() else UNBROKEN))


def terminal_text(tables: Iterable["Table"], width: int = UNBROKEN) -> str:
    """Tables below each other as plain text, those without rows left out; ``width`` in characters."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.table import Table as Grid

    texts = []
    for table in filter(lambda table: table.rows, tables):
        rows = [[printable(str(cell)) for cell in row] for row in table.rows]
        if not table.head:
            rows = [[f"{label}:", *cells] for label, *cells in rows]
        grid = Grid(box=None, show_header=bool(table.head), padding=(0, 2, 0, 0), pad_edge=False)
        longest = max(len(row[0]) for row in rows)
        for column, name in enumerate(table.head or ("", "")):
            grid.add_column(
                printable(name),
                justify="left" if column < table.words else "right",
                no_wrap=column == 0 and longest <= width // 3,  # names stay whole; Rich cuts longer ones instead
                overflow="fold",
            )
        for row in rows:
            grid.add_row(*row)
        text = StringIO()
        console = Console(file=text, width=width, color_system=None, markup=False, emoji=False)
        console.print(Padding(grid, (0, 0, 0, 2)))
        lines = [line.rstrip() for line in text.getvalue().splitlines()]
        texts.append("\n".join([printable(table.title), *lines] if table.title else lines))
    return "\n\n".join(texts)


class StatusLine:
    """One line that changes in place, with remarks scrolling above it; where stderr is no terminal, it is printed anew
    every :data:`STREAM_LINE_S` seconds. If not ``wanted``, for remarks only.

    A context manager; the line is gone at its end.
    """

    def __init__(self, wanted: bool = True) -> None:
        self._live: Live | None = None
        self._wanted, self._spoken = wanted, time.monotonic()
        if wanted and sys.stderr.isatty():
            from rich.console import Console
            from rich.live import Live as RichLive

            # Drawn on request, not by a thread of its own: nothing may get between the caller's updates.
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


def give_up_output() -> None:
    """Forget what could not be written to standard output, or Python would try once more at its end."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  # for as long as we live


class Ending:
    """Takes Ctrl-C and SIGTERM: the end comes as KeyboardInterrupt, so that everything half-written is removed.

    A context manager. Signals that somebody else takes, or ignores, are left to them.

    Attributes:
        number: of the signal that has asked for the end; 0 without one.
    """

    is_exclusive = False  # whether signals are taken from whoever took or ignored them

    def __init__(self) -> None:
        self.number = 0
        self._process = os.getpid()

    def __enter__(self) -> Self:
        # Only the main thread may set handlers; elsewhere whoever runs us takes care of signals.
        is_main = threading.current_thread() is threading.main_thread()
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM) if is_main}
        free = (signal.SIG_DFL, signal.default_int_handler)
        self._before = {number: handler for number, handler in handlers.items() if self.is_exclusive or handler in free}
        for number in self._before:
            signal.signal(number, self.ask)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @property
    def exit_code(self) -> int:
        """Exit code that shells report for a program stopped by the signal; 130 for Ctrl-C."""
        return 128 + (self.number or signal.SIGINT)

    def ask(self, number: int, frame: FrameType | None) -> None:
        """Signal handler: request the end.

        Raises:
            KeyboardInterrupt: always, in this process; its forks end as without a handler.
        """
        if os.getpid() != self._process and number == signal.SIGTERM:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        self.number = number
        raise KeyboardInterrupt


class Interrupts(Ending):
    """Ctrl-C or SIGTERM end a stream between two samples, not within an update or half a line.

    A second one interrupts whatever goes on.

    Attributes:
        on_asked: called by the first one, wherever the program is.
    """

    is_exclusive = True

    def __init__(self) -> None:
        super().__init__()
        self.on_asked: Callable[[], None] = lambda: None
        self._waiting = False

    @property
    def asked(self) -> bool:
        """Whether a signal has come."""
        return self.number != 0

    def until_asked(self, source: Iterator[T]) -> Iterator[T]:
        """The items of a source, until it ends or one of the signals comes."""
        while True:
            try:
                item = self.waiting_for(lambda: next(source))
            except StopIteration:
                return
            except KeyboardInterrupt:
                self.number = self.number or signal.SIGINT
                return
            yield item

    def waiting_for(self, wait: Callable[[], T]) -> T:
        """Return the result of ``wait``, which the signals interrupt.

        Raises:
            KeyboardInterrupt: then.
        """
        self._waiting = True
        try:
            if self.asked:  # looked at after that, lest one between the two be waited over
                raise KeyboardInterrupt
            return wait()
        finally:
            self._waiting = False

    def ask(self, number: int, frame: FrameType | None) -> None:
        """Signal handler: request the end of the stream."""
        is_repeated, self.number = self.asked, number
        if not is_repeated:
            self.on_asked()
        if self._waiting or is_repeated:
            raise KeyboardInterrupt
