"""``vip-factors info``: what a file holds."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from vip_factors.atomic import atomic_open
from vip_factors.cli.options import Flag, Output, WritingOptions
from vip_factors.errors import InputError

READ_S = 300.0  # seconds of a recording that are read: of longer ones the index tells, in a second instead of minutes


@dataclass(frozen=True)
class InfoOptions(WritingOptions):
    """Say what a recording, an estimate or a motion holds: who, which sensors, how long, with which gaps.

    Of a scene also what filmed it, and how much of whom a detector saw there. Of a recording without a camera that
    lasts more than five minutes the file's index tells, and its samples are not read.
    """

    common: ClassVar = ("sites", "picture", "verbose")
    file: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = None
    """Recording or estimate (.mcap), or motion (.bvh …)."""
    sites: Flag = False
    """Instead of a file, say where on the body sensors may be placed by name, and how their axes are taken to lie."""
    picture: Annotated[Path | None, Output(".svg")] = None
    """With --sites, also draw them on a body, into this file (.svg)."""
    verbose: Flag = False
    """Of an estimate also how each solve went: steps, and the cost before and after."""


def main(options: InfoOptions) -> None:
    """Run the command."""
    if options.sites and options.file is None:
        _tell_sites(options)
        return
    if options.file is None or options.sites:
        raise InputError("info takes either a FILE or --sites; --picture goes with --sites")
    if options.picture is not None:
        raise InputError("--picture draws the sites: give --sites instead of a file")
    print(file_text(options.file, options.verbose))


def file_text(path: Path, verbose: bool = False) -> str:
    """What a recording, an estimate or a motion holds.

    Raises:
        InputError, FileFormatError, OSError: if it cannot be read.
    """
    from vip_factors.cli.files import open_one
    from vip_factors.cli.info_text import estimate_text, motion_text, recording_text, scene_estimate_text, scene_text

    if path.suffix.lower() == ".mcap":
        from vip_factors.io.mcap_source import indexed_recording

        index = indexed_recording(path, READ_S)
        if index is not None:
            return recording_text(index.head, index)
    opened = open_one(path)
    parts = []
    if opened.scene is not None:
        recording = opened.recording
        parts.append(scene_text(opened.scene) if recording is None else recording_text(recording))
    if opened.estimate is not None and opened.is_scene:
        parts.append(scene_estimate_text(opened.estimate, verbose))
    elif opened.estimate is not None:
        parts.append(estimate_text(opened.estimate.only_wearer, verbose=verbose))
    if opened.motion is not None:
        parts.append(f"motion '{opened.motion.name}'\n" + motion_text(opened.motion))
    return "\n\n".join(parts)


def _tell_sites(options: InfoOptions) -> None:
    from vip_factors.cli.info_text import sites_text

    if options.picture is not None:
        from vip_factors.viz.drawn_body import sites_picture

        with atomic_open(options.picture, overwrite=options.overwrite) as file:
            file.write(sites_picture())
    print(sites_text())
    if options.picture is not None:
        print(options.picture)
