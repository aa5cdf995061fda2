"""``vip-factors view``: look at recordings, scenes, estimates and motions, in Rerun or as pictures."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.files import open_all
from vip_factors.cli.options import RERUN_FILE, Output, WritingOptions
from vip_factors.cli.terminal import say
from vip_factors.errors import InputError
from vip_factors.viz.viewer import check_display

INSTEAD_OF_A_WINDOW = "--save FILE.rrd or --picture"


@dataclass(frozen=True)
class ViewOptions(WritingOptions):
    """Show recordings and estimates in Rerun, or write them as a file or picture.

    With an estimate and its recording, the viewer also shows sensors, truth, video, assigned detections and bodies over
    the image.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE [FILE …]")]
    """Recording or scene, estimate (.mcap), motion (.bvh …): one of each kind at most."""
    save: Annotated[Path | None, RERUN_FILE] = None
    """Write a Rerun file (.rrd) instead of opening the viewer."""
    picture: Annotated[Path | None, Output(".png")] = None
    """Write a picture (.png): poses in a row, or frames of the video; needs no display."""


def main(options: ViewOptions) -> None:
    """Run the command with its parsed options."""
    if not options.files:
        raise InputError("no file given: expected a recording, an estimate or a motion")
    opened = open_all(options.files)
    in_a_window = options.save is None and options.picture is None
    if in_a_window:
        check_display(INSTEAD_OF_A_WINDOW)
    if opened.is_scene and opened.motion is not None:
        raise InputError(f"a motion ('{opened.motion.name}') beside a scene: expected the scene's own file for truth")
    from vip_factors.viz.drawn_scene import drawn_scene, drawn_wearer

    if opened.is_scene:
        drawn = drawn_scene(opened.scene, opened.estimate)
    else:
        estimate = None if opened.estimate is None else opened.estimate.wearer()
        drawn = drawn_wearer(opened.recording, estimate, opened.motion)
    if options.picture is not None:
        from vip_factors.viz.picture import filmstrip

        filmstrip(drawn, options.picture, overwrite=options.overwrite)
        say(options.picture)
    if options.save is not None or in_a_window:
        from vip_factors.viz.rerun_view import show

        show(drawn, options.save, options.overwrite)
    if options.save is not None:
        say(options.save)
