"""The flat boards that cameras are calibrated with, and finding their corners in an image."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

LEAST_CORNERS = 3  # a side, in both directions: fewer make no board that can be told from a window
LEAST_SEEN = 8  # corners of a ChArUco board in an image: four fix a homography, the rest guard it
# A detector that may find boards of any size finds the least that it may, in noise; and of a blurred board a part.
HINT_CORNERS = 4  # a side, and more on the other
HINT_AGREEING = 2  # images that show the same size
HINT_IMAGES = 6  # looked at once more, slowly, when no board was found


@dataclass(frozen=True)
class BoardView:
    """Corners of a board in one image.

    Attributes:
        name: of the image, for people.
        points_board: ``(n, 3)`` metres in the board's frame (x along its columns, y along its rows, z = 0).
        pixels: ``(n, 2)``.
        outline: ``(4, 2)`` pixels of the outermost corners, also those that are hidden.
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
        _check_size("checkerboard", self.columns, self.rows, LEAST_CORNERS, "inner corners", self.square_m)
        if max(self.columns, self.rows) == LEAST_CORNERS:  # any cross of two bars is found to be one
            raise InputError(
                f"checkerboard of {self.columns} x {self.rows} inner corners: expected at least "
                f"{LEAST_CORNERS + 1} x {LEAST_CORNERS}; anything in an image looks like less"
            )

    @property
    def text(self) -> str:
        """What kind of board it is, with its size, in words."""
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
        return _view(name, grey, points, pixels, points[_outer(self.columns, self.rows)])

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

    def hint(self, greys: Sequence[np.ndarray]) -> str:
        """What was seen instead, in images where the board was not found; empty if nothing."""
        import cv2

        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
        seen: Counter[tuple[int, int]] = Counter()
        for grey in greys[:HINT_IMAGES]:
            found, _, meta = cv2.findChessboardCornersSBWithMeta(grey, (HINT_CORNERS, HINT_CORNERS), flags)
            if found and max(meta.shape) > HINT_CORNERS:
                seen[max(meta.shape), min(meta.shape)] += 1
        own = (max(self.columns, self.rows), min(self.columns, self.rows))
        return _size_hint(seen, own, one_image=len(greys) == 1)


@dataclass(frozen=True)
class Charuco:
    """A checkerboard with ArUco markers in its white squares; it may be partly hidden.

    Attributes:
        columns, rows: numbers of squares.
        dictionary: OpenCV's name of the markers, such as ``DICT_5X5_100``.
        square_m: side of a square in metres.
        marker_share: side of a marker over that of a square.
    """

    columns: int
    rows: int
    dictionary: str = "DICT_5X5_100"
    square_m: float = 1.0
    marker_share: float = 0.75

    def __post_init__(self) -> None:
        _check_size("ChArUco board", self.columns, self.rows, LEAST_CORNERS + 1, "squares", self.square_m)
        if not 0 < self.marker_share < 1:
            raise InputError(f"ChArUco markers of {self.marker_share:g} of a square: expected a share between 0 and 1")
        if self.dictionary not in _dictionaries():
            raise InputError(
                f"unknown marker dictionary '{self.dictionary}': expected one of {', '.join(_dictionaries())}"
            )

    @property
    def text(self) -> str:
        """What kind of board it is, with its size, in words."""
        return f"ChArUco board of {self.columns} x {self.rows} squares, {self.dictionary}"

    @property
    def looks_alike_turned(self) -> bool:
        """Its markers tell one end from the other."""
        return False

    def board(self) -> Any:
        """The same board as OpenCV has it."""
        import cv2

        markers = cv2.aruco.getPredefinedDictionary(_dictionaries()[self.dictionary])
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_share * self.square_m, markers)

    def find(self, name: str, grey: np.ndarray) -> BoardView | None:
        """Its corners in an image ``(height, width)`` of bytes, or None."""
        import cv2

        board = self.board()
        pixels, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        if ids is None or len(ids) < LEAST_SEEN:
            return None
        every = np.array(board.getChessboardCorners(), dtype=float)
        points = every[ids.ravel()]
        if np.linalg.matrix_rank(points - points.mean(axis=0), tol=0.1 * self.square_m) < 2:
            return None  # all in one row
        return _view(
            name, grey, points, pixels.reshape(-1, 2).astype(float), every[_outer(self.columns - 1, self.rows - 1)]
        )

    def hint(self, greys: Sequence[np.ndarray]) -> str:
        """What was seen instead, in images where the board was not found; empty if nothing."""
        import cv2

        def seen(name: str) -> int:
            """Markers of a dictionary in the image where most are."""
            detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(_dictionaries()[name]))
            found = [detector.detectMarkers(grey)[1] for grey in greys[:HINT_IMAGES]]
            return max((len(set(ids.ravel().tolist())) for ids in found if ids is not None), default=0)

        own = seen(self.dictionary)
        if own >= LEAST_CORNERS:
            return f"; {own} of its markers were seen: check the numbers of squares, columns first"
        count, best = max((seen(name), -index, name) for index, name in enumerate(_dictionaries()))[::2]
        return f"; {count} markers of {best} were seen: give that dictionary" if count >= LEAST_CORNERS else ""


Board = Checkerboard | Charuco


def _size_hint(seen: Counter[tuple[int, int]], own: tuple[int, int], one_image: bool) -> str:
    """A size that several images agree on, of ``(columns, rows)`` seen, as a sentence; nothing of a chance find."""
    seen.pop(own, None)
    count, _, size = max(((count, size[0] * size[1], size) for size, count in seen.items()), default=(0, 0, own))
    if count < (1 if one_image else HINT_AGREEING):
        return ""
    columns, rows = size
    if columns <= own[0] and rows <= own[1]:
        return f"; {columns} x {rows} inner corners were seen: show the whole board, or give that if it is all of it"
    return f"; a board of {columns} x {rows} inner corners was seen: give that, or check the board"


def _dictionaries() -> dict[str, int]:
    """OpenCV's marker dictionaries, small ones first: a larger one of the same kind contains the smaller."""
    import cv2

    names = [name for name in dir(cv2.aruco) if name.startswith("DICT_") and name[5].isdigit()]
    return {name: getattr(cv2.aruco, name) for name in sorted(names, key=lambda name: getattr(cv2.aruco, name))}


def _check_size(kind: str, columns: int, rows: int, least: int, what: str, square_m: float) -> None:
    if columns < least or rows < least:
        raise InputError(f"{kind} of {columns} x {rows} {what}: expected at least {least} each way")
    if not (np.isfinite(square_m) and square_m > 0):
        raise InputError(f"{kind} with squares of {square_m} m: expected metres above 0")


def _grid(columns: int, rows: int, square_m: float) -> Array:
    y, x = np.mgrid[:rows, :columns]
    return square_m * np.stack([x.ravel(), y.ravel(), np.zeros(columns * rows)], axis=1)


def _outer(columns: int, rows: int) -> list[int]:
    """Which of the corners are the outermost, in order around the board."""
    return [0, columns - 1, columns * rows - 1, columns * (rows - 1)]


def _view(name: str, grey: np.ndarray, points: Array, pixels: Array, outer: Array) -> BoardView:
    import cv2

    H, _ = cv2.findHomography(points[:, :2], pixels)
    outline = cv2.perspectiveTransform(outer[None, :, :2], H)[0]
    return BoardView(name, points, pixels, outline, _sharpness(grey, pixels))


def _sharpness(grey: np.ndarray, pixels: Array) -> float:
    """Energy of the second derivative over that of the image, where the board is."""
    import cv2

    (left, top), (right, bottom) = np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int)
    there = grey[max(top, 0) : bottom + 1, max(left, 0) : right + 1]
    return float(cv2.Laplacian(there, cv2.CV_64F).var() / max(float(there.var()), 1.0))
