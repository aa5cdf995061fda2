"""OpenSense's mappings of sensors to a model's frames, as placements."""

from pathlib import Path

import pytest

from vip_factors.errors import FileFormatError
from vip_factors.io.convert import placement_from_file


def mapping(*pairs: tuple[str, str]) -> str:
    sensors = "".join(
        f'<ExperimentalSensor name="{name}"><!-- a note --><name_in_model>{frame}</name_in_model></ExperimentalSensor>'
        for name, frame in pairs
    )
    return (
        '<?xml version="1.0" encoding="UTF-8" ?><OpenSimDocument Version="40000"><XsensDataReaderSettings>'
        f"<ExperimentalSensors>{sensors}</ExperimentalSensors></XsensDataReaderSettings></OpenSimDocument>"
    )


def test_sensors_sit_where_the_models_frames_say(tmp_path: Path) -> None:
    path = tmp_path / "myIMUMappings.xml"
    path.write_text(mapping(("_00B42268", "torso_imu"), ("_00B4227D", "tibia_r_imu"), ("00B4", "calcn_l_imu")))
    found = placement_from_file(path).sensors
    assert {name: entry.site for name, entry in found.items()} == {
        "00B42268": "sternum", "00B4227D": "right_shank", "00B4": "left_foot",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("<a></b>", "expected OpenSense's"),
        ("", "expected OpenSense's"),
        ("<a/>", "names no ExperimentalSensor"),
        (mapping(("_1", "mystery")), "sensor '1' is frame 'mystery' of the model: expected a name that tells"),
        (mapping(("", "torso_imu")), "sensor '' is frame 'torso_imu'"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "m.xml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=match):
        placement_from_file(path)
    with pytest.raises(FileFormatError, match="cannot be read"):
        placement_from_file(tmp_path / "none.xml")


@pytest.mark.data
def test_the_example_of_opensense(data_folder: Path) -> None:
    found = placement_from_file(data_folder / "opensense" / "example_MT_009-001" / "myIMUMappings.xml").sensors
    assert len(found) == 8
    assert found["00B4227D"].site == "right_shank"
