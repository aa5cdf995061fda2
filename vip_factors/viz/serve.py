"""A ``.rrd`` file served to web browsers by Rerun's own program.

The program and not the SDK: the SDK's servers listen on every interface of the machine, and cannot be told otherwise.
"""

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from urllib.parse import quote

from vip_factors.errors import InputError, VipFactorsError
from vip_factors.viz.viewer import quiet_environment, rerun_command

START_S = 30.0  # seconds until the servers listen; a slow machine takes two
LOOK_S = 0.1  # seconds between looks whether they do
END_S = 5.0  # seconds that they may take to end
LOCAL = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # of those who listen everywhere, on this machine
MEMORY_MIB = 1024  # that the server may hold at least; beyond its limit the oldest is forgotten


def serve(rrd: Path, host: str, port: int, tell: Callable[[str], None]) -> None:
    """Serve a file until Ctrl-C or SIGTERM, which end the servers in order.

    Args:
        rrd: the file.
        host: address to listen at: ``127.0.0.1`` for this machine alone, ``0.0.0.0`` for the whole network.
        port: of the page; the data come from the port after it.
        tell: called with the page's address once it can be opened.

    Raises:
        InputError: if a port is taken, or there is no such address.
        VipFactorsError: if Rerun's program ends by itself.
    """
    for one in (port, port + 1):
        _check_free(host, one)
    with _servers(rrd, host, port) as process:
        try:
            _wait_for(process, host, (port, port + 1))
            tell(address(host, port))
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
    process = _started(command)
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
    process = _started(command)
    try:
        yield process
    finally:
        _end(process)
        signal.signal(signal.SIGTERM, before)


def _started(command: Sequence[str]) -> subprocess.Popen[bytes]:
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
