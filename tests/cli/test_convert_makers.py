"""Logs as makers' programs write them: a folder or a file for each sensor, or a file for each quantity."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.mcap_recording import read_scene

GRAVITY = np.array([0.0, 0.0, 9.80665])
START = 1_700_000_000.0  # s since 1970
LATE_S = {"acceleration": 0.0, "angular_rate": 0.004, "quaternion": 0.007}


def orientation(time: Array) -> Array:
    """Of somebody who moves gently."""
    return exp(np.stack([0.4 * np.sin(3 * time), 0.3 * np.cos(2 * time), 0.2 * time], axis=1))


def linear(time: Array) -> Array:
    """Acceleration without gravity."""
    moved = 0.8 * np.stack([np.sin(5 * time), np.cos(4 * time), np.sin(7 * time)], axis=1)
    return np.einsum("nji,nj->ni", orientation(time), moved)


def force(time: Array) -> Array:
    return np.einsum("nji,j->ni", orientation(time), GRAVITY) + linear(time)


def angular_rate(time: Array) -> Array:
    after, before = orientation(time + 1e-4), orientation(time - 1e-4)
    R = np.swapaxes(before, 1, 2) @ after
    return np.stack([R[:, 2, 1], R[:, 0, 2], R[:, 1, 0]], axis=1) / 2e-4


def times(quantity: str, rate: float = 100.0, count: int = 300) -> Array:
    return np.arange(count) / rate + LATE_S[quantity]


def write(path: Path, header: str, columns: list[list[str]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([header, *map(",".join, zip(*columns, strict=True))]) + "\n", encoding="utf-8")


def numbers(values: Array, form: str = "{:.6f}") -> list[list[str]]:
    """The cells of each column."""
    return [[form.format(value) for value in column] for column in values.reshape(len(values), -1).T]


def stamps(time: Array) -> list[str]:
    """``2023-11-14T22.13.20.004`` in a zone seven hours west."""
    milliseconds = np.round((time + START - 7 * 3600) * 1000).astype("datetime64[ms]")
    return [str(stamp).replace(":", ".") for stamp in milliseconds]


def write_metamotion(folder: Path) -> Path:
    """MetaBase: a file for each quantity, named by sensor, moment, address, rate and version."""
    for name, address in (("left_foot", "DE982C9EB595"), ("right_foot", "C10F6B5AC415")):
        for quantity, label, unit, factor, values in (
            ("acceleration", "Accelerometer", "g", 9.80665, force),
            ("angular_rate", "Gyroscope", "deg/s", np.pi / 180, angular_rate),
            ("acceleration", "Magnetometer", "T", 1e6, force),
        ):
            time = times(quantity)
            write(
                folder / f"{name}_MetaWear_2023-11-14T15.13.20.100_{address}_{label}_100.000Hz_1.5.0.csv",
                f"epoc (ms),timestamp (-0700),elapsed (s),x-axis ({unit}),y-axis ({unit}),z-axis ({unit})",
                [*numbers(1000 * (time + START), "{:.0f}"), stamps(time), *numbers(time - time[0], "{:.3f}"),
                 *numbers(values(time) / factor)],
            )  # fmt: skip
    return folder


def write_x_imu3(folder: Path) -> Path:
    """x-IMU3's software: a folder for each sensor, a file for each kind of message, microseconds of its own clock."""
    for name in ("left_foot 673B204B (UDP)", "right_foot 5410EC7B (USB)"):
        time = times("angular_rate")
        write(
            folder / name / "Inertial.csv",
            "Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),"
            "Accelerometer Y (g),Accelerometer Z (g)",
            [*numbers(1e6 * (time + 19.15), "{:.0f}"), *numbers(np.rad2deg(angular_rate(time))),
             *numbers(force(time) / 9.80665)],
        )  # fmt: skip
        time = times("quaternion", rate=50.0, count=150)
        write(
            folder / name / "Quaternion.csv",
            "Timestamp (us),W,X,Y,Z",
            [*numbers(1e6 * (time + 19.15), "{:.0f}"), *numbers(quaternion_from_matrix(orientation(time), Order.WXYZ))],
        )
        time = times("acceleration", rate=400.0, count=1200)
        write(
            folder / name / "HighGAccelerometer.csv",
            "Timestamp (us),X (g),Y (g),Z (g)",
            [*numbers(1e6 * (time + 19.15), "{:.0f}"), *numbers(0 * force(time))],
        )
        write(folder / name / "Temperature.csv", "Timestamp (us),Temperature (degC)", [["19400675"] * 3, ["32.25"] * 3])
        write(folder / name / "Notification.csv", "Timestamp (us),String", [["19400675"], ["Initialised, and running"]])
        (folder / name / "Command.json").write_text('[{"ping": {"name": "x-IMU3"}}]')
    return folder


def write_sensor_logger(folder: Path, total: bool = True) -> Path:
    """A phone's folder: axes backwards, nanoseconds since 1970; Accelerometer.csv is without gravity."""
    for quantity, label, values in (
        ("acceleration", "TotalAcceleration", force),
        ("acceleration", "Accelerometer", linear),
        ("acceleration", "Gravity", lambda time: force(time) - linear(time)),
        ("acceleration", "AccelerometerUncalibrated", force),
        ("angular_rate", "Gyroscope", angular_rate),
        ("angular_rate", "GyroscopeUncalibrated", angular_rate),
        ("acceleration", "Magnetometer", force),
    ):
        if label == "TotalAcceleration" and not total:
            continue
        time = times(quantity)
        write(
            folder / f"{label}.csv",
            "time,seconds_elapsed,z,y,x",
            [*numbers(1e9 * (time + START), "{:.0f}"), *numbers(time), *numbers(values(time)[:, ::-1])],
        )
    time = times("quaternion")
    write(
        folder / "Orientation.csv",
        "time,seconds_elapsed,qz,qy,qx,qw,roll,pitch,yaw",
        [*numbers(1e9 * (time + START), "{:.0f}"), *numbers(time),
         *numbers(quaternion_from_matrix(orientation(time), Order.XYZW)[:, [2, 1, 0, 3]]), *numbers(force(time))],
    )  # fmt: skip
    write(folder / "Annotation.csv", "time,seconds_elapsed,text,millisecond_press_duration", [[], [], [], []])
    write(folder / "Metadata.csv", "version,device name,recording epoch time,platform", [["3"], ["a"], ["17"], ["ios"]])
    return folder


def zipped(write_folder: Callable[[Path], Path], name: str) -> Callable[[Path], Path]:
    """An archive of what is written, with what macOS adds."""

    def write_zip(folder: Path) -> Path:
        inside = write_folder(folder / name / "inside")
        with ZipFile(folder / f"{name}.zip", "w") as archive:
            for path in inside.iterdir():
                archive.write(path, path.name)
            archive.writestr("__MACOSX/._Gyroscope.csv", b"\x00\x05\x16\x07")
        return folder / f"{name}.zip"

    return write_zip


def in_folder(write_folder: Callable[[Path], Path], name: str) -> Callable[[Path], Path]:
    return lambda folder: write_folder(folder / name)


@dataclass(frozen=True)
class Maker:
    """How a maker's program writes a log of feet, and what is read of it."""

    write: Callable[[Path], Path]
    sites: Mapping[str, str]
    has_orientation: bool = False
    start_s: float = 0.0


MAKERS = {
    "MetaMotion": Maker(
        write_metamotion, {"left_foot": "left_foot", "right_foot": "right_foot"}, start_s=START + LATE_S["angular_rate"]
    ),
    "x-IMU3": Maker(write_x_imu3, {"left_foot": "left_foot", "right_foot": "right_foot"}, has_orientation=True),
    "Sensor Logger": Maker(
        in_folder(write_sensor_logger, "left_thigh-2023-11-14_22-13-20"), {"left_thigh": "left_thigh"},
        has_orientation=True, start_s=START + LATE_S["angular_rate"],
    ),
    "Sensor Logger, gravity left out": Maker(
        in_folder(partial(write_sensor_logger, total=False), "left_thigh"), {"left_thigh": "left_thigh"},
        has_orientation=True, start_s=START + LATE_S["angular_rate"],
    ),
    "Sensor Logger, zipped": Maker(
        zipped(write_sensor_logger, "left_thigh-2023-11-14_22-13-20"), {"left_thigh": "left_thigh"},
        has_orientation=True, start_s=START + LATE_S["angular_rate"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_what_a_maker_writes_is_read_with_its_template(run, tmp_path: Path, maker: Maker) -> None:
    log = maker.write(tmp_path / "walk")
    told = run("convert", log, "--template", tmp_path / "g")
    assert told.code == 0, told.err
    columns, placement = tmp_path / "g_columns.toml", tmp_path / "g_placement.toml"
    assert "PLEASE" not in columns.read_text(encoding="utf-8")
    told = run("convert", log, tmp_path / "a.mcap", "--columns", columns, "--placement", placement)
    assert told.code == 0, told.err
    recording = read_scene(tmp_path / "a.mcap").wearers[0]
    assert sorted(site for name in recording.placed for key, site in maker.sites.items() if key in name) == sorted(
        maker.sites.values()
    )
    assert recording.start_ns == pytest.approx(maker.start_s * 1e9, abs=2e6)
    for stream in recording.imus.values():
        stream = stream.cut(0, 2.98)  # acceleration ends earlier than angular rate
        time = stream.time + LATE_S["angular_rate"]
        assert len(stream) > 290
        np.testing.assert_allclose(np.diff(stream.time), 0.01, atol=0.002)
        np.testing.assert_allclose(stream.specific_force, force(time), atol=0.05)
        np.testing.assert_allclose(stream.angular_rate, angular_rate(time), atol=0.01)
        if maker.has_orientation:
            np.testing.assert_allclose(stream.R_inertial_sensor, orientation(time), atol=0.01)


def test_an_archive_that_is_none(run, tmp_path: Path) -> None:
    (tmp_path / "walk.zip").write_bytes(b"PK no")
    told = run("convert", tmp_path / "walk.zip", tmp_path / "a.mcap")
    assert (told.code, told.err.count("\n")) == (2, 1)
    assert "walk.zip: cannot be unpacked" in told.err


def test_errors_name_the_archive(run, tmp_path: Path) -> None:
    log = zipped(write_sensor_logger, "thigh")(tmp_path)
    assert run("convert", log, "--template", tmp_path / "g").code == 0
    columns = tmp_path / "g_columns.toml"
    columns.write_text(columns.read_text(encoding="utf-8").replace("Gyroscope.csv", "Gyro.csv"), encoding="utf-8")
    told = run("convert", log, tmp_path / "a.mcap", "--columns", columns)
    assert told.code == 2
    assert f"'Gyro.csv' is not in {log}; did you mean 'Gyroscope.csv'" in told.err
