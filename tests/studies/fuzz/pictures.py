"""Small pictures to film: a square that moves, and a checkerboard from several sides."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from vip_factors.geometry.rotations import exp

WIDTH, HEIGHT = 64, 48
BOARD_WIDTH, BOARD_HEIGHT, FOCAL = 200, 150, 180.0
COLUMNS, ROWS = 5, 4  # inner corners


def moving_square(frame: int) -> np.ndarray:
    """``(48, 64, 3)`` bytes."""
    image = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    image[..., 1] += np.arange(WIDTH, dtype=np.uint8)
    image[10:30, 5 + frame : 25 + frame] = (220, 40, 30)
    return image


def small_film(frames: int = 8) -> bytes:
    """H.264 in MP4, ten pictures a second."""
    from vip_factors.viz.film_file import film_file

    with TemporaryDirectory() as name:
        path = Path(name, "a.mp4")
        with film_file(path, 10.0, overwrite=False) as film:
            for frame in range(frames):
                film.add(moving_square(frame))
        return path.read_bytes()


def board(view: int) -> np.ndarray:
    """A checkerboard ``(150, 200, 3)`` bytes, tilted otherwise in every view."""
    v, u = np.mgrid[:BOARD_HEIGHT, :BOARD_WIDTH]
    ray = np.stack([(u - BOARD_WIDTH / 2) / FOCAL, (v - BOARD_HEIGHT / 2) / FOCAL, np.ones_like(u)], axis=-1)
    R = exp(np.array([0.4 * np.cos(2.0 * view), 0.4 * np.sin(2.0 * view), 0.1 * view]))
    centre = np.array([0.15 * np.cos(view), 0.1 * np.sin(view), 7.0 + 0.3 * (view % 3)])
    to_board = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], centre]))
    on_board = ray @ to_board.T
    x, y = on_board[..., 0] / on_board[..., 2] + (COLUMNS + 1) / 2, on_board[..., 1] / on_board[..., 2] + (ROWS + 1) / 2
    inside = (x >= 0) & (x < COLUMNS + 1) & (y >= 0) & (y < ROWS + 1)
    black = inside & ((np.floor(x) + np.floor(y)) % 2 == 0)
    return np.repeat(np.where(black, 20, 235).astype(np.uint8)[..., None], 3, axis=2)
