"""A film of an estimate: bodies over the camera's pictures, in a room, and headings as they settle.

Its files are H.264 in MP4 that browsers and phones play, or animated WebP and GIF.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_path
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration
from vip_factors.viz.drawn_scene import DrawnScene
from vip_factors.viz.figure import figure_of
from vip_factors.viz.film_panes import CameraPane, HeadingsPane
from vip_factors.viz.film_settings import FilmSettings
from vip_factors.viz.images import frames_left
from vip_factors.viz.room import RoomPane

SUFFIXES = (".mp4", ".webp", ".gif")
# No loss to be seen on a screen, and drawing takes longer than this; g: whole pictures are near for who jumps in time.
H264 = {"crf": "20", "preset": "veryfast", "g": "30"}
WEBP_QUALITY = 84  # below, soft shadows leave blocks behind
INSTALL = "pip install 'vip-factors[film]'"
NO_CAMERA_RATE = 30.0  # frames per second
LARGEST_ANIMATION = 1 << 30  # bytes of pictures: Pillow wants all of them at once
PAPER = 255  # behind the panes
GAP = 0.012  # between the panes, of the height
Pane = CameraPane | RoomPane | HeadingsPane
Box = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""


def film(
    drawn: DrawnScene,
    path: Path,
    settings: FilmSettings,
    histories: Sequence[tuple[Array, list[Calibration]]] = (),
    *,
    overwrite: bool = False,
    on_progress: Callable[[str, float], None] = lambda stage, fraction: None,
) -> tuple[Array, float]:
    """Draw and write a film.

    Args:
        drawn: the scene, its estimate, or both.
        path: ends in .mp4, .webp or .gif.
        settings: what is shown.
        histories: by wearer, times and calibrations of a live estimate, to be drawn beside the room.
        overwrite: replace an existing file.
        on_progress: called with how much is done.

    Returns:
        Instants ``(T,)`` of its pictures in seconds of the recording, and pictures per second.

    Raises:
        InputError: if there is nothing to show, the name's suffix is none of a film, or a library is missing.
    """
    check_film(path)
    if all(wearer.shown is None for wearer in drawn.wearers):
        raise InputError("no motion for a film: give an estimate, or a recording with its truth")
    if len(histories) and not any(len(times) > 1 for times, _ in histories):
        raise InputError(
            f"{settings.headings}: no headings over time in it: expected a live estimate, as vip-factors stream "
            "RECORDING --out makes"
        )
    times, frames, rate = film_times(drawn, settings)
    width, height, boxes = layout(drawn, settings.video_height, len(histories) > 0)
    if path.suffix.lower() != ".mp4" and len(times) * width * height * 3 > LARGEST_ANIMATION:
        raise InputError(
            f"{path}: an animation of {len(times)} pictures of {width} by {height} is too large to make: expected a "
            "shorter (--video-seconds), slower (--video-rate) or smaller (--video-height) one, or an .mp4"
        )
    figures = [figure for figure in map(figure_of, drawn.wearers) if figure is not None]
    panes: list[tuple[Box, Pane]] = []
    if "room" in boxes:
        panes.append((boxes["room"], RoomPane(figures, times, boxes["room"][2:])))
    if "camera" in boxes:
        opacity = None if settings.video_skeleton else settings.video_opacity
        seen = CameraPane(drawn, figures, times, frames, boxes["camera"][2:], opacity)
        panes.append((boxes["camera"], seen))
    if "headings" in boxes:
        panes.append((boxes["headings"], HeadingsPane(drawn, histories, times, boxes["headings"][2:])))
    picture = np.full((height, width, 3), PAPER, np.uint8)
    with film_file(path, rate, overwrite) as file:
        for index in range(len(times)):
            for (left, top, w, h), pane in panes:
                picture[top : top + h, left : left + w] = pane.draw(index)
            file.add(picture)
            on_progress("drawing the film", (index + 1) / len(times))
        on_progress("writing the film", 0.0)
    return times, rate


def film_times(drawn: DrawnScene, settings: FilmSettings) -> tuple[Array, np.ndarray, float]:
    """Instants ``(T,)`` in seconds, the video's frames then ``(T,)``, and pictures per second.

    Where images of some frames alone are left of the video, those are the frames.

    Raises:
        InputError: if nothing is left of the time.
    """
    motions = [wearer.shown for wearer in drawn.wearers if wearer.shown is not None]
    first, last = min(float(m.time[0]) for m in motions), max(float(m.time[-1]) for m in motions)
    if settings.video_seconds is not None:
        first, last = max(first, settings.video_seconds[0]), min(last, settings.video_seconds[1])
    if drawn.detections is not None and len(drawn.detections.time) > 1 and drawn.path is not None:
        video = drawn.detections.time
        frames = frames_left(drawn.video, len(video))
        rate = (len(frames) - 1) / float(video[frames[-1]] - video[frames[0]])
    else:
        rate = NO_CAMERA_RATE
        video = np.arange(int(np.floor(last * rate)) + 1) / rate
        frames = np.arange(len(video))
    step = max(1, int(np.ceil(rate / settings.video_rate - 0.01)))
    frames = frames[(video[frames] >= first - 1e-6) & (video[frames] <= last + 1e-6)][::step]
    if not len(frames):
        raise InputError(f"nothing to film between {first:.2f} and {last:.2f} s: expected seconds of the recording")
    return video[frames], frames, rate / step


def layout(drawn: DrawnScene, wanted: int, headings: bool) -> tuple[int, int, dict[str, Box]]:
    """Width and height of the film, both even, and a box for each pane."""
    height = wanted // 2 * 2
    gap = max(2, round(GAP * height))
    camera = drawn.model if drawn.path is not None and drawn.detections is not None else None
    if camera is None and not headings:
        width = _even(height * 16 / 9)
        return width, height, {"room": (0, 0, width, height)}
    shape = camera.width / camera.height if camera is not None else 1.0
    if not headings:
        seen, room = _even(height * shape), _even(0.8 * height)
        return seen + gap // 2 * 2 + room, height, {
            "camera": (0, 0, seen, height), "room": (seen + gap // 2 * 2, 0, room, height),
        }  # fmt: skip
    room, side = _even(1.05 * height), _even(0.85 * height)
    left = room + gap // 2 * 2
    boxes = {"room": (0, 0, room, height)}
    top = 0
    if camera is not None:
        tall = min(round(side / shape), round(0.62 * height))
        wide = min(side, round(tall * shape))  # a picture taken upright stands in the middle
        boxes["camera"] = (left + (side - wide) // 2, 0, wide, tall)
        top = tall + gap
    boxes["headings"] = (left, top, side, height - top)
    return left + side, height, boxes


def _even(length: float) -> int:
    return 2 * round(length / 2)


def check_film(path: Path) -> None:
    """Fail before the work, not after it.

    Raises:
        InputError: for a suffix that names no kind of film, or if the library that writes it is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: expected a film's name to end in {', '.join(SUFFIXES)}")
    try:
        if suffix == ".mp4":
            import av  # noqa: F401
        else:
            import PIL.Image  # noqa: F401
    except ImportError as error:
        wanted = "PyAV" if suffix == ".mp4" else "Pillow"
        raise InputError(f"films ({suffix}) need {wanted}, which is not installed: {INSTALL}") from error


@contextmanager
def film_file(path: Path, rate: float, overwrite: bool) -> "Iterator[_Mp4 | _Animation]":
    """A film to add pictures to; it appears when the block ends without an exception.

    Args:
        path: ends in .mp4, .webp or .gif.
        rate: pictures per second.
        overwrite: replace an existing file.

    Raises:
        InputError: as :func:`check_film`, or if the file may not be written.
    """
    check_film(path)
    with atomic_path(path, overwrite) as partial:
        film: _Mp4 | _Animation = _Mp4(partial, rate) if path.suffix.lower() == ".mp4" else _Animation(partial, rate)
        try:
            yield film
        except BaseException:
            film.close(complete=False)
            raise
        film.close(complete=True)


class _Mp4:
    def __init__(self, path: Path, rate: float) -> None:
        import av

        self._av = av
        # The index in front, so that a browser plays it while it loads.
        self._container = av.open(str(path), "w", options={"movflags": "faststart"})
        self._stream = self._container.add_stream("libx264", rate=Fraction(rate).limit_denominator(1001), options=H264)
        self._stream.pix_fmt = "yuv420p"  # phones decode no other
        self._begun = False

    def add(self, picture: np.ndarray) -> None:
        """One more picture ``(H, W, 3)`` uint8, red green blue, all of one size."""
        if not self._begun:
            self._stream.height, self._stream.width = picture.shape[:2]
            self._begun = True
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def close(self, complete: bool) -> None:
        if complete and self._begun:
            self._container.mux(self._stream.encode(None))
        self._container.close()


class _Animation:
    """Pillow writes animations in one go: pictures are kept until the end."""

    def __init__(self, path: Path, rate: float) -> None:
        self._path, self._rate = path, rate
        self._pictures: list[np.ndarray] = []

    def add(self, picture: np.ndarray) -> None:
        self._pictures.append(picture.copy())

    def close(self, complete: bool) -> None:
        if not complete or not self._pictures:
            return
        from PIL import Image

        # Players know whole milliseconds (WebP) or hundredths (GIF) only: each picture ends at its rounded time.
        step = 10 if self._path.suffix.lower() == ".gif" else 1
        ends = np.round(np.arange(len(self._pictures) + 1) * 1000 / self._rate / step) * step
        durations = [int(one) for one in np.diff(ends)]
        images = [Image.fromarray(one) for one in self._pictures]
        if step == 1:
            more: dict[str, Any] = {"quality": WEBP_QUALITY, "method": 4}
        else:
            images = _one_palette(images)
            more = {"optimize": False, "disposal": 1}
        images[0].save(self._path, save_all=True, append_images=images[1:], duration=durations, loop=0, **more)


def _one_palette(images: list[Any]) -> list[Any]:
    """All pictures in the colours of some of them: a palette a picture would flicker."""
    from PIL import Image

    some = images[:: max(1, len(images) // 6)]
    sheet = Image.new("RGB", (some[0].width, some[0].height * len(some)))
    for row, image in enumerate(some):
        sheet.paste(image, (0, row * image.height))
    palette = sheet.quantize(256, method=Image.Quantize.MEDIANCUT)
    return [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
