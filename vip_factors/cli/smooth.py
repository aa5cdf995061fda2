"""``vip-factors smooth``: a recording or a scene in, an estimate out."""

import shlex
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.atomic import check_target
from vip_factors.cli.options import UNPREFIXED, FailOn, ManyOptions, Output, SettingsOptions, beside, fail_on
from vip_factors.cli.terminal import printable, progress_bar
from vip_factors.errors import InputError
from vip_factors.settings import Settings

if TYPE_CHECKING:
    from vip_factors.estimate import Estimate, SolveReport


@dataclass(frozen=True)
class SmoothOptions(SettingsOptions, ManyOptions):
    """Reconstruct a recording: motion, headings and mountings of the sensors, as an estimate file.

    With a camera in it: all wearers in one world, and the camera's path. Without: each wearer from the IMUs alone.
    What is longer than --windows.above-s is read and solved window by window, in the memory of one.

    Every setting of the pipeline is an option; --settings reads them from a file, and options win over it.
    """

    recording: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap); vip-factors convert makes one from foreign files. Several, without a camera, are parts of one
    recording that follow one another in time."""
    out: Annotated[Path | None, Output(".mcap")] = None
    """Estimate (.mcap) to write; RECORDING.estimate.mcap if absent."""
    fail_on: FailOn = "never"
    """End with exit code 3 if the verdict is this or worse; what is written is written all the same."""
    settings: Annotated[Settings, UNPREFIXED] = field(default_factory=Settings)


def main(options: SmoothOptions) -> None:
    """Run the command."""
    from vip_factors.cli.workers import windows_elsewhere
    from vip_factors.io.mcap_estimate_writer import write_estimate
    from vip_factors.io.mcap_source import open_source
    from vip_factors.pipeline import smooth_chunks

    if not options.recording:
        raise InputError("no RECORDING.mcap to smooth is named")
    settings = options.settings
    out = options.out or beside(options.recording[0], ".estimate.mcap")
    check_target(out, options.overwrite)
    long_s = settings.windows.above_s if settings.windows.use and not settings.calibration.from_truth else float("inf")
    source = open_source(options.recording, long_s)
    reports: list[SolveReport] = []
    with (
        progress_bar() as progress,
        windows_elsewhere(options.jobs, options.cluster) as each,
    ):
        estimate = smooth_chunks(source, settings, progress, each=each)
        reported = replace(estimate, chunks=_reporting(estimate.chunks, reports))
        write_estimate(reported, out, options.overwrite, start_ns=source.wearers[0].head.start_ns)
    head = estimate.head if estimate.closed is None else estimate.closed()
    head = replace(head, reports=(*head.reports, *reports))
    for wearer, frames in zip(head.wearers, estimate.frames, strict=True):
        rate, count = wearer.motion.rate, len(wearer.sensors)
        who = printable(f", {wearer.name}" if wearer.name else "")
        print(f"{wearer.method}{who}: {frames} frames at {rate:g} Hz from {count} sensors")
    if head.camera is not None:
        given = int((head.wearer_of_detection >= 0).sum())
        print(f"camera: {given} of {len(head.wearer_of_detection)} detections are of wearers")
    print(f"computed in {sum(report.seconds for report in head.all_reports):.1f} s")
    print(printable(f"verdict: {head.verdict}"))
    for finding in head.all_findings:
        print(printable(f"{finding.severity}: {finding}"))
    _tell_file(out, options)
    fail_on(options.fail_on, head.verdict)


def _reporting(chunks: "Iterator[Estimate]", reports: "list[SolveReport]") -> "Iterator[Estimate]":
    """The chunks, and the reports of the solves that made them."""
    for chunk in chunks:
        reports += chunk.all_reports
        yield chunk


def _tell_file(out: Path, options: SmoothOptions) -> None:
    """The file, for scripts; and to who sits before a terminal what may be done with it."""
    print(out)
    if sys.stdout.isatty():
        estimate, recording = (shlex.quote(str(path)) for path in (out, options.recording[0]))
        export = shlex.quote(str(beside(out, ".bvh")))
        print(
            f"next: vip-factors view {estimate} {recording}, vip-factors report {estimate} --recording {recording}, "
            f"vip-factors export {estimate} {export}"
        )
