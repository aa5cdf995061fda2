"""``vip-factors train``: learn from motions what the package ships as small files."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vip_factors.body.train_prior_settings import PriorTraining
from vip_factors.cli.options import Flag, parse
from vip_factors.cli.outputs import Output


@dataclass(frozen=True)
class TrainOptions:
    """Learn the pose prior, a Gaussian over joint rotations, from a folder of motions."""

    what: tyro.conf.Positional[Literal["prior", "body", "association", "keypoints"]]
    """What to learn; for the others' options: train body --help, train association --help, train keypoints --help."""
    motions: Path
    """Folder of motion files, searched with all folders below it."""
    out: Annotated[Path, Output(".npz")]
    """File (.npz) to write."""
    hold_out: tuple[str, ...] | None = None
    """Names of files (without suffix) never to train on; those that the package evaluates on if absent."""
    overwrite: Flag = False
    """Replace the file if it exists."""
    training: Annotated[PriorTraining, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=PriorTraining)


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    if arguments and arguments[0] == "association":
        from vip_factors.cli import train_association

        return train_association.main(f"{prog}", arguments)
    if arguments and arguments[0] == "body":
        from vip_factors.cli import train_body

        return train_body.main(prog, arguments)
    if arguments and arguments[0] == "keypoints":
        from vip_factors.cli import train_keypoints

        return train_keypoints.main(prog, arguments)
    options = parse(TrainOptions, prog, arguments, none_is_a_value=True)
    from vip_factors.body.pose_prior import save_pose_prior
    from vip_factors.cli.terminal import waiting
    from vip_factors.errors import InputError
    from vip_factors.io.atomic import atomic_path, check_target
    from vip_factors.io.motions.prior_training import train_prior_from_folder

    check_target(options.out, options.overwrite)
    if not options.motions.is_dir():
        raise InputError(f"{options.motions}: expected a folder of motion files")
    with waiting("reading motions"):
        prior = train_prior_from_folder(options.motions, options.hold_out, options.training)
    with atomic_path(options.out, options.overwrite) as partial:
        save_pose_prior(prior, partial)
    print(prior.provenance)
    print(options.out)
