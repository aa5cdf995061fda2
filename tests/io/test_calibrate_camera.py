"""Intrinsics and the floor come back from drawn boards; what cannot be determined is said."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_images import CAMERA, SQUARE_M, lying, poses, rays, render
from films import write_video

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import angle_between, exp, rotation_z
from vip_factors.io.calibrate_camera import BoardView, Checkerboard, calibrate, find_views, floor_pose
from vip_factors.sensors.camera import CameraModel

SIZE = (CAMERA.width, CAMERA.height)
CHECKERBOARD = Checkerboard(8, 5, SQUARE_M)


@pytest.fixture(scope="module")
def ray() -> np.ndarray:
    return rays(CAMERA)


def exact_views(board: Checkerboard, where: list, sigma_px: float = 0.1, camera: CameraModel = CAMERA) -> list:
    """Views as a detector would return them, without drawing."""
    random = np.random.default_rng(1)
    views = []
    y, x = np.mgrid[: board.rows, : board.columns]
    points = board.square_m * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    outer = [0, board.columns - 1, x.size - 1, x.size - board.columns]
    for index, (R, p) in enumerate(where):
        pixels = camera.project(points @ R.T + p)
        noisy = pixels + random.normal(0, sigma_px, pixels.shape)
        views.append(BoardView(f"view {index}", points, noisy, pixels[outer], 1.0))
    return views


def film(path: Path, greys: list[np.ndarray]) -> Path:
    return write_video(path, [cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR) for grey in greys])


def test_cameras_all_around_a_board_on_the_floor_stand_in_one_world(ray: np.ndarray) -> None:
    """Each from its own image: they agree which corner is the origin and where x points."""
    board, random = CHECKERBOARD, np.random.default_rng(5)
    *_, R_floor_camera, p_floor_camera = lying(board)
    middle = 0.5 * board.square_m * np.array([board.columns - 1, -(board.rows - 1), 0])
    for yaw in np.deg2rad([0, 80, 170, 260]):
        turn = rotation_z(yaw)
        p_true, R_true = turn @ (p_floor_camera - middle) + middle, turn @ R_floor_camera
        R_board_floor = np.diag([1.0, -1.0, -1.0])
        R_seen, p_seen = R_true.T @ R_board_floor.T, -R_true.T @ p_true
        R, p, _ = floor_pose(board.find("floor", render(board, R_seen, p_seen, ray, random)), CAMERA)
        assert np.rad2deg(angle_between(R, R_true)) < 1.5
        np.testing.assert_allclose(p, p_true, atol=0.02)


def test_a_view_that_does_not_fit_is_left_out() -> None:
    views = exact_views(CHECKERBOARD, poses(CHECKERBOARD, 16, np.random.default_rng(3)))
    bad = replace(views[5], pixels=views[5].pixels + np.random.default_rng(0).normal(0, 3, views[5].pixels.shape))
    found = calibrate([*views[:5], bad, *views[6:]], SIZE)
    assert [name for name, _ in found.left_out] == ["view 5"]
    np.testing.assert_allclose(found.model.focal, CAMERA.focal, rtol=0.01)


def test_alike_or_single_views_are_refused() -> None:
    views = exact_views(CHECKERBOARD, poses(CHECKERBOARD, 1, np.random.default_rng(3)) * 9)
    with pytest.raises(InputError, match=r"9 views.*only 1 of them differ.*at least 3"):
        calibrate(views, SIZE)
    with pytest.raises(InputError, match="1 view of the board: expected at least 3"):
        calibrate(views[:1], SIZE)


def test_what_is_not_determined_is_said() -> None:
    facing = [(exp(np.array([0.01 * i, 0, 0])), np.array([0.03 * i - 0.3, -0.1, 0.5 + 0.05 * i])) for i in range(6)]
    said = " ".join(calibrate(exact_views(CHECKERBOARD, facing, 0.5), SIZE).warnings)
    assert "tilted" in said
    assert "only 6 views" in said
    assert "focal length is uncertain" in said
    good = calibrate(exact_views(CHECKERBOARD, poses(CHECKERBOARD, 40, np.random.default_rng(3))), SIZE)
    assert good.warnings == ()


def test_a_video_without_the_board_or_none_at_all_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such video"):
        find_views(tmp_path / "none", CHECKERBOARD)
    (tmp_path / "video.mp4").write_bytes(b"no video")
    with pytest.raises(FileFormatError, match="not a video"):
        find_views(tmp_path / "video.mp4", CHECKERBOARD)
    film(tmp_path / "v.avi", [np.full((48, 64), 20 * index, np.uint8) for index in range(10)])
    with pytest.raises(InputError, match=r"no checkerboard of .* in 10 images"):
        find_views(tmp_path / "v.avi", CHECKERBOARD)
