"""Rerun's program, as a window and as a server for browsers, and its files made sure of.

The SDK can start both by itself, but lets them listen on every interface of the machine (0.41): whoever is in its
networks could read what is shown. Those started here listen on this machine unless told otherwise.
"""

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING
from urllib.parse import quote

from vip_factors.errors import InputError, VipFactorsError

if TYPE_CHECKING:
    import rerun as rr

APPLICATION = "vip_factors"
LOCAL = "127.0.0.1"


def rerun_command() -> str:
    """The program ``rerun``: beside this Python, which need not be on the path, or else on the path.

    Raises:
        VipFactorsError: if it is in neither place.
    """
    beside = Path(sys.executable).with_name("rerun.exe" if sys.platform == "win32" else "rerun")
    rerun = str(beside) if beside.is_file() else shutil.which("rerun")
    if rerun is None:
        raise VipFactorsError("the command 'rerun' was not found: install rerun-sdk beside this Python")
    return rerun


def start_rerun(arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    """Start Rerun's program in silence, in a process group: ``rerun`` is a small program that runs a large one.

    It sends no statistics of its use to its makers, as on machines that test. There is no variable for that alone, and
    its setting (``rerun analytics disable``) is a file of the user's, for all that the user does with it.
    """
    null = subprocess.DEVNULL
    environment = {**os.environ, "CI": "true"}
    return subprocess.Popen(
        [rerun_command(), *arguments], stdin=null, stdout=null, stderr=null, start_new_session=True, env=environment
    )


def check_display(instead: str) -> None:
    """Make sure of a display before a window is wanted: without one the viewer ends and its sender waits for it.

    Args:
        instead: what can be done without a display, for the message.

    Raises:
        InputError: if there is none.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(f"no display: use {instead}")


def open_viewer(stream: "rr.RecordingStream", instead: str, memory: str = "75%") -> None:
    """Send a stream to Rerun's window, which is opened unless it is open already.

    Args:
        stream: what is shown.
        instead: as :func:`check_display`, whose error this raises too.
        memory: that a new window may use at most, then it forgets the oldest; a share of the machine's.
    """
    check_display(instead)
    # A second program finds the port taken by the first, and ends.
    start_rerun(["--bind", LOCAL, "--expect-data-soon", "--memory-limit", memory])
    stream.connect_grpc()


def serve(rrd: Path, host: str, port: int, on_start: Callable[[str], None]) -> None:
    """Serve a file to browsers until Ctrl-C or SIGTERM.

    Args:
        rrd: the file.
        host: address to listen at: ``127.0.0.1`` for this machine alone, ``0.0.0.0`` for the whole network.
        port: of the page; the data come from the port after it.
        on_start: called with the page's address as the server starts.

    Raises:
        InputError: if a port is taken, or there is no such address.
        VipFactorsError: if Rerun's program ends by itself.
    """
    check_free(host, port)
    check_free(host, port + 1)
    memory_mib = max(1024, 2 * rrd.stat().st_size >> 20)  # beyond it the oldest would be forgotten
    before = signal.signal(signal.SIGTERM, _interrupt)
    process = start_rerun([
        str(rrd), "--serve-web", "--bind", host, "--web-viewer-port", str(port), "--port", str(port + 1),
        "--server-memory-limit", f"{memory_mib}MiB", "--cors-allow-origin", f"http://*:{port}",
    ])  # fmt: skip
    try:
        on_start(address(host, port))
        process.wait()
    except KeyboardInterrupt:
        return
    finally:
        signal.signal(signal.SIGTERM, before)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)  # it holds no file
            process.wait()
    raise VipFactorsError(f"Rerun's server ended by itself, with exit code {process.returncode}")


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def check_free(host: str, port: int) -> None:
    """Make sure that a port can be listened at.

    Raises:
        InputError: if it is taken, or there is no such address.
    """
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a server that has just ended is no hindrance
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InputError(
                f"{host}, port {port}: {error.strerror or error}; choose with --host and --port"
            ) from error  # fmt: skip


def address(host: str, port: int) -> str:
    """The page's address, which tells the page where its data come from."""
    everywhere = host in ("0.0.0.0", "::")
    name = socket.gethostname() if everywhere else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/?url={quote(f'rerun+http://{name}:{port + 1}/proxy', safe=':/')}"


STALL_S = 5.0  # without a byte more, after which a file is taken to grow no more: a slow disk writes some of it in time


def write_out(stream: "rr.RecordingStream", partial: Path, path: Path) -> None:
    """Have what was logged until now written.

    Args:
        stream: that saves to a file.
        partial: where it is written.
        path: what it will be called, for the message.

    Raises:
        VipFactorsError: if it cannot be written. The stream must not be disconnected then: that would wait for ever.
    """
    size = -1
    while True:
        try:
            stream.flush(timeout_sec=STALL_S)
            return
        except RuntimeError as error:
            if size == (size := partial.stat().st_size):
                raise _not_written(path) from error


def complete(stream: "rr.RecordingStream", partial: Path, path: Path) -> None:
    """Finish a file; arguments and errors as :func:`write_out`. Rerun itself only logs that it could not."""
    write_out(stream, partial, path)
    stream.disconnect()
    if not is_whole(partial):
        raise _not_written(path)


def is_whole(path: Path) -> bool:
    """Whether there is a file that was written to its end."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        file.seek(-min(64, path.stat().st_size), os.SEEK_END)
        return b"RRF2FOOT" in file.read()


def _not_written(path: Path) -> VipFactorsError:
    return VipFactorsError(f"{path}: Rerun could not write it: is the disk, or what you may use of it, full?")
