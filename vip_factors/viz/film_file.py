"""Films into files: H.264 in MP4 that browsers and phones play, or animated WebP and GIF."""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vip_factors.atomic import atomic_path
from vip_factors.errors import InputError

SUFFIXES = (".mp4", ".webp", ".gif")
# No loss to be seen on a screen, and drawing takes longer than this; g: whole pictures are near for who jumps in time.
H264 = {"crf": "20", "preset": "veryfast", "g": "30"}
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
