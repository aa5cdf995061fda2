"""``vip-factors evaluate``: how good an estimate is."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import Flag, parse
from vip_factors.errors import InputError


@dataclass(frozen=True)
class EvaluateOptions:
    """Compare an estimate with the truth: positions, orientations, path, headings, mountings, honesty."""

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
    from vip_factors.evaluate.evaluation import evaluate
    from vip_factors.io.atomic import atomic_open, check_target
    from vip_factors.io.mcap_estimate import read_estimate
    from vip_factors.io.mcap_recording import read_recording

    if options.json is not None:
        check_target(options.json, options.overwrite)
    estimate = read_estimate(options.estimate)
    source = options.truth or options.estimate
    recording = read_recording(source)
    if recording.truth is None:
        raise InputError(f"{source} holds no truth: give a recording that does with --truth")
    evaluation = evaluate(estimate, recording.truth)
    print(evaluation.to_table(), end="")
    if options.json is not None:
        with atomic_open(options.json, "w", options.overwrite) as file:
            file.write(evaluation.to_json())
