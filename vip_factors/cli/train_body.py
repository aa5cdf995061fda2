"""``vip-factors train body``: learn from a survey of people what bodies are like."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vip_factors.body.train_body_prior import BodyTraining
from vip_factors.cli.options import Flag, parse
from vip_factors.cli.outputs import Output


@dataclass(frozen=True)
class TrainBodyOptions:
    """Learn the prior over bodies, Gaussians over mass and lengths, from the survey ANSUR II."""

    what: tyro.conf.Positional[Literal["body"]]
    """What to learn."""
    ansur: Path
    """Folder with male.csv and female.csv of ANSUR II."""
    out: Annotated[Path, Output(".npz")]
    """File (.npz) to write."""
    overwrite: Flag = False
    """Replace the file if it exists."""
    training: Annotated[BodyTraining, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=BodyTraining)


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(TrainBodyOptions, prog, arguments, none_is_a_value=True)
    from vip_factors.body.body_prior import save_body_prior
    from vip_factors.io.ansur import train_body_prior_from_folder
    from vip_factors.io.atomic import atomic_path, check_target

    check_target(options.out, options.overwrite)
    prior = train_body_prior_from_folder(options.ansur, options.training)
    with atomic_path(options.out, options.overwrite) as partial:
        save_body_prior(prior, partial)
    print(prior.provenance)
    print(options.out)
