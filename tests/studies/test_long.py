"""The recording of hours is one: in time, without leaps where it turns."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.long import Long, LongRun
from tests.studies.study import markdown
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between
from vip_factors.io.mcap_recording import read_recording


def test_a_clip_is_played_forwards_and_backwards(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    Long(hours=20 / 3600, sensors="sip6", clip_s=8.0).write(path)
    recording = read_recording(path)
    assert recording.truth is None
    assert recording.initial_pose == "t-pose"
    assert recording.interval[1] == pytest.approx(20.0, abs=0.1)
    for stream in recording.imus.values():
        assert len(stream) > 0.95 * 60 * 20
        assert np.diff(stream.time).min() > 0.2 / 60
        R = stream.R_inertial_sensor
        assert R is not None
        assert np.rad2deg(angle_between(R[:-1], R[1:])).max() < 20.0
        ends = [np.argmin(np.abs(stream.time - one)) for one in (5.0, 11.0)]  # of the first lap, and of the second
        assert np.rad2deg(angle_between(R[ends[0]], R[ends[1]])) < 20.0


def test_what_cannot_be_made_is_refused() -> None:
    with pytest.raises(InputError, match="clip"):
        Long(clip_s=1.0)
    with pytest.raises(InputError, match="hours"):
        Long(hours=0.0)


def test_the_table_is_per_hour() -> None:
    one = LongRun(108000, 600.0, 550.0, 200_000_000, 10**9, 10**8, 2 * 10**8)
    assert "| 108000 | 1000 | 200 | 600 | 1200 | 1100 | 100 | 200 |" in markdown(Long(hours=0.5), [one])
