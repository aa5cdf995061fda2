"""sensor_msgs/msg/Imu of a ROS 2 recording."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer as RawWriter
from ros2_samples import imu, write_ros2

from vip_factors.errors import FileFormatError, RecordingError
from vip_factors.geometry.rotations import rotation_z
from vip_factors.io import ros2
from vip_factors.io.mcap_reader import McapWarning
from vip_factors.io.mcap_recording import read_scene


@settings(max_examples=30, deadline=None)
@given(st.text(st.characters(codec="ascii", exclude_characters="\0"), min_size=1, max_size=20))
def test_all_fields_are_read_whatever_the_length_of_the_frame(tmp_path_factory, frame_id: str) -> None:
    path = write_ros2(tmp_path_factory.mktemp("ros") / "r.mcap", {"/imu": [imu(i, frame_id) for i in range(5)]})
    streams = ros2.read(path).imus
    assert list(streams) == [frame_id]
    stream, i = streams[frame_id], np.arange(5)
    np.testing.assert_allclose(stream.time, i * 0.01, atol=1e-15)
    np.testing.assert_array_equal(stream.specific_force, np.stack([0.5 + 0 * i, 0.25 * i, 9.81 + 0 * i], axis=1))
    np.testing.assert_array_equal(stream.angular_rate, np.stack([1 + 0 * i, 2 + 0 * i, i], axis=1))
    np.testing.assert_allclose(stream.R_inertial_sensor, rotation_z(0.1 * i), atol=1e-12)


def test_a_covariance_of_minus_one_means_not_measured(tmp_path: Path) -> None:
    absent = [-1.0] + [0.0] * 8
    path = write_ros2(
        tmp_path / "r.mcap",
        {
            "/a": [imu(i, "a", orientation_covariance=absent) for i in range(3)],
            "/b": [imu(i, "b", linear_acceleration_covariance=absent) for i in range(3)],
            "/c": [imu(i, "c", angular_velocity_covariance=absent) for i in range(3)],
            "/d": [imu(i, "d", orientation=dict.fromkeys("xyzw", 0.0)) for i in range(2, 5)],
        },
    )
    streams = ros2.read(path).imus
    assert streams["a"].R_inertial_sensor is None
    assert streams["b"].specific_force is None
    assert streams["d"].R_inertial_sensor is None  # as of drivers without an orientation
    assert [float(stream.time[0]) for stream in streams.values()] == [0, 0, 0, 0.02]  # from the earliest stamp
    assert streams["c"].angular_rate is None
    assert streams["c"].specific_force is not None
    assert streams["c"].R_inertial_sensor is not None


@pytest.mark.parametrize("frame_id", ["", "base_link"])
def test_empty_and_shared_frames_give_way_to_topics(tmp_path: Path, frame_id: str) -> None:
    messages = [imu(i, frame_id) for i in range(2)]
    path = write_ros2(tmp_path / "r.mcap", {"/left/imu": messages, "/right/imu": messages})
    assert sorted(ros2.read(path).imus) == ["left/imu", "right/imu"]


def test_stamps_out_of_order_are_sorted_and_repeats_left_out(tmp_path: Path) -> None:
    path = write_ros2(tmp_path / "r.mcap", {"/imu": [imu(i) for i in (0, 2, 1, 2, 3)]})
    with pytest.warns(McapWarning, match="1 samples repeat"):
        stream = ros2.read(path).imus["pelvis"]
    np.testing.assert_allclose(stream.time, [0, 0.01, 0.02, 0.03])
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "pelvis"}
    write_ros2(path, {"/imu": [imu(i, header=header) for i in range(3)]})
    with pytest.warns(McapWarning, match="no time stamps"):  # log times stand for them
        np.testing.assert_allclose(ros2.read(path).imus["pelvis"].time, [0, 0.01, 0.02])


def test_big_endian_messages_are_read(tmp_path: Path) -> None:
    numbers = [0.0] * 37
    numbers[3], numbers[27] = 1.0, 9.81
    data = b"\0\0\0\0" + struct.pack(">iII5s3x", 3, 4, 5, b"shin\0") + b"\0" * 4 + struct.pack(">37d", *numbers)
    with open(tmp_path / "r.mcap", "wb") as file:
        writer = RawWriter(file)
        writer.start("ros2")
        schema = writer.register_schema("sensor_msgs/msg/Imu", "ros2idl", b"")
        writer.add_message(writer.register_channel("/imu", "cdr", schema), 0, data, 0)
        writer.finish()
    stream = ros2.read(tmp_path / "r.mcap").imus["shin"]
    np.testing.assert_array_equal(stream.specific_force, [[0, 0, 9.81]])
    np.testing.assert_array_equal(stream.R_inertial_sensor, [np.eye(3)])


def test_errors_name_the_file_and_what_to_do(tmp_path: Path) -> None:
    path = write_ros2(tmp_path / "r.mcap", {"/imu": [imu(0)]})
    with pytest.warns(McapWarning), pytest.raises(FileFormatError, match="vip-factors convert"):
        read_scene(path)
    far = {"x": 0.0, "y": 0.0, "z": 981.0}
    write_ros2(path, {"/imu": [imu(0, linear_acceleration=far)]})
    with pytest.raises(RecordingError, match=r"r\.mcap: sensor 'pelvis'.*m/s²"):
        ros2.read(path)
    write_ros2(path, {})
    with pytest.raises(FileFormatError, match=r"no messages of sensor_msgs/msg/Imu: topics found are none"):
        ros2.read(path)


@pytest.mark.parametrize("names", [["pelvis", "left_foot", "right_foot"], ["imu 0", "imu 1"]])
def test_frames_of_one_topic_are_sensors(tmp_path: Path, names: list[str]) -> None:
    path = write_ros2(tmp_path / "r.mcap", {"/imu": [imu(i, name) for i in range(4) for name in names]})
    streams = ros2.read(path).imus
    assert list(streams) == names
    for stream in streams.values():
        np.testing.assert_allclose(stream.time, 0.01 * np.arange(4), atol=1e-12)


def test_frames_of_two_topics_that_share_them_are_told_apart(tmp_path: Path) -> None:
    both = [imu(i, frame) for i in range(3) for frame in ("a", "b")]
    assert set(ros2.read(write_ros2(tmp_path / "r.mcap", {"/x": both, "/y": both})).imus) == {
        "x/a",
        "x/b",
        "y/a",
        "y/b",
    }


@pytest.mark.parametrize("xyzw", [(0.0, 0.0, 0.0, 1.0), (0.5, 0.5, 0.5, 0.5)])
def test_an_orientation_that_never_changes_was_not_measured(tmp_path: Path, xyzw: tuple[float, ...]) -> None:
    orientation = dict(zip("xyzw", xyzw, strict=True))
    path = write_ros2(tmp_path / "r.mcap", {"/imu": [imu(i, orientation=orientation) for i in range(5)]})
    log = ros2.read(path)
    assert log.imus["pelvis"].R_inertial_sensor is None
    assert any("never changes" in note for note in log.notes)


@pytest.mark.parametrize(
    ("gyroscope", "accelerometer", "name"),
    [
        ("/camera/gyro/sample", "/camera/accel/sample", "camera"),
        ("/left/gyro", "/left/accel", "left"),
        ("/gyro", "/accel", "gyro"),
    ],
)
def test_topics_of_one_quantity_each_are_one_sensor(
    tmp_path: Path, gyroscope: str, accelerometer: str, name: str
) -> None:
    zero, absent = dict.fromkeys("xyz", 0.0), [-1.0] + [0.0] * 8
    rates = [imu(i, "", linear_acceleration=zero, orientation_covariance=absent) for i in range(200)]
    forces = [
        imu(0.63 * i, "", angular_velocity=zero, orientation_covariance=absent) for i in range(300) if not 100 < i < 150
    ]
    stream = ros2.read(write_ros2(tmp_path / "r.mcap", {gyroscope: rates, accelerometer: forces})).imus[name]
    assert stream.specific_force is not None
    assert stream.angular_rate is not None
    number = np.round(stream.time / 0.01)
    np.testing.assert_allclose(stream.specific_force[:, 1], 0.25 * number, atol=1e-5)  # interpolated
    np.testing.assert_allclose(stream.angular_rate[:, 2], number)
    assert not np.any((number > 65) & (number < 93))  # never over a gap
