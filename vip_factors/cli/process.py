"""What the command line is to the shell: signals that end it in order, and streams that take any text."""

import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from vip_factors.errors import naming_file

STANDARD_OUTPUT = "standard output"
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


class _StandardOutput(io.FileIO):
    """Standard output, whose errors name it: to the system it is a number."""

    def write(self, data: Any, /) -> int:
        with naming_file(STANDARD_OUTPUT):
            return super().write(data)


def open_streams() -> None:
    """Make sure that there is an output to write to, and that it takes all characters: what it has not is escaped."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by who started us
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  # for as long as we live
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
            if name == "stdout" and type(stream) is io.TextIOWrapper:
                sys.stdout = _named(stream)


def _named(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """The same output with a name; Python itself keeps the first one open, as ``sys.__stdout__``."""
    if stream is not sys.__stdout__:
        return stream
    stream.flush()
    raw = _StandardOutput(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(raw), stream.encoding, stream.errors, line_buffering=stream.line_buffering
    )


def give_up_output() -> None:
    """Forget what could not be written to standard output, or Python would try once more at its end."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  # for as long as we live
