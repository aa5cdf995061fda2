"""What the command line is to the shell: signals that end it in order, and streams that take any text."""

import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM)


class Ending:
    """Which signal has asked for the end, if any has.

    Attributes:
        number: of the signal; 0 without one.
    """

    def __init__(self) -> None:
        self.number = 0
        self._process = os.getpid()

    @property
    def exit_code(self) -> int:
        """What shells report for a program that the signal stopped; 130 for Ctrl-C."""
        return 128 + (self.number or signal.SIGINT)

    def ask(self, number: int, frame: FrameType | None) -> None:
        """As a handler: the end comes as KeyboardInterrupt, so that everything half-written is removed.

        Raises:
            KeyboardInterrupt: always, in this process; its forks end as without a handler.
        """
        if os.getpid() != self._process and number == signal.SIGTERM:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        self.number = number
        raise KeyboardInterrupt


@contextmanager
def ending() -> Iterator[Ending]:
    """Take the signals that ask for the end; those that somebody else takes, or ignores, are left to them."""
    found, before = Ending(), {}
    if threading.current_thread() is threading.main_thread():
        for number in ENDING:
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                before[number] = signal.signal(number, found.ask)
    try:
        yield found
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def open_streams() -> None:
    """Make sure that there is an output to write to, and that it takes all characters: what it has not is escaped."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by who started us
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  # for as long as we live
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
