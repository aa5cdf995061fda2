"""``vip-factors detect``: the 2D poses of everybody in a video, in a file that convert takes."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from vip_factors.atomic import check_target
from vip_factors.cli.options import UNPREFIXED, Output, WritingOptions, beside
from vip_factors.cli.terminal import note, progress_bar, say
from vip_factors.detect.settings import DetectSettings
from vip_factors.errors import InputError


@dataclass(frozen=True)
class DetectOptions(WritingOptions):
    """Find the 2D poses of everybody in a video, and follow people from frame to frame.

    The poses go into a file as MMPose writes them, with the keypoints' names, the frames' times and a number for each
    person followed: convert --detections takes it. Needs: pip install 'vip-factors[detect]'.

    The model is BlazePose, 33 keypoints, whose files are fetched once with pip; --model takes any other as ONNX.
    """

    video: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="VIDEO")]
    """Video (.mp4, .mov …)."""
    out: Annotated[Path | None, Output(".json")] = None
    """File (.json) to write; VIDEO.poses.json if absent."""
    overlay: Annotated[Path | None, Output(".mp4")] = None
    """Also write the video (.mp4) with the poses drawn over it."""
    blazepose: Annotated[Path | None, tyro.conf.arg(metavar="WHEEL_OR_FOLDER")] = None
    """Wheel of mediapipe 0.10.21, or a folder with pose_detection.tflite and pose_landmark_full.tflite; if absent, that
    wheel is fetched with pip, once, and the two files are kept in the user's cache."""
    model: Annotated[Path | None, tyro.conf.arg(metavar="MODEL.onnx")] = None
    """Top-down pose model such as RTMPose (SimCC rows or heat maps), for the keypoints of the people that BlazePose
    finds and follows."""
    keypoints: str | None = None
    """Keypoints of that model: coco17, halpe26 …; told by their number if absent."""
    start_s: float | None = None
    """Second of the video to begin at."""
    end_s: float | None = None
    """Second of the video to end at."""
    every: int = 1
    """Look at each n-th frame only; the others hold nobody."""
    threads: int | None = None
    """Of the processor; as many as there are, up to four, if absent."""
    settings: Annotated[DetectSettings, UNPREFIXED] = field(default_factory=DetectSettings)


def main(options: DetectOptions) -> None:
    """Run the command."""
    from vip_factors.detect.video import Stretch, detect_people, poses_summary, write_overlay, write_poses

    if options.keypoints is not None and options.model is None:
        raise InputError("--keypoints given without --model: BlazePose has its own 33")
    out = options.out or beside(options.video, ".poses.json")
    for target in (out, options.overlay):
        if target is not None:
            check_target(target, options.overwrite)
    with progress_bar() as progress:
        began = time.perf_counter()
        poses = detect_people(
            options.video, options.settings, Stretch(options.start_s, options.end_s, options.every),
            model=options.model, keypoints=options.keypoints, blazepose=options.blazepose, threads=options.threads,
            on_message=note,
            on_progress=lambda done, count: progress(f"looking for people in {count:,} frames", done / count),
        )  # fmt: skip
        seconds = time.perf_counter() - began
        write_poses(out, poses, options.overwrite)
        if options.overlay is not None:
            write_overlay(
                options.overlay,
                poses,
                options.overwrite,
                lambda done, count: progress(f"drawing {count:,} frames", done / count),
            )
    say("\n".join(poses_summary(poses, seconds)))
    for path in (out, options.overlay):
        if path is not None:
            say(path)
