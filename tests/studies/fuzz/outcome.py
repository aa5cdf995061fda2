"""What came of reading one file: read, refused in a sentence, or neither; here, or in a process of its own."""

import faulthandler
import json
import os
import signal
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path

import vip_factors
from tests.studies.fuzz.limits import IDLE, SECONDS, Hang, limited_memory, limited_time, out_of_memory
from vip_factors.errors import VipFactorsError

PACKAGE = Path(vip_factors.__file__).parent
REFUSALS = (VipFactorsError, OSError)
POLL_S = 0.002
MORE_S = 2  # seconds that a process may compute beyond what its own alarm allows


class Verdict(StrEnum):
    """In one word."""

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
        with limited_memory(), limited_time():
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
    with tempfile.TemporaryFile() as told, tempfile.TemporaryFile() as errors:
        process = os.fork()
        if process == 0:
            _read_and_exit(read, told.fileno(), errors.fileno())
        status = _ended(process)
        for file in (told, errors):
            file.seek(0)
        answer, trace = told.read(), errors.read().decode(errors="replace")
    if answer:
        content = json.loads(answer)
        return Outcome(Verdict(content.pop("verdict")), **content)
    if status is None or os.WTERMSIG(status) == signal.SIGXCPU:
        return Outcome(Verdict.FAILED, Hang.__name__, _place_of_crash(trace), "a native library does not return", trace)
    kind = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"exit {os.WEXITSTATUS(status)}"
    return Outcome(Verdict.FAILED, kind, _place_of_crash(trace), "the process ended", trace)


def _read_and_exit(read: Callable[[], object], told: int, errors: int) -> None:
    """In the child: what came of it into one file, what libraries print and where they crash into another."""
    code = 1
    try:
        import resource

        os.dup2(errors, 2)
        faulthandler.enable(errors)
        seconds = int(SECONDS) + MORE_S
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.write(told, json.dumps(asdict(outcome(read))).encode())
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
    own = ""
    for frame in traceback.extract_tb(error.__traceback__):
        path = Path(frame.filename)
        if path.is_relative_to(PACKAGE):
            own = f"{path.relative_to(PACKAGE)}:{frame.lineno} {frame.name}"
    return own


def _place_of_crash(trace: str) -> str:
    """The same, of what Python prints of a crash: innermost first."""
    for line in trace.splitlines():
        path, _, rest = line.strip().removeprefix('File "').partition('", line ')
        if rest and Path(path).is_relative_to(PACKAGE):
            return f"{Path(path).relative_to(PACKAGE)}:{rest.replace(' in ', ' ')}"
    return ""
