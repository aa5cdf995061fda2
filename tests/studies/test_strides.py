"""Strides are as long as the feet went."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.strides import Strides, read_strides, stride_errors
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.motion import Motion
from vip_factors.errors import FileFormatError


def test_a_slide_forward_is_as_long_as_it_is() -> None:
    path = np.stack([np.linspace(0.0, 3.0, 31), np.zeros(31), np.full(31, 1.0)], axis=1)  # 1 m/s
    motion = Motion(skeleton_from_stature(1.75), np.tile(np.eye(3), (31, 24, 1, 1)), path, 10.0)
    left = Strides(np.array([0.0, 1.0]), np.array([1.0, 2.5]), np.array([1.1, 1.4]))
    right = Strides(np.array([2.0]), np.array([9.0]), np.array([7.0]))  # ends after the motion
    errors = stride_errors(motion, {"left": left, "right": right})
    assert errors.count == 2
    assert errors.length == pytest.approx(1.25)
    assert errors.error_mean == pytest.approx(0.0)
    assert errors.error_sd == pytest.approx(0.1)


def test_strides_are_read_from_markers_and_events(tmp_path: Path) -> None:
    names = [(f"{side}_FCC", axis) for side in "LR" for axis in "xyz"]
    header = [",".join(["", *(one[k] for one in names)]) for k in (0, 1)]
    rows = [f"{k},{10 * k},0,{k},{5 * k},0,0" for k in range(201)]  # heels at 1 and 0.5 m/s
    (tmp_path / "mocap_sample.csv").write_text("\n".join([*header, *rows]) + "\n")
    events = tmp_path / "stride_events_sample.csv"
    events.write_text("s_id,foot,start,end\n0,left,0,204.8\n1,right,102.4,307.2\n")
    found = read_strides(tmp_path)
    assert found["left"].length == pytest.approx([1.0])
    assert found["right"].start == pytest.approx([0.5])
    assert found["right"].length == pytest.approx([0.5])
    events.write_text("s_id,foot,start,end\n0,middle,0,204.8\n")
    with pytest.raises(FileFormatError, match="line 2: expected a foot"):
        read_strides(tmp_path)
