"""Numbers that no file should hold are told in a sentence, wherever they stand."""

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.cli.options import read_settings
from vip_factors.errors import FileFormatError, InputError
from vip_factors.evaluate.metrics import common_frames
from vip_factors.io.camera_file import read_camera_file
from vip_factors.io.codec import set_timestamp
from vip_factors.io.detection_formats import read_people
from vip_factors.io.importers.maker_tables import APDM
from vip_factors.io.importers.mvnx import read_document
from vip_factors.io.mcap_reader import RECORD_HEAD, McapWarning, read_contents
from vip_factors.io.motions.files import read_amass, read_bvh
from vip_factors.io.placement_file import placement_from_file
from vip_factors.sensors.camera import VideoClock
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures

TWENTY_DIGITS, TOO_MANY = "12345678901234567890", "9" * 400


CAMERA_TOML = "width = {}\nheight = 480\nfx = 500\nfy = 500\ncx = 320\ncy = 240\n"
CAMERA_JSON = '{{"camera_matrix": [[{}, 0, 1], [0, 1, 1], [0, 0, 1]], "image_size": [{}, 480]}}'
CAMERA_YAML = "%YAML:1.0\n---\nimage_width: []\nimage_height: 480\ncamera_matrix: [1,0,1,0,1,1,0,0,1]\n"
NO_TIME = "x\nTest,1\nNot,Time\nTime,Opal/Acceleration/X,Opal/Acceleration/Y,Opal/Acceleration/Z\ninf,1,2,3\n"


def read_all_settings(path: Path) -> object:
    return read_settings(path, Settings())


# The file, what is in it, what reads it, and what is said.
@pytest.mark.parametrize(
    ("name", "text", "read", "words"),
    [
        *(("a.toml", CAMERA_TOML.format(one), read_camera_file, "pixels|number") for one in (TWENTY_DIGITS, TOO_MANY)),
        ("a.json", CAMERA_JSON.format(1, "NaN"), read_camera_file, "nan by 480 pixels"),
        ("a.json", CAMERA_JSON.format(1, "1e999"), read_camera_file, "inf by 480 pixels"),
        ("a.json", CAMERA_JSON.format(TOO_MANY, 640), read_camera_file, "expected numbers"),
        ("a.yaml", "%YAML:1.0\n---\n- 1\n", read_camera_file, "camera_matrix"),
        ("a.yaml", CAMERA_YAML, read_camera_file, "size is missing"),
        ("a.json", "[]", placement_from_file, r"a\.json: the content: expected table"),
        ("a.csv", "Format=7,,1,a,2,b\nTime,Accelerometer\n,X,Y,Z\n1,2,3,4\n", APDM.read, "lines 2 and 3"),
        ("a.csv", NO_TIME, APDM.read, "time"),
        ("a.csv", "x\nTime,Opal/Acceleration/X\ns,m/s^2,deg/s,deg/s\nx,1\n", APDM.read, "line 4"),
        ("a.mvnx", '<?xml version="1.0" encoding="none"?><mvnx/>', read_document, "encoding"),
        *(
            ("a.bvh", f"HIERARCHY\n{one}\n", read_bvh, "line 2: .* before the first ROOT")
            for one in ("OFFSET 0 0 0", "CHANNELS 1 Xrotation")
        ),
        *(
            ("a.toml", f"frame_rate = {one}\n", read_all_settings, r"a\.toml")
            for one in (TOO_MANY, "9" * 5000, "[" * 5000)
        ),
        ("a.toml", f"[solve]\nmax_iterations = {TOO_MANY}\n", read_all_settings, "max_iterations is 9+: expected"),
    ],
    ids=itertools.count(),
)
def test_what_no_file_should_hold_is_refused_in_a_sentence(
    tmp_path: Path, name: str, text: str, read: Callable[[Path], object], words: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=words):
        read(tmp_path / name)


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e308])
def test_positions_that_are_none(value: float) -> None:
    motion = gestures(seconds=0.2)
    p = motion.p_world_pelvis.copy()
    p[3, 1] = value
    with pytest.raises(InputError, match="frame 3"):
        Motion(motion.skeleton, motion.R_parent_child, p, motion.rate)


def test_a_motion_without_poses_is_compared_with_nothing() -> None:
    none = Motion(skeleton_from_stature(1.7), np.zeros((0, 24, 3, 3)), np.zeros((0, 3)), 60.0, name="cut")
    with pytest.raises(InputError, match="'cut' has no poses"):
        common_frames(none, gestures(seconds=0.2))


@pytest.mark.parametrize("seconds", [math.nan, math.inf, 1e308])
def test_clocks_that_are_off_by_no_time(seconds: float) -> None:
    with pytest.raises(InputError, match="clock"):
        VideoClock(seconds)
    with pytest.raises(InputError, match="clock"):
        VideoClock(0.0, seconds)


def test_a_time_that_no_clock_shows() -> None:
    from google.protobuf.timestamp_pb2 import Timestamp

    for time_ns in (-(10**30), 10**30):
        with pytest.raises(InputError, match="1970"):
            set_timestamp(Timestamp(), time_ns)


def test_a_channel_whose_description_ends_early(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    record, chunk = RECORD_HEAD.pack(Opcode.CHANNEL, 3) + b"\x01\x00\x00", RecordBuilder()
    Chunk("", record, 0, 0, 0, len(record)).write(chunk)
    path.write_bytes(b"\x89MCAP0\r\n" + chunk.end())
    with pytest.warns(McapWarning, match="malformed|cut off"):
        contents = read_contents(path)
    assert "malformed" in " ".join(contents.damage)


def test_an_archive_of_arrays_with_a_damaged_part(tmp_path: Path) -> None:
    """Its checksum fits, but what it describes is no array."""
    path = tmp_path / "a.npz"
    for head in (b"\x93NUMPY\x01\x00\x04\x00{'(\n", b"\x93NUMPY\x01\x00", b""):
        with ZipFile(path, "w") as file:
            file.writestr("poses.npy", head)
            file.writestr("trans.npy", head)
        with pytest.raises(FileFormatError, match="not an AMASS npz"):
            read_amass(path)
    np.savez(path, poses=np.zeros((2, 72)), trans=np.zeros((2, 3)), gender=np.array("x"), mocap_framerate=60.0)
    content = path.read_bytes()
    with ZipFile(path) as file:
        parts = {name: file.read(name) for name in file.namelist()}
    parts["gender.npy"] = parts["gender.npy"][:-4] + b"\xff" * 4  # a letter beyond Unicode
    with ZipFile(path, "w") as file:
        for name, part in parts.items():
            file.writestr(name, part)
    assert path.read_bytes() != content
    with pytest.raises(FileFormatError, match="not an AMASS npz"):
        read_amass(path)


@pytest.mark.parametrize("text", ["9" * 5000, "[" * 100_000])
def test_json_without_end(tmp_path: Path, text: str) -> None:
    path = tmp_path / "poses.json"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=r"poses\.json"):
        read_people(path)


def test_a_single_number_where_poses_should_be(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", poses=1.0, trans=np.zeros((2, 3)))
    with pytest.raises(FileFormatError, match="poses"):
        read_amass(tmp_path / "a.npz")


def test_an_array_that_claims_to_be_huge(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 72), }"
    with ZipFile(path, "w") as file:
        for name in ("poses", "trans"):
            file.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + (len(head) + 1).to_bytes(2, "little") + head + b"\n")
    with pytest.raises(FileFormatError, match="too short"):
        read_amass(path)
