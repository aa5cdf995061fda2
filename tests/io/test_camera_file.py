"""Camera files of all kinds."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from camera_samples import GOOD, PLAIN, POSE2SIM, ROS, K, write_opencv
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import exp
from vip_factors.io.camera_file import CameraFile, read_camera_file, write_camera_file
from vip_factors.sensors.camera import CameraModel

finite = st.floats(-1e4, 1e4)


@given(st.integers(1, 10_000), st.floats(1, 1e5), finite, st.sampled_from([0, 4, 5, 8]), st.lists(finite, min_size=11))
def test_what_is_written_is_read(tmp_path_factory, width, focal, centre, count, numbers) -> None:
    path = tmp_path_factory.mktemp("camera") / "camera.toml"
    model = CameraModel(width, width + 1, (focal, 2 * focal), (centre, -centre), tuple(numbers[:count]))
    R, p = exp(np.array(numbers[8:11]) / 1e4), np.array(numbers[8:11])
    write_camera_file(path, model, (R, p), {"board": 'a "board"\\', "rms_px": 0.25, "views": 12})
    file = read_camera_file(path)
    assert (file.model, file.focal_sigma) == (model, 0.0)
    assert file.floor is not None
    np.testing.assert_allclose(file.floor[0], R, atol=1e-12)
    np.testing.assert_array_equal(file.floor[1], p)
    path.write_text("focal_sigma = 0.1\n" + path.read_text())
    assert read_camera_file(path).focal_sigma == 0.1
    assert tomllib.loads(path.read_text())["calibration"] == {"board": 'a "board"\\', "rms_px": 0.25, "views": 12}


def test_existing_files_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text("precious")
    model = CameraModel(640, 480, (500, 500), (320, 240))
    with pytest.raises(InputError, match="exists"):
        write_camera_file(path, model)
    assert path.read_text() == "precious"
    write_camera_file(path, model, overwrite=True)
    assert read_camera_file(path).model == model


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD.replace("fy", "fz"), "fz.*fy"),
        (GOOD.replace("fx = 500\n", ""), "fx is missing"),
        (GOOD.replace("fx = 500\n", "fx = -3\n"), "focal"),
        (GOOD.replace("640", "640.5"), "width.*whole"),
        (GOOD + "distortion = [1, 2, 3]", "distortion.*0, 4, 5 or 8"),
        (GOOD + "distortion = [1, 2, 3, nan]", "distortion.*number"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"camera.toml: .*{words}"):
        read_camera_file(path)


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
    assert read_camera_file(path) == CameraFile(EXPECTED)


def test_files_of_ros_and_plain_json(tmp_path: Path) -> None:
    ros, plain = tmp_path / "ros.yaml", tmp_path / "plain.json"
    ros.write_text(ROS)
    plain.write_text(PLAIN)
    assert read_camera_file(ros).model == EXPECTED
    assert read_camera_file(plain).model == EXPECTED
    plain.write_text('{"camera_matrix": [[1, 2]], "image_size": [640, 480]}')
    with pytest.raises(InputError, match=r"plain\.json: .*camera_matrix"):
        read_camera_file(plain)
    plain.write_text(f'{{"camera_matrix": {K.tolist()}}}')
    with pytest.raises(InputError, match=r"plain\.json: .*size"):
        read_camera_file(plain)


def test_one_of_the_cameras_of_pose2sim(tmp_path: Path) -> None:
    (tmp_path / "Calib.toml").write_text(POSE2SIM)
    left = tmp_path / "Calib.toml:left"
    file = read_camera_file(left)
    assert file.model == CameraModel(1088, 1920, (1681.2, 1681.0), (532.9, 948.1), (-0.05, 0.1, 0.0, 0.0))
    assert file.floor is not None
    R, p = file.floor
    np.testing.assert_allclose(R @ [0, -1, 0], [0, 0, 1], atol=1e-12)  # the image's upward axis is the world's
    np.testing.assert_allclose(R.T @ (np.zeros(3) - p), [0.5, 1.5, 4.0], atol=1e-12)
    assert read_camera_file(tmp_path / "Calib.toml:right").model.focal == (500, 500)


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("", "", "", "holds the cameras left, right: name the one you mean, such as"),
        (":lft", "", "", "no camera 'lft'; did you mean 'left'"),
        (":left", "size = [1088.0, 1920.0]", "", "left.size is missing"),
        (":left", "fisheye = false", "fisheye = true", "fisheye camera"),
        (":left", "translation = [0.5, 1.5, 4.0]", "translation = 3", "left.translation: expected list"),
        (":left", "1681.2, 0.0", "-3.0, 0.0", "left: "),
    ],
)
def test_mistakes_in_files_of_pose2sim_are_named(tmp_path: Path, name: str, old: str, new: str, words: str) -> None:
    assert old in POSE2SIM
    (tmp_path / "Calib.toml").write_text(POSE2SIM.replace(old, new))
    with pytest.raises(InputError, match=words):
        read_camera_file(tmp_path / f"Calib.toml{name}")


def test_our_own_files_hold_one_camera(tmp_path: Path) -> None:
    write_camera_file(tmp_path / "a.toml", CameraModel(640, 480, (500, 500), (320, 240)))
    with pytest.raises(InputError, match="holds a single camera: leave out ':left'"):
        read_camera_file(tmp_path / "a.toml:left")
