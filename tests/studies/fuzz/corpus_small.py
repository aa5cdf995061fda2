"""Motions, 2D poses, cameras, bodies and settings: whole files of each, as programs and people write them."""

import json
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tests.studies.fuzz.case import Case, files_below
from vip_factors.body.anthropometry import LengthPrior, likely_body
from vip_factors.body.keypoints import OFFSET_KEYPOINTS, KeypointOffsets, PooledOffsets, keypoint_set
from vip_factors.body.lengths import LENGTHS
from vip_factors.cli.info_text import motion_text
from vip_factors.cli.settings_file import read_settings
from vip_factors.configurations import configured
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.settings import Settings, flatten
from vip_factors.simulate.gestures import gestures

PLAIN_CAMERA = (
    "width = 640\nheight = 480\nfx = 500\nfy = 500.5\ncx = 320\ncy = 240\ndistortion = [0.1, -0.2, 0.001, 0]\n"
)
FLOOR = "[floor]\nR_floor_camera = [[1,0,0],[0,0,1],[0,-1,0]]\np_floor_camera = [0.0, -3.0, 1.2]\n"
OPENCV_YAML = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 320., 0., 510., 240., 0., 0., 1. ]
dist_coeffs: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, -0.2, 0.001, 0.002, 0.05 ]
"""
OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>500. 0. 320. 0. 510. 240. 0. 0. 1.</data></camera_matrix>
<dist_coeffs type_id="opencv-matrix"><rows>1</rows><cols>4</cols><dt>d</dt><data>0.1 -0.2 0.001 0.</data></dist_coeffs>
</opencv_storage>
"""
OPENCV_JSON = {
    "camera_matrix": [[500, 0, 320], [0, 510, 240], [0, 0, 1]],
    "dist_coeffs": [[0.1, -0.2, 0.001, 0.002, 0.05]],
    "image_size": [640, 480],
}
POSE2SIM = """[left]
name = "left"
size = [1088.0, 1920.0]
matrix = [[1681.2, 0.0, 532.9], [0.0, 1681.0, 948.1], [0.0, 0.0, 1.0]]
distortions = [-0.05, 0.1, 0.0, 0.0]
rotation = [1.57, 0.0, 0.0]
translation = [0.5, 1.5, 4.0]
fisheye = false

[metadata]
adjusted = false
"""


def small_cases() -> list[Case]:
    return [*_motions(), *_detections(), *_cameras(), *_bodies(), _settings()]


def _motions() -> list[Case]:
    from vip_factors.io.export.animation import write_bvh
    from vip_factors.io.export.files import ExportSettings
    from vip_factors.io.export.smpl import write_amass
    from vip_factors.io.motions import read_motion

    def read(folder: Path, name: str) -> None:
        motion_text(read_motion(folder / name))

    motion = gestures(0.05)
    estimate = Estimate("a", "IT", (WearerEstimate("a", "IT", motion, {}),))
    with TemporaryDirectory() as name:
        write_bvh(estimate, Path(name, "a.bvh"), ExportSettings())
        write_amass(estimate, Path(name, "a.npz"), ExportSettings())
        files = files_below(Path(name))
    files |= {"07.asf": _asf().encode(), "07_01.amc": _amc().encode()}
    together = {"bvh": ("a.bvh",), "amass": ("a.npz",), "asf-amc": ("07_01.amc", "07.asf")}
    return [
        Case(
            kind,
            {one: files[one] for one in names},
            partial(read, name=names[0]),
            f"vip-factors info {{}}/{names[0]}",
            seldom=5 if kind == "asf-amc" else 2,
        )
        for kind, names in together.items()
    ]


_SIDE = {
    "hipjoint": ("root", (1, -0.6, 0), 2.0, ""), "femur": ("hipjoint", (0.34, -0.94, 0), 7.4, "rx ry rz"),
    "tibia": ("femur", (0.34, -0.94, 0), 7.4, "rx"), "foot": ("tibia", (0, -0.26, 0.97), 2.3, "rx rz"),
    "toes": ("foot", (0, 0, 1), 1.0, "rx"), "clavicle": ("thorax", (1, 0.2, 0), 3.2, "ry rz"),
    "humerus": ("clavicle", (1, 0, 0), 5.1, "rx ry rz"), "radius": ("humerus", (1, 0, 0), 3.2, "rx"),
    "wrist": ("radius", (1, 0, 0), 1.6, "ry"), "hand": ("wrist", (1, 0, 0), 0.9, "rx rz"),
    "fingers": ("hand", (1, 0, 0), 1.0, "rx"),
}  # fmt: skip
_MIDDLE = ("root", "lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head")


def _bones() -> dict[str, tuple[str, tuple[float, float, float], float, str]]:
    """Parent, direction, length and degrees of freedom, as of the figures of CMU."""
    bones = {name: (above, (0.0, 1.0, 0.0), 2.0, "rx ry rz") for above, name in pairwise(_MIDDLE)}
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for name, (above, (x, y, z), length, freedom) in _SIDE.items():
            bones[side + name] = (above if above in _MIDDLE else side + above, (sign * x, y, z), length, freedom)
    return bones


def _asf() -> str:
    bones = _bones()
    lines = [":version 1.10", ":units", "  length 0.45", "  angle deg", ":root", "  order TX TY TZ RX RY RZ",
             "  axis XYZ", "  position 0 0 0", "  orientation 0 0 0", ":bonedata"]  # fmt: skip
    for number, (name, (_, direction, length, freedom)) in enumerate(bones.items(), start=1):
        lines += ["  begin", f"    id {number}", f"    name {name}", "    direction {} {} {}".format(*direction)]
        lines += [f"    length {length}", "    axis 0 0 20 XYZ"]
        lines += [f"    dof {freedom}", "    limits (-90 90)"] if freedom else []
        lines += ["  end"]
    lines += [":hierarchy", "  begin"]
    for above in ("root", *bones):
        below = [name for name, bone in bones.items() if bone[0] == above]
        lines += [f"    {above} {' '.join(below)}"] if below else []
    return "\n".join([*lines, "  end"]) + "\n"


def _amc() -> str:
    lines = ["#!OML:ASF somewhere", ":FULLY-SPECIFIED", ":DEGREES"]
    for number in range(1, 4):
        lines += [str(number), "root 0 17 0 0 0 0"]
        lines += [f"{name} " + " ".join(["1.5"] * len(bone[3].split())) for name, bone in _bones().items() if bone[3]]
    return "\n".join(lines) + "\n"


def _detections() -> list[Case]:
    from vip_factors.io.detections.read import read_detections

    def read(folder: Path, name: str) -> None:
        read_detections(folder / name, 30.0)

    rows = np.column_stack([100.0 + 10 * np.arange(34).reshape(17, 2), np.full(17, 0.8)])
    flat, body25 = rows.ravel().tolist(), np.tile([120.5, 80.25, 0.7], 25).tolist()
    openpose = {
        f"poses/walk_{number:012d}_keypoints.json": {
            "version": 1.3,
            "people": [{"person_id": [-1], "pose_keypoints_2d": body25, "face_keypoints_2d": []}] * 2,
        }
        for number in range(3)
    }
    coco = [{"image_id": number, "category_id": 1, "keypoints": flat, "score": 0.9} for number in range(3)]
    alphapose = [one | {"image_id": f"{one['image_id']}.jpg", "box": [0, 0, 1, 1], "idx": [0.0]} for one in coco]
    instance = {"keypoints": rows[:, :2].tolist(), "keypoint_scores": rows[:, 2].tolist(), "bbox_score": 0.9}
    frames = [{"frame_id": number, "instances": [instance] * 2} for number in range(1, 4)]
    names = {str(i): name for i, name in enumerate(keypoint_set("coco17").keypoints)}
    mmpose = {"meta_info": {"dataset_name": "coco", "keypoint_id2name": names}, "instance_info": frames}
    trees: dict[str, dict[str, Any]] = {
        "alphapose": {"a.json": alphapose},
        "mmpose": {"a.json": mmpose},
        "coco": {"a.json": coco},
    }
    cases = []
    kinds: dict[str, dict[str, Any]] = {"openpose": openpose, **trees}
    for kind, files in kinds.items():
        name = "poses" if kind == "openpose" else "a.json"
        command = f"vip-factors convert RECORDING.mcap out.mcap --detections {{}}/{name} --camera CAMERA.toml"
        content = {one: json.dumps(tree).encode() for one, tree in files.items()}
        cases.append(Case(kind, content, partial(read, name=name), command + " --video-rate 30"))
    return cases


def _cameras() -> list[Case]:
    from vip_factors.io.camera_file import read_camera_file, read_floor

    def read(folder: Path, name: str) -> None:
        read_camera_file(folder / name)
        read_floor(folder / name)

    files = {
        "camera-toml": ("camera.toml", PLAIN_CAMERA + FLOOR), "camera-yaml": ("camera.yaml", OPENCV_YAML),
        "camera-xml": ("camera.xml", OPENCV_XML), "camera-json": ("camera.json", json.dumps(OPENCV_JSON)),
        "pose2sim": ("Calib.toml", POSE2SIM),
    }  # fmt: skip
    command = "vip-factors convert RECORDING.mcap out.mcap --detections POSES.json --camera {}/"
    return [
        Case(kind, {name: text.encode()}, partial(read, name=name), command + name)
        for kind, (name, text) in files.items()
    ]


def _bodies() -> list[Case]:
    from vip_factors.io.body_file import BodyFile, read_body_file, write_body_file
    from vip_factors.io.keypoint_offsets_file import KeypointOffsetsFile, read_keypoint_offsets, write_keypoint_offsets

    likely, lengths = likely_body(1.7), LengthPrior(LENGTHS, 1e-4 * np.eye(len(LENGTHS)))
    shape = (len(OFFSET_KEYPOINTS), 3)
    offsets = PooledOffsets(KeypointOffsets(np.full(shape, 0.01), np.full(shape, 0.02)), 2)
    with TemporaryDirectory() as name:
        write_body_file(Path(name, "body.toml"), BodyFile("Ada", likely.skeleton, lengths, (), "made"))
        write_keypoint_offsets(Path(name, "offsets.toml"), KeypointOffsetsFile({"body25": offsets}, "made"))
        files = files_below(Path(name))
    readers: dict[str, tuple[str, Callable[[Path], object], str]] = {
        "body": ("body.toml", read_body_file, "vip-factors convert LOG out.mcap --body {}/body.toml"),
        "offsets": (
            "offsets.toml", read_keypoint_offsets,
            "vip-factors smooth SCENE.mcap --initialise.keypoint-offsets.learned {}/offsets.toml",
        ),
    }  # fmt: skip
    return [
        Case(kind, {name: files[name]}, partial(_read_file, name=name, read=read), command, seldom=3)
        for kind, (name, read, command) in readers.items()
    ]


def _read_file(folder: Path, name: str, read: Callable[[Path], object]) -> None:
    read(folder / name)


def _settings() -> Case:
    """All that are numbers."""

    def read(folder: Path) -> None:
        read_settings(folder / "settings.toml", Settings(), lambda name: configured(Settings(), name))

    lines = [f"{name} = {value}" for name, value in flatten(Settings()).items() if _is_number(value)]
    command = "vip-factors smooth RECORDING.mcap --settings {}/settings.toml"
    return Case("settings", {"settings.toml": "\n".join([*lines, ""]).encode()}, read, command, seldom=4)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
