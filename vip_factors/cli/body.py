"""``vip-factors body``: the body that an estimate found, as a file and as a picture."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.atomic import atomic_open
from vip_factors.cli.options import Output, WritingOptions
from vip_factors.cli.terminal import say
from vip_factors.errors import InputError, nearest


@dataclass(frozen=True)
class BodyOptions(WritingOptions):
    """Write the body that was found into a file (TOML): skeleton, lengths and hinges, with how sure they are.

    The next recording of the same person starts from it: vip-factors convert … --body ada.toml. What was found is
    taken for likely then, and as sure as it is here, instead of what a stature tells.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap) of a filmed wearer with a declared stature only."""
    wearer: str | None = None
    """Name of the wearer, if there are several."""
    out: Annotated[Path | None, Output(".toml")] = None
    """Body file (.toml) to write; ESTIMATE.body.toml if absent."""
    picture: Annotated[Path | None, Output(".svg")] = None
    """Also draw what was found beside what was likely beforehand, into this file (.svg)."""
    truth: Path | None = None
    """Recording (.mcap) that holds the truth, to be drawn as well."""


def main(options: BodyOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.cli.terminal import print_tables
    from vip_factors.describe.estimates import hinge_table, length_table
    from vip_factors.io.body_file import body_of_estimate, write_body_file
    from vip_factors.io.mcap_estimate import read_estimate
    from vip_factors.viz.charts import body_figure, svg

    out = options.target(options.out, options.estimate, ".body.toml")
    if options.picture is None and options.truth is not None:
        raise InputError("--truth is drawn into the picture: give --picture too")
    estimate = read_estimate(options.estimate).wearer(options.wearer)
    truth = _true_lengths(options.truth, estimate.motion.name) if options.truth is not None else {}
    write_body_file(out, body_of_estimate(estimate, options.estimate.name), options.overwrite)
    assert estimate.body is not None
    print_tables([length_table(estimate.body), hinge_table(estimate.body)])
    say(out)
    if options.picture is not None:
        with atomic_open(options.picture, overwrite=options.overwrite) as file:
            file.write(svg(body_figure(estimate.motion.name, estimate.body, truth)))
        say(options.picture)


def _true_lengths(path: Path, name: str) -> Mapping[str, float]:
    """Return the true lengths of the wearer of that name, or of the only one."""
    from vip_factors.evaluate.calibration import true_lengths
    from vip_factors.io.mcap_recording import read_scene

    wearers = {wearer.subject.name: wearer for wearer in read_scene(path).wearers}
    if len(wearers) > 1 and name not in wearers:
        raise InputError(f"{path}: no wearer '{name}'{nearest(name, wearers)}")
    truth = wearers.get(name, next(iter(wearers.values()))).truth
    if truth is None:
        raise InputError(f"{path} holds no truth: give a recording that does with --truth")
    return true_lengths(truth.motion.skeleton)
