"""Workers for many recordings, or for the windows of a long one: local processes or a Dask cluster."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vip_factors.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

    from vip_factors.stages.windows import MapFn

CONNECT_S = 2.0  # until a scheduler has answered
LOOK_S = 0.5  # between looks at whether to stop
END_S = 20.0  # until a process that was asked to end is killed: what it writes is removed by then
SIGNAL = 128  # exit codes above it tell a signal
# A process of run_child: as the command line, until its standard input is closed.
CHILD = "import sys; from vip_factors.cli import main, workers; workers.end_with_parent(); sys.exit(main.main())"


@contextmanager
def cluster(address: str) -> Iterator["Client"]:
    """A connection to a Dask scheduler, by its address or by the file (.json) that it writes.

    Raises:
        InputError: without Dask, or if no scheduler answers there.
    """
    import asyncio

    try:
        from distributed import Client, Security
        from distributed.core import rpc
    except ImportError as error:
        raise InputError("--cluster needs Dask: pip install 'vip-factors[cluster]'") from error

    async def kind(scheduler: str) -> str:
        async with rpc(scheduler, connection_args=Security().get_connection_args("client")) as remote:
            return str((await asyncio.wait_for(remote.identity(), CONNECT_S))["type"])

    try:
        scheduler = json.loads(Path(address).read_bytes())["address"] if address.endswith(".json") else address
        if (server := asyncio.run(kind(scheduler))) != "Scheduler":  # a client would ask for minutes
            raise InputError(f"it is a {server}'s address")
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except Exception as error:  # whatever Dask makes of what is not a scheduler's
        reason = f" ({error})" if isinstance(error, ValueError | OSError) and str(error) else ""
        raise InputError(f"--cluster {address}: no Dask scheduler answers there{reason}") from error
    with client:
        yield client


@contextmanager
def workers(jobs: int, address: str | None) -> Iterator[Callable[..., Any]]:
    """A function that submits a call of a function on a task, and returns its future.

    Calls run in ``jobs`` threads, which wait for processes, or on the Dask cluster at ``address``. What is not done at
    the end is given up: threads learn it from the function's second argument, a cluster ends what it has begun.
    """
    if address is not None:
        with cluster(address) as client:
            executor = client.get_executor(pure=False)
            try:
                yield lambda function, task: executor.submit(function, task)
            finally:
                executor.shutdown(wait=False)
        return
    stopped, threads = threading.Event(), ThreadPoolExecutor(jobs)
    try:
        yield lambda function, task: threads.submit(function, task, stopped.is_set)
    finally:
        stopped.set()
        threads.shutdown(cancel_futures=True)


@contextmanager
def windows_elsewhere(jobs: int, address: str | None) -> Iterator["MapFn"]:
    """What calls a function on each of many things, as :func:`map`, some ahead: in ``jobs`` processes (one: in this
    one), or on the Dask cluster at ``address``.
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


def run_child(words: Sequence[str], folder: Path, is_stopped: Callable[[], bool]) -> tuple[int, str]:
    """Run ``vip-factors`` in a process of its own, which ends with this one: if it is killed, it costs itself alone.

    Returns:
        Exit code as shells tell it, and a sentence on why it failed; empty if it did not.
    """
    command = [sys.executable, "-c", CHILD, *words]
    with open(folder / "err.txt", "w+b") as err:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=err)
        assert process.stdin is not None
        try:
            while process.poll() is None and not is_stopped():
                with suppress(subprocess.TimeoutExpired):
                    process.wait(LOOK_S)
        finally:
            process.stdin.close()
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        err.seek(0)
        complaint = err.read().decode("utf-8", "replace").strip()
    code = process.returncode if process.returncode >= 0 else SIGNAL - process.returncode
    if code > SIGNAL:
        reason = ", for want of memory, perhaps" if code == SIGNAL + signal.SIGKILL else ""
        return code, f"the process was ended by {signal.Signals(code - SIGNAL).name}{reason}"
    sentence = (complaint or f"exit code {code}").splitlines()[-1].removeprefix("vip-factors: ")
    return code, sentence if code else ""


def end_with_parent() -> None:
    """Have SIGTERM sent to this process once its standard input is closed."""

    def wait_for_end() -> None:
        os.read(0, 1)  # unbuffered: a lock on the stream would outlast the interpreter
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait_for_end, daemon=True).start()
