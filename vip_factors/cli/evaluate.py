"""``vip-factors evaluate``: how good an estimate is."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.atomic import atomic_open
from vip_factors.cli.options import Output, WritingOptions
from vip_factors.cli.terminal import say, waiting
from vip_factors.errors import InputError

if TYPE_CHECKING:
    from vip_factors.evaluate.evaluation import Evaluation


@dataclass(frozen=True)
class EvaluateOptions(WritingOptions):
    """Compare an estimate with the truth: positions, orientations, path, calibration and consistency.

    The summary names the alignment of each error; tables of joints and sensors follow. Limbs without truth are
    excluded. --json FILE writes all metrics.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap)."""
    truth: Path | None = None
    """Recording (.mcap) with the truth, or a true motion (.bvh …) that starts at the same time; default: the recording
    in the estimate's file."""
    json: Annotated[Path | None, Output()] = None
    """JSON file for all metrics."""


def main(options: EvaluateOptions) -> None:
    """Run the command with its parsed options."""
    with waiting(f"comparing {options.estimate.name} with the truth"):
        evaluation = _evaluation(options)
    say(evaluation)
    if options.json is not None:
        with atomic_open(options.json, "w", options.overwrite) as file:
            file.write(evaluation.to_json())


def _evaluation(options: EvaluateOptions) -> "Evaluation":
    from vip_factors.cli.files import open_one
    from vip_factors.evaluate.comparison import doubts
    from vip_factors.evaluate.evaluation import evaluate, evaluate_scene
    from vip_factors.io.mcap_estimate import read_start
    from vip_factors.sensors.recording import Truth

    opened = open_one(options.estimate)
    scene, estimate = opened.scene, opened.estimate
    if estimate is None:
        raise InputError(f"{options.estimate} holds no estimate: expected a file of vip-factors smooth")
    if options.truth is not None:
        truth = open_one(options.truth)
        if truth.motion is not None:
            return evaluate(estimate.wearer(), Truth(truth.motion))  # of headings and mountings it knows nothing
        scene = truth.scene
    source = options.truth or options.estimate
    if scene is None:
        raise InputError(
            f"{source} holds an estimate and no recording: say with --truth which recording, simulated say, holds the "
            "truth"
        )
    if all(wearer.truth is None for wearer in scene.wearers):
        raise InputError(f"{source} holds no truth: give a recording that does with --truth")
    if odd := doubts(estimate, scene, read_start(options.estimate)[0]):
        warnings.warn(odd, stacklevel=2)
    wearer = scene.wearers[0]
    if len(scene.wearers) == len(estimate.wearers) == 1 and scene.camera is None and wearer.truth is not None:
        return evaluate(estimate.wearers[0], wearer.truth)
    return evaluate_scene(estimate, scene)
