"""Rerun's window, and its files made sure of."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from vip_factors.errors import InputError, VipFactorsError

if TYPE_CHECKING:
    import rerun as rr

APPLICATION = "vip_factors"


def rerun_command() -> str:
    """The program ``rerun``: beside this Python, which need not be on the path, or else on the path.

    Raises:
        VipFactorsError: if it is in neither place.
    """
    places = [str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)]
    if (rerun := shutil.which("rerun", path=os.pathsep.join(places))) is None:
        raise VipFactorsError("the command 'rerun' was not found: install rerun-sdk beside this Python")
    return rerun


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

    It listens to this machine alone, where the SDK's own ``spawn`` listens to whole networks (0.41), and sends no
    statistics of its use to its makers, as on machines that test: there is no variable for that alone.

    Args:
        stream: what is shown.
        instead: as :func:`check_display`, whose error this raises too.
        memory: that a new window may use at most, then it forgets the oldest; a share of the machine's.
    """
    check_display(instead)
    # A second program finds the port taken by the first, and ends.
    command = [rerun_command(), "--bind", "127.0.0.1", "--expect-data-soon", "--memory-limit", memory]
    null, environment = subprocess.DEVNULL, {**os.environ, "CI": "true"}
    subprocess.Popen(command, stdin=null, stdout=null, stderr=null, start_new_session=True, env=environment)
    stream.connect_grpc()


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
    """Return whether a file exists and is complete."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        file.seek(-min(64, path.stat().st_size), os.SEEK_END)
        return b"RRF2FOOT" in file.read()


def _not_written(path: Path) -> VipFactorsError:
    return VipFactorsError(f"{path}: Rerun could not write it: check the free space and the quota of the disk")
