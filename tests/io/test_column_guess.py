"""What names of columns and files tell."""

import pytest

from vip_factors.io.importers.column_guess import meaning, meaning_of_file


@pytest.mark.parametrize(
    ("name", "of_file", "told"),
    [
        ("x-axis (g)", "", ("", "acceleration", "x")),
        ("Y-axis (deg/s)", "acceleration", ("", "angular_rate", "y")),
        ("z [m/s²]", "", ("", "acceleration", "z")),
        ("x-axis (T)", "acceleration", None),
        ("X (g)", "ignored", None),
        ("w (number)", "quaternion", ("", "quaternion", "w")),
        ("z", "angular_rate", ("", "angular_rate", "z")),
        ("z", "", None),
        ("AnkleAccelerometer_x-axis (g)", "", ("Ankle", "acceleration", "x")),
        ("rotationRateX", "", ("", "angular_rate", "x")),
        ("Linear Acceleration X (g)", "", None),
        ("High G Accelerometer X (g)", "", None),
        ("Specific Force X", "", ("", "acceleration", "x")),
        ("seconds_elapsed", "acceleration", None),
    ],
)
def test_a_column_tells_sensor_quantity_and_axis(name: str, of_file: str, told: tuple[str, str, str] | None) -> None:
    assert meaning(name, of_file=of_file) == told


@pytest.mark.parametrize(
    ("stem", "told"),
    [
        ("left_foot_Accelerometer", ("acceleration", "left_foot")),
        ("walk_2020-07-25T17.58.14.662_DE982C9EB595_Gyroscope_100.000Hz_1.5.0", ("angular_rate", "walk_DE982C9EB595")),
        ("Inertial", ("", "")),
        ("TotalAcceleration", ("acceleration", "")),
        ("AccelerometerUncalibrated", ("ignored", "")),
        ("Linear Acceleration", ("ignored", "")),
        ("HighGAccelerometer", ("ignored", "")),
        ("WatchGyroscope", ("angular_rate", "Watch")),
        ("Quaternion_2024-01-02_10-11-12", ("quaternion", "")),
        ("thigh_l", ("", "thigh_l")),
    ],
)
def test_a_file_tells_its_quantity_and_whose(stem: str, told: tuple[str, str]) -> None:
    assert meaning_of_file(stem) == told
