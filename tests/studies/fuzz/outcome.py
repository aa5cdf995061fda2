"""What came of reading one file, within limits of time and memory: read, refused in a sentence, or neither.

Here, or in a process of its own.
"""

import faulthandler
import json
import os
import re
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from types import FrameType

import vip_factors
from tests.limited_memory import limited_memory
from vip_factors.errors import VipFactorsError

SECONDS, MEMORY = 10.0, 2 * 2**30
IDLE = 6  # times as long may pass while others have the processor
PACKAGE = Path(vip_factors.__file__).parent
REFUSALS = (VipFactorsError, OSError)
POLL_S = 0.002
MORE_S = 2  # seconds that a process may compute beyond what its own alarm allows


class Verdict(StrEnum):
    """What came of it, in one word."""

    READ = "read"
    REFUSED = "refused"
    FAILED = "failed"


@dataclass(frozen=True)
class Outcome:
    """Of one attempt.

    Attributes:
        verdict: in one word.
        kind: type of the exception of one that failed, or name of the signal that ended its process.
        place: innermost line of this package that it came from.
        text: of the exception.
        trace: as Python prints it.
    """

    verdict: Verdict
    kind: str = ""
    place: str = ""
    text: str = ""
    trace: str = ""


def outcome(read: Callable[[], object]) -> Outcome:
    """Read, within the limits of time and memory."""
    try:
        with limited_memory(MEMORY), limited_time():
            read()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # panics of libraries in Rust are no Exception, and the parser of options exits
        if isinstance(error, REFUSALS) and not out_of_memory(error):
            return Outcome(Verdict.REFUSED, text=str(error))
        kind = "MemoryError" if out_of_memory(error) else type(error).__name__
        trace = "".join(traceback.format_exception(error))
        return Outcome(Verdict.FAILED, kind, _place(error), str(error), trace)
    return Outcome(Verdict.READ)


def outcome_apart(read: Callable[[], object]) -> Outcome:
    """The same in a process of its own, so that a native library that crashes or hangs takes nothing with it.

    Where the system cannot fork, in this one.
    """
    if not hasattr(os, "fork"):
        return outcome(read)
    with tempfile.TemporaryFile() as answer, tempfile.TemporaryFile() as errors:
        process = os.fork()
        if process == 0:
            _read_and_exit(read, answer.fileno(), errors.fileno())
        status = _ended(process)
        for file in (answer, errors):
            file.seek(0)
        content, trace = answer.read(), errors.read().decode(errors="replace")
    if content:
        found = json.loads(content)
        return Outcome(Verdict(found.pop("verdict")), **found)
    if status is None or os.WTERMSIG(status) == signal.SIGXCPU:
        kind, text = Hang.__name__, "a native library does not return"
    else:
        text = "the process ended"
        kind = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"exit {os.WEXITSTATUS(status)}"
    # Of what Python prints of a crash, innermost first.
    own = re.findall(rf'File "{re.escape(str(PACKAGE))}/(.+)", line (\d+) in (.+)', trace)
    return Outcome(Verdict.FAILED, kind, "{}:{} {}".format(*own[0]) if own else "", text, trace)


def _read_and_exit(read: Callable[[], object], answer: int, errors: int) -> None:
    """In the child: what came of it into one file, what libraries print and where they crash into another."""
    code = 1
    try:
        import resource

        os.dup2(errors, 2)
        faulthandler.enable(errors)
        seconds = int(SECONDS) + MORE_S
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.write(answer, json.dumps(asdict(outcome(read))).encode())
        code = 0
    finally:
        os._exit(code)  # nothing that the parent has to end is ended here


def _ended(process: int) -> int | None:
    """The status of a process that ended; None if it had to be stopped."""
    until = time.monotonic() + IDLE * SECONDS
    while time.monotonic() < until:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return status
        time.sleep(POLL_S)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return None


def _place(error: BaseException) -> str:
    """The innermost line of the package."""
    frames = [one for one in traceback.extract_tb(error.__traceback__) if Path(one.filename).is_relative_to(PACKAGE)]
    return f"{Path(frames[-1].filename).relative_to(PACKAGE)}:{frames[-1].lineno} {frames[-1].name}" if frames else ""


class Hang(BaseException):
    """Something took longer than it may; no Exception, so that nobody catches it by accident."""


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
