"""``vip-factors repetitions``: squats, lunges, jumps and curls, with their figures, as tables, JSON and a picture."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import WritingOptions, beside
from vip_factors.cli.terminal import say, waiting


@dataclass(frozen=True)
class RepetitionOptions(WritingOptions):
    """Count squats, lunges, jumps and curls, and write their times, depth, tempo, ranges and symmetry into
    repetitions.csv, repetitions.json and repetitions.png.

    Standard deviations need an estimate made without --no-covariance.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap)."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Folder to write; default: beside the estimate, ending in .repetitions."""


def main(options: RepetitionOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.cli.terminal import print_tables
    from vip_factors.io.mcap_estimate import read_estimate
    from vip_factors.repetitions.files import repetition_table, write_repetitions
    from vip_factors.repetitions.repetitions import all_repetitions

    with waiting(f"reading {options.estimate.name}"):
        wearers = all_repetitions(read_estimate(options.estimate))
    for wearer in wearers:
        if wearer.repetitions:
            print_tables([repetition_table(wearer)])
        else:
            say(wearer.summary()[0])
    for path in write_repetitions(wearers, options.out or beside(options.estimate, ".repetitions"), options.overwrite):
        say(path)
