"""``vip-factors report``: an estimate as one page for people."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vip_factors.atomic import check_target
from vip_factors.cli.options import FailOn, Output, WritingOptions, fail_on
from vip_factors.cli.terminal import note, progress_bar, say
from vip_factors.errors import InputError
from vip_factors.ranges import Range

if TYPE_CHECKING:
    from vip_factors.sensors.scene import Scene


@dataclass(frozen=True)
class ReportOptions(WritingOptions):
    """Write one HTML page: verdict, findings, results with uncertainty, and a 3D view.

    The page needs no network. --recording adds sensors, gaps and video.
    """

    estimate: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATE")]
    """Estimate (.mcap)."""
    recording: Path | None = None
    """Recording (.mcap) of the estimate; default: the one in the estimate's file."""
    truth: Path | None = None
    """Recording (.mcap) with the truth; default: --recording."""
    video: Annotated[tuple[Path, ...] | None, tyro.conf.arg(metavar="[FILM …]")] = None
    """Also write a film (.mp4) for each camera, with skeletons over the given videos or those of the recording; needs
    vip-factors[film]."""
    video_height: Annotated[int, Range(least=64, most=2160)] = 480
    """Height of the film in pixels."""
    video_seconds: tuple[float, float] | None = None
    """First and last second of the film; default: the whole recording."""
    out: Annotated[Path | None, Output(".html")] = None
    """Page (.html) to write; default: beside the estimate."""
    fail_on: FailOn = "never"
    """Exit with code 3 if the verdict is this or worse; files are written anyway."""


def main(options: ReportOptions) -> None:
    """Run the command with its parsed options."""
    out = options.target(options.out, options.estimate, ".html")
    if options.video is not None:
        from vip_factors.viz.film import check_film

        check_film(out.with_suffix(".mp4"))
    from vip_factors.cli.files import open_one
    from vip_factors.io.mcap_recording import read_scene

    with progress_bar() as progress:
        progress("reading", 0.0)
        opened = open_one(options.estimate)
        if (estimate := opened.estimate) is None:
            raise InputError(f"{options.estimate} holds no estimate: expected a file of vip-factors smooth")
        scene = opened.scene if options.recording is None else read_scene(options.recording)
        truth = None if options.truth is None else read_scene(options.truth)
        from vip_factors.report.page import film_paths, write_report  # late: input is checked first

        films = list[Path]()
        if options.video is not None and scene is not None:
            films = film_paths(out, [camera.name for camera in scene.cameras])
            for path in films:
                check_target(path, options.overwrite)
            if not options.video:
                _note_missing_videos(scene)
        write_report(
            estimate,
            out,
            scene,
            truth,
            options.overwrite,
            progress,
            options.video or options.video is not None,
            video_height=options.video_height,
            video_seconds=options.video_seconds,
        )
    say(out)
    for path in films:
        say(path)
    fail_on(options.fail_on, estimate.verdict)


def _note_missing_videos(scene: "Scene") -> None:
    """Say which of the recording's videos are not where they were."""
    for camera in scene.cameras:
        video = camera.video
        if video is not None and video.path is not None and not video.path.is_file() and not video.images:
            note(f"note: no video at {video.path}: the film has a plain ground instead; --video FILM names it")
