"""``vip-factors info``: what a file holds."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.cli.options import Flag
from vip_factors.errors import InputError

if TYPE_CHECKING:
    from vip_factors.tables import Table

READ_S = 300.0  # seconds of a recording that are read: of longer ones the index tells, in a second instead of minutes


@dataclass(frozen=True)
class InfoOptions:
    """Summarise a recording, an estimate or a motion: wearers, sensors, duration and gaps.

    A scene also lists cameras and detections. For a recording without a camera above five minutes, only the file's
    index is read.
    """

    file: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = None
    """Recording or estimate (.mcap), or motion (.bvh …)."""
    sites: Flag = False
    """Print the sensor sites and their default axes, instead of a file."""
    verbose: Flag = False
    """Also print the iterations and costs of each solve of an estimate."""


def main(options: InfoOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.cli.terminal import print_tables

    if (options.file is None) != options.sites:
        raise InputError("info takes either a FILE or --sites")
    if options.file is not None:
        print_tables(file_tables(options.file, options.verbose))
        return
    from vip_factors.describe.recordings import site_table

    print_tables([site_table()])


def file_tables(path: Path, verbose: bool = False) -> Iterator["Table"]:
    """Facts about a recording, an estimate or a motion."""
    from vip_factors.cli.files import open_one
    from vip_factors.describe.estimates import estimate_tables
    from vip_factors.describe.recordings import motion_facts, recording_tables, scene_tables
    from vip_factors.tables import facts

    if path.suffix.lower() == ".mcap":
        from vip_factors.io.mcap_source import indexed_recording

        index = indexed_recording(path, READ_S)
        if index is not None:
            yield from recording_tables(index.head, index.time, index.truth_frames)
            yield facts("", ("note", "from the file's index; samples between first and last were not read"))
            return
    opened = open_one(path)
    if opened.recording is not None:
        yield from recording_tables(opened.recording)
    elif opened.scene is not None:
        yield from scene_tables(opened.scene)
    if opened.estimate is not None:
        yield from estimate_tables(opened.estimate, verbose)
    if opened.motion is not None:
        yield motion_facts(opened.motion, f"motion '{opened.motion.name}'")
