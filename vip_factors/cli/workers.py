"""Who does the work of many recordings, or of many windows: processes on this machine, or a cluster through Dask.

Either way the same functions are called, and answer with the same futures. A recording is worked on in a process of its
own, wherever that is: one that runs out of memory or is killed costs that recording alone.
"""

import os
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vip_factors.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

    from vip_factors.stages.windows import Each

LOOK_S = 0.5  # between looks at whether to stop: a recording takes many seconds
END_S = 20.0  # until a process that was asked to end is killed: what it writes is removed by then
SIGNAL = 128  # exit codes above it tell one
CHILD = "from vip_factors.cli.workers import child; child()"
Future = Any
"""Of :mod:`concurrent.futures`, or of Dask: here they are used alike."""


@dataclass(frozen=True)
class Worker:
    """Where a task is done.

    Attributes:
        name: of the worker.
        stopped: whether the work is to be given up.
        memory: bytes that it may take; any if None.
    """

    name: str
    stopped: Callable[[], bool]
    memory: int | None = None


class Workers:
    """They call ``function(worker, task)``, so many tasks at a time on this machine."""

    def __init__(self, jobs: int) -> None:
        self._stopped = threading.Event()
        self._threads = ThreadPoolExecutor(jobs)  # they wait for processes

    def submit(self, function: Callable[..., Any], task: Any, other_than: str = "") -> Future:
        """Have a task done, if possible by another worker than that of a name."""
        return self._threads.submit(function, Worker("", self._stopped.is_set), task)

    def stop(self) -> None:
        """Give up all tasks; returns when those at work here have ended."""
        self._stopped.set()
        self._threads.shutdown(cancel_futures=True)


class _ClusterWorkers(Workers):
    """Those of a Dask cluster; a task whose worker is lost is done by another, as Dask has it."""

    def __init__(self, client: "Client") -> None:
        self._client, self._name, self._futures = client, f"vip-factors-{secrets.token_hex(8)}", list[Any]()

    def submit(self, function: Callable[..., Any], task: Any, other_than: str = "") -> Future:
        others = [one for one in self._client.scheduler_info(n_workers=-1)["workers"] if one != other_than]
        chosen = {"workers": others, "allow_other_workers": True} if other_than and others else {}
        future = self._client.submit(_on_cluster, function, task, self._name, other_than, pure=False, **chosen)
        self._futures.append(future)
        return future

    def stop(self) -> None:
        from distributed import Event

        if any(not one.done() for one in self._futures):
            Event(self._name, client=self._client).set()
            self._client.cancel(self._futures, force=True)


def _on_cluster(function: Callable[..., Any], task: Any, name: str, other_than: str) -> Any:
    from distributed import Event, Reschedule, get_client, get_worker

    dask_worker = get_worker()
    if dask_worker.address == other_than and len(get_client().scheduler_info(n_workers=-1)["workers"]) > 1:
        time.sleep(LOOK_S)
        raise Reschedule  # a worker at which tasks fail soon is idle, and Dask gives it those of the others
    limit = dask_worker.memory_manager.memory_limit
    return function(
        Worker(dask_worker.address, Event(name).is_set, limit and limit // dask_worker.state.nthreads), task
    )


@contextmanager
def cluster(address: str) -> Iterator["Client"]:
    """A connection to a Dask scheduler, by its address or by the file (.json) that it writes.

    Raises:
        InputError: without Dask, or if nobody answers there.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("--cluster needs Dask: pip install 'vip-factors[cluster]'") from error
    where = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    try:
        client = Client(**where, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster {address}: no Dask scheduler answers there ({error})") from error
    with client:
        yield client


@contextmanager
def workers(jobs: int, address: str | None) -> Iterator[Workers]:
    """So many processes here, or those of a cluster; what is not done at the end is given up.

    Raises:
        InputError: as :func:`cluster`.
    """
    with nullcontext() if address is None else cluster(address) as client:
        found = Workers(jobs) if client is None else _ClusterWorkers(client)
        try:
            yield found
        finally:
            found.stop()


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
            yield partial(_each, client.get_executor(pure=False), at_once, KilledWorker)
    elif jobs > 1:
        # Not forked: libraries have threads by now.
        pool = ProcessPoolExecutor(jobs, get_context("spawn"), _begin)
        try:
            yield partial(_each, pool, jobs, BrokenExecutor)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
    else:
        yield map


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started us ends us
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # as the pipeline has it; before NumPy comes


def _each(
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
            yield _answer(*waiting.popleft(), lost, function)
    while waiting:
        yield _answer(*waiting.popleft(), lost, function)


def _answer(task: Any, future: Any, lost: type[Exception], function: Callable[[Any], Any]) -> Any:
    if future is not None:
        with suppress(lost):
            return future.result()
    return function(task)


@dataclass(frozen=True)
class Ended:
    """How a process ended.

    Attributes:
        code: as shells tell it; that of a killed one for want of memory.
        out: what it said.
        sentence: why it failed.
    """

    code: int
    out: str
    sentence: str


def run_child(worker: Worker, words: Sequence[str], folder: Path) -> Ended:
    """Run ``vip-factors`` in a process of its own, which ends with this one.

    Args:
        worker: where this is.
        words: after the program's name.
        folder: to work in; it holds what the process says, too.
    """
    told = [folder / name for name in ("out.txt", "err.txt")]
    starved = False
    with open(told[0], "wb") as out, open(told[1], "wb") as err:
        process = subprocess.Popen([sys.executable, "-c", CHILD, *words], stdin=subprocess.PIPE, stdout=out, stderr=err)
        try:
            while process.poll() is None and not worker.stopped():
                if starved := worker.memory is not None and _memory(process.pid) > worker.memory:
                    process.kill()
                with suppress(subprocess.TimeoutExpired):
                    process.wait(LOOK_S)
        finally:
            _end(process)
    out_text, err_text = (path.read_text(encoding="utf-8", errors="replace") for path in told)
    code = process.returncode if process.returncode >= 0 else SIGNAL - process.returncode
    sentence = (err_text.strip() or f"exit code {code}").splitlines()[-1].removeprefix("vip-factors: ")
    if starved:
        sentence = f"out of memory: it took more than its share of its worker's ({(worker.memory or 0) / 1e9:.2f} GB)"
    elif code == 1 and "MemoryError" in err_text[-1000:]:
        code, sentence = SIGNAL + signal.SIGKILL, f"out of memory: {sentence}"
    elif code > SIGNAL:
        more = ": out of memory, perhaps" if code == SIGNAL + signal.SIGKILL else ""
        sentence = f"the process was ended by {signal.Signals(code - SIGNAL).name}{more}"
    return Ended(code, out_text, sentence)


def _memory(number: int) -> int:
    """Bytes that a process takes; Dask brings what tells them."""
    import psutil

    try:
        return psutil.Process(number).memory_info().rss
    except psutil.Error:  # it has ended
        return 0


def _end(process: subprocess.Popen) -> None:
    assert process.stdin is not None
    process.stdin.close()
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def child() -> None:
    """The process of :func:`run_child`: as the command line, until its standard input is closed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    from vip_factors.cli.main import main

    sys.exit(main(sys.argv[1:]))


def _end_with_parent() -> None:
    os.read(0, 1)  # unbuffered: a lock on the stream would outlast the interpreter
    os.kill(os.getpid(), signal.SIGTERM)
