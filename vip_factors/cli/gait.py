"""``vip-factors gait``: how somebody walked, as tables, JSON and a picture."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vip_factors.cli.options import WritingOptions, beside
from vip_factors.cli.terminal import say
from vip_factors.errors import InputError


@dataclass(frozen=True)
class GaitOptions(WritingOptions):
    """Detect strides and write their parameters: strides.csv, figures.csv, curves.csv (joint angles over the cycle),
    gait.json and gait.png.

    Events and lengths come from the foot sensors if --recording is given, otherwise from the motion of the legs.
    """

    source: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE|RECORDING")]
    """Estimate (.mcap), or a recording (.mcap), which is reconstructed first."""
    recording: Path | None = None
    """Recording (.mcap) of the estimate; default: the one in the estimate's file."""
    count: tuple[Literal["start", "stop", "turn", "pause"], ...] = ()
    """Kinds of strides to include in the means."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Folder to write; default: beside the first file, ending in .gait."""


def main(options: GaitOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.cli.files import open_one
    from vip_factors.cli.terminal import progress_bar
    from vip_factors.gait.analysis import gaits_of
    from vip_factors.gait.files import write_gait
    from vip_factors.io.mcap_recording import read_scene

    with progress_bar() as progress:
        progress("reading", 0.0)
        opened = open_one(options.source)
        scene = opened.scene if options.recording is None else read_scene(options.recording)
        if (estimate := opened.estimate) is None:
            if opened.scene is None:
                raise InputError(f"{options.source} is a motion: expected an estimate or a recording (.mcap)")
            from vip_factors.pipeline import smooth

            estimate = smooth(opened.scene, progress=progress)
        gaits = gaits_of(estimate, scene, options.count)
    if not any(gait.strides for gait in gaits):
        raise InputError(f"{options.source}: no walking was detected: no foot takes two steps")
    for gait in gaits:
        say(gait)
    for path in write_gait(gaits, options.out or beside(options.source, ".gait"), options.overwrite):
        say(path)
