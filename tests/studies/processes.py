"""Processes: work in one of its own, memory of this one, and what others take where the system (Linux) shows them."""

import os
import resource
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import ParamSpec, TypeVar

from tests.running_processes import PROC, begun_by, process_status

P = ParamSpec("P")
T = TypeVar("T")


def apart(work: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
    """What a function returns in a new process, which has a peak memory of its own and gives all of it back."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *arguments, **named).result()


def peak_memory() -> int:
    """Peak resident memory of this process so far, bytes."""
    status = PROC / "self" / "status"
    if status.is_file():  # Linux: there ru_maxrss of a new process begins with its parent's
        line = next((line for line in status.read_text().splitlines() if line.startswith("VmHWM:")), None)
        if line is not None:
            return 1024 * int(line.split()[1])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak  # macOS counts in bytes, others in KiB


@dataclass(frozen=True)
class ProcessTree:
    """A program and the processes that it has begun, at one moment.

    Attributes:
        own: resident bytes of the program itself.
        others: of the processes below it.
        cpu_s: seconds of processor time of the program itself, since it began.
    """

    own: int
    others: int
    cpu_s: float


def process_tree(pid: int) -> ProcessTree | None:
    """What a program takes now; None if it is over, or the system does not say."""
    fields = process_status(pid)
    if fields is None:
        return None
    return ProcessTree(_resident(pid), sum(map(_resident, begun_by(pid))), cpu_seconds(pid)[0])


def cpu_seconds(pid: int) -> tuple[float, float]:
    """Of a process itself, and of those that it began and that have ended; NaN where the system does not say."""
    fields = process_status(pid)
    if fields is None:
        return float("nan"), float("nan")
    own, begun = (sum(map(int, fields[first : first + 2])) / os.sysconf("SC_CLK_TCK") for first in (11, 13))
    return own, begun


def _resident(pid: int) -> int:
    try:
        return int((PROC / str(pid) / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):  # it has ended since
        return 0
