"""The command writes a camera file, and says what it could not find."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from films import write_video

from vip_factors.io.camera_file import read_camera_file


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A board of 7 x 5 inner corners seen through a camera with a focal length of 400 pixels; it lies down last."""
    folder = tmp_path_factory.mktemp("board")
    y, x = np.mgrid[:6, :8]
    squares = np.kron(((x + y) % 2 * 235 + 10).astype(np.uint8), np.ones((30, 30), np.uint8))
    board = cv2.copyMakeBorder(squares, 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=245)
    K = np.array([[400.0, 0, 200], [0, 400, 150], [0, 0, 1]])
    texel = np.array([[1 / 30, 0, -4.5], [0, 1 / 30, -3.5], [0, 0, 1]])  # of the board in squares, about its middle
    images = []
    turns = [(a, b, 0.1) for a in (-0.6, 0.0, 0.6) for b in (-0.6, 0.0, 0.6)] + [(-1.0, 0, 0)]
    for index, turn in enumerate(turns):
        R, _ = cv2.Rodrigues(np.array(turn, dtype=float))
        shift = [1.5 * (index % 3 - 1), 1.0 * (index // 3 % 3 - 1), 13.0] if index < 9 else [0, 0, 14.0]
        H = K @ np.column_stack([R[:, :2], shift]) @ texel
        finer = np.diag([3.0, 3.0, 1.0])
        seen = cv2.warpPerspective(board, finer @ H, (1200, 900), borderValue=150)
        images.append(cv2.cvtColor(cv2.resize(seen, (400, 300), interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR))
    cv2.imwrite(str(folder / "lying.png"), images[-1])
    return write_video(folder / "board.avi", images)


def test_from_a_video_to_a_camera_file(run, video: Path, tmp_path: Path) -> None:
    out = tmp_path / "camera.toml"
    told = run(
        "calibrate-camera", video, out, "--checkerboard", "7x5", "--square-m", "0.1", "--floor", "last",
        "--distortion", "0",
    )  # fmt: skip
    assert told.code == 0, told.err
    assert "reprojection error" in told.out
    assert "floor from frame 9" in told.out
    model = read_camera_file(out).model
    assert (model.width, model.height, model.distortion) == (400, 300, ())
    np.testing.assert_allclose(model.focal, 400, rtol=0.01)
    floor = read_camera_file(out).floor
    assert floor is not None
    assert floor[1][2] == pytest.approx(1.4 * np.cos(1.0), abs=0.02)


def test_a_camera_file_is_told_where_it_stands(run, video: Path, tmp_path: Path) -> None:
    board = ("--checkerboard", "7x5", "--square-m", "0.1")
    run("calibrate-camera", video, tmp_path / "a.toml", *board, "--distortion", "0", "--floor", "last")
    plain = tmp_path / "plain.toml"
    plain.write_text((tmp_path / "a.toml").read_text().split("[floor]")[0])
    lying = ("--floor-image", video.with_name("lying.png"))
    told = run("calibrate-camera", plain, tmp_path / "b.toml", *board, *lying)
    assert told.code == 0, told.err
    assert "alike from both ends" in told.err  # seven and five: both are odd
    again, before = (read_camera_file(tmp_path / name) for name in ("b.toml", "a.toml"))
    assert again.model == read_camera_file(plain).model
    for mine, expected in zip(again.floor, before.floor, strict=True):
        np.testing.assert_allclose(mine, expected, atol=2e-3)  # films are compressed
    assert "--floor-image" in run("calibrate-camera", plain, tmp_path / "c.toml", *board).err
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), cv2.imread(str(video.with_name("lying.png")))[::2, ::2])
    assert "200 x 150" in run("calibrate-camera", plain, tmp_path / "c.toml", *board, "--floor-image", small).err
    assert "no such image" in run("calibrate-camera", plain, tmp_path / "c.toml", *board, "--floor-image", "none").err
    both = run("calibrate-camera", video, tmp_path / "c.toml", *board, *lying, "--floor", "last")
    assert "one of them" in both.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--checkerboard", "8x6"), ("8 x 6", "one less than the squares")),
        (("--checkerboard", "big"), ("big", "9x6")),
        ((), ("--checkerboard",)),
        (("--checkerboard", "7x5", "--floor", "last"), ("--square-m",)),
        (("--checkerboard", "7x5", "--floor", "middle", "--square-m", "1"), ("middle", "first")),
    ],
)
def test_mistakes(run, video: Path, tmp_path: Path, options: tuple[str, ...], words: tuple[str, ...]) -> None:
    told = run("calibrate-camera", video, tmp_path / "camera.toml", *options)
    assert told.code == 2
    assert "Traceback" not in told.err
    for word in words:
        assert word in told.err
    assert list(tmp_path.iterdir()) == []
