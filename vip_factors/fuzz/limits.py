"""Time and memory that reading one small file may take."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SECONDS, MEMORY = 10.0, 2 * 2**30


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
    """Raise :class:`Hang` after so many seconds, where the system has such an alarm; in the main thread only."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise Hang(f"took more than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
