"""The end of a ``.rrd`` file, made sure of: Rerun itself only logs that it could not write one."""

import errno
import os
import shutil
import sys
import time
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

from vip_factors.errors import VipFactorsError

if TYPE_CHECKING:
    import rerun as rr

FOOTER = b"RRF2FOOT"  # stands in the last bytes of a whole file
FOOTER_BYTES = 64
STALL_S = 5.0  # without a byte more, after which a file is taken to grow no more: a slow disk writes some of it in time
ATTEMPT_S = 1.0  # of it, between looks whether the thread that writes has ended
ENDED = "shut down"  # in Rerun's error then
FULL_BYTES = 1 << 20  # free on a disk that is as good as full


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
