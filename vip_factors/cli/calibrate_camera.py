"""``vip-factors calibrate-camera``: a video of a board in, a camera file out."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from vip_factors.cli.options import Output, WritingOptions
from vip_factors.cli.terminal import note, progress_bar, say
from vip_factors.errors import InputError

if TYPE_CHECKING:
    from vip_factors.io.calibrate_camera import BoardView, CameraCalibration, Checkerboard
    from vip_factors.sensors.camera import CameraModel


@dataclass(frozen=True)
class CalibrateCameraOptions(WritingOptions):
    """Estimate a camera's focal length, principal point and distortion from a video of a checkerboard.

    Film with the zoom, focus and image size of the recording. Show the board from many sides, tilted by 30° and more,
    filling a third of the image, also in its corners. --floor or --floor-image names an image with the board on the
    floor, which gives the camera's pose. Cameras that see the board in the same place share one world, if the board has
    an odd and an even number of inner corners.
    """

    source: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="VIDEO|CAMERA")]
    """Video of the board; or a camera file, to which --floor-image adds the pose."""
    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CAMERA.toml"), Output(".toml")]
    """Camera file to write."""
    checkerboard: str
    """Columns and rows of inner corners (squares minus one), such as 9x6."""
    square_m: float | None = None
    """Side of a square in metres; required for the floor only."""
    floor: Literal["first", "last"] | None = None
    """Which of the frames that show the board shows it on the floor."""
    floor_image: Path | None = None
    """Image of the same size that shows the board on the floor; replaces --floor."""
    distortion: Literal[0, 4, 5, 8] = 4
    """Number of distortion coefficients: 4 for most lenses, 8 for wide-angle ones."""


def execute_calibrate_camera(options: CalibrateCameraOptions) -> None:
    """Run ``vip-factors calibrate-camera``."""
    from vip_factors.io.calibrate_camera import calibrate, find_views
    from vip_factors.io.camera_file import read_camera_file, write_camera_file

    board = _board(options)
    views: Sequence[BoardView] = ()
    warnings: Sequence[str] = ()
    if options.source.suffix.lower() == ".toml":
        model = read_camera_file(options.source).model
        report: dict[str, str | float | int] = {"intrinsics": str(options.source)}
        if options.floor_image is None:
            raise InputError(f"{options.source}: a camera file needs --floor-image, which gives the pose")
    else:
        with progress_bar() as on_progress:
            views, size = find_views(options.source, board, on_progress)
            calibration = calibrate(views, size, options.distortion, on_progress)
        say(calibration_text(calibration, len(views)))
        model, warnings = calibration.model, calibration.warnings
        report = {
            "board": board.text,
            "rms_px": calibration.rms_px,
            "views": len(calibration.views),
            "focal_sigma_px": float(calibration.sigma[:2].max()),
            "centre_sigma_px": float(calibration.sigma[2:].max()),
        }
    floor = None
    if options.floor is not None or options.floor_image is not None:
        floor, text = _floor(options, board, views, model)
        say(text)
    for warning in warnings:
        note(f"warning: {warning}")
    if floor is not None and board.looks_alike_turned:
        note(f"warning: a {board.text} looks alike from both ends: several cameras may disagree about its origin")
    write_camera_file(options.out, model, floor, report, options.overwrite)
    say(options.out)


def calibration_text(calibration: "CameraCalibration", image_count: int) -> str:
    """The result with its standard deviations, and the error of every view."""
    model, sigma = calibration.model, calibration.sigma
    numbers = zip(("fx", "fy", "cx", "cy"), (*model.focal, *model.centre), sigma, strict=True)
    lines = [
        f"{model.width} x {model.height} pixels; board in {image_count} images, {len(calibration.views)} views used, "
        f"{100 * calibration.coverage:.0f} % of the image reached",
        f"reprojection error {calibration.rms_px:.3f} px (root mean square)",
        "  " + ", ".join(f"{name} {value:.1f} ± {sigma:.1f}" for name, value, sigma in numbers),
    ]
    if model.distortion:
        bent = zip(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), model.distortion, calibration.distortion_sigma)  # noqa: B905
        lines.append("  " + ", ".join(f"{name} {value:.4f} ± {sigma:.4f}" for name, value, sigma in bent))
    lines += [f"  {name:<24} {error:6.3f} px" for name, error in calibration.views]
    lines += [
        f"  {name:<24} {error:6.3f} px, left out: does not fit the others" for name, error in calibration.left_out
    ]
    return "\n".join(lines)


def _board(options: CalibrateCameraOptions) -> "Checkerboard":
    from vip_factors.io.calibrate_camera import Checkerboard

    if options.floor is not None and options.floor_image is not None:
        raise InputError("--floor and --floor-image: expected one of them")
    if (options.floor is not None or options.floor_image is not None) and options.square_m is None:
        raise InputError("--floor needs --square-m, the side of a square in metres")
    match = re.fullmatch(r"\s*(\d+)\s*[xX,]\s*(\d+)\s*", options.checkerboard)
    if match is None:
        raise InputError(f"--checkerboard '{options.checkerboard}': expected columns and rows, such as 9x6")
    return Checkerboard(int(match[1]), int(match[2]), 1.0 if options.square_m is None else options.square_m)


def _floor(
    options: CalibrateCameraOptions, board: "Checkerboard", views: "Sequence[BoardView]", model: "CameraModel"
) -> tuple[tuple, str]:
    """The camera's pose over the floor, and what it says in words."""
    import numpy as np

    from vip_factors.io.calibrate_camera import floor_pose, photograph

    if options.floor_image is not None:
        grey = photograph(options.floor_image)
        if grey.shape != (model.height, model.width):
            height, width = grey.shape
            raise InputError(
                f"{options.floor_image}: {width} x {height} pixels, but the camera has {model.width} x {model.height}: "
                "expected an image of the same size"
            )
        view = board.find(options.floor_image.name, grey)
        if view is None:
            raise InputError(f"{options.floor_image}: no {board.text} in it: expected an image that shows it")
    else:
        view = views[0 if options.floor == "first" else -1]
    R, p, rms_px = floor_pose(view, model)
    down = np.rad2deg(np.arcsin(-R[2, 2]))
    return (R, p), (
        f"floor from {view.name}: camera {p[2]:.2f} m above it, looking {abs(down):.1f}° "
        f"{'down' if down >= 0 else 'up'}, error {rms_px:.3f} px"
    )
