"""Sensor logs of all formats, a few samples each, written here in the form that their makers give them."""

from functools import partial
from pathlib import Path

import numpy as np

from tests.studies.fuzz.case import Case, Files
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.cli.info_text import recording_text
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, exp, rotation_x
from vip_factors.io.convert import ImportOptions, import_recording
from vip_factors.io.convert_template import write_templates

ROWS = 8
NAMES = ("Pelvis", "LeftShank", "RightForeArm")
GRAVITY = np.array([0.0, 0.0, 9.81])
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
    txt = {f"{name}.txt": _xsens_txt(row) for row, name in enumerate(NAMES)}
    mapped = {"a-000_00B1.txt": _xsens_txt(0), "a-000_00B2.txt": _xsens_txt(1), "m.xml": xml}
    dot = {f"{name}_20210820_202113_836.csv": _xsens_dot(row) for row, name in enumerate(NAMES)}
    return [
        ("xsens-txt", "log", _below("log", txt), {}),
        ("placement-toml", "log", _below("log", txt) | {"p.toml": placement}, {"placement": "p.toml"}),
        ("placement-json", "log", _below("log", txt) | {"p.json": json}, {"placement": "p.json"}),
        ("opensense-xml", "log", _below("log", mapped), {"placement": "log/m.xml"}),
        ("xsens-dot", "log", _below("log", dot), {}),
        ("mvnx", "a.mvnx", {"a.mvnx": _mvnx()}, {}),
        ("apdm-7", "a.csv", {"a.csv": _apdm_7()}, {}),
        ("apdm-named", "a.csv", {"a.csv": _apdm_named()}, {}),
        ("opensense-sto", "a.sto", {"a.sto": _quaternion_table()}, {}),
        ("opensim-export", "log", _below("log", _opensim_export()), {}),
        ("table", "log.csv", _table(), {"columns": "map.toml"}),
        ("ros2", "a.mcap", {"a.mcap": _ros2()}, {}),
        ("totalcapture", "s1", _below("s1", _totalcapture()), {}),
    ]


def _below(folder: str, files: dict[str, bytes]) -> dict[str, bytes]:
    return {f"{folder}/{name}": content for name, content in files.items()}


def _sample(seed: int, rows: int = ROWS) -> tuple[Array, Array, Array]:
    """Orientation, specific force and angular rate of a sensor that turns."""
    random = np.random.default_rng(seed)
    rate = random.normal(size=3)
    R = exp(random.normal(size=3)) @ exp(0.01 * np.arange(rows)[:, None] * rate)
    return R, np.einsum("nji,j->ni", R, GRAVITY), np.tile(rate, (rows, 1))


def _quaternions(R: Array) -> Array:
    return quaternion_from_matrix(R, Order.WXYZ)


def _row(*values: object, separator: str = ",") -> str:
    return separator.join(f"{one:.6f}" if isinstance(one, float) else str(one) for one in values)


def _xsens_txt(seed: int) -> bytes:
    R, force, rate = _sample(seed)
    head = "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tQuat_q0\tQuat_q1\tQuat_q2\tQuat_q3"
    rows = [
        _row(65530 + i if i < 6 else i - 6, "", *force[i], *rate[i], *_quaternions(R)[i], separator="\t")
        for i in range(ROWS)
    ]
    return "\n".join(["// Start Time: Unknown", "// Update Rate: 100.0Hz", head, *rows, ""]).encode()


def _xsens_dot(seed: int) -> bytes:
    R, _, _ = _sample(seed)
    start = "sep=,\nDeviceTag:,abc\nOutputRate:,60Hz\nStartTime: ,2021-08-20_20:21:13_839 GMT+8\n© Xsens\n\n"
    head = "PacketCounter,SampleTimeFine,Quat_W,Quat_X,Quat_Y,Quat_Z,FreeAcc_X,FreeAcc_Y,FreeAcc_Z,Gyr_X,Gyr_Y,Gyr_Z"
    rows = [_row(i + 1, 1000 + 16667 * i, *_quaternions(R)[i], 0.1, 0.2, 0.3, 9.0, 0.0, 0.0) for i in range(ROWS)]
    return (start + "\n".join([head, *rows])).encode()


def _apdm_7() -> bytes:
    first, quantities, axes = ["Format=7"], ["Time"], [""]
    for i, name in enumerate(("Lumbar", "Right Ankle")):
        first += [str(5700 + i), "", "", name, *[""] * 10]
        quantities += ["Accelerometer", "", "", "Gyroscope", "", "", "Magnetometer", "", "", "Barometer", "Orientation"]
        quantities += [""] * 3
        axes += [*"XYZXYZXYZ", "", "S", "X", "Y", "Z"]
    rows = []
    for i in range(ROWS):
        cells: list[object] = [1550879504438281 + round(i * 1e6 / 128)]
        for seed in (1, 2):
            R, force, rate = _sample(seed)
            cells += [*force[i], *rate[i], 0.1, 0.2, 0.3, 4.6, *_quaternions(R)[i]]
        rows.append(_row(*cells))
    return "\n".join([*(",".join(one) for one in (first, quantities, axes)), *rows, ""]).encode()


def _apdm_named() -> bytes:
    names, units = ["Time"], ["s"]
    for name in ("Lumbar", "Right Ankle"):
        names += [f"{name}/{what}/{axis}" for what in ("Acceleration", "Angular Velocity") for axis in "XYZ"]
        names += [f"{name}/Orientation/{axis}" for axis in ("Scalar", "X", "Y", "Z")]
        units += ["m/s^2"] * 3 + ["rad/s"] * 3 + [""] * 4
    rows = []
    for i in range(ROWS):
        cells: list[object] = [0.25 + i / 128]
        for seed in (1, 2):
            R, force, rate = _sample(seed)
            cells += [*force[i], *rate[i], *_quaternions(R)[i]]
        rows.append(_row(*cells))
    return "\n".join(["Test Name:,Swing", "Sample Rate:,128,Hz", ",".join(names), ",".join(units), *rows, ""]).encode()


def _quaternion_table() -> bytes:
    header = "DataRate=100.000000\nDataType=Quaternion\nversion=3\nOpenSimVersion=4.1\nendheader\n"
    lines = ["time\tpelvis_imu\ttibia_l_imu"]
    for i in range(ROWS):
        cells = (_row(*_quaternions(_sample(seed)[0])[i]) for seed in (1, 2))
        lines.append("\t".join([f"{678 + i / 100:.2f}", *cells]))
    return (header + "\n".join(lines) + "\n").encode()


def _opensim_export() -> dict[str, bytes]:
    names = ("pelvis_imu", "tibia_l_imu")
    files = {"walk_Orientations.sto": _quaternion_table()}
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
            values = np.concatenate([_sample(seed)[quantity][i] for seed in (1, 2)])
            lines.append(_row(i + 1, float(678 + i / 100), *values, separator="\t"))
        files[file] = ("\n".join(lines) + "\n").encode()
    return files


def _table() -> dict[str, bytes]:
    head, rows = ["t"], [[i / 50.0] for i in range(ROWS)]
    text = ['time = "t"', 'time_unit = "s"', 'acceleration_unit = "m/s2"', 'angular_rate_unit = "rad/s"',
            'quaternion_order = "wxyz"', 'quaternion_sense = "sensor_to_world"', 'world_up = "z"']  # fmt: skip
    for number, name in enumerate(("pelvis", "left shank")):
        R, force, rate = _sample(number)
        text += [f'[sensors."{name}"]', 'file = "log.csv"']
        for quantity, values in (("acceleration", force), ("angular_rate", rate), ("quaternion", _quaternions(R))):
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
        R, force, rate = _sample(number)
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


_JOINTS = {
    "Hips": "pelvis", "Spine": "spine1", "Spine1": "spine1", "Spine2": "spine2", "Spine3": "spine3", "Neck": "neck",
    "Head": "head",
} | {
    f"{side}{theirs}": f"{side.lower()}_{ours}"
    for side in ("Right", "Left")
    for theirs, ours in {
        "Shoulder": "collar", "Arm": "shoulder", "ForeArm": "elbow", "Hand": "wrist", "UpLeg": "hip", "Leg": "knee",
        "Foot": "ankle",
    }.items()
}  # fmt: skip
_SENSORS = {"Head": "head", "Sternum": "spine3", "Pelvis": "pelvis"} | {
    f"{side[0]}_{theirs}": f"{side.lower()}_{ours}"
    for side in ("Left", "Right")
    for theirs, ours in {
        "UpArm": "shoulder", "LowArm": "elbow", "UpLeg": "hip", "LowLeg": "knee", "Foot": "ankle",
    }.items()
}  # fmt: skip


def _totalcapture() -> dict[str, bytes]:
    up, frames = rotation_x(-np.pi / 2), 20
    R = exp(0.1 * np.sin(np.arange(frames)[:, None, None] / 10 + np.arange(72).reshape(24, 3)))
    R[:, 0] = rotation_x(np.pi / 2) @ R[:, 0]
    state = forward_kinematics(skeleton_from_stature(1.8), R, np.tile([0.3, -0.2, 1.0], (frames, 1)))
    rows = [joint_index(bone) for bone in _JOINTS.values()]
    p = state.p_world_joint[:, rows] @ up.T / 0.0254
    q = quaternion_from_matrix(up @ state.R_world_bone[:, rows], Order.XYZW)
    header, files = "\t".join(_JOINTS) + "\t", {}
    for name, values in (("pos", p), ("ori", q)):
        lines = [header, *("\t".join(_row(*row, separator=" ") for row in frame) + "\t" for frame in values)]
        files[f"gt_skel_gbl_{name}.txt"] = ("\n".join(lines) + "\n").encode()
    for kind, matrix in (("bone", np.eye(3)), ("ref", up)):
        quaternion = _row(*quaternion_from_matrix(matrix, Order.XYZW), separator=" ")
        lines = ["13", *(f"{sensor} {quaternion}" for sensor in _SENSORS)]
        files[f"s1_a_calib_imu_{kind}.txt"] = ("\n".join(lines) + "\n").encode()
    lines = [f"13\t{frames}"]
    for t in range(frames):
        lines.append(str(t + 1))
        for sensor, bone in _SENSORS.items():
            R_sensor = state.R_world_bone[t, joint_index(bone)]
            numbers = _row(*_quaternions(R_sensor), *(R_sensor.T @ GRAVITY), separator=" ")
            lines.append(f"{sensor}\t{numbers}")
    files["s1_a_Xsens.sensors"] = ("\n".join(lines) + "\n").encode()
    return files


_LIMBS = {
    "Shoulder": ("T8", (0, 0.03, 0.07)), "UpperArm": ("Shoulder", (0, 0.14, 0)), "ForeArm": ("UpperArm", (0, 0.27, 0)),
    "Hand": ("ForeArm", (0, 0.23, 0)), "UpperLeg": ("Pelvis", (0, 0.09, 0)), "LowerLeg": ("UpperLeg", (0, 0, -0.4)),
    "Foot": ("LowerLeg", (0, 0, -0.41)), "Toe": ("Foot", (0.15, 0, -0.07)),
}  # fmt: skip
_SEGMENTS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "Pelvis": ("", (0, 0, 0)), "L5": ("Pelvis", (0, 0, 0.1)), "L3": ("L5", (0, 0, 0.1)), "T12": ("L3", (0, 0, 0.09)),
    "T8": ("T12", (0, 0, 0.09)), "Neck": ("T8", (0, 0, 0.12)), "Head": ("Neck", (0, 0, 0.09)),
} | {
    side + name: (above if above in ("T8", "Pelvis") else side + above, (x, y * sign, z))
    for side, sign in (("Right", -1), ("Left", 1))
    for name, (above, (x, y, z)) in _LIMBS.items()
}  # fmt: skip


def _mvnx() -> bytes:
    names, p = list(_SEGMENTS), np.zeros((23, 3))
    segments, joints, numbers = "", "", partial(_row, separator=" ")
    for row, (name, (above, offset)) in enumerate(_SEGMENTS.items()):
        p[row] = p[names.index(above)] + offset if above else (0.1, 0.2, 0.9)
        points = {f"j{name}": (0.0, 0.0, 0.0)} if above else {}
        points |= {f"j{child}": at for child, (up, at) in _SEGMENTS.items() if up == name}
        points |= {"pTopOfHead": (0, 0, 0.17)} if name == "Head" else {}
        tags = "".join(
            f'<point label="{point}"><pos_b>{numbers(*map(float, at))}</pos_b></point>' for point, at in points.items()
        )
        segments += f'<segment label="{name}" id="{row + 1}"><points>{tags}</points></segment>'
        if above:
            ends = f"<connector1>{above}/j{name}</connector1><connector2>{name}/j{name}</connector2>"
            joints += f'<joint label="j{name}">{ends}</joint>'
    still = numbers(*(1.0, 0.0, 0.0, 0.0) * 23)
    frames = (
        f'<frame time="0" type="identity"><orientation>{still}</orientation>'
        f"<position>{numbers(*p.ravel())}</position></frame>"
    )
    for t in range(4):
        sensors = np.stack([_quaternions(_sample(seed)[0][t]) for seed in range(3)])
        frames += (
            f'\n<frame time="{t * 17}" index="{t}" ms="{1542082631842 + t * 17}" type="normal">'
            f"<orientation>{still}</orientation><position>{numbers(*p.ravel())}</position>"
            f"<sensorOrientation>{numbers(*sensors.ravel())}</sensorOrientation>"
            f"<sensorFreeAcceleration>{numbers(*[0.5] * 9)}</sensorFreeAcceleration></frame>"
        )
    labels = "".join(f'<sensor label="{name}"/>' for name in ("Pelvis", "T8", "LeftForeArm"))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4">'
        f'<mvn version="2019.0.0"/><comment/><subject label="x" frameRate="60" segmentCount="23">\n'
        f"<segments>{segments}</segments>\n<sensors>{labels}</sensors>\n<joints>{joints}</joints>\n"
        f'<frames sensorCount="3">{frames}</frames></subject></mvnx>'
    ).encode()
