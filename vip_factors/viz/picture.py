"""Pictures for a page: poses in a row, the truth in grey behind, or frames of a video with skeletons; errors below."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import ESTIMATE_COLOURS, Side
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, yaw_of
from vip_factors.viz.charts import (
    INK,
    MARGIN,
    SENSOR,
    SOFT_INK,
    TEXT,
    WIDTH,
    Curve,
    View,
    canvas,
    draw_body,
    draw_curves,
    draw_sensors,
    page,
    panel,
    pixels,
    save,
    size_of,
    view_from,
    write,
)
from vip_factors.viz.colours import STRANGER_COLOUR, hexadecimal, wearer_colour
from vip_factors.viz.drawn_scene import R_WORLD_STANDING, DrawnScene, DrawnWearer, floor_height
from vip_factors.viz.film import GROUND, overlaid_frames

GHOST = (220, 222, 226)  # of the truth, behind the estimate
GAP, HEADER, STRIP_HEIGHT, CHART_HEIGHT = 20, 130, 470, 190
BODY_HEIGHTS = (1.95, 2.5)  # metres that fit into the strip: standing, and arms raised overhead
HEADROOM_M = 0.25  # from the highest joint to the top: a head or a hand
FOOT_ROOM_PX = 42  # below the point under the pelvis: feet before it
VIEW_YAW, VIEW_PITCH = np.deg2rad(32.0), np.deg2rad(9.0)  # from the wearer's front left, a little from above
COLUMNS = 3  # frames of a video beside each other
AROUND = 1.25  # around the people shown
FINER = 2  # pixels drawn for one that is kept, along each side: lines are smooth then

Entry = tuple[str, str, str]
"""Of a legend: name, colour and matplotlib's marker ("-" for a bar)."""
DOT = "   ·   "


def filmstrip(
    drawn: DrawnScene, path: Path, *, frames: int = 6, title: str | None = None, overwrite: bool = False
) -> None:
    """Draw a PNG, with errors over time below: of what a camera filmed frames of its video, three in a row, skeletons
    in their wearers' colours over them; of one wearer alone poses in a row, each seen from the wearer's front left, in
    colour, the truth in grey behind.

    Args:
        drawn: of one wearer by :func:`~vip_factors.viz.drawn_scene.drawn_wearer`: the truth's pelvis is under the
            estimate's then.
        path: of the PNG.
        frames: how many, or poses, evenly over the time.
        title: above the picture; name and method if None.
        overwrite: replace an existing file.

    Raises:
        InputError: if there is neither a camera with video frames nor a single motion to draw, or the file exists.
    """
    if len(drawn.wearers) > 1 or any(camera.detections is not None for camera in drawn.cameras):
        _draw_frames(drawn, path, frames, title, overwrite)
    else:
        _draw_poses(drawn.wearers[0], path, frames, title, overwrite)


def _draw_poses(wearer: DrawnWearer, path: Path, poses: int, title: str | None, overwrite: bool) -> None:
    if wearer.shown is None:
        raise InputError("nothing to draw: expected an estimate, or a recording with its truth")
    shown, ghost, estimate = wearer.shown, wearer.truth if wearer.motion is not None else None, wearer.estimate
    values, label = wearer.error_mm, "joint error, mm"
    if values is None and estimate is not None and "orientation_deg" in estimate.residuals:
        values, label = mean_residual(estimate.residuals["orientation_deg"]), "mean orientation residual, °"
    frames = np.round(np.linspace(0.04, 0.96, poses) * (len(shown) - 1)).astype(int)
    if title is None:
        title = ", ".join(filter(None, (estimate.name, estimate.method))) if estimate is not None else shown.name
    entries = [(side.value, hexadecimal(ESTIMATE_COLOURS[side]), "-") for side in (Side.LEFT, Side.RIGHT)]
    entries += [("truth", hexadecimal(GHOST), "-")] if ghost is not None else []
    entries += [("sensor", SENSOR, "s")] if wearer.recording is not None else []
    curves = [Curve("", shown.time, values)] if values is not None else []
    words = [f"{len(shown) / shown.rate:.1f} s"]
    words += [f"{len(estimate.sensors)} inertial sensors"] if estimate is not None and estimate.sensors else []
    words += [f"mean joint error {np.mean(values):.0f} mm"] if ghost is not None and values is not None else []
    figure = _page(title, DOT.join(words), entries, STRIP_HEIGHT, curves, label, shown.time[frames])
    axes = panel(figure, (0, HEADER, WIDTH, HEADER + STRIP_HEIGHT))
    axes.set(xlim=(0, WIDTH), ylim=(STRIP_HEIGHT, 0), xticks=(), yticks=())
    _draw_row(axes, wearer, shown, ghost, frames)
    save(figure, path, overwrite)


def pose_picture(motion: Motion, frame: int, size: tuple[int, int]) -> np.ndarray:
    """One pose on white, seen from the wearer's front left.

    Args:
        motion: whose pose.
        frame: which one.
        size: width and height in pixels.

    Returns:
        ``(height, width, 3)``, blue green red.
    """
    axes = canvas(*size)
    floor = floor_height(motion.frames(slice(frame, frame + 1)))
    view = _view(motion, frame, floor, size[0] / 2, size[1], _scale(motion, [frame], [floor], size[1]))
    _draw_floor(axes, view)
    draw_body(axes, motion, frame, view, ESTIMATE_COLOURS)
    figure = axes.get_figure(root=True)
    assert figure is not None
    return pixels(figure)[..., ::-1]


def _draw_frames(drawn: DrawnScene, path: Path, frames: int, title: str | None, overwrite: bool) -> None:
    camera, detections, labels = drawn.films()[0]
    count = len(detections.time)
    chosen = np.unique(np.round(np.linspace(0.04, 0.96, frames) * (count - 1)).astype(int))
    curves, label = _scene_curves(drawn)
    columns = min(COLUMNS, len(chosen))
    rows = -(-len(chosen) // columns)
    cell = (WIDTH - 2 * MARGIN - (columns - 1) * GAP) // columns
    height = round(cell * camera.model.height / camera.model.width)
    strip = np.full((rows * (height + GAP), WIDTH, 3), 255, np.uint8)
    plates = []
    for number, (frame, picture) in enumerate(zip(chosen, _pictures(drawn, chosen, (cell, height)), strict=True)):
        x, y = MARGIN + (number % columns) * (cell + GAP), (number // columns) * (height + GAP)
        strip[y : y + height, x : x + cell] = picture
        plates.append((x, HEADER + y + height, f"{detections.time[frame]:.1f} s"))
    if title is None:
        title = f"{drawn.name}, {drawn.estimate.method}" if drawn.estimate is not None else drawn.name
    entries = [(wearer.name, hexadecimal(wearer_colour(wearer.index)), "-") for wearer in drawn.wearers]
    entries += [("nobody's", hexadecimal(STRANGER_COLOUR), "-")] if np.any(labels < 0) else []
    assigned, time = int(np.sum(labels >= 0)), detections.time
    subtitle = (f"{time[-1] - time[0]:.1f} s", f"{len(detections)} people detected", f"{assigned} assigned to wearers")
    figure = _page(title, DOT.join(subtitle), entries, strip.shape[0], curves, label, time[chosen])
    figure.figimage(strip, 0, round(size_of(figure)[1]) - HEADER - strip.shape[0], origin="upper")
    for x, low, text in plates:
        box = {"facecolor": hexadecimal(GROUND), "edgecolor": "none", "pad": 8}
        write(figure, (x + 10, low - 11), text, TEXT, "#ebeef2", bbox=box)
    save(figure, path, overwrite)


def _page(
    title: str,
    subtitle: str,
    entries: Sequence[Entry],
    strip_height: int,
    curves: Sequence[Curve],
    label: str,
    marks: Array,
) -> Figure:
    """A header with its legend, room for the strip, and curves below it."""
    bottom = HEADER + strip_height
    figure = page(WIDTH, bottom + (70 + CHART_HEIGHT if curves else 30))
    write(figure, (MARGIN, 62), title, 28, weight="bold")
    write(figure, (MARGIN, 98), subtitle, 19, SOFT_INK)
    lines = [
        Line2D([], [], color=colour, linewidth=12, solid_capstyle="round")
        if marker == "-"
        else Line2D([], [], color=colour, marker=marker, markersize=15, linestyle="none")
        for _, colour, marker in entries
    ]
    figure.legend(
        lines,
        [name for name, _, _ in entries],
        loc="upper right",
        ncols=len(entries),
        frameon=False,
        fontsize=19,
        labelcolor=SOFT_INK,
        bbox_to_anchor=(1 - MARGIN / WIDTH, 1 - 30 / size_of(figure)[1]),
        handlelength=0.8,
        columnspacing=1.4,
        borderaxespad=0.0,
    )
    if curves:
        axes = panel(figure, (MARGIN + 40, bottom + 50, WIDTH - MARGIN, bottom + 20 + CHART_HEIGHT))
        draw_curves(axes, curves, label, marks.tolist())
    return figure


def mean_residual(values: Array) -> Array:
    """Mean over the sensors ``(T,)``; NaN where none gave anything."""
    is_seen = np.isfinite(values).any(axis=1)
    mean = np.full(len(values), np.nan)
    mean[is_seen] = np.nanmean(values[is_seen], axis=1)
    return mean


def _draw_row(axes: Axes, wearer: DrawnWearer, shown: Motion, ghost: Motion | None, frames: Array) -> None:
    """Draw poses beside each other over the axes."""
    cell = (WIDTH - 2 * MARGIN) / len(frames)
    # Without the truth the height of an inertial reconstruction drifts: then every pose stands on its own lower foot.
    floors = [floor_height(ghost if ghost is not None else shown.frames(slice(f, f + 1))) for f in frames]
    scale = _scale(shown, frames, floors, STRIP_HEIGHT)
    sites = wearer.recording.placement.sites if wearer.recording is not None else ()
    for index, (frame, floor) in enumerate(zip(frames.tolist(), floors, strict=True)):
        x = MARGIN + cell * (index + 0.5)
        view = _view(ghost if ghost is not None else shown, frame, floor, x, STRIP_HEIGHT, scale)
        _draw_floor(axes, view)
        if ghost is not None:
            draw_body(axes, ghost, frame, view, dict.fromkeys(Side, GHOST))
        draw_body(axes, shown, frame, view, ESTIMATE_COLOURS)
        draw_sensors(axes, shown, frame, view, sites)


def _scale(motion: Motion, frames: Sequence[int] | Array, floors: Sequence[float], height: float) -> float:
    """Pixels per metre at which the highest of some poses fits."""
    highest = float((motion.state.p_world_joint[frames, :, 2].max(axis=1) - floors).max())
    return (height - FOOT_ROOM_PX) / float(np.clip(highest + HEADROOM_M, *BODY_HEIGHTS))


def _view(motion: Motion, frame: int, floor: float, x: float, height: float, scale: float) -> View:
    """View of a pose whose feet stand at x near the lower edge."""
    state = motion.state
    facing = float(yaw_of(state.R_world_bone[frame, 0] @ R_WORLD_STANDING.T))
    foot = np.append(state.p_world_joint[frame, 0, :2], floor)
    return view_from(facing + VIEW_YAW, VIEW_PITCH, (x, height - FOOT_ROOM_PX), scale, foot)


def _draw_floor(axes: Axes, view: View) -> None:
    """Draw a soft spot below the feet, so that they stand on something."""
    for metres in np.linspace(0.26, 0.66, 9):
        size = metres * view.scale, metres * view.scale * 2 * np.sin(VIEW_PITCH)
        axes.add_patch(Ellipse(view.pixel, *size, color=INK, alpha=0.02, lw=0, zorder=0))


def _scene_curves(drawn: DrawnScene) -> tuple[list[Curve], str]:
    """Joint errors of the wearers whose truth is known, else reprojection errors; and a label."""
    camera, detections, _ = drawn.films()[0]
    label = "joint error, mm (mean)"
    errors = [(wearer, wearer.error_mm, wearer.shown.time) for wearer in drawn.wearers if wearer.shown is not None]
    if drawn.estimate is not None and all(values is None for _, values, _ in errors):
        label = "reprojection error, px (mean)"
        errors = [(wearer, camera.reprojection_px(wearer), detections.time) for wearer in drawn.wearers]
    curves = [
        Curve(wearer.name, time, values, hexadecimal(wearer_colour(wearer.index)))
        for wearer, values, time in errors
        if values is not None
    ]
    return curves, label


def _pictures(drawn: DrawnScene, chosen: np.ndarray, size: tuple[int, int]) -> Iterator[np.ndarray]:
    """The part of each frame where people are, not less than half of it, ``(H, W, 3)`` red green blue, as in a film."""
    camera, detections, _ = drawn.films()[0]
    image_size, low, high = np.array([camera.model.width, camera.model.height], float), np.zeros(2), np.full(2, np.inf)
    pixels = detections.pixels[np.isin(detections.frame, chosen)]
    pixels = pixels[np.isfinite(pixels).all(axis=2)]
    if len(pixels):
        low, high = pixels.min(axis=0), pixels.max(axis=0)
    low, high = np.clip(low, 0, image_size), np.clip(high, 0, image_size)
    share = float(np.clip(AROUND * np.max((high - low) / image_size), 0.5, 1.0))
    corner = np.clip((low + high) / 2 - share * image_size / 2, 0, (1 - share) * image_size)
    enlarged = np.round(np.array(size) / share).astype(int)
    x, y = np.minimum(np.round(corner * enlarged / image_size).astype(int), enlarged - size).tolist()
    width, height = enlarged.tolist()
    for picture in overlaid_frames(drawn, chosen, (FINER * width, FINER * height), names=False):
        smaller = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
        yield smaller[y : y + size[1], x : x + size[0]]
