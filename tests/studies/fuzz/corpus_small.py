"""Motions, 2D poses, cameras, bodies and settings: whole files of each, as programs and people write them."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from tests.io.motion_samples import write_amc
from tests.io.pose_files import person, write_alphapose, write_coco, write_mmpose, write_openpose
from tests.studies.fuzz.case import Case, written, written_motions
from vip_factors.body.anthropometry import LengthPrior, likely_body
from vip_factors.body.keypoints import OFFSET_KEYPOINTS, KeypointOffsets, PooledOffsets, keypoint_set
from vip_factors.body.lengths import LENGTHS
from vip_factors.cli.info_text import motion_text
from vip_factors.cli.settings_file import read_settings
from vip_factors.configurations import configured
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
    from vip_factors.io.motions import read_motion

    def read(folder: Path, name: str) -> None:
        motion_text(read_motion(folder / name))

    files = written_motions(gestures(0.05)) | written(lambda folder: write_amc(folder / "07_01.amc", [{}, {}, {}]))
    together = {"bvh": ("a.bvh",), "amass": ("a.npz",), "asf-amc": ("07_01.amc", "07.asf")}
    return [
        Case(kind, {one: files[one] for one in names}, partial(read, name=names[0]),
             f"vip-factors info {{}}/{names[0]}", seldom=5 if kind == "asf-amc" else 2)
        for kind, names in together.items()
    ]  # fmt: skip


def _detections() -> list[Case]:
    from vip_factors.io.detections.read import read_detections

    def read(folder: Path, name: str) -> None:
        read_detections(folder / name, 30.0)

    names = keypoint_set("coco17").keypoints

    def write_all(folder: Path) -> None:
        write_openpose(folder / "poses", {number: [person("body25")] * 2 for number in range(3)})
        for kind, write in (("alphapose", write_alphapose), ("coco", write_coco)):
            write(folder / f"{kind}.json", {number: [person()] for number in range(3)})
        write_mmpose(folder / "mmpose.json", {number: [person()] * 2 for number in range(1, 4)}, names)

    files, cases = written(write_all), []
    for kind in ("openpose", "alphapose", "mmpose", "coco"):
        name = "poses" if kind == "openpose" else f"{kind}.json"
        command = f"vip-factors convert RECORDING.mcap out.mcap --detections {{}}/{name} --camera CAMERA.toml"
        content = {one: data for one, data in files.items() if one.startswith(name)}
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

    def write(folder: Path) -> None:
        write_body_file(folder / "body.toml", BodyFile("Ada", likely.skeleton, lengths, (), "made"))
        write_keypoint_offsets(folder / "offsets.toml", KeypointOffsetsFile({"body25": offsets}, "made"))

    files = written(write)
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
