"""Numbers that no file should hold are told in a sentence, wherever they stand."""

import math
from pathlib import Path

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.motion import Motion
from vip_factors.errors import FileFormatError, InputError
from vip_factors.evaluate.frames import common_frames
from vip_factors.io.camera_file import read_camera_file
from vip_factors.io.importers import apdm
from vip_factors.io.mcap_contents import CHANNEL, RECORD_HEAD, McapWarning, read_contents
from vip_factors.io.mcap_messages import set_timestamp
from vip_factors.io.placement_file import placement_from_file
from vip_factors.sensors.video_clock import VideoClock
from vip_factors.simulate.gestures import gestures

TWENTY_DIGITS, TOO_MANY = "12345678901234567890", "9" * 400


@pytest.mark.parametrize("width", [TWENTY_DIGITS, TOO_MANY])
def test_a_camera_with_an_absurd_image(tmp_path: Path, width: str) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(f"width = {width}\nheight = 480\nfx = 500\nfy = 500\ncx = 320\ncy = 240\n")
    with pytest.raises(InputError, match=r"pixels|number"):
        read_camera_file(path)


def test_a_placement_with_an_absurd_number(tmp_path: Path) -> None:
    path = tmp_path / "ada.toml"
    path.write_text(f"stature_m = {TOO_MANY}\n")
    with pytest.raises(InputError, match="stature_m"):
        placement_from_file(path)


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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Format=7,,1,a,2,b\nTime,Accelerometer\n,X,Y,Z\n1,2,3,4\n", "lines 2 and 3"),
        ("x\nTest,1\nNot,Time\nTime,Opal/Acceleration/X\ninf,1\n", "time"),
    ],
)
def test_tables_of_opals_with_short_headers(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "opal.csv"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=words):
        apdm.read(path)


def test_a_channel_whose_description_ends_early(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + RECORD_HEAD.pack(CHANNEL, 3) + b"\x01\x00\x00")
    with pytest.warns(McapWarning, match="malformed|cut off"):
        contents = read_contents(path)
    assert "malformed" in " ".join(contents.damage)
