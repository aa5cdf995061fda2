"""Rerun's program: its window, pictures of a ``.rrd`` file, and servers for browsers and viewers.

Servers are Rerun's program and not its SDK: the SDK's listen on every interface of the machine, and cannot be told
otherwise.

The end of a ``.rrd`` file is made sure of: Rerun itself only logs that it could not write one.
"""

import errno
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import TYPE_CHECKING
from urllib.parse import quote

from vip_factors.atomic import atomic_path
from vip_factors.errors import InputError, VipFactorsError

if TYPE_CHECKING:
    import rerun as rr

FOOTER = b"RRF2FOOT"  # stands in the last bytes of a whole file
FOOTER_BYTES = 64
STALL_S = 5.0  # without a byte more, after which a file is taken to grow no more: a slow disk writes some of it in time
ATTEMPT_S = 1.0  # of it, between looks whether the thread that writes has ended
ENDED = "shut down"  # in Rerun's error then
FULL_BYTES = 1 << 20  # free on a disk that is as good as full


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


# Rerun's programs send no statistics of their use where this is set, as on machines that test. There is no variable
# for that alone, and its setting (rerun analytics disable) is a file of the user's, for all that the user does with it.
QUIET = {"CI": "true"}


def quiet_environment() -> dict[str, str]:
    """Of this process, for a program of Rerun's that is to send nothing to its makers."""
    return {**os.environ, **QUIET}


@contextmanager
def quiet() -> Iterator[None]:
    """The same for programs that Rerun starts by itself: this process's own environment, within the block."""
    before = {name: os.environ.get(name) for name in QUIET}
    os.environ.update(QUIET)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def has_display() -> bool:
    """Whether windows can be opened; other systems than Linux always have a place for them."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_display(instead: str) -> None:
    """Make sure of a display before a window is wanted: without one the viewer ends and its sender waits for it.

    Args:
        instead: what can be done without a display, for the message.

    Raises:
        InputError: if there is none.
    """
    if not has_display():
        raise InputError(f"no display: use {instead}")


TIMEOUT_S = 180.0  # a software renderer on a slow machine needs some tens of seconds


def screenshot(rrd: Path, png: Path, *, size: tuple[int, int] = (1600, 900), overwrite: bool = False) -> None:
    """Render the first view of a file.

    Args:
        rrd: the file.
        png: where the picture goes.
        size: of the window in points; screens of high density give more pixels.
        overwrite: replace an existing picture.

    Raises:
        InputError: if the file is missing or the picture exists.
        VipFactorsError: if no viewer can run here (it needs a GPU or Mesa's software Vulkan, and a screen or xvfb).
    """
    if not rrd.is_file():
        raise InputError(f"{rrd}: there is no such file")
    try:
        with atomic_path(png, overwrite) as partial:
            command = [*_viewer(), str(rrd), "--screenshot-to", str(partial), "--window-size", f"{size[0]}x{size[1]}"]
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False, env=quiet_environment()
            )
            if not partial.is_file():
                last = (done.stderr or done.stdout).strip().splitlines()
                raise VipFactorsError(
                    f"Rerun's viewer made no picture of {rrd} ({last[-1] if last else 'no message'}): it needs Vulkan; "
                    "on a machine without GPU or screen install xvfb and mesa-vulkan-drivers"
                )
    except subprocess.TimeoutExpired as late:
        raise VipFactorsError(f"Rerun's viewer made no picture of {rrd} in {TIMEOUT_S:.0f} s") from late


def _viewer() -> list[str]:
    """The command that runs the viewer, under xvfb where there is no screen."""
    xvfb = None if has_display() else shutil.which("xvfb-run")
    return [xvfb, "-a", rerun_command()] if xvfb else [rerun_command()]


START_S = 30.0  # seconds until the servers listen; a slow machine takes two
LOOK_S = 0.1  # seconds between looks whether they do
END_S = 5.0  # seconds that they may take to end
LOCAL = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # of those who listen everywhere, on this machine
MEMORY_MIB = 1024  # that the server may hold at least; beyond its limit the oldest is forgotten


def serve(rrd: Path, host: str, port: int, on_ready: Callable[[str], None]) -> None:
    """Serve a file until Ctrl-C or SIGTERM, which end the servers in order.

    Args:
        rrd: the file.
        host: address to listen at: ``127.0.0.1`` for this machine alone, ``0.0.0.0`` for the whole network.
        port: of the page; the data come from the port after it.
        on_ready: called with the page's address once it can be opened.

    Raises:
        InputError: if a port is taken, or there is no such address.
        VipFactorsError: if Rerun's program ends by itself.
    """
    for one in (port, port + 1):
        _check_free(host, one)
    with _servers(rrd, host, port) as process:
        try:
            _wait_for(process, host, (port, port + 1))
            on_ready(address(host, port))
            process.wait()
        except KeyboardInterrupt:
            return
    raise VipFactorsError(f"Rerun's server ended by itself, with exit code {process.returncode}")


def address(host: str, port: int) -> str:
    """Of the page, which is told in it where its data come from."""
    name = socket.gethostname() if host in LOCAL else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/?url={quote(f'rerun+http://{name}:{port + 1}/proxy', safe=':/')}"


def _check_free(host: str, port: int, options: str = "--host and --port") -> None:
    if not 0 < port < 1 << 16:
        raise InputError(f"port {port}: expected 1 to 65534, for the page, and the port after it for the data")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a server that has just ended is no hindrance
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InputError(f"{host}, port {port}: {error.strerror or error}; choose with {options}") from error


@contextmanager
def grpc_server(host: str, port: int) -> Iterator[str]:
    """A server to which viewers may connect, and whoever has something to show; its address for those on this machine.

    Raises:
        InputError: if the port is taken, or there is no such address.
        VipFactorsError: if it does not start.
    """
    _check_free(host, port, "--rerun-serve and --rerun-host")
    command = [
        rerun_command(), "--serve-grpc", "--bind", host, "--port", str(port), "--server-memory-limit",
        f"{MEMORY_MIB}MiB",
    ]  # fmt: skip
    process = _start_program(command)
    try:
        _wait_for(process, host, (port,))
        local = LOCAL.get(host, host)
        yield f"rerun+http://[{local}]:{port}/proxy" if ":" in local else f"rerun+http://{local}:{port}/proxy"
    finally:
        _end(process, (signal.SIGKILL,))  # it holds no file


@contextmanager
def _servers(rrd: Path, host: str, port: int) -> Iterator[subprocess.Popen[bytes]]:
    """Rerun's program in a process group of its own, so that Ctrl-C reaches it through us alone."""
    memory = max(MEMORY_MIB, 2 * rrd.stat().st_size >> 20)
    command = [
        rerun_command(), str(rrd), "--serve-web", "--bind", host, "--web-viewer-port", str(port), "--port",
        str(port + 1), "--server-memory-limit", f"{memory}MiB", "--cors-allow-origin", f"http://*:{port}",
    ]  # fmt: skip
    before = signal.signal(signal.SIGTERM, _interrupt)
    process = _start_program(command)
    try:
        yield process
    finally:
        _end(process)
        signal.signal(signal.SIGTERM, before)


def _start_program(command: Sequence[str]) -> subprocess.Popen[bytes]:
    """A program in a process group of its own, in silence."""
    nowhere = subprocess.DEVNULL
    return subprocess.Popen(
        command, stdout=nowhere, stderr=nowhere, stdin=nowhere, start_new_session=True, env=quiet_environment()
    )


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _end(process: subprocess.Popen[bytes], numbers: Sequence[int] = (signal.SIGTERM, signal.SIGKILL)) -> None:
    """The whole group: ``rerun`` is a small program that runs a large one."""
    for number in numbers:
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            break
        try:
            process.wait(END_S)
            break
        except subprocess.TimeoutExpired:
            continue


def _wait_for(process: subprocess.Popen[bytes], host: str, ports: Sequence[int]) -> None:
    """Return once all ports answer."""
    local = LOCAL.get(host, host)
    deadline = time.monotonic() + START_S
    for one in ports:
        while True:
            try:
                socket.create_connection((local, one), timeout=LOOK_S).close()
                break
            except OSError:
                if process.poll() is not None or time.monotonic() > deadline:
                    raise VipFactorsError(f"Rerun's server did not start at {host}, port {one}") from None
                time.sleep(LOOK_S)


def hand_over(stream: "rr.RecordingStream", partial: Path, path: Path) -> None:
    """Have what was logged until now written.

    Args:
        stream: that saves to a file.
        partial: where it is written.
        path: what it will be called, for the message.

    Raises:
        OSError, VipFactorsError: if it cannot be written. The stream must not be disconnected then: that would wait for
            ever.
    """
    until, size = time.monotonic() + STALL_S, -1
    while True:
        try:
            stream.flush(timeout_sec=ATTEMPT_S)
            return
        except RuntimeError as error:
            # A writer that fails while it is waited for is not noticed by Rerun; that there is no room, is.
            if size != (size := partial.stat().st_size):
                until = time.monotonic() + STALL_S
            if time.monotonic() > until or ENDED in str(error) or _cannot_grow(partial):
                raise _not_written(path) from error


def complete(stream: "rr.RecordingStream", partial: Path, path: Path) -> None:
    """Finish a file.

    Args:
        stream: that saves to it.
        partial: where it is written.
        path: what it will be called, for the message.

    Raises:
        OSError, VipFactorsError: if it is not whole.
    """
    hand_over(stream, partial, path)
    ending = Thread(target=stream.disconnect, daemon=True)  # it waits for ever for a writer that has failed
    ending.start()
    until = time.monotonic() + STALL_S
    while ending.is_alive() and time.monotonic() < until:
        ending.join(ATTEMPT_S)
        if _cannot_grow(partial):
            break
    if not is_whole(partial):
        raise _not_written(path)


def is_whole(path: Path) -> bool:
    """Whether there is a file that was written to its end."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        file.seek(-min(FOOTER_BYTES, path.stat().st_size), os.SEEK_END)
        return FOOTER in file.read()


def _cannot_grow(partial: Path) -> bool:
    """Whether the disk is full, or the file as large as the system lets this process make one."""
    if shutil.disk_usage(partial.parent).free < FULL_BYTES:
        return True
    if sys.platform == "win32":
        return False
    import resource

    most, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return most != resource.RLIM_INFINITY and partial.stat().st_size >= most


def _not_written(path: Path) -> OSError | VipFactorsError:
    """Rerun keeps the system's reason to itself; a full disk is seen from outside."""
    if shutil.disk_usage(path.parent).free < FULL_BYTES:
        return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), os.fspath(path))
    return VipFactorsError(f"{path}: Rerun could not write it: is the disk, or what you may use of it, full?")
