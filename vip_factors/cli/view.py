"""``vip-factors view``: look at recordings, estimates and motions in Rerun."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.files import Opened, open_all
from vip_factors.cli.options import Flag, parse
from vip_factors.errors import InputError
from vip_factors.viz.compare import Compare


@dataclass(frozen=True)
class ViewOptions:
    """Look at a recording, an estimate, or both together, in Rerun's viewer or as files.

    Give the recording beside the estimate to see the sensors, what they measured, and the truth if it is known.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE [FILE …]")]
    """Recording, estimate (.mcap), motion (.bvh …): one of each kind at most."""
    save: Path | None = None
    """Write a Rerun file (.rrd) instead of opening the viewer."""
    screenshot: Path | None = None
    """Write a picture (.png) of Rerun's view; needs Vulkan, in software (Mesa) if need be."""
    picture: Path | None = None
    """Write a filmstrip (.png): poses in a row; needs nothing."""
    compare: Compare = Compare.ROOT
    """Where to draw the estimate beside the truth: on the true root path, in the true world, or to the side."""
    overwrite: Flag = False
    """Replace files that exist."""


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(ViewOptions, prog, arguments)
    if not options.files:
        raise InputError("no file given: expected a recording, an estimate or a motion")
    from vip_factors.io.atomic import check_target

    for wanted in (options.save, options.screenshot, options.picture):
        if wanted is not None:
            check_target(wanted, options.overwrite)
    opened = open_all(options.files)
    if options.picture is not None:
        from vip_factors.viz.picture import filmstrip

        filmstrip(opened.estimate, opened.recording, opened.truth, options.picture, overwrite=options.overwrite)
        print(options.picture)
    if options.screenshot is not None:
        _screenshot(opened, options.screenshot, options)
        print(options.screenshot)
    if options.save is not None:
        _show(opened, options.save, options)
        print(options.save)
    if options.save is None and options.screenshot is None and options.picture is None:
        _show(opened, None, options)


def _show(opened: Opened, save: Path | None, options: ViewOptions) -> None:
    from vip_factors.viz.rerun_view import LiveViewer, SaveTo, show

    sink = LiveViewer() if save is None else SaveTo(save, options.overwrite)
    show(opened.recording, opened.estimate, opened.truth, sink, compare=options.compare)


def _screenshot(opened: Opened, png: Path, options: ViewOptions) -> None:
    from tempfile import TemporaryDirectory

    from vip_factors.cli.terminal import waiting
    from vip_factors.viz.screenshot import screenshot

    with TemporaryDirectory() as folder, waiting("rendering"):
        rrd = Path(folder) / "view.rrd"
        _show(opened, rrd, options)
        screenshot(rrd, png, overwrite=options.overwrite)
