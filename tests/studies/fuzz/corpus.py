"""Small whole files of every format that is not the package's own, as programs and people write them, and what reads
each: sensor logs, motions, 2D poses, cameras, bodies, settings, and what was trained or kept.

Left out on purpose: BlazePose's models (nothing here can write a small one), WebSocket's handshake and frames (the
library's; what its messages hold is in), Rerun files (written, never read), the published data sets that studies read,
and messages between the package's own processes.
"""

import json
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

import numpy as np
from ros2_samples import imu, write_ros2

from tests.io import mvnx_samples, totalcapture_samples
from tests.io.camera_samples import GOOD, PLAIN, POSE2SIM, write_opencv
from tests.io.pose_files import person, write_alphapose, write_coco, write_mmpose, write_openpose
from tests.io.table_samples import (
    Layout,
    columns_of,
    made_up,
    turning,
    write_dot,
    write_export,
    write_format7,
    write_log,
    write_mtw,
    write_named,
    write_quaternions,
)
from tests.onnx_samples import simcc_model
from tests.studies.fuzz.run import Case, Files
from tests.studies.train_keypoints import keypoint_offsets_text
from vip_factors.associate.weights import SHIPPED_WEIGHTS, load_weights
from vip_factors.body.anthropometry import LengthPrior, likely_body
from vip_factors.body.keypoints import OFFSET_KEYPOINTS, KeypointOffsets, keypoint_set
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import LENGTHS
from vip_factors.cli.options import read_settings
from vip_factors.cli.terminal import terminal_text
from vip_factors.describe.recordings import motion_facts, recording_tables
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.io.body_file import BodyFile, read_body_file, write_body_file
from vip_factors.io.camera_file import read_camera_file
from vip_factors.io.convert import ImportOptions, import_recording, write_templates
from vip_factors.io.detections import read_detections, read_keypoint_offsets
from vip_factors.io.export.animation import write_bvh
from vip_factors.io.export.files import ExportSettings
from vip_factors.io.export.smpl import write_amass
from vip_factors.io.live_open import read_token
from vip_factors.io.motions.files import read_motion
from vip_factors.settings import Settings, flatten
from vip_factors.simulate.gestures import gestures

ROWS = 8
NAMES = ("Pelvis", "LeftShank", "RightForeArm")
FLOOR = "[floor]\nR_floor_camera = [[1,0,0],[0,0,1],[0,-1,0]]\np_floor_camera = [0.0, -3.0, 1.2]\n"
XML = (
    '<OpenSimDocument><R><ExperimentalSensors><ExperimentalSensor name="_00B1"><name_in_model>pelvis_imu'
    '</name_in_model></ExperimentalSensor><ExperimentalSensor name="_00B2"><name_in_model>tibia_l_imu</name_in_model>'
    "</ExperimentalSensor></ExperimentalSensors></R></OpenSimDocument>"
)
PLACEMENT = (
    'stature_m = 1.7\nsubject = "Ada"\ninitial_pose = "t-pose"\n[segment_lengths_m]\nthigh = 0.42\n[sensors]\n'
    'Pelvis = "pelvis"\nLeftShank = { site = "left_shank", sigma_deg = 10 }\n'
)
PLACEMENT_JSON = (
    '{"stature_m": 1.7, "sex": "male", "sensors": {"Pelvis": "pelvis", "RightForeArm": {"site": "right_forearm"}}}'
)


def all_cases() -> list[Case]:
    """One of each format that the commands read."""
    from tests.studies.fuzz.corpus_scenes import scene_cases

    return [*log_cases(), *_file_cases(), *_model_cases(), *scene_cases()]


def written(write: Callable[[Path], object]) -> dict[str, bytes]:
    """All files that something writes into a folder."""
    with TemporaryDirectory() as name:
        write(Path(name))
        return {str(p.relative_to(name)): p.read_bytes() for p in sorted(Path(name).rglob("*")) if p.is_file()}


# Sensor logs


def log_cases() -> list[Case]:
    """One case for each format of logs: what is converted, its files, options that name further files, how seldom."""
    opals = {"Lumbar": turning(seed=1), "Right Ankle": turning(seed=2)}
    logs: tuple[tuple[str, str, Callable[[], Files], dict[str, str], int], ...] = (
        ("xsens-txt", "log", xsens_log, {}, 4),
        ("placement-toml", "log", lambda: {**xsens_log(), "p.toml": PLACEMENT.encode()}, {"placement": "p.toml"}, 4),
        ("placement-json", "log", lambda: {**xsens_log(), "p.json": PLACEMENT_JSON.encode()},
         {"placement": "p.json"}, 4),
        ("opensense-xml", "log", lambda: {**xsens_log("a-000_00B1", "a-000_00B2"), "log/m.xml": XML.encode()},
         {"placement": "log/m.xml"}, 4),
        ("xsens-dot", "log", partial(written, _dot), {}, 4),
        ("mvnx", "a.mvnx",
         partial(written, lambda folder: mvnx_samples.write(folder / "a.mvnx", mvnx_samples.motion())), {}, 8),
        ("apdm-7", "a.csv", partial(written, lambda folder: write_format7(folder / "a.csv", opals)), {}, 3),
        ("apdm-named", "a.csv",
         partial(written, lambda folder: write_named(folder / "a.csv", opals, ("m/s^2", "rad/s"))), {}, 4),
        ("opensense-sto", "a.sto", partial(written, lambda folder: _quaternions(folder / "a.sto")), {}, 4),
        ("opensim-export", "log",
         partial(written, lambda folder: write_export(folder / "log", made_up(1, ROWS))), {}, 4),
        ("table", "log.csv", _table, {"columns": "map.toml"}, 4),
        ("ros2", "a.mcap", partial(written, _ros2), {}, 4),
        ("totalcapture", "s1",
         partial(written, lambda folder: totalcapture_samples.write(_below(folder, "s1"))), {}, 12),
    )  # fmt: skip
    cases = []
    for name, path, make, options, seldom in logs:
        command = f"vip-factors convert {{}}/{path} out.mcap" + "".join(f" --{k} {{}}/{v}" for k, v in options.items())
        cases.append(Case(name, make, partial(_read_log, path=path, options=options), command, seldom=seldom))
    return [
        *cases,
        Case("template", lambda: {"log.csv": _table()["log.csv"]},
             lambda folder: write_templates(folder / "log.csv", folder / "template", overwrite=True),
             "vip-factors convert {}/log.csv --template {}/template", seldom=6),
    ]  # fmt: skip


def _read_log(folder: Path, path: str, options: dict[str, str]) -> None:
    """As ``convert`` does."""
    told = {key: (folder / value if key == "columns" else str(folder / value)) for key, value in options.items()}
    terminal_text(recording_tables(import_recording(folder / path, ImportOptions(**told))))  # type: ignore[arg-type]


def _below(folder: Path, name: str) -> Path:
    (folder / name).mkdir()
    return folder / name


def xsens_log(*names: str) -> dict[str, bytes]:
    """Of sensors with these names, in the folder log."""

    def write(folder: Path) -> None:
        for seed, name in enumerate(names or NAMES):
            counter = np.arange(65530.0, 65530.0 + ROWS) % 65536
            write_mtw(folder / f"{name}.txt", columns_of(*turning(ROWS, seed)), counter)

    return written(lambda folder: write(_below(folder, "log")))


def _dot(folder: Path) -> None:
    folder = _below(folder, "log")
    for seed, name in enumerate(NAMES):
        R, force, _ = turning(ROWS, seed)
        clock = np.linspace(1000.0, 1000.0 + 16667 * (ROWS - 1), ROWS)
        write_dot(folder / f"{name}_20210820_202113_836.csv", R, force, clock)


def _quaternions(path: Path) -> None:
    R = np.stack([turning(ROWS, seed)[0] for seed in (1, 2)], axis=1)
    write_quaternions(path, R, ["pelvis_imu", "tibia_l_imu"])


def _table() -> Files:
    return written(lambda folder: write_log(folder, made_up(1, ROWS), Layout()))


def _ros2(folder: Path) -> None:
    write_ros2(folder / "a.mcap", {f"/imu/{name}": [imu(i, name) for i in range(ROWS)] for name in NAMES[:2]})


# Motions, 2D poses, cameras, bodies, settings


def written_motions(motion: Motion) -> dict[str, bytes]:
    """A motion as the files of other programs: a.bvh, a.npz."""
    estimate = Estimate("a", "IT", (WearerEstimate("a", "IT", motion, {}),))

    def write(folder: Path) -> None:
        write_bvh(estimate, folder / "a.bvh", ExportSettings())
        write_amass(estimate, folder / "a.npz", ExportSettings())

    return written(write)


def _file_cases() -> list[Case]:
    motions = written_motions(gestures(0.05))
    poses, prepared = written(_write_poses), written(_write_bodies)
    numbers = [f"{name} = {value}" for name, value in flatten(Settings()).items() if _is_number(value)]
    convert = "vip-factors convert RECORDING.mcap out.mcap"

    def case(
        name: str, files: Files, read: Callable[[Path], object], command: str, seldom: int = 1, first: str = ""
    ) -> Case:
        file = first or next(iter(files))
        return Case(name, lambda: files, lambda folder: read(folder / file), f"{command}{{}}/{file}", seldom=seldom)

    def some(files: Files, *names: str) -> Files:
        return {name: files[name] for name in names}

    def motion(path: Path) -> None:
        terminal_text([motion_facts(read_motion(path))])

    def camera(path: Path) -> None:
        path = path.with_name(f"{path.name}:left") if path.name == "Calib.toml" else path  # one of two cameras
        read_camera_file(path)

    return [
        case("bvh", some(motions, "a.bvh"), motion, "vip-factors info ", 2),
        case("amass", some(motions, "a.npz"), motion, "vip-factors info ", 2),
        *(
            case(kind, {one: data for one, data in poses.items() if one.startswith(kind)},
                 lambda path: read_detections(path, 30.0),
                 f"{convert} --camera CAMERA.toml --video-rate 30 --detections ", first=first)
            for kind, first in (("openpose", "openpose"), ("alphapose", ""), ("mmpose", ""), ("coco", ""))
        ),
        *(
            case(f"camera-{name.partition('.')[2]}" if name != "Calib.toml" else "pose2sim", {name: data}, camera,
                 f"{convert} --detections POSES.json --camera ")
            for name, data in written(_write_cameras).items()
        ),
        case("body", some(prepared, "body.toml"), read_body_file, "vip-factors convert LOG out.mcap --body ", 3),
        case("offsets", some(prepared, "offsets.toml"), read_keypoint_offsets,
             "vip-factors smooth SCENE.mcap --initialise.keypoint-offsets.learned ", 3),
        case("settings", {"settings.toml": "\n".join([*numbers, ""]).encode()},
             lambda path: read_settings(path, Settings()),
             "vip-factors smooth RECORDING.mcap --settings ", 4),
        case("token", {"token.txt": b"c2VjcmV0\n"}, read_token,
             "vip-factors stream ws://0.0.0.0:5555 --token-file ", 3),
        case("weights", {SHIPPED_WEIGHTS.name: SHIPPED_WEIGHTS.read_bytes()}, partial(_afresh, read=load_weights),
             "vip-factors smooth SCENE.mcap --association.weights ", 3),
    ]  # fmt: skip


def _write_poses(folder: Path) -> None:
    write_openpose(folder / "openpose", {number: [person("body25")] * 2 for number in range(3)})
    for kind, write in (("alphapose", write_alphapose), ("coco", write_coco)):
        write(folder / f"{kind}.json", {number: [person()] for number in range(3)})
    people = {number: [person()] * 2 for number in range(1, 4)}
    write_mmpose(folder / "mmpose.json", people, keypoint_set("coco17").keypoints)


def _write_cameras(folder: Path) -> None:
    (folder / "camera.toml").write_text(f"{GOOD}distortion = [0.1, -0.2, 0.001, 0]\n{FLOOR}")
    (folder / "camera.json").write_text(PLAIN)
    (folder / "Calib.toml").write_text(POSE2SIM)
    for suffix in ("yaml", "xml"):
        write_opencv(folder / f"camera.{suffix}")


def _write_bodies(folder: Path) -> None:
    lengths, shape = LengthPrior(LENGTHS, 1e-4 * np.eye(len(LENGTHS))), (len(OFFSET_KEYPOINTS), 3)
    write_body_file(folder / "body.toml", BodyFile("Ada", likely_body(1.7).skeleton, lengths, (), "made"))
    offsets = KeypointOffsets(np.full(shape, 0.01), np.full(shape, 0.02))
    (folder / "offsets.toml").write_text(keypoint_offsets_text({"body25": (offsets, 2)}, "made"))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _afresh(path: Path, read: Callable[[Path], object]) -> None:
    """A copy of the file under a name that no cache knows."""
    with TemporaryDirectory(dir=path.parent) as inner:
        read(Path(copyfile(path, Path(inner, path.name))))


# Models of detectors, records of steps: what optional packages read


def _model_cases() -> list[Case]:
    cases = [Case("step-record", lambda: {"info.json": _step_record()}, _take_step, "vip-factors run", seldom=3)]
    if find_spec("onnxruntime") and find_spec("onnx"):
        command = "vip-factors detect VIDEO.mp4 --model {}/pose.onnx"
        cases.append(Case("onnx", lambda: {"pose.onnx": simcc_model()}, _onnx, command, seldom=3, apart=True))
    return cases


def _step_record() -> bytes:
    from vip_factors import __version__

    record = {"version": __version__, "parameters": "None", "inputs": {}, "files": [], "lines": ["a note"]}
    return json.dumps(record).encode()


def _take_step(folder: Path) -> None:
    """One that does nothing, as ``run`` takes it again."""
    from vip_factors.workflow import Result, Step, take

    take(Step("info", (), None, lambda overwrite, progress: Result(())), folder)


def _onnx(folder: Path) -> None:
    from vip_factors.detect.models import Box, OnnxPose

    OnnxPose(folder / "pose.onnx", threads=1).look(np.zeros((48, 64, 3), np.uint8), Box(10, 5, 40, 45))
