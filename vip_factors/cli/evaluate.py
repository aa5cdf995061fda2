"""``vip-factors evaluate``: how good an estimate is."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.cli.options import Flag, parse
from vip_factors.errors import InputError

if TYPE_CHECKING:
    from vip_factors.evaluate.evaluation import Evaluation
    from vip_factors.evaluate.scene import SceneEvaluation


@dataclass(frozen=True)
class EvaluateOptions:
    """Compare an estimate with the truth: positions, orientations, path, headings, mountings, honesty.

    Of scenes also the camera, who was assigned to what, and how the wearers stand to each other. The first five
    lines tell the most important, and in which alignment. Limbs of which the truth knows nothing are left out.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap)."""
    truth: Path | None = None
    """Recording (.mcap) that holds the truth; the estimate's own file if the recording is in it."""
    json: Path | None = None
    """Also write everything to this file, as JSON."""
    overwrite: Flag = False
    """Replace the JSON file if it exists."""


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options = parse(EvaluateOptions, prog, arguments)
    from vip_factors.io.atomic import atomic_open, check_target

    if options.json is not None:
        check_target(options.json, options.overwrite)
    evaluation = _evaluation(options)
    print(evaluation)
    if options.json is not None:
        with atomic_open(options.json, "w", options.overwrite) as file:
            file.write(evaluation.to_json())


def _evaluation(options: EvaluateOptions) -> "Evaluation | SceneEvaluation":
    from vip_factors.evaluate.evaluation import evaluate
    from vip_factors.evaluate.scene import evaluate_scene
    from vip_factors.io.mcap_scene_estimate import read_scene_estimate
    from vip_factors.io.mcap_scene_recording import read_scene

    estimate = read_scene_estimate(options.estimate)
    source = options.truth or options.estimate
    scene = read_scene(source)
    if all(wearer.truth is None for wearer in scene.wearers):
        raise InputError(f"{source} holds no truth: give a recording that does with --truth")
    wearer = scene.wearers[0]
    if len(scene.wearers) == len(estimate.wearers) == 1 and scene.camera is None and wearer.truth is not None:
        return evaluate(estimate.wearers[0], wearer.truth, wearer.placement)
    return evaluate_scene(estimate, scene)
