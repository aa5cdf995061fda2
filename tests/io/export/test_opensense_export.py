"""Orientations are read back by the importer of OpenSense's tables."""

from pathlib import Path

import numpy as np
import pytest
from turning_body import sample_scene

from vip_factors.body.joint_angles import segment_orientations
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import angle_between
from vip_factors.io.export.files import export
from vip_factors.io.importers.maker_tables import OPENSENSE

SOME = {
    "pelvis_imu": "pelvis", "torso_imu": "spine3", "head_imu": "head", "femur_l_imu": "left_hip",
    "calcn_r_imu": "right_ankle", "humerus_l_imu": "left_shoulder", "radius_r_imu": "right_elbow",
}  # fmt: skip


def test_segments_come_back(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    path = export(scene, tmp_path / "walk.sto")[0]
    found = OPENSENSE.read(path)
    R = segment_orientations(motion)
    for sensor, bone in SOME.items():
        apart = angle_between(found.imus[sensor].R_inertial_sensor, R[:, joint_index(bone)])
        assert np.degrees(apart).max() < 1e-5
    assert found.imus["pelvis_imu"].time == pytest.approx(motion.time - motion.time[0], abs=1e-6)
    assert len(found.imus) == 17


def test_the_real_part_comes_first(tmp_path: Path) -> None:
    scene = sample_scene()
    lines = export(scene, tmp_path / "walk.sto")[0].read_text(encoding="utf-8").splitlines()
    assert "DataType=Quaternion" in lines
    cells = lines[lines.index("endheader") + 2].split("\t")
    tilt = 2 * np.degrees(np.arccos(float(cells[1].split(",")[0])))  # of the pelvis, which faces x and hardly tilts
    assert tilt < 30
