"""Bags of ROS 2 on the command line."""

from pathlib import Path

import pytest
from ros2_samples import imu, write_ros2

from vip_factors.io.mcap_recording import read_scene


@pytest.mark.parametrize("parts", [1, 3])
def test_the_folder_of_a_bag_is_read(run, tmp_path: Path, parts: int) -> None:
    bag = tmp_path / "walk"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 9\n")
    for part in range(parts):
        samples = [imu(i, "pelvis") for i in range(100 * part, 100 * (part + 1))]
        write_ros2(bag / f"walk_{part}.mcap", {"/imu": samples})
    converted = run("convert", bag, tmp_path / "out.mcap")
    assert converted.code == 0, converted.err
    (stream,) = read_scene(tmp_path / "out.mcap").wearers[0].imus.values()
    assert len(stream) == 100 * parts
    assert not len(stream.gaps)


def test_a_bag_in_sqlite_is_refused_with_the_way_out(run, tmp_path: Path) -> None:
    bag = tmp_path / "walk"
    bag.mkdir()
    (bag / "metadata.yaml").touch()
    (bag / "walk_0.db3").touch()
    converted = run("convert", bag, tmp_path / "out.mcap")
    assert converted.code == 2
    assert "ros2 bag convert" in converted.err
    assert converted.err.count("\n") == 1
