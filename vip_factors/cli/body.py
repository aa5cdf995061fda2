"""``vip-factors body``: the body that an estimate found, as a file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import Flag, beside, parse
from vip_factors.errors import InputError


@dataclass(frozen=True)
class BodyOptions:
    """Write the body that was found into a file (TOML): skeleton, lengths and hinges, with how sure they are.

    The next recording of the same person starts from it: vip-factors convert … --body ada.toml. What was found is
    taken for likely then, and as sure as it is here, instead of what a stature tells.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap) of a filmed wearer of whom only the stature was told."""
    wearer: str | None = None
    """Name of the wearer, if there are several."""
    out: Path | None = None
    """Body file (.toml) to write; ESTIMATE.body.toml if absent."""
    overwrite: Flag = False
    """Replace the file if it exists."""


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(BodyOptions, prog, arguments)
    from vip_factors.cli.info_body import body_lines
    from vip_factors.io.atomic import check_target
    from vip_factors.io.body_file import body_of_estimate, write_body_file
    from vip_factors.io.mcap_scene_estimate import read_scene_estimate
    from vip_factors.io.toml_values import nearest

    out = options.out or beside(options.estimate, ".body.toml")
    if out.suffix.lower() != ".toml":
        raise InputError(f"{out}: expected the name of a body file that ends in .toml; give --out another one")
    check_target(out, options.overwrite)
    wearers = {one.motion.name: one for one in read_scene_estimate(options.estimate).wearers}
    if options.wearer is None and len(wearers) > 1:
        raise InputError(f"{options.estimate} holds {', '.join(wearers)}: say whose body is wanted with --wearer")
    name = next(iter(wearers)) if options.wearer is None else options.wearer
    if name not in wearers:
        raise InputError(f"{options.estimate}: no wearer '{name}'{nearest(name, wearers)}")
    estimate = wearers[name]
    write_body_file(out, body_of_estimate(estimate, options.estimate.name), options.overwrite)
    if estimate.body is not None:
        print("\n".join(body_lines(estimate.body)))
    print(out)
