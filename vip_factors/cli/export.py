"""``vip-factors export``: an estimate in the formats of other programs."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import UNPREFIXED, WritingOptions
from vip_factors.cli.terminal import note, say, waiting
from vip_factors.errors import InputError
from vip_factors.io.settings import ExportSettings


@dataclass(frozen=True)
class ExportOptions(WritingOptions):
    """Write an estimate into files of other programs.

    The suffix names the format:
    - .bvh, .glb, .fbx (through Blender): animation; Maya and MotionBuilder expect --bvh.unit cm.
    - .csv: joint positions and joint angles, a row a frame; walk.angles.csv or walk.positions.csv has one of the two.
    - .trc, .mot, .sto: markers, joint angles and segment orientations for OpenSim.
    - .c3d: markers and joint angles.
    - .npz: poses as in AMASS; .pkl: poses, camera and 2D poses as in 3DPW.

    Example: vip-factors export walk.estimate.mcap walk.bvh walk.trc walk.mot

    Several wearers in a format that holds one person get a file each: walk.npz becomes walk.Ada.npz and walk.Bea.npz.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE FILE [FILE …]")]
    """Estimate (.mcap), and the files to write."""
    settings: Annotated[ExportSettings, UNPREFIXED] = field(default_factory=ExportSettings)


def main(options: ExportOptions) -> None:
    """Run the command with its parsed options."""
    if len(options.files) < 2:
        raise InputError("expected an estimate and at least one file to write: vip-factors export ESTIMATE FILE …")
    from vip_factors.cli.options import keep_inputs
    from vip_factors.io.export.files import export, export_format
    from vip_factors.io.mcap_estimate import read_estimate, read_start

    source, *targets = options.files
    keep_inputs([source], targets)
    for target in targets:
        export_format(target)
    with waiting(f"reading {source.name}"):
        estimate = read_estimate(source)
        start_ns, clock_s = read_start(source)
    for target in targets:
        with waiting(f"writing {target.name}"):
            written = export(estimate, target, options.settings, options.overwrite, note, start_ns, clock_s)
        for path in written:
            say(path)
