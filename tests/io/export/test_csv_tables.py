"""Tables are read back by NumPy's reader of comma-separated files, as pandas and spreadsheets would."""

from pathlib import Path

import numpy as np
import pytest
from turning_body import sample_scene

from vip_factors.body.joint_angles import joint_angles
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.io.export.files import export


def read(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True, encoding="utf-8")


def test_positions_and_angles_come_back(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    table = read(export(scene, tmp_path / "walk.csv")[0])
    assert table["time_s"] == pytest.approx(motion.time, abs=1e-6)
    for number, joint in enumerate(JOINT_NAMES):
        found = np.stack([table[f"{joint}_{axis}_m"] for axis in "xyz"], axis=1)
        assert np.abs(found - motion.state.p_world_joint[:, number]).max() < 1e-6
    angles = joint_angles(motion)
    for name in angles.names:
        assert np.abs(table[f"{name}_deg"] - angles.of(name)).max() < 1e-4
    assert len(table.dtype.names) == 1 + 72 + len(angles.names)


@pytest.mark.parametrize(("name", "joints", "angles"), [("walk.positions.csv", 1, 0), ("angles.csv", 0, 1)])
def test_the_name_tells_which_table(tmp_path: Path, name: str, joints: int, angles: int) -> None:
    columns = read(export(sample_scene(), tmp_path / name)[0]).dtype.names
    assert ("pelvis_x_m" in columns) == joints
    assert ("left_knee_flexion_deg" in columns) == angles


def test_standard_deviations_follow_where_they_are_known(tmp_path: Path) -> None:
    table = read(export(sample_scene(covariance=True), tmp_path / "walk.csv")[0])
    assert table["pelvis_z_sd_m"] == pytest.approx(0.01)
    # Of an error that is alike about all axes the flexion's is as large, and larger where the shank is abducted.
    assert np.all(table["left_knee_flexion_sd_deg"] >= np.degrees(0.02) - 1e-4)
    assert np.all(table["left_knee_flexion_sd_deg"] < 1.2 * np.degrees(0.02))
    assert "left_shoulder_elevation_sd_deg" not in table.dtype.names
