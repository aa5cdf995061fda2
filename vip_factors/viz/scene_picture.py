"""A picture of a scene for a page: what the camera saw, detections and projected bodies over it, errors below."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from vip_factors.body.mannequin import Colour
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.scene import Scene
from vip_factors.viz.canvas import Canvas, mixed
from vip_factors.viz.curves_chart import Curve, draw_curves
from vip_factors.viz.drawn_scene import DrawnScene, drawn_scene
from vip_factors.viz.figure import figure_of
from vip_factors.viz.film_panes import CameraPane
from vip_factors.viz.images import limb_pairs, video_frames
from vip_factors.viz.wearer_colours import STRANGER_COLOUR, UNCLAIMED, wearer_colour

INK, SOFT_INK, WHITE, BLACK = (40, 46, 58), (120, 128, 140), (255, 255, 255), (0, 0, 0)
PLANE: Colour = (34, 38, 45)  # of a frame whose picture is not there
WIDTH, MARGIN, GAP, HEADER = 1600, 60, 20, 130
COLUMNS, CHART_HEIGHT = 3, 240
OPACITY = 0.72  # of the bodies over the frames
ROOM = 1.25  # around the people shown
Window = tuple[tuple[float, float], float]
"""Upper left corner of the part of the image that is shown, in pixels, and the share of its width and height."""


def scene_filmstrip(
    scene: Scene,
    estimate: Estimate | None,
    path: Path,
    *,
    frames: int = 6,
    title: str | None = None,
    overwrite: bool = False,
) -> None:
    """Draw a PNG: frames of the video, three in a row, with joint (else reprojection) errors over time below.

    Args:
        scene: with a camera.
        estimate: its bodies are laid over the frames in their wearers' colours; without it the truth's are.
        path: of the PNG.
        frames: how many, evenly over the time.
        title: above the picture; name and method if None.
        overwrite: replace an existing file.

    Raises:
        InputError: if the scene has no camera, or one without frames, or the file exists.
    """
    drawn = drawn_scene(scene, estimate)
    if drawn.detections is None or drawn.model is None:
        raise InputError(f"scene '{scene.name}' has no camera: expected one to draw what it saw")
    count = len(drawn.detections.time)
    if not count:
        raise InputError(f"scene '{drawn.name}': its camera has no video frames to draw: was its file cut off?")
    chosen = np.unique(np.round(np.linspace(0.04, 0.96, frames) * (count - 1)).astype(int))
    curves, label = _curves(drawn)
    columns = min(COLUMNS, len(chosen))
    rows = -(-len(chosen) // columns)
    cell = (WIDTH - 2 * MARGIN - (columns - 1) * GAP) // columns
    height = round(cell * drawn.model.height / drawn.model.width)
    strip = rows * (height + GAP)
    canvas = Canvas(WIDTH, HEADER + strip + (CHART_HEIGHT + 60 if curves else 10))
    if title is None:
        title = f"{drawn.name}, {estimate.method}" if estimate is not None else drawn.name
    _header(canvas, drawn, title)
    _strip(canvas, drawn, chosen, (cell, height), columns)
    if curves:
        top = HEADER + strip
        box = (MARGIN + 40, top + 50, WIDTH - MARGIN, top + CHART_HEIGHT)
        draw_curves(canvas, box, curves, label, drawn.detections.time[chosen])
    canvas.save(path, overwrite)


def _curves(drawn: DrawnScene) -> tuple[list[Curve], str]:
    errors = [(wearer, wearer.error_mm, wearer.motion) for wearer in drawn.wearers]
    joint = [
        Curve(wearer.name, motion.time, error, wearer_colour(wearer.index))
        for wearer, error, motion in errors
        if error is not None and motion is not None
    ]
    if joint or drawn.estimate is None:
        return joint, "joint error, mm (mean)"
    assert drawn.detections is not None
    pixels = [(wearer, drawn.reprojection_px(wearer)) for wearer in drawn.wearers]
    time = drawn.detections.time
    found = [Curve(w.name, time, one, wearer_colour(w.index)) for w, one in pixels if one is not None]
    return found, "reprojection error, px (mean)"


def _header(canvas: Canvas, drawn: DrawnScene, title: str) -> None:
    assert drawn.detections is not None
    assert drawn.labels is not None
    canvas.text((MARGIN, 62), title, INK, 30, 600)
    time = drawn.detections.time
    parts = [f"{time[-1] - time[0]:.1f} s", f"{len(drawn.detections)} people detected"]
    parts.append(f"{int(np.sum(drawn.labels >= 0))} given to wearers")
    canvas.text((MARGIN, 98), "   ·   ".join(parts), SOFT_INK, 20)
    entries = [(w.name, wearer_colour(w.index)) for w in drawn.wearers]
    if np.any(drawn.labels < 0):
        entries.append(("nobody's", STRANGER_COLOUR))
    x = WIDTH - MARGIN - sum(canvas.text_width(name, 20) + 58 for name, _ in entries) + 24
    for name, colour in entries:
        canvas.curve([[x, 55], [x + 22, 55]], colour, 7.0)
        x = canvas.text((x + 34, 62), name, SOFT_INK, 20) + 24


def _strip(canvas: Canvas, drawn: DrawnScene, chosen: np.ndarray, size: tuple[int, int], columns: int) -> None:
    assert drawn.detections is not None
    pictures = _pictures(drawn, chosen, size)
    for number, (frame, picture) in enumerate(zip(chosen, pictures, strict=True)):
        left = MARGIN + (number % columns) * (size[0] + GAP)
        top = HEADER + (number // columns) * (size[1] + GAP)
        canvas.paste(picture, left, top)
        plate = np.array([[0, -34], [76, -34], [76, 0], [0, 0]])
        canvas.polygon(np.array([left, top + size[1]]) + plate, PLANE)
        canvas.text((left + 12, top + size[1] - 12), f"{drawn.detections.time[frame]:.1f} s", (235, 238, 242), 17)


def frame_picture(drawn: DrawnScene, frame: int, size: tuple[int, int]) -> np.ndarray:
    """A frame of the video, near the people in it, with the bodies over it, or what was detected.

    Args:
        drawn: with a camera's model and detections.
        frame: index of the video frame.
        size: width and height in pixels.

    Returns:
        ``(height, width, 3)``, blue green red; dark behind where the video is not there.
    """
    return next(_pictures(drawn, np.array([frame]), size))


def _pictures(drawn: DrawnScene, chosen: np.ndarray, size: tuple[int, int]) -> Iterator[np.ndarray]:
    known = drawn.path is not None and any(wearer.shown is not None for wearer in drawn.wearers)
    return _reconstructed(drawn, chosen, size) if known else _detected_only(drawn, chosen, size)


def _reconstructed(drawn: DrawnScene, chosen: np.ndarray, size: tuple[int, int]) -> Iterator[np.ndarray]:
    """The bodies over the frames, as in a film."""
    assert drawn.detections is not None
    corner, share = _window(drawn, chosen)
    assert drawn.model is not None
    whole = (round(size[0] / share), round(size[1] / share))
    figures = [figure for figure in map(figure_of, drawn.wearers) if figure is not None]
    left, top = (round(at * whole[0] / drawn.model.width) for at in corner)
    left, top = min(left, whole[0] - size[0]), min(top, whole[1] - size[1])
    pane = CameraPane(drawn, figures, drawn.detections.time[chosen], chosen, whole, OPACITY, coarse=False)
    for number in range(len(chosen)):
        yield pane.draw(number)[top : top + size[1], left : left + size[0], ::-1]


def _detected_only(drawn: DrawnScene, chosen: np.ndarray, size: tuple[int, int]) -> Iterator[np.ndarray]:
    """Where the camera was is not known: what the detector found, over the frames or a dark plane."""
    assert drawn.model is not None
    window = _window(drawn, chosen)
    pictures = video_frames(drawn.video, (int(frame) for frame in chosen))
    for frame in chosen:
        cell = _Cell(drawn.model, window, size, pictures.get(int(frame)))
        _detected(cell, drawn, int(frame))
        yield cell.canvas.pixels()


def _detected(cell: "_Cell", drawn: DrawnScene, frame: int) -> None:
    assert drawn.detections is not None
    assert drawn.labels is not None
    people, pairs = drawn.detections.of_frame(frame), limb_pairs(drawn.detections.keypoints)
    seen = np.where(drawn.detections.seen[people][..., None], drawn.detections.pixels[people], np.nan)
    for label, pixels in sorted(zip(drawn.labels[people].tolist(), seen, strict=True), key=lambda pair: pair[0]):
        colour = UNCLAIMED if label < 0 else mixed(wearer_colour(label), WHITE, 0.55)
        cell.skeleton(pixels, pairs, colour, 1.5, 2.8)


def _window(drawn: DrawnScene, chosen: np.ndarray) -> Window:
    """What all frames show: the image's part where people are, of the image's proportions, not less than a half."""
    assert drawn.detections is not None
    assert drawn.model is not None
    found = drawn.detections.pixels[np.isin(drawn.detections.frame, chosen)]
    found = found[np.isfinite(found).all(axis=2)]
    whole = np.array([drawn.model.width, drawn.model.height], dtype=float)
    if not len(found):
        return (0.0, 0.0), 1.0
    low, high = np.clip(found.min(axis=0), 0, whole), np.clip(found.max(axis=0), 0, whole)
    share = float(np.clip(ROOM * np.max((high - low) / whole), 0.5, 1.0))
    corner = np.clip((low + high) / 2 - share * whole / 2, 0, (1 - share) * whole)
    return (float(corner[0]), float(corner[1])), share


class _Cell:
    """One frame: its picture (or a dark plane), and skeletons over it, in the camera's pixels."""

    def __init__(self, model: CameraModel, window: Window, size: tuple[int, int], picture: np.ndarray | None) -> None:
        self.canvas = Canvas(*size)
        self._corner, share = np.array(window[0]), window[1]
        self._scale = np.array(size) / (share * np.array([model.width, model.height]))
        if picture is None:
            self.canvas.polygon([[0, 0], [size[0], 0], size, [0, size[1]]], PLANE)
            return
        # Pictures may be embedded smaller than the camera's image.
        by = np.array([picture.shape[1] / model.width, picture.shape[0] / model.height])
        x, y = np.round(self._corner * by).astype(int)
        w, h = np.round(share * np.array([model.width, model.height]) * by).astype(int)
        small = cv2.resize(picture[y : y + h, x : x + w], size, interpolation=cv2.INTER_AREA)
        # Darkened a little, so that coloured lines stand out on a bright day.
        self.canvas.paste((0.8 * small).astype(np.uint8), 0, 0)

    def skeleton(self, pixels: Array, pairs: np.ndarray, colour: Colour, line: float, dot: float) -> None:
        """Limbs ``pairs`` ``(L, 2)`` between keypoints ``pixels`` ``(K, 2)`` (NaN if missing), then the keypoints."""
        at = (pixels - self._corner) * self._scale
        at = np.where(np.abs(at) < 1e4, at, np.nan)  # near the image plane of the camera, points shoot off
        for pair in at[pairs]:
            if np.isfinite(pair).all():
                self.canvas.curve(pair, colour, line)
        for point in at[np.isfinite(at).all(axis=1)] if dot > 0 else ():
            self.canvas.ellipse(point, dot, dot, colour)
