"""What a video and sensors say of a joint, and by how much their clocks differ."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.leg_angles import GaitMotion
from tests.studies.video_agreement import BENDS, agreement, video_motion


def _bending(time: np.ndarray, late: float, size: float = 40.0) -> GaitMotion:
    swing = size * np.sin(2.1 * (time - late)) + 0.3 * size * np.sin(5.3 * (time - late))
    return GaitMotion(time, {"left_elbow": 50 + swing, "right_elbow": 50 - swing})


def test_the_lag_is_what_the_video_lacks() -> None:
    sensors = _bending(np.arange(0.0, 12.0, 1 / 60), late=0.4)
    found = agreement("elbow", sensors, _bending(np.arange(1.0, 10.0, 1 / 30), late=0.0))
    assert found.lag_s == pytest.approx(0.4, abs=0.01)
    assert found.correlation > 0.999
    assert found.degrees < 1.0
    assert (found.least, found.most) == pytest.approx((0.0, 100.0), abs=5.0)


def test_joints_that_hardly_move_tell_of_no_lag() -> None:
    time = np.arange(0.0, 6.0, 1 / 30)
    found = agreement("elbow", _bending(time, 0.0), _bending(time, 0.0, size=5.0))
    assert np.isnan(found.lag_s)
    assert np.isnan(found.correlation)
    assert np.isfinite(found.degrees)


def test_motions_that_do_not_agree_tell_of_no_lag() -> None:
    time, random = np.arange(0.0, 20.0, 1 / 30), np.random.default_rng(1)
    noise = GaitMotion(
        time, {f"{side}_elbow": 50 + 30 * random.standard_normal(len(time)) for side in ("left", "right")}
    )
    found = agreement("elbow", _bending(time, 0.0), noise)
    assert np.isnan(found.lag_s)
    assert found.correlation < 0.4


def test_bends_are_read_from_the_videos_joints(tmp_path: Path) -> None:
    names = [f"{side}_{name}" for chain in BENDS.values() for name in chain for side in ("left", "right")]
    there = {
        "hip": (0, 0),
        "knee": (0, 400),
        "ankle": (400, 400),
        "shoulder": (0, 0),
        "elbow": (0, 300),
        "wrist": (0, 600),
    }
    header = ", ".join(f"{name}_{axis}" for name in names for axis in "xyz")
    row = ",".join(f"{x},{y},2000" for x, y in (there[name.partition("_")[2]] for name in names))
    path = tmp_path / "video.csv"
    path.write_text("\r\n".join([header, row, row, ""]))
    found = video_motion(path, begins=3.0)
    assert found.time == pytest.approx([3.0, 3.0 + 1 / 30])
    assert found.flexion["left_knee"] == pytest.approx([90.0, 90.0])
    assert found.flexion["right_elbow"] == pytest.approx([0.0, 0.0])
