"""``vip-factors convert``: foreign sensor logs in, one recording out."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vip_factors.cli.options import Flag, parse


@dataclass(frozen=True)
class ConvertOptions:
    """Bring a sensor log of any known format into a recording (MCAP): a file, a folder, or how its files' names begin.

    Say where the sensors sit with --placement; without it their names must tell.
    """

    log: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
    """File or folder: Xsens .txt, .mvnx, DOT .csv, OpenSense .sto, TotalCapture .sensors, ROS 2 .mcap …"""
    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap) to write."""
    placement: str | None = None
    """Name of a preset (sip6, tnt10, totalcapture13, mvn17) or a placement file (.toml, .json)."""
    stature_m: float | None = None
    """Height of the wearer in metres, without shoes."""
    mass_kg: float | None = None
    """Mass of the wearer."""
    sex: Literal["male", "female"] | None = None
    """Which table of body proportions to use; an average one if absent."""
    segment_lengths_m: dict[str, float] = field(default_factory=dict)
    """Measured lengths in metres, such as: thigh 0.43 shank 0.42."""
    subject: str | None = None
    """Name of the wearer."""
    initial_pose: Literal["t-pose", "n-pose", "none"] | None = None
    """What the wearer held at the first moment kept."""
    start_s: float | None = None
    """Seconds of the log to leave out before."""
    end_s: float | None = None
    """Second of the log to end at."""
    format: str | None = None
    """Format of the log; found by its content if absent."""
    name: str | None = None
    """Name of the recording; the log's own if absent."""
    overwrite: Flag = False
    """Replace the recording if it exists."""


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(ConvertOptions, prog, arguments)
    from vip_factors.cli.info import recording_text
    from vip_factors.cli.terminal import waiting
    from vip_factors.io.atomic import check_target
    from vip_factors.io.convert import ImportOptions, import_recording
    from vip_factors.io.mcap_recording import write_recording

    check_target(options.out, options.overwrite)
    known = {name: value for name, value in vars(options).items() if name not in ("log", "out", "overwrite")}
    with waiting(f"reading {options.log}"):
        recording = import_recording(options.log, ImportOptions(**known))
        write_recording(recording, options.out, overwrite=options.overwrite)
    print(recording_text(recording))
    print(options.out)
