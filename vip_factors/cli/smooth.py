"""``vip-factors smooth``: a recording in, an estimate out."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import Flag, beside, parse
from vip_factors.settings import Settings


@dataclass(frozen=True)
class SmoothOptions:
    """Reconstruct a recording: motion, headings and mountings of the sensors, as an estimate file.

    Every setting of the pipeline is an option; --settings reads them from a file, and options win over it.
    """

    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap); vip-factors convert makes one from foreign files."""
    out: Path | None = None
    """Estimate (.mcap) to write; RECORDING.estimate.mcap if absent."""
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
    from vip_factors.io.mcap_estimate import write_estimate
    from vip_factors.io.mcap_recording import read_recording

    options = parse(SmoothOptions, prog, arguments, _defaults(arguments), none_is_a_value=True)
    out = options.out or beside(options.recording, ".estimate.mcap")
    check_target(out, options.overwrite)
    recording = read_recording(options.recording)
    from vip_factors.pipeline import smooth

    with progress_bar() as tell:
        estimate = smooth(recording, options.tree, tell)
    estimate = replace(estimate, settings=flattened(options.tree))
    write_estimate(estimate, out, overwrite=options.overwrite, start_ns=recording.start_ns)
    motion = estimate.motion
    print(
        f"{estimate.method}: {len(motion)} frames at {motion.rate:g} Hz from {len(estimate.sensors)} sensors, "
        f"{sum(report.seconds for report in estimate.reports):.1f} s of solving"
    )
    print(out)


def _defaults(arguments: Sequence[str]) -> SmoothOptions | None:
    """The options' defaults, with those of a settings file if one is named: found before the rest is parsed."""
    path = None
    for index, word in enumerate(arguments):
        if word == "--settings" and index + 1 < len(arguments):
            path = arguments[index + 1]
        elif word.startswith("--settings="):
            path = word.partition("=")[2]
    if path is None:
        return None
    from vip_factors.cli.settings_file import read_settings

    return SmoothOptions(recording=tyro.MISSING, tree=read_settings(Path(path), Settings()))
