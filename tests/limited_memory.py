"""A limit of memory, for what must not take more whatever it is given."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def limited_memory(extra: int) -> Iterator[None]:
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
