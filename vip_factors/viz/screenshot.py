"""A PNG of a ``.rrd`` file, rendered by Rerun's own viewer, with or without a screen."""

import shutil
import subprocess
from pathlib import Path

from vip_factors.atomic import atomic_path
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.viz.viewer import has_display, quiet_environment, rerun_command

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
