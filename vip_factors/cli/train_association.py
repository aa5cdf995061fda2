"""``vip-factors train association``: learn from simulated scenes who is who in a video."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vip_factors.benchmark.scene_making import SceneMaking
from vip_factors.cli.options import Flag, parse
from vip_factors.cli.outputs import Output
from vip_factors.ranges import NotNegativeInt


@dataclass(frozen=True)
class TrainAssociationOptions:
    """Learn the weights of the association from scenes simulated with a folder of motions."""

    what: tyro.conf.Positional[Literal["association"]]
    """What to learn."""
    motions: Path
    """Folder of motion files, searched with all folders below it; those that the package evaluates on are left out."""
    out: Annotated[Path, Output(".json")]
    """File (.json) to write."""
    scenes: int = 40
    """How many scenes to simulate; each trains both passes."""
    measure: int = 0
    """How many scenes to simulate of the motions left out, to measure precision and recall by."""
    seed: NotNegativeInt = 0
    """Of the scenes; those to measure by are other ones anyhow."""
    overwrite: Flag = False
    """Replace the file if it exists."""
    making: Annotated[SceneMaking, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=SceneMaking)


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(TrainAssociationOptions, prog, arguments, none_is_a_value=True)
    from vip_factors.cli.terminal import waiting
    from vip_factors.errors import InputError
    from vip_factors.io.atomic import atomic_path, check_target

    check_target(options.out, options.overwrite)
    if not options.motions.is_dir():
        raise InputError(f"{options.motions}: expected a folder of motion files")
    if options.scenes < 1 or options.measure < 0:
        raise InputError(f"--scenes {options.scenes}, --measure {options.measure}: expected at least 1 and 0")
    from vip_factors.associate.weights import save_weights
    from vip_factors.benchmark.association import measured, split_clips, trained
    from vip_factors.io.motions.files import motion_files, read_motion

    train_on, measure_on = split_clips(motion_files(options.motions))
    if not train_on:
        raise InputError(f"{options.motions}: no motion file to train on")
    if options.measure and not measure_on:
        raise InputError(f"{options.motions}: none of the motions that are left out of training: nothing to measure by")
    with waiting("simulating and learning"):
        weights = trained(
            [read_motion(path) for path in train_on], options.scenes, options.seed, options.making,
            f"clips in the folder '{options.motions.name}'",
        )  # fmt: skip
    with atomic_path(options.out, options.overwrite) as partial:
        save_weights(weights, partial)
    print(weights.provenance)
    if options.measure:
        with waiting("measuring"):
            clips = [read_motion(path) for path in measure_on]
            lines = measured(clips, options.measure, options.seed, options.making, options.out)
        print("\n".join(lines))
    print(options.out)
