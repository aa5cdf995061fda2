"""Sensor logs of all formats, a few samples each, written here in the form that their makers give them."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from tests.io import mvnx_samples, totalcapture_samples
from tests.io.table_samples import (
    columns_of,
    sample,
    turning,
    write_dot,
    write_format7,
    write_mtw,
    write_named,
    write_quaternions,
)
from tests.studies.fuzz.case import Case, Files, written
from vip_factors.cli.info_text import recording_text
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.io.convert import ImportOptions, import_recording
from vip_factors.io.convert_template import write_templates

ROWS = 8
NAMES = ("Pelvis", "LeftShank", "RightForeArm")
SELDOM = {"mvnx": 8, "totalcapture": 12, "apdm-7": 3}


def log_cases() -> list[Case]:
    """One case for each format of logs."""
    cases = []
    for name, path, files, options in _logs():
        command = f"vip-factors convert {{}}/{path} out.mcap" + "".join(
            f" --{key.replace('_', '-')} {{}}/{value}" for key, value in options.items()
        )
        read = partial(_read, path=path, options=options)
        cases.append(Case(name, files, read, command, seldom=SELDOM.get(name, 4)))
    table = {"log.csv": _table()["log.csv"]}
    return [
        *cases,
        Case("template", table, _template, "vip-factors convert {}/log.csv --template {}/template", seldom=6),
    ]


def _read(folder: Path, path: str, options: dict[str, str]) -> None:
    """As ``convert`` does."""
    told = {key: (folder / value if key == "columns" else str(folder / value)) for key, value in options.items()}
    recording_text(import_recording(folder / path, ImportOptions(**told)))  # type: ignore[arg-type]


def _template(folder: Path) -> None:
    """As ``convert --template`` does."""
    write_templates(folder / "log.csv", folder / "template", overwrite=True)


def _logs() -> list[tuple[str, str, Files, dict[str, str]]]:
    mapping = "".join(
        f'<ExperimentalSensor name="_{name}"><name_in_model>{frame}_imu</name_in_model></ExperimentalSensor>'
        for name, frame in (("00B1", "pelvis"), ("00B2", "tibia_l"))
    )
    xml = f"<OpenSimDocument><R><ExperimentalSensors>{mapping}</ExperimentalSensors></R></OpenSimDocument>".encode()
    placement = (
        b'stature_m = 1.7\nsubject = "Ada"\ninitial_pose = "t-pose"\n[segment_lengths_m]\nthigh = 0.42\n'
        b'[sensors]\nPelvis = "pelvis"\nLeftShank = { site = "left_shank", sigma_deg = 10 }\n'
    )
    json = (
        b'{"stature_m": 1.7, "sex": "male", "sensors": {"Pelvis": "pelvis", "RightForeArm": {"site": "right_forearm"}}}'
    )
    txt = written(partial(_mtw, names=NAMES))
    mapped = {**written(partial(_mtw, names=("a-000_00B1", "a-000_00B2"))), "m.xml": xml}
    opals = {"Lumbar": sample(1), "Right Ankle": sample(2)}
    si = ("m/s^2", "rad/s")
    return [
        ("xsens-txt", "log", _below("log", txt), {}),
        ("placement-toml", "log", _below("log", txt) | {"p.toml": placement}, {"placement": "p.toml"}),
        ("placement-json", "log", _below("log", txt) | {"p.json": json}, {"placement": "p.json"}),
        ("opensense-xml", "log", _below("log", mapped), {"placement": "log/m.xml"}),
        ("xsens-dot", "log", _below("log", written(_dot)), {}),
        ("mvnx", "a.mvnx", written(lambda folder: mvnx_samples.write(folder / "a.mvnx", mvnx_samples.motion())), {}),
        ("apdm-7", "a.csv", written(lambda folder: write_format7(folder / "a.csv", opals)), {}),
        ("apdm-named", "a.csv", written(lambda folder: write_named(folder / "a.csv", opals, si)), {}),
        ("opensense-sto", "a.sto", written(lambda folder: _quaternion_table(folder / "a.sto")), {}),
        ("opensim-export", "log", _below("log", _opensim_export()), {}),
        ("table", "log.csv", _table(), {"columns": "map.toml"}),
        ("ros2", "a.mcap", {"a.mcap": _ros2()}, {}),
        ("totalcapture", "s1", _below("s1", written(totalcapture_samples.write)), {}),
    ]


def _below(folder: str, files: Files) -> dict[str, bytes]:
    return {f"{folder}/{name}": content for name, content in files.items()}


def _row(*values: object, separator: str = ",") -> str:
    return separator.join(f"{one:.6f}" if isinstance(one, float) else str(one) for one in values)


def _opensim_export() -> dict[str, bytes]:
    names = ("pelvis_imu", "tibia_l_imu")
    files = dict(written(lambda folder: _quaternion_table(folder / "walk_Orientations.sto")))
    for file, quantity in (("walk_Accel.trc", 1), ("walk_Gyro.trc", 2)):
        lines = [
            f"PathFileType\t4\t(X/Y/Z)\t{file}",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
            f"100\t100\t{ROWS}\t2\tm\t100\t1\t{ROWS}",
            "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
            "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
            "",
        ]
        for i in range(ROWS):
            values = np.concatenate([sample(seed, ROWS)[quantity][i] for seed in (1, 2)])
            lines.append(_row(i + 1, float(678 + i / 100), *values, separator="\t"))
        files[file] = ("\n".join(lines) + "\n").encode()
    return files


def _table() -> dict[str, bytes]:
    head, rows = ["t"], [[i / 50.0] for i in range(ROWS)]
    text = ['time = "t"', 'time_unit = "s"', 'acceleration_unit = "m/s2"', 'angular_rate_unit = "rad/s"',
            'quaternion_order = "wxyz"', 'quaternion_sense = "sensor_to_world"', 'world_up = "z"']  # fmt: skip
    for number, name in enumerate(("pelvis", "left shank")):
        R, force, rate = sample(number, ROWS)
        q_wxyz = quaternion_from_matrix(R, Order.WXYZ)
        text += [f'[sensors."{name}"]', 'file = "log.csv"']
        for quantity, values in (("acceleration", force), ("angular_rate", rate), ("quaternion", q_wxyz)):
            columns = [f"{number}_{quantity}_{axis}" for axis in range(values.shape[1])]
            head += columns
            text.append(f"{quantity} = {columns}")
            for i, row in enumerate(rows):
                row += values[i].tolist()
    table = "\n".join([",".join(head), *(_row(*row) for row in rows), ""])
    return {"log.csv": table.encode(), "map.toml": "\n".join(text).encode()}


def _ros2() -> bytes:
    import struct

    from tests.studies.fuzz.containers import mcap_of

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    schema = struct.pack("<H", 1) + text("sensor_msgs/msg/Imu") + text("ros2msg") + text("float64 x")
    records = [(0x01, text("ros2") + text("")), (0x03, schema)]
    for number, name in enumerate(("pelvis", "left_shank"), start=1):
        channel = struct.pack("<HH", number, 1) + text(f"/imu/{name}") + text("cdr") + struct.pack("<I", 0)
        records.append((0x04, channel))
        R, force, rate = sample(number, ROWS)
        quaternion = quaternion_from_matrix(R, Order.XYZW)
        for i in range(ROWS):
            frame = name.encode() + b"\0"
            head = b"\0\1\0\0" + struct.pack("<iII", 1_700_000_000, i * 10_000_000, len(frame)) + frame
            head += b"\0" * (-(len(head) - 4) % 8)
            numbers = [*quaternion[i], *[0.0] * 9, *rate[i], *[0.0] * 9, *force[i], *[0.0] * 9]
            time_ns = 1_700_000_000_000_000_000 + i * 10_000_000
            content = struct.pack("<HIQQ", number, i, time_ns, time_ns) + head + struct.pack("<37d", *numbers)
            records.append((0x05, content))
    return mcap_of([*records, (0x0F, b"\0" * 4), (0x02, b"\0" * 20)])


def _mtw(folder: Path, names: Sequence[str]) -> None:
    for seed, name in enumerate(names):
        write_mtw(folder / f"{name}.txt", columns_of(*turning(ROWS, seed)), np.arange(65530.0, 65530.0 + ROWS) % 65536)


def _dot(folder: Path) -> None:
    for seed, name in enumerate(NAMES):
        R, force, _ = turning(ROWS, seed)
        write_dot(
            folder / f"{name}_20210820_202113_836.csv", R, force, np.linspace(1000.0, 1000.0 + 16667 * (ROWS - 1), ROWS)
        )


def _quaternion_table(path: Path) -> None:
    R = np.stack([sample(seed, ROWS)[0] for seed in (1, 2)], axis=1)
    write_quaternions(path, R, ["pelvis_imu", "tibia_l_imu"])
