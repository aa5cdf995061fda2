"""``vip-factors view``: look at recordings, scenes, estimates and motions, in Rerun or as pictures."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.cli.files import Opened, open_all
from vip_factors.cli.options import RERUN_FILE, Output, WritingOptions
from vip_factors.cli.terminal import say
from vip_factors.errors import InputError
from vip_factors.viz.viewer import check_display

if TYPE_CHECKING:
    from vip_factors.viz.drawn_scene import DrawnScene

INSTEAD_OF_A_WINDOW = "--save FILE.rrd or --picture"


@dataclass(frozen=True)
class ViewOptions(WritingOptions):
    """Look at a recording or scene, an estimate, or both together, in Rerun's viewer or as files.

    Give the recording beside the estimate to see the sensors and the truth if it is known; of a
    scene also the video, who was assigned to what, and the estimated bodies over the image.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE [FILE …]")]
    """Recording or scene, estimate (.mcap), motion (.bvh …): one of each kind at most."""
    save: Annotated[Path | None, RERUN_FILE] = None
    """Write a Rerun file (.rrd) instead of opening the viewer."""
    picture: Annotated[Path | None, Output(".png")] = None
    """Write a filmstrip (.png): poses in a row, of a scene frames of its video; needs nothing."""


def main(options: ViewOptions) -> None:
    """Run the command."""
    if not options.files:
        raise InputError("no file given: expected a recording, an estimate or a motion")
    opened = open_all(options.files)
    in_a_window = options.save is None and options.picture is None
    if in_a_window:
        check_display(INSTEAD_OF_A_WINDOW)
    if opened.is_scene and opened.motion is not None:
        raise InputError(f"a motion ('{opened.motion.name}') beside a scene: expected the scene's own file for truth")
    if options.picture is not None:
        from vip_factors.viz.picture import filmstrip

        filmstrip(_drawn(opened), options.picture, overwrite=options.overwrite)
        say(options.picture)
    if options.save is not None:
        _show(opened, options.save, options)
        say(options.save)
    if in_a_window:
        _show(opened, None, options)


def _drawn(opened: Opened) -> "DrawnScene":
    from vip_factors.viz.drawn_scene import drawn_scene, drawn_wearer

    if opened.is_scene:
        return drawn_scene(opened.scene, opened.estimate)
    return drawn_wearer(opened.recording, opened.wearer_estimate, opened.motion)


def _show(opened: Opened, save: Path | None, options: ViewOptions) -> None:
    from vip_factors.viz.rerun_view import show

    show(_drawn(opened), save, options.overwrite)
