"""The process that finds calibrations anew: stretches go in, and what tracking goes on with comes out.

A program of its own behind two pipes, and no ``multiprocessing``: that would run a user's script or notebook again to
start with, and a script that tracks at its top level would never end.
"""

import contextlib
import os
import pickle
import subprocess
import sys
import threading
import time
import weakref
from concurrent.futures import Future

from vip_factors.errors import SolveError, VipFactorsError
from vip_factors.live.buffered import MeasuredStretch
from vip_factors.live.coarse import Known
from vip_factors.live.settings import LiveSettings
from vip_factors.live.start import Started

LOOK_S = 1.0  # seconds between looks whether the program that tracks is still there
POLITE = 10  # of niceness: the tracker's updates come first where both want a core


class RecalibrationProcess:
    """Begun when it is made; ended by :meth:`close`, or with the program."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            start_new_session=True,  # Ctrl-C is for the program that tracks
        )
        self._end = weakref.finalize(self, _ended, self._process)

    def submit(self, stretch: MeasuredStretch, settings: LiveSettings, known: Known | None = None) -> "Future[Started]":
        """Have a stretch solved; one at a time. The answer raises :class:`SolveError` where there is none."""
        answer: Future[Started] = Future()
        work = (self._process, pickle.dumps((stretch, settings, known), pickle.HIGHEST_PROTOCOL), answer)
        threading.Thread(target=_exchange, args=work, daemon=True).start()
        return answer

    def close(self) -> None:
        """End it, whatever it does."""
        self._end()


def _exchange(process: "subprocess.Popen[bytes]", work: bytes, answer: "Future[Started]") -> None:
    """Hand work over and wait for what comes back."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(work)
        process.stdin.flush()
        found = pickle.load(process.stdout)
    except (OSError, ValueError, EOFError, pickle.UnpicklingError):
        found = "the process that should find it has ended"
    if isinstance(found, Started):
        answer.set_result(found)
    else:
        answer.set_exception(SolveError(str(found)))


def _ended(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):  # what was still to be written is lost with the process
                pipe.close()


def _end_with(parent: int) -> None:
    """End when the program that tracks is gone: what it was killed in the midst of takes half a minute more."""
    while os.getppid() == parent:
        time.sleep(LOOK_S)
    os._exit(1)


def main() -> None:
    """Solve what comes through standard input until it ends."""
    from vip_factors.live.recalibration import recalibrate

    if hasattr(os, "nice"):
        os.nice(POLITE)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no answer
    while True:
        try:
            stretch, settings, known = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        found: Started | str
        try:
            found = recalibrate(stretch, settings, known)
        except VipFactorsError as error:
            found = str(error)
        except Exception as error:  # the stream goes on with what it has, and says so
            found = f"{type(error).__name__}: {error}"
        try:
            pickle.dump(found, answers, pickle.HIGHEST_PROTOCOL)
            answers.flush()
        except BrokenPipeError:  # the program that tracks was killed meanwhile
            os._exit(1)  # without another attempt to write what is in the buffer


if __name__ == "__main__":
    main()
