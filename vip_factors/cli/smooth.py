"""``vip-factors smooth``: a recording or a scene in, an estimate out."""

import shlex
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import UNPREFIXED, FailOn, ManyOptions, Output, SettingsOptions, beside, fail_on
from vip_factors.cli.terminal import progress_bar, say
from vip_factors.errors import InputError
from vip_factors.settings import Settings


@dataclass(frozen=True)
class SmoothOptions(SettingsOptions, ManyOptions):
    """Reconstruct a recording: motion, headings and mountings of the sensors, as an estimate file.

    With cameras, all wearers and the cameras' paths are in one world. Without, each wearer is solved alone. Recordings
    longer than --windows.above-s are solved in windows.

    Every setting is an option; --settings reads a file, and options override it.
    """

    recording: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap) from vip-factors convert. Several recordings without a camera are consecutive parts of one."""
    out: Annotated[Path | None, Output(".mcap")] = None
    """Estimate (.mcap) to write; default: RECORDING.estimate.mcap."""
    fail_on: FailOn = "never"
    """Exit with code 3 if the verdict is this or worse; files are written anyway."""
    settings: Annotated[Settings, UNPREFIXED] = field(default_factory=Settings)


def main(options: SmoothOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.cli.workers import windows_elsewhere
    from vip_factors.workflow import estimate_lines, smooth_file

    if not options.recording:
        raise InputError("no RECORDING.mcap to smooth is named")
    out = options.target(options.out, options.recording[0], ".estimate.mcap")
    with progress_bar() as progress, windows_elsewhere(options.jobs, options.cluster) as map_fn:
        estimate, frames = smooth_file(
            options.recording, out, options.settings, progress, map_fn=map_fn, overwrite=options.overwrite
        )
    for line in estimate_lines(estimate, frames):
        say(line)
    _tell_file(out, options)
    fail_on(options.fail_on, estimate.verdict)


def _tell_file(out: Path, options: SmoothOptions) -> None:
    """The file, for scripts; and to who sits before a terminal what may be done with it."""
    say(out)
    if sys.stdout.isatty():
        estimate, recording = (shlex.quote(str(path)) for path in (out, options.recording[0]))
        export = shlex.quote(str(beside(out, ".bvh")))
        say(
            f"next: vip-factors view {estimate} {recording}, vip-factors report {estimate} --recording {recording}, "
            f"vip-factors export {estimate} {export}"
        )
