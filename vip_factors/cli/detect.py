"""``vip-factors detect``: the 2D poses of everybody in a video, in a file that convert takes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.cli.options import UNPREFIXED, Output, WritingOptions, beside
from vip_factors.cli.terminal import progress_bar, say
from vip_factors.detect.settings import DetectSettings


@dataclass(frozen=True)
class DetectOptions(WritingOptions):
    """Detect and track the 2D poses of all people in a video.

    The file has MMPose's format, with keypoint names, frame times and a track number per person, for convert
    --detections. Needs: pip install 'vip-factors[detect]'.

    The model is BlazePose with 33 keypoints, downloaded once with pip; --model uses another ONNX model.
    """

    video: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="VIDEO")]
    """Video (.mp4, .mov …)."""
    out: Annotated[Path | None, Output(".json")] = None
    """File (.json) to write; VIDEO.poses.json if absent."""
    overlay: Annotated[Path | None, Output(".mp4")] = None
    """Also write the video (.mp4) with the poses drawn over it."""
    settings: Annotated[DetectSettings, UNPREFIXED] = field(default_factory=DetectSettings)


def main(options: DetectOptions) -> None:
    """Run the command with its parsed options."""
    from vip_factors.detect.video import detect_people, poses_summary

    out = options.out or beside(options.video, ".poses.json")
    with progress_bar() as progress:
        poses = detect_people(
            options.video, options.settings, progress, out=out, overlay=options.overlay, overwrite=options.overwrite
        )
    say("\n".join(poses_summary(poses)))
    for path in filter(None, (out, options.overlay)):
        say(path)
