"""Tables of sensors: Xsens MTw and DOT, APDM in both layouts, OpenSense's, OpenSim's; and of any make, with a map."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, exp, transpose
from vip_factors.io.importers.column_map import ACCELERATION_UNITS, ANGULAR_RATE_UNITS, TIME_UNITS
from vip_factors.io.importers.text_table import SEPARATORS
from vip_factors.io.importers.units import R_UP
from vip_factors.sensors.imu_stream import ImuStream

GRAVITY = np.array([0.0, 0.0, 9.81])
MATRIX = [f"Mat[{row}][{column}]" for column in (1, 2, 3) for row in (1, 2, 3)]  # column-major, as exports have it
PREAMBLE = "// Start Time: Unknown\n// Update Rate: 100.0Hz\n// Firmware Version: 4.0.2\n"


def turning(count: int = 6, seed: int = 0, hertz: float = 100.0) -> tuple[Array, Array, Array]:
    """Orientation, specific force and angular rate of a sensor that turns about and feels gravity only."""
    rng = np.random.default_rng(seed)
    rate = rng.normal(size=3)
    R = exp(rng.normal(size=3)) @ exp(np.arange(count)[:, None] / hertz * rate)
    return R, np.einsum("nji,j->ni", R, GRAVITY), np.tile(rate, (count, 1))


def columns_of(R: Array, force: Array | None, rate: Array | None, kind: str = "quaternion") -> dict[str, Array]:
    columns: dict[str, Array] = {}
    for name, values in (("Acc", force), ("Gyr", rate)):
        if values is not None:
            columns |= {f"{name}_{axis}": values[:, i] for i, axis in enumerate("XYZ")}
    if kind == "quaternion":
        quaternion = quaternion_from_matrix(R, Order.WXYZ)
        columns |= {f"Quat_q{i}": quaternion[:, i] for i in range(4)}
    elif kind == "matrix":
        columns |= {name: R[:, int(name[4]) - 1, int(name[7]) - 1] for name in MATRIX}
    elif kind == "euler":
        columns["Roll"] = np.rad2deg(np.arctan2(R[:, 2, 1], R[:, 2, 2]))
        columns["Pitch"] = np.rad2deg(-np.arcsin(np.clip(R[:, 2, 0], -1, 1)))
        columns["Yaw"] = np.rad2deg(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    return columns


def write_mtw(
    path: Path,
    columns: dict[str, Array],
    counter: Array | None,
    separator: str = "\t",
    preamble: str = PREAMBLE,
    blank: str = "",
    order: list[str] | None = None,
) -> Path:
    """One sensor's file, with two empty columns as the exports have them."""
    names = order or list(columns)
    head = ["PacketCounter", "SampleTimeFine", "Year"] if counter is not None else []
    lines = [separator.join([*head, *names])]
    for row in range(len(next(iter(columns.values())))):
        start = [f"{int(counter[row]):05d}", blank, blank] if counter is not None else []
        lines.append(separator.join([*start, *(f"{columns[name][row]:.6f}" for name in names)]))
    path.write_text(preamble + "\n".join(lines) + "\n", encoding="utf-8")
    return path


DOT_PREAMBLE = (
    "sep=,\nDeviceTag:,abc\nFirmwareVersion:,2.0.0\nSyncStatus:,Synced\nOutputRate:,60Hz\n"
    "Measurement Mode:,Sensor fusion Mode - Extended(Quaternion)\n"
    "StartTime: ,2021-08-20_20:21:13_{ms} GMT+8\n© Xsens Technologies\n\n"
)
STEP_US = 16667


def write_dot(path: Path, R: Array, free: Array, clock_us: Array, ms: int = 839, kind: str = "quaternion") -> Path:
    names = ["PacketCounter", "SampleTimeFine"]
    if kind == "quaternion":
        names += ["Quat_W", "Quat_X", "Quat_Y", "Quat_Z"]
        orientation = quaternion_from_matrix(R, Order.WXYZ)
    else:
        names += ["Euler_X", "Euler_Y", "Euler_Z"]
        roll, yaw = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
        orientation = np.rad2deg(np.stack([roll, -np.arcsin(R[:, 2, 0]), yaw], axis=1))
    names += ["FreeAcc_X", "FreeAcc_Y", "FreeAcc_Z", "Gyr_X", "Gyr_Y", "Gyr_Z", "Status"]
    rows = [
        ",".join([str(i + 1), f"{clock:.0f}", *(f"{v:.6f}" for v in (*orientation[i], *free[i], 90.0, 0.0, 0.0)), "0"])
        for i, clock in enumerate(clock_us)
    ]
    text = DOT_PREAMBLE.format(ms=ms) + "\n".join([",".join(names), *rows])
    path.write_text(text, encoding="utf-8")
    return path


def write_format7(path: Path, sensors: dict[str, tuple[Array, Array, Array]]) -> Path:
    first, quantities, axes = ["Format=7"], ["Time"], [""]
    for i, name in enumerate(sensors):
        first += [str(5700 + i), "", "", name, *[""] * 10]
        quantities += ["Accelerometer", "", "", "Gyroscope", "", "", "Magnetometer", "", "", "Barometer", "Orientation"]
        quantities += [""] * 3
        axes += [*"XYZXYZXYZ", "", "S", "X", "Y", "Z"]
    lines = [",".join(cells) for cells in (first, quantities, axes)]
    for row in range(6):
        cells = [str(1550879504438281 + round(row * 1e6 / 128))]
        for R, force, rate in sensors.values():
            values = [*force[row], *rate[row], 0.1, 0.2, 0.3, 4.6e18, *quaternion_from_matrix(R[row], Order.WXYZ)]
            cells += [f"{value:.6f}" for value in values]
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n")
    return path


def write_named(path: Path, sensors: dict[str, tuple[Array, Array, Array]], units: tuple[str, str]) -> Path:
    names, kinds = ["Time"], ["s"]
    for name in sensors:
        names += [f"{name}/Acceleration/{axis}" for axis in "XYZ"] + [
            f"{name}/Angular Velocity/{axis}" for axis in "XYZ"
        ]
        names += [f"{name}/Orientation/{axis}" for axis in ("Scalar", "X", "Y", "Z")] + [f"{name}/Temperature/Scalar"]
        kinds += [units[0]] * 3 + [units[1]] * 3 + [""] * 4 + ["deg C"]
    lines = ["Test Name:,Swing", "Sample Rate:,128,Hz", ",".join(names), ",".join(kinds)]
    for row in range(6):
        cells = [f"{0.25 + row / 128:.9f}"]
        for R, force, rate in sensors.values():
            values = [*force[row], *rate[row], *quaternion_from_matrix(R[row], Order.WXYZ), 21.5]
            cells += [f"{value:.9f}" for value in values]
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n")
    return path


STO_HEADER = "DataRate=100.000000\nDataType=Quaternion\nversion=3\nOpenSimVersion=4.1\nendheader\n"


def write_quaternions(
    path: Path, R: Array, names: list[str], start: float = 678.0, rate: float = 100.0, header: str = STO_HEADER
) -> Path:
    """Rotations ``(T, sensors, 3, 3)`` as a table."""
    lines = ["\t".join(["time", *names])]
    for row, quaternions in enumerate(quaternion_from_matrix(R, Order.WXYZ)):
        lines.append("\t".join([repr(start + row / rate), *(",".join(map(repr, map(float, q))) for q in quaternions)]))
    path.write_text(header + "\n".join(lines) + "\n")
    return path


SENSORS = ("pelvis", "left shank")


def made_up(seed: int, count: int = 40, rate: float = 50.0) -> dict[str, ImuStream]:
    """Streams whose specific force is gravity and a little more."""
    rng = np.random.default_rng(seed)
    time = np.arange(count) / rate
    streams = {}
    for name in SENSORS:
        R = exp(rng.normal(size=3) + np.cumsum(rng.normal(scale=0.1, size=(count, 3)), axis=0))
        force = np.einsum("nji,j->ni", R, [0, 0, 9.81]) + rng.normal(scale=0.5, size=(count, 3))
        streams[name] = ImuStream(name, time, force, R, rng.normal(size=(count, 3)))
    return streams


@dataclass(frozen=True)
class Layout:
    """How a table is written."""

    separator: str = "comma"
    ending: str = "\n"
    mark: bool = False
    comments: int = 0
    time_unit: str = "s"
    acceleration_unit: str = "m/s2"
    angular_rate_unit: str = "rad/s"
    order: str = "wxyz"
    sense: str = "sensor_to_world"
    up: str = "z"
    per_sensor: bool = False
    start: float = 0.0


def quantities_of(stream: ImuStream, layout: Layout) -> dict[str, Array]:
    """The numbers of one sensor by quantity, as the layout has them."""
    assert stream.R_inertial_sensor is not None
    assert stream.specific_force is not None
    assert stream.angular_rate is not None
    R = transpose(R_UP[layout.up]) @ stream.R_inertial_sensor
    R = R if layout.sense == "sensor_to_world" else transpose(R)
    return {
        "acceleration": stream.specific_force / ACCELERATION_UNITS[layout.acceleration_unit],
        "angular_rate": stream.angular_rate / ANGULAR_RATE_UNITS[layout.angular_rate_unit],
        "quaternion": quaternion_from_matrix(R, Order(layout.order)),
    }


def write_log(folder: Path, streams: dict[str, ImuStream], layout: Layout) -> tuple[Path, Path]:
    """The log (a file, or a folder with one for each sensor) and its column map."""
    folder.mkdir(exist_ok=True)
    separator = SEPARATORS[layout.separator] or " "
    tables: dict[str, dict[str, Array]] = {}
    text = [
        'time = "t"', f'time_unit = "{layout.time_unit}"', f'acceleration_unit = "{layout.acceleration_unit}"',
        f'angular_rate_unit = "{layout.angular_rate_unit}"', f'quaternion_order = "{layout.order}"',
        f'quaternion_sense = "{layout.sense}"', f'world_up = "{layout.up}"',
    ]  # fmt: skip
    for number, (name, stream) in enumerate(streams.items()):
        file = f"{number}.csv" if layout.per_sensor else "log.csv"
        table = tables.setdefault(file, {"t": (stream.time + layout.start) / TIME_UNITS[layout.time_unit]})
        text += [f'[sensors."{name}"]', f'file = "{file}"']
        for quantity, values in quantities_of(stream, layout).items():
            names = [f"{number}_{quantity}_{axis}" for axis in range(values.shape[1])]
            table.update(dict(zip(names, values.T, strict=True)))
            text.append(f"{quantity} = {names}")
    for file, table in tables.items():
        lines = ["# made by a logger"] * layout.comments + [separator.join(table)]
        lines += [separator.join(repr(float(one)) for one in row) for row in np.stack(list(table.values()), axis=1)]
        content = layout.ending.join(lines) + layout.ending
        (folder / file).write_bytes(("\ufeff" * layout.mark + content).encode())
    columns = folder / "map.toml"
    columns.write_text("\n".join(text), encoding="utf-8")
    return (folder if layout.per_sensor else folder / "log.csv"), columns


def write_export(folder: Path, stream_of: dict[str, ImuStream]) -> Path:
    """OpenSim's three tables side by side, in the form of its exports."""
    folder.mkdir(exist_ok=True)
    streams = list(stream_of.values())
    for ending, quantity in (("Accel", "specific_force"), ("Gyro", "angular_rate")):
        names = "\t".join(stream_of)
        lines = [f"PathFileType\t4\t(X/Y/Z)\t{ending}", "DataRate\tUnits", "50\tm", f"Frame#\tTime\t{names}"]
        lines.append("\t\t" + "\t".join(f"X{i + 1}\tY{i + 1}\tZ{i + 1}" for i in range(len(streams))) + "\n")
        for i, time in enumerate(streams[0].time):
            values = np.concatenate([getattr(stream, quantity)[i] for stream in streams])
            lines.append("\t".join([str(i + 1), repr(float(time)), *(repr(float(v)) for v in values)]))
        (folder / f"walk_{ending}.trc").write_text("\n".join(lines) + "\n")
    lines = ["DataRate=50", "DataType=Quaternion", "version=3", "endheader", "\t".join(["time", *stream_of])]
    for i, time in enumerate(streams[0].time):
        R = [stream.R_inertial_sensor[i] for stream in streams if stream.R_inertial_sensor is not None]
        quaternions = [quaternion_from_matrix(one, Order.WXYZ) for one in R]
        lines.append(
            "\t".join(
                [repr(float(time)), *(",".join(repr(float(q)) for q in quaternion) for quaternion in quaternions)]
            )
        )
    (folder / "walk_Orientations.sto").write_text("\n".join(lines) + "\n")
    return folder
