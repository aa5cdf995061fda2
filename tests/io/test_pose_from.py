"""A calibration pose held in another log, or in one row, stands before the recording."""

from pathlib import Path

import numpy as np
import pytest

from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.io.convert import ImportOptions, import_recording
from vip_factors.io.log_streams import HOLD_S, LEAD_S

NAMES = ("pelvis_imu", "femur_r_imu")
R_POSE = np.stack([exp(np.array([0.3, 0.1, 0.0])), exp(np.array([-0.2, 0.5, 1.0]))])


def write_sto(path: Path, R: Array, names: tuple[str, ...] = NAMES) -> Path:
    """Rotations ``(N, sensors, 3, 3)`` at 50 Hz."""
    lines = ["DataType=Quaternion", "endheader", "\t".join(["time", *names])]
    for i, row in enumerate(R):
        cells = [",".join(repr(float(q)) for q in quaternion_from_matrix(one, Order.WXYZ)) for one in row]
        lines.append("\t".join([f"{i / 50}", *cells]))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def walk() -> Array:
    return np.stack([rotation_z(2.0) @ exp(np.array([0.01 * i, 0, 0])) @ R_POSE for i in range(100)])


def test_a_row_of_the_log_itself(tmp_path: Path, walk: Array) -> None:
    log = write_sto(tmp_path / "a.sto", np.concatenate([R_POSE[None], walk]))
    recording = import_recording(log, ImportOptions(initial_pose="n-pose", pose_from=f"{log}:1"))
    assert recording.initial_pose == "n-pose"
    for number, name in enumerate(NAMES):
        stream = recording.imus[name]
        held = stream.cut(0, HOLD_S + 0.1)
        assert len(held) == 51
        np.testing.assert_allclose(held.R_inertial_sensor, np.tile(R_POSE[number], (51, 1, 1)), atol=1e-9)
        rest = stream.cut(HOLD_S + 0.1, np.inf)
        np.testing.assert_allclose(rest.time, LEAD_S + np.arange(100) / 50)
        np.testing.assert_allclose(rest.R_inertial_sensor, walk[:, number], atol=1e-9)
    assert f"begins at {LEAD_S:g} s" in recording.notes


def test_a_pose_decades_before_the_rest_is_refused_unless_it_is_said_to_be_one(tmp_path: Path, walk: Array) -> None:
    log = write_sto(tmp_path / "a.sto", np.concatenate([R_POSE[None], walk]))
    header, first, *rows = log.read_text().split("\n0.0\t")[0], *log.read_text().splitlines()[3:]
    unix = [f"{1.6e9 + float(row.partition(chr(9))[0])!r}\t{row.partition(chr(9))[2]}" for row in rows]
    log.write_text("\n".join([header, first, *unix]) + "\n")
    with pytest.raises(InputError, match=r"leap from 0.00 to 1600000000.\d\d s after row 1 .* --start-s 1600000000.0"):
        import_recording(log)
    recording = import_recording(log, ImportOptions(initial_pose="n-pose", pose_from=f"{log}:1"))
    assert recording.interval[1] == pytest.approx(LEAD_S + 99 / 50, abs=1e-3)
    assert import_recording(log, ImportOptions(start_s=1.6e9)).interval[1] == pytest.approx(2.0, abs=1e-3)


def test_another_log_on_average_and_a_cut(tmp_path: Path, walk: Array) -> None:
    log = write_sto(tmp_path / "a.sto", walk)
    sway = exp(np.stack([0.02 * np.sin(np.arange(51)), np.zeros(51), np.zeros(51)], axis=1))
    pose = write_sto(tmp_path / "pose.sto", sway[:, None] @ R_POSE)
    options = ImportOptions(initial_pose="t-pose", pose_from=str(pose), start_s=1.0)
    stream = import_recording(log, options).imus[NAMES[1]]
    np.testing.assert_allclose(stream.R_inertial_sensor[0], R_POSE[1], atol=2e-3)
    assert stream.time[51] == pytest.approx(LEAD_S)
    np.testing.assert_allclose(stream.R_inertial_sensor[51], walk[50, 1], atol=1e-9)


def test_sensors_whose_pose_is_unknown_are_left_out(tmp_path: Path, walk: Array) -> None:
    log = write_sto(tmp_path / "a.sto", walk)
    pose = write_sto(tmp_path / "pose.sto", R_POSE[None, :1], NAMES[:1])
    recording = import_recording(log, ImportOptions(initial_pose="n-pose", pose_from=f"{pose}:1"))
    assert list(recording.imus) == [NAMES[0]]
    assert "sensor 'femur_r_imu' is not in the log of the held pose" in recording.notes


@pytest.mark.parametrize(
    ("source", "match"),
    [
        ("{0}:0", "sample '0': expected LOG, or LOG:SAMPLE with a number from 1 on"),
        ("{0}:last", "sample 'last'"),
        ("{0}:101", "has 100 samples: there is no sample 101"),
        ("{0}:100", "none is left after the pose's, 100"),
        ("nowhere.sto", "there is no file or folder nowhere.sto"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, walk: Array, source: str, match: str) -> None:
    log = write_sto(tmp_path / "a.sto", walk)
    with pytest.raises(InputError, match=match):
        import_recording(log, ImportOptions(initial_pose="n-pose", pose_from=source.format(log)))
    with pytest.raises(InputError, match="say which it was, initial pose t-pose or n-pose"):
        import_recording(log, ImportOptions(pose_from=source.format(log)))
