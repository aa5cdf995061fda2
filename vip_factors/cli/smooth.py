"""``vip-factors smooth``: a recording or a scene in, an estimate out."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.named import named_tree
from vip_factors.cli.options import Flag, beside, parse
from vip_factors.configurations import Configuration
from vip_factors.estimate import SceneEstimate
from vip_factors.settings import Settings


@dataclass(frozen=True)
class SmoothOptions:
    """Reconstruct a recording: motion, headings and mountings of the sensors, as an estimate file.

    With a camera in it: all wearers in one world, and the camera's path. Without: each wearer from the IMUs alone.

    Every setting of the pipeline is an option; --settings reads them from a file, and options win over it.
    """

    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap); vip-factors convert makes one from foreign files."""
    out: Path | None = None
    """Estimate (.mcap) to write; RECORDING.estimate.mcap if absent."""
    configuration: Configuration = Configuration.OWN
    """Settings to start from: this package's own, or those that stand for the estimators of Kaichi et al. 2020, which
    want a camera of known pose. A settings file may name one too (configuration = "kaichi-full")."""
    settings: Path | None = None
    """TOML file with settings; a table for each group, such as [solve]."""
    overwrite: Flag = False
    """Replace the estimate if it exists."""
    tree: Annotated[Settings, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=Settings)


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    from vip_factors.cli.settings_file import flattened
    from vip_factors.cli.terminal import progress_bar
    from vip_factors.io.atomic import check_target
    from vip_factors.io.mcap_scene_recording import read_scene

    options = parse(SmoothOptions, prog, arguments, _defaults(arguments), none_is_a_value=True)
    out = options.out or beside(options.recording, ".estimate.mcap")
    check_target(out, options.overwrite)
    scene = read_scene(options.recording)
    from vip_factors.pipeline import smooth_scene

    with progress_bar() as tell:
        estimate = smooth_scene(scene, options.tree, tell)
    _write(replace(estimate, settings=flattened(options.tree)), out, options.overwrite, scene.wearers[0].start_ns)
    _tell(estimate)
    print(out)


def _write(estimate: SceneEstimate, out: Path, overwrite: bool, start_ns: int) -> None:
    """One wearer without a camera is written as a plain estimate, which more programs know."""
    from vip_factors.io.mcap_estimate import write_estimate
    from vip_factors.io.mcap_scene_estimate import write_scene_estimate

    if estimate.camera is None and len(estimate.wearers) == 1:
        alone = replace(estimate.wearers[0], settings=estimate.settings)
        write_estimate(alone, out, overwrite=overwrite, start_ns=start_ns)
    else:
        write_scene_estimate(estimate, out, overwrite=overwrite, start_ns=start_ns)


def _tell(estimate: SceneEstimate) -> None:
    reports = [*estimate.reports, *(report for wearer in estimate.wearers for report in wearer.reports)]
    seconds = sum(report.seconds for report in reports)
    for wearer in estimate.wearers:
        motion = wearer.motion
        print(
            f"{wearer.method}, {wearer.name}: {len(motion)} frames at {motion.rate:g} Hz from {len(wearer.sensors)} "
            "sensors"
        )
    if estimate.camera is not None:
        given = int((estimate.wearer_of_detection >= 0).sum())
        print(f"camera: {given} of {len(estimate.wearer_of_detection)} detections are of wearers")
    print(f"{seconds:.1f} s of solving")
    for finding in estimate.findings:
        print(f"note: {finding}")


def _defaults(arguments: Sequence[str]) -> SmoothOptions | None:
    """The options' defaults, with those of a configuration or settings file if named."""
    tree = named_tree(arguments, Settings())
    return None if tree is None else SmoothOptions(recording=tyro.MISSING, tree=tree)
