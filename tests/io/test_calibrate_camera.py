"""Intrinsics and the floor come back from drawn boards; what cannot be determined is said."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_images import CAMERA, SQUARE_M, lying, poses, rays, render
from films import write_video

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import angle_between, exp
from vip_factors.io.calibrate_camera import calibrate, find_views, floor_pose, video_images
from vip_factors.io.checkerboard import BoardView, Checkerboard
from vip_factors.sensors.camera_model import CameraModel

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


@pytest.mark.slow
def test_intrinsics_and_floor_from_a_video(tmp_path: Path, ray: np.ndarray) -> None:
    board, random = CHECKERBOARD, np.random.default_rng(0)
    greys = [render(board, *pose, ray, random) for pose in poses(board, 14, random)]
    R_camera_board, p_camera_board, R_floor_camera, p_floor_camera = lying(board)
    floor = render(board, R_camera_board, p_camera_board, ray, random)

    views, size = find_views(film(tmp_path / "board.avi", [*greys, floor]), board)
    found = calibrate(views, size)
    assert size == SIZE
    assert found.rms_px < 0.3
    np.testing.assert_allclose(found.model.focal, CAMERA.focal, rtol=0.005)
    np.testing.assert_allclose(found.model.centre, CAMERA.centre, atol=2.5)
    assert np.all(np.abs(np.subtract(found.model.focal, CAMERA.focal)) < 4 * found.sigma[:2])
    in_view = np.stack([*np.meshgrid([-0.4, 0, 0.4], [-0.3, 0, 0.3]), np.ones((3, 3))], axis=-1)
    np.testing.assert_allclose(found.model.project(in_view), CAMERA.project(in_view), atol=2.5)

    view = board.find("floor", floor)
    R, p, rms_px = floor_pose(view, found.model)
    assert rms_px < 0.5
    assert np.rad2deg(np.arccos(R[2] @ R_floor_camera[2])) < 1.0  # which way is up, in the camera
    assert p[2] == pytest.approx(p_floor_camera[2], abs=0.01)
    assert np.rad2deg(angle_between(R, R_floor_camera)) < 1.5
    np.testing.assert_allclose(p, p_floor_camera, atol=0.015)


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


def test_what_was_seen_instead(tmp_path: Path, ray: np.ndarray) -> None:
    random = np.random.default_rng(0)
    pose = poses(CHECKERBOARD, 1, random)[0]
    board = film(tmp_path / "a.avi", [render(CHECKERBOARD, *pose, ray, random)])
    with pytest.raises(InputError, match=r"no checkerboard of 7 x 5 inner corners in 1 images; .* 8 x 5 inner corners"):
        find_views(board, Checkerboard(7, 5))
    blank = film(tmp_path / "b.avi", [np.full((480, 640), 120, np.uint8)])
    with pytest.raises(InputError, match=r"no checkerboard of 7 x 5 inner corners in 1 images$"):
        find_views(blank, Checkerboard(7, 5))


def test_images_of_a_video(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none"):
        list(video_images(tmp_path / "none", 10))
    (tmp_path / "video.mp4").write_bytes(b"no video")
    with pytest.raises(FileFormatError, match="video"):
        list(video_images(tmp_path / "video.mp4", 10))
    film(tmp_path / "v.avi", [np.full((48, 64), 20 * index, np.uint8) for index in range(10)])
    images = list(video_images(tmp_path / "v.avi", 4))
    assert [image.number for image in images] == [0, 3, 6, 9]
    np.testing.assert_allclose([image.grey[0, 0] for image in images], [0, 60, 120, 180], atol=4)
