"""Images of a drawn board through a known camera: every pixel's ray is followed to the board."""

import cv2
import numpy as np

from vip_factors.geometry.rotations import Array, exp, rotation_x
from vip_factors.io.calibrate_camera import Checkerboard
from vip_factors.sensors.camera import CameraModel

CAMERA = CameraModel(640, 480, (520.0, 516.0), (326.0, 235.0), (-0.12, 0.06, 0.001, -0.0008))
SQUARE_M = 0.03
TEXELS = 40  # a square


def drawing(board: Checkerboard) -> tuple[np.ndarray, Array]:
    """The board with a white margin of one square, and where its frame's origin is in the drawing, in squares."""
    columns, rows = board.columns + 1, board.rows + 1
    y, x = np.mgrid[:rows, :columns]
    squares = np.where((x + y) % 2 == 0, 0, 255).astype(np.uint8)
    large = np.kron(squares, np.ones((TEXELS, TEXELS), np.uint8))
    return cv2.copyMakeBorder(large, *[TEXELS] * 4, cv2.BORDER_CONSTANT, value=255), np.array([2.0, 2.0])


def rays(camera: CameraModel, finer: int = 2) -> Array:
    """Undistorted coordinates ``(finer * height, finer * width, 2)`` of points within all pixels."""
    v, u = np.mgrid[: finer * camera.height, : finer * camera.width]
    return camera.normalise((np.stack([u, v], axis=-1) + 0.5) / finer - 0.5)


def render(
    board: Checkerboard, R_camera_board: Array, p_camera_board: Array, ray: Array, random: np.random.Generator
) -> np.ndarray:
    """A noisy grey image of the board."""
    picture, origin = drawing(board)
    H = np.linalg.inv(np.column_stack([R_camera_board[:, :2], p_camera_board]))
    on_board = np.concatenate([ray, np.ones((*ray.shape[:2], 1))], axis=-1) @ H.T
    texel = ((on_board[..., :2] / on_board[..., 2:]) / board.square_m + origin) * TEXELS - 0.5
    fine = cv2.remap(
        picture, texel.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=150
    )
    grey = cv2.resize(fine, (ray.shape[1] // 2, ray.shape[0] // 2), interpolation=cv2.INTER_AREA).astype(float)
    return np.clip(0.8 * grey + 20 + random.normal(0, 2, grey.shape), 0, 255).astype(np.uint8)


def poses(board: Checkerboard, count: int, random: np.random.Generator) -> list[tuple[Array, Array]]:
    """Tilted boards in all parts of the image: ``R_camera_board``, ``p_camera_board``."""
    centre = 0.5 * board.square_m * np.array([board.columns - 1, board.rows - 1, 0])
    made = []
    for index in range(count):
        R = exp(np.append(random.uniform(-0.6, 0.6, 2), random.uniform(-0.2, 0.2)))
        depth = random.uniform(0.36, 0.5)
        side = np.array([(-0.28, 0.28)[index % 2], (-0.18, 0.18)[index // 2 % 2], 1.0]) * random.uniform(0.2, 1.0)
        side[2] = 1.0
        made.append((R, depth * side - R @ centre))
    return made


def lying(board: Checkerboard) -> tuple[Array, Array, Array, Array]:
    """A board on the floor: ``R_camera_board``, ``p_camera_board``, and the true pose of the camera.

    The camera looks forward and 50° down from 0.4 m; the floor's frame is the board's turned upside down, z up.
    """
    R_floor_level = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # a camera looking along the floor's y
    R_floor_camera = R_floor_level @ rotation_x(-np.deg2rad(50.0))
    p_floor_camera = np.array([0.1, -0.4, 0.4])
    R_floor_board = np.diag([1.0, -1.0, -1.0])
    R_camera_board = R_floor_camera.T @ R_floor_board
    return R_camera_board, -R_floor_camera.T @ p_floor_camera, R_floor_camera, p_floor_camera
