"""The checkerboard that cameras are calibrated with, and finding its corners in an image."""

from dataclasses import dataclass

import numpy as np

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

LEAST_CORNERS = 3  # a side, in both directions: fewer make no board that can be told from a window


@dataclass(frozen=True)
class BoardView:
    """Corners of a board in one image.

    Attributes:
        name: of the image, for people.
        points_board: ``(n, 3)`` metres in the board's frame (x along its columns, y along its rows, z = 0).
        pixels: ``(n, 2)``.
        outline: ``(4, 2)`` pixels of the outermost corners, in order around the board.
        sharpness: larger is sharper; comparable between images of the same board.
    """

    name: str
    points_board: Array
    pixels: Array
    outline: Array
    sharpness: float


@dataclass(frozen=True)
class Checkerboard:
    """Black and white squares.

    Attributes:
        columns, rows: numbers of *inner* corners: one less than squares.
        square_m: side of a square in metres.
    """

    columns: int
    rows: int
    square_m: float = 1.0

    def __post_init__(self) -> None:
        sides = sorted((self.columns, self.rows))
        if sides[0] < LEAST_CORNERS or sides[1] <= LEAST_CORNERS:  # any cross of two bars is found to be 3 x 3
            raise InputError(
                f"{self.text}: expected at least {LEAST_CORNERS + 1} x {LEAST_CORNERS}; anything in an image looks "
                "like less"
            )
        if not (np.isfinite(self.square_m) and self.square_m > 0):
            raise InputError(f"checkerboard with squares of {self.square_m} m: expected metres above 0")

    @property
    def text(self) -> str:
        """The board with its size, in words."""
        return f"checkerboard of {self.columns} x {self.rows} inner corners"

    def find(self, name: str, grey: np.ndarray) -> BoardView | None:
        """Its corners in an image ``(height, width)`` of bytes, or None."""
        import cv2

        # The sector-based detector (Duda & Frese 2018): subpixel by itself, and certain about what is no board.
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        found, corners = cv2.findChessboardCornersSB(grey, (self.columns, self.rows), flags=flags)
        if not found:
            return None
        points, pixels = _grid(self.columns, self.rows, self.square_m), corners.reshape(-1, 2).astype(float)
        if not self.looks_alike_turned and self._begins_white(grey, points, pixels):
            pixels = pixels[::-1]
        outer = [0, self.columns - 1, len(points) - 1, len(points) - self.columns]
        return BoardView(name, points, pixels, pixels[outer], _sharpness(grey, pixels))

    @property
    def looks_alike_turned(self) -> bool:
        """Whether half a turn leaves the board as it is: then two cameras may take different corners for its origin."""
        return (self.columns + self.rows) % 2 == 0

    def _begins_white(self, grey: np.ndarray, points: Array, pixels: Array) -> bool:
        """Whether the square before the first corner is white: corners are counted from where it is black."""
        import cv2

        H, _ = cv2.findHomography(points[:, :2], pixels)
        squares = _grid(self.columns - 1, self.rows - 1, 1.0)[:, :2]
        u, v = np.rint(cv2.perspectiveTransform(self.square_m * (squares[None] + 0.5), H)[0]).astype(int).T
        shades, even = grey[v, u].astype(float), squares.sum(axis=1) % 2 == 0
        return bool(shades[even].mean() > shades[~even].mean())


def _grid(columns: int, rows: int, square_m: float) -> Array:
    y, x = np.mgrid[:rows, :columns]
    return square_m * np.stack([x.ravel(), y.ravel(), np.zeros(columns * rows)], axis=1)


def _sharpness(grey: np.ndarray, pixels: Array) -> float:
    """Energy of the second derivative over that of the image, where the board is."""
    import cv2

    (left, top), (right, bottom) = np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int)
    there = grey[max(top, 0) : bottom + 1, max(left, 0) : right + 1]
    return float(cv2.Laplacian(there, cv2.CV_64F).var() / max(float(there.var()), 1.0))
