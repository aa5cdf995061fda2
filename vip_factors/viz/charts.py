"""Drawings by Matplotlib, on pages measured in pixels: curves over time, shaded bodies, and files.

Its import takes some tenths of a second: whoever draws imports it late.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import TriMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from vip_factors.atomic import atomic_path
from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import Colour, Side, side_of
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, rotation_x, rotation_z
from vip_factors.sensors.calibration import SensorSite

INK, SOFT_INK, GRID, ERROR = "#282e3a", "#66707e", "#e4e7ec", "#c44854"
WIDTH, MARGIN, TEXT = 1600, 60, 16.0

Box = tuple[float, float, float, float]
"""Left, top, right and bottom in pixels of the page; y goes down."""


@dataclass(frozen=True)
class Curve:
    """Values ``(T,)`` at times ``(T,)`` seconds, gaps where not finite; in the legend if it has a name.

    ``sigma`` ``(T,)`` is drawn as a pale band.
    """

    name: str
    time: Array
    values: Array
    colour: str = ERROR
    sigma: Array | None = None


def page(width: float, height: float) -> Figure:
    """An empty picture of a size in pixels: sizes of text and lines are pixels too."""
    figure = Figure(figsize=(width / 72, height / 72), dpi=72)
    FigureCanvasAgg(figure)
    return figure


def size_of(figure: Figure) -> tuple[float, float]:
    """Width and height in pixels."""
    width, height = figure.get_size_inches() * 72
    return float(width), float(height)


def write(
    figure: Figure, position: tuple[float, float], text: str, size: float = TEXT, colour: str = INK, **options: Any
) -> None:
    """Text from a point on its baseline, in pixels of the page."""
    width, height = size_of(figure)
    figure.text(position[0] / width, 1 - position[1] / height, text, size=size, color=colour, **options)


def panel(figure: Figure, box: Box) -> Axes:
    """Axes without a frame in a part of the page."""
    width, height = size_of(figure)
    left, top, right, bottom = box
    size = max(right - left, 1.0) / width, max(bottom - top, 1.0) / height
    axes = figure.add_axes((left / width, 1 - bottom / height, *size))
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0, labelsize=TEXT, labelcolor=SOFT_INK, pad=7)
    axes.set_axisbelow(True)
    return axes


def canvas(width: float, height: float) -> Axes:
    """Axes without a frame over a whole picture of a size in pixels, in which they measure too; y goes down."""
    axes = page(width, height).add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.set_autoscale_on(False)
    return axes


def save(figure: Figure, path: Path, overwrite: bool = False) -> None:
    """Write a PNG, complete or not at all.

    Raises:
        InputError: if the file exists and must not be overwritten, or is not named ``.png``.
    """
    if Path(path).suffix.lower() != ".png":
        raise InputError(f"{path}: expected a name that ends in .png")
    with atomic_path(Path(path), overwrite) as partial:
        figure.savefig(partial, dpi=72)


def png(figure: Figure) -> bytes:
    """The picture as bytes of a PNG file."""
    file = BytesIO()
    figure.savefig(file, format="png", dpi=72, facecolor=figure.get_facecolor())
    return file.getvalue()


def svg(drawing: Figure | Axes) -> str:
    """The picture, or that which some axes are of, as SVG."""
    figure = drawing if isinstance(drawing, Figure) else drawing.figure
    assert isinstance(figure, Figure), "axes of a part of a figure"
    file = BytesIO()
    svg_dpi = 108  # of what is drawn as pixels within: half as many again as the page has
    # Text stays text, a file stays itself.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "vip_factors"}):
        figure.savefig(file, format="svg", dpi=svg_dpi, metadata=dict.fromkeys(("Date", "Creator", "Type", "Format")))
    return file.getvalue().decode()


def pixels(figure: Figure) -> np.ndarray:
    """The picture ``(height, width, 3)`` uint8, red green blue."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def seconds_axis(axes: Axes, start: float, end: float, max_ticks: int = 10) -> None:
    """Label x with seconds at round steps."""
    axes.set_xlim(start, max(end, start + 1e-9))
    axes.xaxis.set_major_locator(MaxNLocator(max_ticks, steps=[1, 2, 2.5, 5, 10]))
    axes.xaxis.set_major_formatter(lambda value, _: f"{abs(value) if abs(value) < 1e-9 else value:g} s")


def known_curves(curves: Sequence[Curve]) -> list[Curve]:
    """The curves that have a finite value."""
    return [curve for curve in curves if np.any(np.isfinite(curve.values))]


def plot_curves(
    axes: Axes,
    curves: Sequence[Curve],
    *,
    unit: str = "",
    from_zero: bool = True,
    usual: float = 0.995,
    seconds: int = 10,
    width: float = 2.2,
) -> None:
    """Draw curves over seconds on one scale, each with its band; the bands are of few points.

    Args:
        axes: where to.
        curves: with finite values.
        unit: of the values, written after them.
        from_zero: whether the scale begins at zero, if no value is less.
        usual: share of the values within the scale: a single wild frame must not flatten all others.
        seconds: labels of the time axis at most.
        width: of lines, in pixels.
    """
    low = min(float(np.nanquantile(curve.values, 1 - usual)) for curve in curves)
    high = max(float(np.nanquantile(curve.values, usual)) for curve in curves)
    ticks = np.asarray(
        MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(min(low, 0.0) if from_zero else low, max(high, low + 1e-9))
    )
    axes.set_ylim(ticks[0], ticks[-1])
    axes.set_yticks(ticks, [f"{0.0 if abs(tick) < 1e-9 else tick:g}{unit}" for tick in ticks])
    axes.grid(axis="y", color=GRID, linewidth=width / 2)
    start, end = min(float(curve.time[0]) for curve in curves), max(float(curve.time[-1]) for curve in curves)
    seconds_axis(axes, start, end, seconds)
    for curve in curves:
        axes.plot(*thinned(curve.time, curve.values), color=curve.colour, linewidth=width)
        if curve.sigma is not None:
            every = slice(None, None, max(1, len(curve.time) // BINS))
            band = (curve.values - curve.sigma)[every], (curve.values + curve.sigma)[every]
            axes.fill_between(curve.time[every], *band, color=curve.colour, alpha=0.16, linewidth=0)


BINS = 320  # of time: of each the least and the largest value are drawn, so that no peak is lost


def thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """Indices of the least and the largest sample in each of :data:`BINS` intervals, in the order of time."""
    if len(time) <= 2 * BINS:
        return time, values
    edges = np.linspace(0, len(time), BINS + 1).astype(int)
    indices = []
    for start, stop in itertools.pairwise(edges):
        interval, is_known = values[start:stop], np.isfinite(values[start:stop])
        shown = {int(np.argmin(interval)), int(np.argmax(interval))}
        if not is_known.all():  # a gap, if only of a frame, is to be seen
            shown = {*np.flatnonzero(is_known)[:1].tolist(), int(np.argmin(is_known))}
        indices += [start + index for index in sorted(shown)]
    chosen = np.array(indices, int)
    return time[chosen], values[chosen]


def draw_curves(axes: Axes, curves: Sequence[Curve], label: str, marks: Sequence[float] = ()) -> None:
    """Draw curves from zero up under a label.

    A curve alone is filled below, and ``marks`` (seconds) are dots on it; several are lines, and marks cross them. Each
    name is followed by the curve's mean, for that is the number people quote.
    """
    if not (curves := known_curves(curves)):
        return
    plot_curves(axes, curves)
    if len(curves) == 1:
        curve, good = curves[0], np.isfinite(curves[0].values)
        axes.fill_between(curve.time, 0, curve.values, color=curve.colour, alpha=0.12, linewidth=0)
        heights = np.interp(marks, curve.time[good], curve.values[good])
        axes.plot(marks, heights, "o", color=curve.colour, markersize=9, markeredgecolor="white", clip_on=False)
    else:
        axes.vlines(marks, *axes.get_ylim(), color="#cdd2da", linewidth=1.6, zorder=0)
    axes.set_title(label, loc="left", size=TEXT, color=SOFT_INK, pad=10)
    named = [curve for curve in curves if curve.name]
    if named:
        axes.legend(
            [Line2D([], [], color=curve.colour, linewidth=4) for curve in named],
            [f"{curve.name}  {np.nanmean(curve.values):.3g}" for curve in named],
            loc="lower right",
            bbox_to_anchor=(1, 1),
            ncols=len(named),
            frameon=False,
            prop={"size": TEXT, "weight": "bold"},
            labelcolor="linecolor",
            borderaxespad=0.2,
        )


R_FRONT_WORLD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])  # a view along −x
LIGHT = np.array([-0.42, -0.76, -0.50])  # unit, from the upper left, before the page
AMBIENT, DIFFUSE, GLOSS = 0.64, 0.44, 0.16  # shares of light, chosen by eye
SENSOR = "#2c3038"
FACING = -0.25  # of a sensor's axis out of the skin along the look: nearer to 0 it is seen from its edge


@dataclass(frozen=True)
class View:
    """Parallel projection of the world onto a page.

    Attributes:
        R_page_world: ``(3, 3)``; the page's x points right, y down, z away from who looks.
        scale: pixels per metre.
        pixel: where on the page ``p_world`` is seen.
        p_world: ``(3,)`` metres.
    """

    R_page_world: Array
    scale: float
    pixel: tuple[float, float]
    p_world: Array

    def project(self, p_world: Array) -> Array:
        """Pixels ``(..., 2)`` of points ``(..., 3)``."""
        return np.asarray(self.pixel) + self.scale * ((p_world - self.p_world) @ self.R_page_world.T)[..., :2]

    def depth(self, p_world: Array) -> Array:
        """Depths ``(...)`` in metres of points ``(..., 3)`` behind ``p_world``."""
        return (p_world - self.p_world) @ self.R_page_world[2]


def view_from(
    yaw: float, pitch: float, pixel: tuple[float, float], scale: float, p_world: Sequence[float] | Array = (0, 0, 0)
) -> View:
    """View of a point at a pixel, ``scale`` pixels a metre.

    ``yaw`` (rad) 0 sees the front of who faces x, positive from their left; ``pitch`` (rad) is from above.
    """
    return View(rotation_x(pitch) @ R_FRONT_WORLD @ rotation_z(-yaw), scale, pixel, np.asarray(p_world, float))


def draw_body(axes: Axes, motion: Motion, frame: int, view: View, colours: Mapping[Side, Colour]) -> None:
    """Draw the body of a motion at a frame, in the colours of its sides, over what is drawn already.

    The axes measure in pixels, y down.
    """
    mesh = body_mesh(motion.skeleton)
    p_world, normal = mesh.posed(motion.state.R_world_bone[frame], motion.state.p_world_joint[frame])
    pixels = view.project(p_world)
    corners = pixels[mesh.faces]
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    facing = np.flatnonzero(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0] < 0)  # anticlockwise, with y down
    faces = facing[np.argsort(-view.depth(p_world)[mesh.faces[facing]].mean(axis=1))]
    light = np.clip(normal @ view.R_page_world.T @ LIGHT, 0, 1)[:, None]
    by_bone = np.array([colours[side_of(bone)] for bone in range(JOINT_COUNT)]) / 255
    skin = TriMesh(Triangulation(pixels[:, 0], pixels[:, 1], mesh.faces[faces]), rasterized=True, zorder=1)
    skin.set_facecolor(np.clip((mesh.weights @ by_bone) * (AMBIENT + DIFFUSE * light) + GLOSS * light**6, 0, 1))
    axes.add_collection(skin, autolim=False)


def draw_sensors(axes: Axes, motion: Motion, frame: int, view: View, sites: Iterable[SensorSite]) -> None:
    """Draw the sensors at their sites whose outer side faces the page's reader, as dark squares."""
    R_world_bone, p_world_joint = motion.state.R_world_bone[frame], motion.state.p_world_joint[frame]
    for site in sites:
        R, p = R_world_bone[site.bone_index], p_world_joint[site.bone_index]
        if view.R_page_world[2] @ R @ site.R_bone_sensor[:, 2] < FACING:
            axes.plot(*view.project(p + R @ site.p_bone_sensor), "s", color=SENSOR, markersize=10, mew=0, zorder=1)
