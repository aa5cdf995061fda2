"""Smooth shapes and text on a white picture, with OpenCV: drawn twice as large, then averaged down."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vip_factors.atomic import atomic_path
from vip_factors.body.mannequin import Colour
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

OVERSAMPLING = 3  # on top of OpenCV's own smoothing: thin curves stay even
FRACTION_BITS = 4  # OpenCV takes coordinates in sixteenths of a pixel
RIM_PX = 1.3
LIGHT = np.array([-0.30, -0.42])  # where highlights shift to, in radii: light from the upper left


@dataclass(frozen=True)
class Rod:
    """A tapered rod: ends ``(2,)`` and the radii there, all in pixels."""

    start: Array
    end: Array
    radii: tuple[float, float]


def mixed(colour: Colour, other: Colour, share: float) -> Colour:
    """``share`` of another colour in a colour."""
    red, green, blue = (round((1 - share) * a + share * b) for a, b in zip(colour, other, strict=True))
    return red, green, blue


class Canvas:
    """A white picture of a size in pixels; x goes right, y down, colours are red, green, blue."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._image = np.full((height * OVERSAMPLING, width * OVERSAMPLING, 3), 255, np.uint8)
        # OpenCV 5 brings a real typeface; before it there are only stroke fonts without accents.
        self._font = cv2.FontFace("sans") if hasattr(cv2, "FontFace") else None

    def polygon(self, points: ArrayLike, colour: Colour) -> None:
        """A filled polygon ``(N, 2)``."""
        cv2.fillPoly(self._image, [self._fixed(points)], colour[::-1], cv2.LINE_AA, FRACTION_BITS)

    def curve(self, points: ArrayLike, colour: Colour, width: float) -> None:
        """A line through points ``(N, 2)``."""
        thickness = max(1, round(width * OVERSAMPLING))
        cv2.polylines(self._image, [self._fixed(points)], False, colour[::-1], thickness, cv2.LINE_AA, FRACTION_BITS)

    def limb(self, rods: Sequence[Rod], colour: Colour) -> None:
        """Tapered, round-ended rods as one body, lit from the upper left; a white rim parts it from what is behind."""
        white, black = (255, 255, 255), (0, 0, 0)
        for share, shift, tone in (
            (None, 0.0, white),
            (1.0, 0.0, mixed(colour, black, 0.18)),
            (0.84, 0.25, colour),
            (0.50, 0.85, mixed(colour, white, 0.16)),
        ):
            for rod in rods:
                radii = np.array(rod.radii)
                radii = radii + RIM_PX if share is None else radii * share
                start, end = (p + shift * LIGHT * r for p, r in zip((rod.start, rod.end), radii, strict=True))
                self._rod(start, end, float(radii[0]), float(radii[1]), tone)

    def _rod(self, start: Array, end: Array, radius_start: float, radius_end: float, colour: Colour) -> None:
        angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        outline = np.concatenate([start + radius_start * circle, end + radius_end * circle])
        hull = cv2.convexHull(outline.astype(np.float32))[:, 0]
        cv2.fillConvexPoly(self._image, self._fixed(hull), colour[::-1], cv2.LINE_AA, FRACTION_BITS)

    def ellipse(self, centre: Array, radius_x: float, radius_y: float, colour: Colour) -> None:
        """A filled ellipse with level axes."""
        angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)
        self.polygon(centre + np.stack([radius_x * np.cos(angles), radius_y * np.sin(angles)], axis=1), colour)

    def text(self, at: tuple[float, float], text: str, colour: Colour, size: float, weight: int = 400) -> float:
        """Write from a point on the baseline; returns the x where the text ends."""
        x, y = (round(value * OVERSAMPLING) for value in at)
        if self._font is not None:
            end, _ = cv2.putText(
                self._image, text, (x, y), colour[::-1], self._font, round(size * OVERSAMPLING), weight
            )
            return float(end[0]) / OVERSAMPLING
        plain = text.replace("°", " deg").replace("²", "^2").encode("ascii", "replace").decode()
        scale, thickness = size * OVERSAMPLING / 30, max(1, round(size * OVERSAMPLING * weight / 9000))
        face = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(self._image, plain, (x, y), face, scale, colour[::-1], thickness, cv2.LINE_AA)
        return float(x + cv2.getTextSize(plain, face, scale, thickness)[0][0]) / OVERSAMPLING

    def text_width(self, text: str, size: float, weight: int = 400) -> float:
        """Width in pixels that :meth:`text` takes."""
        probe = Canvas(1, 1)
        return probe.text((0.0, 0.0), text, (0, 0, 0), size, weight)

    def paste(self, picture: np.ndarray, left: int, top: int) -> None:
        """Lay a picture ``(height, width, 3)``, blue green red, on the canvas; what sticks out is cut off."""
        x, y = left * OVERSAMPLING, top * OVERSAMPLING
        room = self._image[y : y + picture.shape[0] * OVERSAMPLING, x : x + picture.shape[1] * OVERSAMPLING]
        large = cv2.resize(picture, None, fx=OVERSAMPLING, fy=OVERSAMPLING, interpolation=cv2.INTER_NEAREST)
        room[:] = large[: room.shape[0], : room.shape[1]]

    def pixels(self) -> np.ndarray:
        """The picture ``(height, width, 3)``, blue green red, as OpenCV has it."""
        return cv2.resize(self._image, (self.width, self.height), interpolation=cv2.INTER_AREA)

    def save(self, path: Path, overwrite: bool = False) -> None:
        """Write a PNG, complete or not at all.

        Raises:
            InputError: if the file exists and must not be overwritten, or is not named ``.png``.
        """
        if Path(path).suffix.lower() != ".png":
            raise InputError(f"{path}: expected a name that ends in .png")
        done, encoded = cv2.imencode(".png", self.pixels(), [cv2.IMWRITE_PNG_COMPRESSION, 6])
        if not done:
            raise InputError(f"{path}: the picture could not be encoded")
        with atomic_path(Path(path), overwrite) as partial:
            partial.write_bytes(encoded.tobytes())

    def _fixed(self, points: ArrayLike) -> np.ndarray:
        # Half a big pixel: OpenCV's pixel centres lie on whole numbers.
        scaled = np.asarray(points, dtype=float) * OVERSAMPLING - 0.5
        return np.round(scaled * (1 << FRACTION_BITS)).astype(np.int32)
