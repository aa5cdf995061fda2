"""Rerun's viewer: the command that runs it, and whether there is a display for its window."""

import os
import shutil
import sys
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
