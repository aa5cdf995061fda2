"""Who solves the windows of one long recording: this process, others of this machine, or a cluster through Dask."""

import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import active_children, get_context
from typing import TYPE_CHECKING, Any

from vip_factors.cli.workers import cluster

if TYPE_CHECKING:
    from vip_factors.stages.windows import Each


@contextmanager
def windows_elsewhere(jobs: int, address: str | None) -> Iterator["Each"]:
    """What calls a function on each of many things, as :func:`map`, in other processes, some of them ahead.

    Args:
        jobs: processes; with one, it is done in this one.
        address: of a Dask cluster, if it is to be done there.

    Raises:
        InputError: as :func:`cluster`.
    """
    if address is not None:
        with cluster(address) as client:
            from distributed import KilledWorker

            at_once = max(sum(client.nthreads().values()), 1)
            yield partial(_in_order, client.get_executor(pure=False), at_once, KilledWorker)
    elif jobs > 1:
        # Not forked: libraries have threads by now.
        pool = ProcessPoolExecutor(jobs, get_context("spawn"), _begin)
        try:
            yield partial(_in_order, pool, jobs, BrokenExecutor)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
    else:
        yield map


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started us ends us
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # as the pipeline has it; before NumPy comes


def _in_order(
    executor: Executor, at_once: int, lost: type[Exception], function: Callable[[Any], Any], tasks: Iterable[Any]
) -> Iterator[Any]:
    """Results in order; what a lost process did not do is done here."""
    waiting = deque[tuple[Any, Any]]()
    for task in tasks:
        future = None
        with suppress(lost):
            future = executor.submit(function, task)
        waiting.append((task, future))
        if len(waiting) > at_once:  # one more than there are processes: none waits for its task to be read
            yield _result(*waiting.popleft(), lost, function)
    while waiting:
        yield _result(*waiting.popleft(), lost, function)


def _result(task: Any, future: Any, lost: type[Exception], function: Callable[[Any], Any]) -> Any:
    if future is not None:
        with suppress(lost):
            return future.result()
    return function(task)
