"""What a person at a terminal sees while waiting: on stderr, and nothing where stderr is not a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.live import Live

Tell = Callable[[str, float], None]
"""Called with the name of a stage and the fraction of it that is done."""


@contextmanager
def progress_bar() -> Iterator[Tell]:
    """A bar per stage, gone when all is done."""
    if not sys.stderr.isatty():
        yield lambda stage, fraction: None
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
    """A spinner for work whose length nobody knows."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


def note(text: str) -> None:
    """A remark that is not a result, on stderr."""
    print(text, file=sys.stderr)


class StatusLine:
    """One line that changes in place, with remarks scrolling above it; where stderr is no terminal, remarks only.

    A context manager; the line is gone at its end.

    Args:
        wanted: False for remarks only.
    """

    def __init__(self, wanted: bool = True) -> None:
        self._live: Live | None = None
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
        """Whether anybody sees the line."""
        return self._live is not None

    def show(self, text: str) -> None:
        """Put another text into the line, cut at the terminal's width."""
        if self._live is not None:
            from rich.text import Text

            self._live.update(Text(text, no_wrap=True, overflow="ellipsis"), refresh=True)

    def note(self, text: str) -> None:
        """A remark on a line of its own."""
        if self._live is not None:
            self._live.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            note(text)
