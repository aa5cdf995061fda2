"""Time and memory that reading one small file may take."""

import faulthandler
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SECONDS, MEMORY = 10.0, 2 * 2**30
IDLE = 6  # times as long may pass while others have the processor


class Hang(BaseException):
    """Something took longer than it may; no Exception, so that nobody catches it by accident."""


@contextmanager
def limited_memory(extra: int = MEMORY) -> Iterator[None]:
    """Let the process have so many bytes more than it has: beyond them, allocation fails with a MemoryError.

    Where the system knows no such limit, nothing is limited.
    """
    try:
        import resource

        with open("/proc/self/statm") as file:
            now = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError, ValueError):
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_AS)
    soft = now + extra if before[1] == resource.RLIM_INFINITY else min(now + extra, before[1])
    resource.setrlimit(resource.RLIMIT_AS, (soft, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@contextmanager
def limited_time(seconds: float = SECONDS) -> Iterator[None]:
    """Raise :class:`Hang` after so many seconds of computing, or :data:`IDLE` times as many of waiting.

    In the main thread only, and only where the system has such alarms; a loop within a C library ends first. If that
    does not end, the whole program does, and prints where it was; the damaged file is left in its temporary folder.
    """
    if not hasattr(signal, "setitimer"):
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise Hang(f"took more than {seconds:g} s")

    alarms = ((signal.SIGPROF, signal.ITIMER_PROF, seconds), (signal.SIGALRM, signal.ITIMER_REAL, IDLE * seconds))
    before = [signal.signal(number, stop) for number, _, _ in alarms]
    try:
        for _, timer, after in alarms:
            signal.setitimer(timer, after)
        # What a command prints may be caught; where it was is for whoever started the program.
        faulthandler.dump_traceback_later(2 * IDLE * seconds, exit=True, file=sys.__stderr__ or sys.stderr)
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        for (number, timer, _), handler in zip(alarms, before, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, handler)


def out_of_memory(error: BaseException | None) -> bool:
    """Whether an exception, or one that it was made of, is a lack of memory."""
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False
