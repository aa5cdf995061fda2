"""Camera files of all kinds, and intrinsics that come back from drawn boards; what cannot be determined is said."""

import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_images import CAMERA, SQUARE_M, lying, poses, rays, render
from camera_samples import GOOD, PLAIN, POSE2SIM, ROS, K, write_opencv
from films import write_video
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import angle_between, exp, rotation_z
from vip_factors.io.calibrate_camera import (
    CameraCalibrationSettings,
    calibrate,
    calibration_images,
    chosen_views,
    find_views,
    floor_pose,
    one_image,
)
from vip_factors.io.calibrate_camera_board import BoardView, Charuco, Checkerboard
from vip_factors.io.camera_file import read_camera_file, read_floor, write_camera_file
from vip_factors.sensors.camera_model import CameraModel

finite = st.floats(-1e4, 1e4)


@given(st.integers(1, 10_000), st.floats(1, 1e5), finite, st.sampled_from([0, 4, 5, 8]), st.lists(finite, min_size=11))
def test_what_is_written_is_read(tmp_path_factory, width, focal, centre, count, numbers) -> None:
    path = tmp_path_factory.mktemp("camera") / "camera.toml"
    model = CameraModel(width, width + 1, (focal, 2 * focal), (centre, -centre), tuple(numbers[:count]))
    R, p = exp(np.array(numbers[8:11]) / 1e4), np.array(numbers[8:11])
    write_camera_file(path, model, (R, p), {"board": 'a "board"\\', "rms_px": 0.25, "views": 12})
    assert read_camera_file(path) == model
    again = read_floor(path)
    assert again is not None
    np.testing.assert_allclose(again[0], R, atol=1e-12)
    np.testing.assert_array_equal(again[1], p)
    assert tomllib.loads(path.read_text())["calibration"] == {"board": 'a "board"\\', "rms_px": 0.25, "views": 12}


def test_floor_and_distortion_are_optional(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(GOOD)
    assert read_camera_file(path) == CameraModel(640, 480, (500, 500.5), (320, 240))
    assert read_floor(path) is None


def test_existing_files_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text("precious")
    model = CameraModel(640, 480, (500, 500), (320, 240))
    with pytest.raises(InputError, match="exists"):
        write_camera_file(path, model)
    assert path.read_text() == "precious"
    write_camera_file(path, model, overwrite=True)
    assert read_camera_file(path) == model


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD.replace("fy", "fz"), "fz.*fy"),
        (GOOD.replace("fx = 500\n", ""), "fx is missing"),
        (GOOD.replace("fx = 500\n", "fx = 'long'\n"), "fx is 'long'.*number"),
        (GOOD.replace("fx = 500\n", "fx = -3\n"), "focal"),
        (GOOD.replace("640", "640.5"), "width.*whole"),
        (GOOD + "distortion = [1, 2, 3]", "distortion.*0, 4, 5 or 8"),
        (GOOD + "distortion = 3", "distortion.*list"),
        (GOOD + "distortion = [1, 2, 3, nan]", "distortion.*number"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"camera.toml: .*{words}"):
        read_camera_file(path)


@pytest.mark.parametrize(
    ("floor", "words"),
    [
        ("p_floor_camera = [0, 0, 1]", "incomplete.*R_floor_camera"),
        ("R_floor_camera = [[1,0,0],[0,1,0],[0,0,-1]]\np_floor_camera = [0, 0, 1]", "not a rotation"),
        ("R_floor_camera = [[1,0,0],[0,1,0],[0,0]]\np_floor_camera = [0, 0, 1]", "3 numbers"),
        ("R_floor_camera = 3\np_floor_camera = [0, 0, 1]", "three rows"),
        ("R_floor_camera = [[1,0,0],[0,1,0],[0,0,1]]\np_floor_camera = 2", "p_floor_camera.*3 numbers"),
    ],
)
def test_mistakes_in_the_floor_are_named(tmp_path: Path, floor: str, words: str) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(f"{GOOD}[floor]\n{floor}\n")
    with pytest.raises(InputError, match=f"camera.toml: .*{words}"):
        read_floor(path)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"none\.toml"):
        read_camera_file(tmp_path / "none.toml")
    (tmp_path / "a.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "a.yaml").write_text("{[")
    (tmp_path / "a.json").write_text("[3")
    for name in ("a.toml", "a.yaml", "a.json"):
        with pytest.raises(FileFormatError, match=name):
            read_camera_file(tmp_path / name)


EXPECTED = CameraModel(640, 480, (500.0, 510.0), (320.0, 240.0), (0.1, -0.2, 0.001, 0.002, 0.05))


@pytest.mark.parametrize("suffix", [".yaml", ".json", ".xml"])
def test_files_of_opencv(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"camera{suffix}"
    write_opencv(path)
    assert read_camera_file(path) == EXPECTED
    assert read_floor(path) is None


def test_files_of_ros_and_plain_json(tmp_path: Path) -> None:
    ros, plain = tmp_path / "ros.yaml", tmp_path / "plain.json"
    ros.write_text(ROS)
    plain.write_text(PLAIN)
    assert read_camera_file(ros) == EXPECTED
    assert read_camera_file(plain) == EXPECTED
    plain.write_text('{"camera_matrix": [[1, 2]], "image_size": [640, 480]}')
    with pytest.raises(InputError, match=r"plain\.json: .*camera_matrix"):
        read_camera_file(plain)
    plain.write_text(f'{{"camera_matrix": {K.tolist()}}}')
    with pytest.raises(InputError, match=r"plain\.json: .*size"):
        read_camera_file(plain)


def test_one_of_the_cameras_of_pose2sim(tmp_path: Path) -> None:
    (tmp_path / "Calib.toml").write_text(POSE2SIM)
    left = tmp_path / "Calib.toml:left"
    assert read_camera_file(left) == CameraModel(1088, 1920, (1681.2, 1681.0), (532.9, 948.1), (-0.05, 0.1, 0.0, 0.0))
    floor = read_floor(left)
    assert floor is not None
    R, p = floor
    np.testing.assert_allclose(R @ [0, -1, 0], [0, 0, 1], atol=1e-12)  # the image's upward axis is the world's
    np.testing.assert_allclose(R.T @ (np.zeros(3) - p), [0.5, 1.5, 4.0], atol=1e-12)
    assert read_camera_file(tmp_path / "Calib.toml:right").focal == (500, 500)


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("", "", "", "holds the cameras left, right: name the one you mean, such as"),
        (":lft", "", "", "no camera 'lft'; did you mean 'left'"),
        (":left", "size = [1088.0, 1920.0]", "", "left.size is missing"),
        (":left", "fisheye = false", "fisheye = true", "fisheye camera"),
        (":left", "translation = [0.5, 1.5, 4.0]", "translation = 3", "left.translation is 3"),
        (":left", "[0.0, 1681.0, 948.1], [0.0, 0.0, 1.0]]", "[0.0, 1681.0, 948.1]]", "three rows of three numbers"),
        (":left", "1681.2, 0.0", "-3.0, 0.0", "left: "),
        (":left", "distortions = [-0.05, 0.1, 0.0, 0.0]", "distortions = 1", "left.distortions is 1"),
    ],
)
def test_mistakes_in_files_of_pose2sim_are_named(tmp_path: Path, name: str, old: str, new: str, words: str) -> None:
    assert old in POSE2SIM
    (tmp_path / "Calib.toml").write_text(POSE2SIM.replace(old, new))
    with pytest.raises(InputError, match=words):  # of intrinsics, or of the pose
        [read(tmp_path / f"Calib.toml{name}") for read in (read_camera_file, read_floor)]


def test_our_own_files_hold_one_camera(tmp_path: Path) -> None:
    write_camera_file(tmp_path / "a.toml", CameraModel(640, 480, (500, 500), (320, 240)))
    with pytest.raises(InputError, match="holds a single camera: leave out ':left'"):
        read_camera_file(tmp_path / "a.toml:left")


SIZE = (CAMERA.width, CAMERA.height)
CHECKERBOARD, CHARUCO = Checkerboard(8, 5, SQUARE_M), Charuco(8, 6, "DICT_5X5_100", SQUARE_M)


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


@pytest.mark.parametrize(
    "board",
    [pytest.param(CHECKERBOARD, id="checkerboard", marks=pytest.mark.slow), pytest.param(CHARUCO, id="charuco")],
)
def test_intrinsics_and_floor_from_images(tmp_path: Path, ray: np.ndarray, board) -> None:
    random = np.random.default_rng(0)
    for index, pose in enumerate(poses(board, 14, random)):
        cv2.imwrite(str(tmp_path / f"{index:02d}.png"), render(board, *pose, ray, random))
    R_camera_board, p_camera_board, R_floor_camera, p_floor_camera = lying(board)
    floor = render(board, R_camera_board, p_camera_board, ray, random)
    cv2.imwrite(str(tmp_path / "floor.png"), floor)

    views, size = find_views(tmp_path, board)
    found = calibrate(views, size)
    assert size == SIZE
    assert found.rms_px < 0.2
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


@pytest.mark.parametrize("board", [CHECKERBOARD, CHARUCO], ids=["checkerboard", "charuco"])
def test_cameras_all_around_a_board_on_the_floor_stand_in_one_world(ray: np.ndarray, board) -> None:
    """Each from its own image: they agree which corner is the origin and where x points."""
    random = np.random.default_rng(5)
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


@pytest.mark.parametrize("distortion", [0, 4, 5, 8])
def test_number_of_distortion_coefficients(distortion: int) -> None:
    camera = replace(CAMERA, distortion=() if distortion == 0 else CAMERA.distortion)
    views = exact_views(CHECKERBOARD, poses(CHECKERBOARD, 25, np.random.default_rng(3)), 0.02, camera)
    found = calibrate(views, SIZE, CameraCalibrationSettings(distortion=distortion))
    assert len(found.model.distortion) == len(found.distortion_sigma) == distortion
    np.testing.assert_allclose(found.model.focal, camera.focal, rtol=0.003)


def test_a_view_that_does_not_fit_is_left_out() -> None:
    views = exact_views(CHECKERBOARD, poses(CHECKERBOARD, 16, np.random.default_rng(3)))
    bad = replace(views[5], pixels=views[5].pixels + np.random.default_rng(0).normal(0, 3, views[5].pixels.shape))
    found = calibrate([*views[:5], bad, *views[6:]], SIZE)
    assert [name for name, _ in found.left_out] == ["view 5"]
    np.testing.assert_allclose(found.model.focal, CAMERA.focal, rtol=0.01)


def test_of_views_that_are_alike_the_sharpest_is_used() -> None:
    where = poses(CHECKERBOARD, 6, np.random.default_rng(3))
    views = exact_views(CHECKERBOARD, where)
    blurred = [replace(view, name=f"blurred {view.name}", sharpness=0.2) for view in views]
    upside_down = [replace(view, outline=np.roll(view.outline, 2, axis=0)) for view in blurred]
    chosen = chosen_views([*blurred, *views, *upside_down], SIZE, CameraCalibrationSettings())
    assert [view.name for view in chosen] == [view.name for view in views]


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
    cv2.imwrite(str(tmp_path / "a.png"), render(CHECKERBOARD, *pose, ray, random))
    with pytest.raises(InputError, match=r"no checkerboard of 7 x 5 inner corners in 1 images; .* 8 x 5 inner corners"):
        find_views(tmp_path, Checkerboard(7, 5))
    cv2.imwrite(str(tmp_path / "a.png"), render(CHARUCO, *pose, ray, random))
    with pytest.raises(InputError, match="markers of DICT_5X5_50 were seen"):
        find_views(tmp_path, Charuco(8, 6, "DICT_4X4_50"))
    with pytest.raises(InputError, match="its markers were seen: check the numbers of squares"):
        find_views(tmp_path, Charuco(15, 12, "DICT_5X5_100"))
    cv2.imwrite(str(tmp_path / "a.png"), np.full((480, 640), 120, np.uint8))
    with pytest.raises(InputError, match=r"no checkerboard of 7 x 5 inner corners in 1 images$"):
        find_views(tmp_path, Checkerboard(7, 5))


def test_images_and_videos(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none"):
        list(calibration_images(tmp_path / "none", 10))
    with pytest.raises(InputError, match="no image in this folder"):
        list(calibration_images(tmp_path, 10))
    (tmp_path / "video.mp4").write_bytes(b"no video")
    with pytest.raises(FileFormatError, match="video"):
        list(calibration_images(tmp_path / "video.mp4", 10))
    folder = tmp_path / "images"
    folder.mkdir()
    for index in range(10):
        cv2.imwrite(str(folder / f"{index}.png"), np.full((20, 30), 20 * index, np.uint8))
    assert [image.number for image in calibration_images(folder, 4)] == [0, 3, 6, 9]
    assert one_image(folder, 7).grey[0, 0] == 140
    with pytest.raises(InputError, match="holds 10 images"):
        one_image(folder, 10)
    cv2.imwrite(str(folder / "x.png"), np.zeros((20, 31), np.uint8))
    with pytest.raises(InputError, match=r"x\.png has 31 x 20 pixels.*same size"):
        list(calibration_images(folder, 100))
    write_video(tmp_path / "v.avi", [np.full((48, 64, 3), 20 * index, np.uint8) for index in range(10)])
    assert [image.number for image in calibration_images(tmp_path / "v.avi", 4)] == [0, 3, 6, 9]
    assert abs(int(one_image(tmp_path / "v.avi", 5).grey[0, 0]) - 100) < 4
    with pytest.raises(InputError, match="no frame 99"):
        one_image(tmp_path / "v.avi", 99)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Checkerboard(2, 5), "at least 3"),
        (lambda: Charuco(3, 5), "at least 4"),
        (lambda: Checkerboard(8, 5, -1.0), "metres above 0"),
        (lambda: Charuco(8, 5, "DICT_5X5"), "DICT_5X5_100"),
        (lambda: Charuco(8, 5, marker_share=1.5), "between 0 and 1"),
    ],
)
def test_impossible_boards(make, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()


def boards(ray: np.ndarray, board: Checkerboard, count: int = 3) -> list[np.ndarray]:
    random = np.random.default_rng(0)
    return [render(board, *pose, ray, random) for pose in poses(board, count, random)]


def test_what_several_images_agree_on_is_named(ray: np.ndarray) -> None:
    greys = boards(ray, Checkerboard(9, 6, SQUARE_M))
    assert "a board of 9 x 6 inner corners was seen" in Checkerboard(7, 5).hint(greys)
    assert "give that if it is all of it" in Checkerboard(10, 7).hint(greys)
    assert Checkerboard(9, 6).hint(greys) == ""  # found, but blurred where it was looked for: its own size is no advice
    assert Checkerboard(7, 5).hint([greys[1], np.full_like(greys[1], 128)]) == ""  # a chance find


def test_noise_is_no_board(ray: np.ndarray) -> None:
    random = np.random.default_rng(0)
    blank = random.integers(0, 255, (480, 640)).astype(np.uint8)
    for width in (1, 2, 4, 8):
        assert Checkerboard(9, 6).hint([cv2.GaussianBlur(blank, (0, 0), width)]) == ""


def test_a_board_of_three_by_three_is_refused() -> None:
    with pytest.raises(InputError, match="at least 4 x 3"):
        Checkerboard(3, 3)
    assert Checkerboard(4, 3).text == "checkerboard of 4 x 3 inner corners"
