"""``vip-factors smooth``: a recording or a scene in, an estimate out."""

import shlex
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.cli.common_settings import CommonSettings
from vip_factors.cli.options import Flag, Output, beside, parse_with_settings
from vip_factors.cli.settings_file import named_tree
from vip_factors.configurations import Configuration
from vip_factors.errors import InputError

if TYPE_CHECKING:
    from vip_factors.estimate import Estimate, EstimateChunks
    from vip_factors.io.mcap_sampled import SampledScene
    from vip_factors.settings import Settings


@dataclass(frozen=True)
class SmoothOptions:
    """Reconstruct a recording: motion, headings and mountings of the sensors, as an estimate file.

    With a camera in it: all wearers in one world, and the camera's path. Without: each wearer from the IMUs alone.
    What is longer than --windows.above-s is solved window by window, in the memory of one.

    Every setting of the pipeline is an option (--help-all tells them); --settings reads them from a file, and options
    win over it.
    """

    recording: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RECORDING")]
    """Recording (.mcap); vip-factors convert makes one from foreign files. Several, without a camera, are parts of one
    recording that follow one another in time."""
    out: Annotated[Path | None, Output(".mcap")] = None
    """Estimate (.mcap) to write; RECORDING.estimate.mcap if absent."""
    configuration: Configuration = Configuration.OWN
    """Settings to start from: this package's own, or those that stand for the estimators of Kaichi et al. 2020, which
    want a camera of known pose. A settings file may name one too (configuration = "kaichi-full")."""
    settings: Path | None = None
    """TOML file with settings; a table for each group, such as [solve]."""
    overwrite: Flag = False
    """Replace the estimate if it exists."""


def main(prog: str, arguments: Sequence[str]) -> None:
    """Run the command."""
    options, settings = parse_with_settings(
        SmoothOptions, prog, arguments, CommonSettings, lambda: _defaults(arguments)
    )
    from vip_factors.atomic import check_target
    from vip_factors.cli.terminal import progress_bar
    from vip_factors.io.scene_building import read_scenes

    if not options.recording:
        raise InputError("no RECORDING.mcap to smooth is named")
    out = options.out or beside(options.recording[0], ".estimate.mcap")
    check_target(out, options.overwrite)
    sampled = _in_windows(options.recording, settings)
    if sampled is not None and (not sampled.has_camera or not settings.fusion.use_camera):
        _smooth_windows(sampled, options, settings, out)
        return
    if sampled is not None and _smooth_filmed_windows(sampled, options, settings, out):
        return
    scene = read_scenes(options.recording)
    from vip_factors.estimate import EstimateChunks
    from vip_factors.pipeline import smooth_scene

    with progress_bar() as tell:
        estimate = smooth_scene(scene, settings, tell)
    _write(EstimateChunks.of(estimate), scene.wearers[0].start_ns, options, out)


def _in_windows(paths: Sequence[Path], settings: "Settings") -> "SampledScene | None":
    """The recordings of files that are to be read and solved window by window; None if they are to be read at once."""
    from vip_factors.io.mcap_sampled import open_sampled_parts
    from vip_factors.pipeline import is_long

    if settings.calibration.from_truth or not settings.windows.use:
        return None
    with warnings.catch_warnings(record=True) as told:
        sampled = open_sampled_parts(paths)
    if sampled is None or not any(is_long(one.interval, settings) for one in sampled.wearers):
        return None
    for one in told:  # else whoever reads it at once says so
        warnings.warn(one.message, stacklevel=2)
    return sampled


def _smooth_windows(
    sampled: "SampledScene", options: SmoothOptions, settings: "Settings", out: Path, findings: tuple[str, ...] = ()
) -> None:
    """Each wearer by the sensors alone; ``findings`` are told beside those of the estimates."""
    from vip_factors.cli.terminal import progress_bar
    from vip_factors.pipeline import smooth_long

    with progress_bar() as tell:
        estimate = smooth_long(sampled.name, sampled.wearers, settings, tell)
        head = replace(estimate.head, findings=(*findings, *estimate.head.findings))
        _write(replace(estimate, head=head), sampled.wearers[0].head.start_ns, options, out)


def _smooth_filmed_windows(sampled: "SampledScene", options: SmoothOptions, settings: "Settings", out: Path) -> bool:
    """Whether it was done: what cannot be read by time, or is short, is to be read at once."""
    from vip_factors.cli.terminal import progress_bar
    from vip_factors.io.mcap_long_scene import filmed_scene
    from vip_factors.pipeline import UNSEEN, covered, is_long, smooth_long_scene

    source = filmed_scene(sampled)
    if source is None or not is_long(covered(source), settings):
        return False
    with progress_bar() as tell:
        estimate = smooth_long_scene(source, settings, tell)
        if estimate is not None:
            _write(estimate, sampled.wearers[0].head.start_ns, options, out)
    if estimate is None:
        _smooth_windows(sampled, options, settings, out, (UNSEEN,))
    return True


def _write(estimate: "EstimateChunks", start_ns: int, options: SmoothOptions, out: Path) -> None:
    """The file, chunk by chunk as they are solved; then what it holds, for people, and where it is, for scripts."""
    from vip_factors.io.mcap_estimate_writer import write_estimate

    seconds = list[float]()

    def timed() -> "Iterator[Estimate]":
        for chunk in estimate.chunks:
            seconds.append(_solving(chunk))
            yield chunk

    write_estimate(replace(estimate, chunks=timed()), out, options.overwrite, start_ns=start_ns)
    head = estimate.head if estimate.closed is None else estimate.closed()
    for wearer, frames in zip(head.wearers, estimate.frames, strict=True):
        rate, count = wearer.motion.rate, len(wearer.sensors)
        print(f"{wearer.method}, {wearer.name}: {frames} frames at {rate:g} Hz from {count} sensors")
    if head.camera is not None:
        given = int((head.wearer_of_detection >= 0).sum())
        print(f"camera: {given} of {len(head.wearer_of_detection)} detections are of wearers")
    print(f"{_solving(head) + sum(seconds):.1f} s of solving")
    for finding in head.findings:
        print(f"note: {finding}")
    _tell_file(out, options)


def _solving(estimate: "Estimate") -> float:
    """Seconds of all its solves."""
    reports = (*estimate.reports, *(report for wearer in estimate.wearers for report in wearer.reports))
    return sum(report.seconds for report in reports)


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


def _defaults(arguments: Sequence[str]) -> "Settings":
    """The defaults, with those of a configuration or settings file if named."""
    from vip_factors.settings import Settings

    return named_tree(arguments, Settings())
