"""Rerun's viewer: the command that runs it, its environment, and whether there is a display for its window."""

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vip_factors.errors import InputError, VipFactorsError


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
