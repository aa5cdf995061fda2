"""Intrinsics of a camera from views of a flat board (Zhang 2000, by OpenCV), and its pose over the floor.

The images come from a video, evenly spread; the sharpest of those that differ are used. Views that do not fit are left
out, and warnings name what the views do not determine.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.display import ProgressCallback, silent
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.video import iterate_frames, opened_video
from vip_factors.sensors.camera import CameraModel

LEAST_VIEWS = 3  # below, focal lengths and centre are not determined (Zhang 2000, section 3.1)


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
        if sides[0] < 3 or sides[1] < 4:  # any cross of two bars is found to be 3 x 3, any window to be less
            raise InputError(f"{self.text}: expected at least 4 x 3; anything in an image looks like less")
        if not (np.isfinite(self.square_m) and self.square_m > 0):
            raise InputError(f"checkerboard with squares of {self.square_m} m: expected metres above 0")

    @property
    def text(self) -> str:
        """The board with its size, in words."""
        return f"checkerboard of {self.columns} x {self.rows} inner corners"

    def find(self, name: str, grey: np.ndarray) -> BoardView | None:
        """Its corners in an image ``(height, width)`` of bytes, or None."""
        import cv2

        # The sector-based detector (Duda & Frese 2018): subpixel by itself, and without false boards.
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        is_complete, corners = cv2.findChessboardCornersSB(grey, (self.columns, self.rows), flags=flags)
        if not is_complete:
            return None
        points, pixels = _grid(self.columns, self.rows, self.square_m), corners.reshape(-1, 2).astype(float)
        if not self.looks_alike_turned:  # corners are counted from where the square before the first one is black
            H, _ = cv2.findHomography(points[:, :2], pixels)
            squares = _grid(self.columns - 1, self.rows - 1, 1.0)[:, :2]
            u, v = np.rint(cv2.perspectiveTransform(self.square_m * (squares[None] + 0.5), H)[0]).astype(int).T
            shades, even = grey[v, u].astype(float), squares.sum(axis=1) % 2 == 0
            pixels = pixels[::-1] if shades[even].mean() > shades[~even].mean() else pixels
        outer = [0, self.columns - 1, len(points) - 1, len(points) - self.columns]
        x, y = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
        x_end, y_end = np.ceil(pixels.max(axis=0)).astype(int) + 1
        image = grey[y:y_end, x:x_end]
        # Energy of the second derivative over that of the image.
        sharpness = float(cv2.Laplacian(image, cv2.CV_64F).var() / max(float(image.var()), 1.0))
        return BoardView(name, points, pixels, pixels[outer], sharpness)

    @property
    def looks_alike_turned(self) -> bool:
        """Whether half a turn leaves the board as it is: then two cameras may take different corners for its origin."""
        return (self.columns + self.rows) % 2 == 0


def _grid(columns: int, rows: int, square_m: float) -> Array:
    y, x = np.mgrid[:rows, :columns]
    return square_m * np.stack([x.ravel(), y.ravel(), np.zeros(columns * rows)], axis=1)


@dataclass(frozen=True)
class CameraCalibration:
    """Intrinsics with their uncertainty.

    Attributes:
        model: the intrinsics.
        sigma: standard deviations of fx, fy, cx, cy in pixels, ``(4,)``; the distortion's, ``(D,)``.
        rms_px: root mean square reprojection error of all corners used.
        views: names of the used views, with their errors in pixels.
        left_out: names of views that do not fit, with their errors.
        coverage: share of the image that corners reach.
        warnings: sentences about poorly determined quantities.
    """

    model: CameraModel
    sigma: Array
    distortion_sigma: Array
    rms_px: float
    views: tuple[tuple[str, float], ...]
    left_out: tuple[tuple[str, float], ...]
    coverage: float
    warnings: tuple[str, ...]


def find_views(
    source: Path, board: Checkerboard, on_progress: ProgressCallback = silent
) -> tuple[tuple[BoardView, ...], tuple[int, int]]:
    """Find the views of a board in a video, in order, and the images' width and height."""
    import cv2

    with opened_video(source) as capture:
        total = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    # 150 images at most; where a video does not say how many it has, about four a second.
    step = -(-total // 150) if total > 0 else 8
    views: list[BoardView] = []
    looked, size = 0, (0, 0)
    for number, _, image in iterate_frames(source, every=step):
        on_progress("looking for the board", number / total if total > 0 else 0.0)
        looked, size = looked + 1, (image.shape[1], image.shape[0])
        view = board.find(f"frame {number}", cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
        if view is not None:
            views.append(view)
    if not looked:
        raise FileFormatError(f"{source}: OpenCV finds no frame in it: expected a video")
    if not views:
        raise InputError(
            f"{source}: no {board.text} in {looked} images: give one less than the squares on each side, and show the "
            "whole board, with its white border"
        )
    return tuple(views), size


def calibrate(
    views: Sequence[BoardView], size: tuple[int, int], distortion: int = 4, on_progress: ProgressCallback = silent
) -> CameraCalibration:
    """Find intrinsics from views of a board in images of ``size`` (width, height).

    Args:
        views: of the board.
        size: of the images.
        distortion: number of coefficients, 0, 4 (k1 k2 p1 p2), 5 (and k3) or 8 (wide-angle lenses).
        on_progress: called with the stage and the fraction of it that is done.
    """
    chosen = _chosen_views(views, size)
    if len(chosen) < LEAST_VIEWS:
        alike = f", and only {len(chosen)} of them differ" if len(views) >= LEAST_VIEWS else ""
        raise InputError(
            f"{len(views)} view{'s' if len(views) != 1 else ''} of the board{alike}: expected at least {LEAST_VIEWS}, "
            "better twenty, tilted in several directions and in all parts of the image"
        )
    left_out: list[tuple[str, float]] = []
    rounds = 4  # of leaving out views that do not fit
    for number in range(rounds):
        on_progress("fitting the camera", number / rounds)
        fit = _fit(chosen, size, distortion)
        errors = fit[-1]
        # Blur, a bent board, a wrong corner; good corners have errors of a third of a pixel too.
        bad = errors > max(3.0 * np.median(errors), 0.3)
        if not np.any(bad) or np.sum(~bad) < LEAST_VIEWS or number == rounds - 1:
            break
        left_out += [(view.name, float(errors[i])) for i, view in enumerate(chosen) if bad[i]]
        chosen = [view for i, view in enumerate(chosen) if not bad[i]]
    on_progress("fitting the camera", 1.0)
    rms, K, coefficients, turns, sigma, errors = fit
    focal, centre = (float(K[0, 0]), float(K[1, 1])), (float(K[0, 2]), float(K[1, 2]))
    model = CameraModel(*size, focal, centre, tuple(coefficients[:distortion].tolist()))
    pixels = np.concatenate([view.pixels for view in chosen])
    cells, _, _ = np.histogram2d(pixels[:, 0], pixels[:, 1], bins=8, range=[[0, size[0]], [0, size[1]]])
    coverage = float(np.mean(cells > 0))
    named = tuple((view.name, float(error)) for view, error in zip(chosen, errors, strict=True))
    warnings = _warnings(focal, sigma, turns, coverage, len(chosen))
    return CameraCalibration(
        model, sigma[:4], sigma[4 : 4 + distortion], rms, named, tuple(left_out), coverage, warnings
    )


def _chosen_views(views: Sequence[BoardView], size: tuple[int, int]) -> list[BoardView]:
    """Views that differ, the sharper of those alike: farthest first, until all left are near a chosen one.

    Two views of a plane differ as their outlines do. A board that looks the same upside down may be found either way.
    """
    outlines = np.stack([view.outline for view in views]) / np.hypot(*size)
    turned = np.roll(outlines, 2, axis=1)
    sharpness = np.array([view.sharpness for view in views])
    nearest = np.full(len(views), np.inf)
    chosen: list[int] = []
    for _ in range(min(40, len(views))):  # the time of the fit grows with them; beyond some tens nothing is gained
        far = nearest >= 0.03  # mean shift of corners, as a share of the image's diagonal
        if not np.any(far):
            break
        # A blurred view counts as nearer than it is, so that of its neighbours the sharpest comes first.
        worth = np.where(far, np.minimum(nearest, 1.0) * np.sqrt(sharpness), -1.0)
        view = int(np.argmax(worth))
        chosen.append(view)
        for either_way in (outlines, turned):
            nearest = np.minimum(nearest, np.linalg.norm(either_way[view] - outlines, axis=2).mean(axis=1))
    return [views[index] for index in sorted(chosen)]


def floor_pose(view: BoardView, model: CameraModel) -> tuple[Array, Array, float]:
    """The camera over a floor on which the board lies: ``R_floor_camera``, ``p_floor_camera``, and the error in pixels.

    The floor's origin is a corner of the board, its x axis the board's, its z axis up, towards the camera.
    """
    import cv2

    flat = model.normalise(view.pixels)
    # Sorted by error; IPPE (Collins & Bartoli 2014) sees both answers that a plane has.
    _, turns, shifts, _ = cv2.solvePnPGeneric(view.points_board, flat, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    turn, shift = cv2.solvePnPRefineLM(view.points_board, flat, np.eye(3), None, turns[0], shifts[0])
    R_camera_board, p_camera_board = exp(turn.ravel()), shift.ravel()
    error = model.project(view.points_board @ R_camera_board.T + p_camera_board) - view.pixels
    R_board_camera, p_board_camera = R_camera_board.T, -R_camera_board.T @ p_camera_board
    up = 1.0 if p_board_camera[2] > 0 else -1.0
    R_floor_board = np.diag([1.0, up, up])
    return R_floor_board @ R_board_camera, R_floor_board @ p_board_camera, float(np.sqrt((error**2).sum(1).mean()))


def _fit(
    views: Sequence[BoardView], size: tuple[int, int], distortion: int
) -> tuple[float, Array, Array, Array, Array, Array]:
    """RMS, camera matrix, distortion, rotation vectors of the boards, sigmas of the intrinsics, error of each view."""
    import cv2

    flags = {
        0: cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
        4: cv2.CALIB_FIX_K3,
        5: 0,
        8: cv2.CALIB_RATIONAL_MODEL,
    }.get(distortion)
    if flags is None:
        raise InputError(f"{distortion} distortion coefficients: expected 0, 4, 5 or 8")
    points = [view.points_board.astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    rms, *fit = cv2.calibrateCameraExtended(points, pixels, size, np.zeros((3, 3)), np.zeros(8), flags=flags)
    K, coefficients, turns, _, sigma, _, errors = (np.array(result, dtype=float) for result in fit)
    return float(rms), K, coefficients.ravel(), turns.reshape(-1, 3), sigma.ravel(), errors.ravel()


def _warnings(focal: tuple[float, float], sigma: Array, turns: Array, coverage: float, count: int) -> tuple[str, ...]:
    normals = exp(turns)[:, :, 2]  # of the boards, in the camera's frame
    tilt_deg = np.rad2deg(np.arccos(np.clip(np.abs(normals @ normals.T).min(), -1, 1)))
    doubts = []
    if count < 10:
        doubts.append(f"only {count} views that differ: 20 make the result reliable")
    if tilt_deg < 20.0:
        doubts.append(
            f"the board was never tilted by more than {tilt_deg:.0f}° between views: focal length and distance are "
            "confused; tilt it by 30° and more, in several directions"
        )
    relative = max(sigma[0] / focal[0], sigma[1] / focal[1])
    if relative > 0.01:  # 3 cm at 3 m
        doubts.append(
            f"the focal length is uncertain by {100 * relative:.1f} %: add tilted views, nearer to the camera"
        )
    if coverage < 0.5:
        doubts.append(
            f"the board reached {100 * coverage:.0f} % of the image: near the edges the distortion is a guess; "
            "show it there too"
        )
    return tuple(doubts)


def photograph(path: Path) -> np.ndarray:
    """Read a single grey image ``(height, width)``."""
    import cv2

    if not path.is_file():
        raise InputError(f"{path}: there is no such image")
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)  # turned as its file asks for, as videos are too
    if grey is None:
        raise FileFormatError(f"{path}: OpenCV cannot read this image")
    return grey
