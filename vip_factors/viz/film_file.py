"""Films into files, and their settings: H.264 in MP4 that browsers and phones play, or animated WebP and GIF."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vip_factors.atomic import atomic_path
from vip_factors.errors import InputError
from vip_factors.ranges import Rate

SUFFIXES = (".mp4", ".webp", ".gif")
H264 = {"crf": "20", "preset": "veryfast"}  # no loss to be seen on a screen; drawing takes longer than this
WEBP_QUALITY = 84  # below, soft shadows leave blocks behind
INSTALL = "pip install 'vip-factors[film]'"


class FilmFile(Protocol):
    """Takes pictures one by one."""

    def add(self, picture: np.ndarray) -> None:
        """One more ``(H, W, 3)`` uint8, red green blue, all of one size."""


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
def film_file(path: Path, rate: float, overwrite: bool) -> Iterator[FilmFile]:
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


@dataclass(frozen=True)
class FilmSettings:
    """Of films (--video)."""

    video_height: int = 720
    """Height in pixels; the width follows. Small films for pages: 360 to 480."""
    video_rate: Rate = 30.0
    """Most frames per second: of a faster video every second or third frame is shown. 15 makes animated pictures
    (.gif, .webp) half as large."""
    video_seconds: tuple[float, float] | None = None
    """First and last second of the recording to show; all of it if not given."""
    video_opacity: float = 0.72
    """Of the bodies over the camera's picture: the person under them has to be seen."""
    headings: Path | None = None
    """Live estimate of the same recording (vip-factors stream RECORDING --out …): how its headings settle is drawn
    beside the room."""

    def __post_init__(self) -> None:
        if not 64 <= self.video_height <= 2160:
            raise InputError(f"film of {self.video_height} pixels' height: expected 64 to 2160")
        if not 0 < self.video_rate <= 120:
            raise InputError(f"film of {self.video_rate} frames per second: expected more than 0, at most 120")
        if self.video_seconds is not None and not self.video_seconds[0] < self.video_seconds[1]:
            raise InputError(
                f"film from second {self.video_seconds[0]} to {self.video_seconds[1]}: expected a later end"
            )
        if not 0 < self.video_opacity <= 1:
            raise InputError(f"opacity {self.video_opacity}: expected more than 0, at most 1")
