"""``vip-factors body``: the body that an estimate found, as a file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import Output, WritingOptions
from vip_factors.cli.terminal import say


@dataclass(frozen=True)
class BodyOptions(WritingOptions):
    """Write the estimated body into a file (TOML): skeleton, lengths and hinge axes with their uncertainty.

    It replaces the prior from stature in the next recording of the same person: vip-factors convert … --body ada.toml
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap) of a filmed wearer."""
    wearer: str | None = None
    """Name of the wearer; required if there are several."""
    out: Annotated[Path | None, Output(".toml")] = None
    """Body file (.toml) to write; default: ESTIMATE.body.toml."""


def main(options: BodyOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.cli.terminal import print_tables
    from vip_factors.describe.estimates import hinge_table, length_table
    from vip_factors.io.body_file import body_of_estimate, write_body_file
    from vip_factors.io.mcap_estimate import read_estimate

    out = options.target(options.out, options.estimate, ".body.toml")
    estimate = read_estimate(options.estimate).wearer(options.wearer)
    write_body_file(out, body_of_estimate(estimate, options.estimate.name), options.overwrite)
    assert estimate.body is not None
    print_tables([length_table(estimate.body), hinge_table(estimate.body)])
    say(out)
