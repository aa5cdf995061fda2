"""Marker files are read back by column, as OpenSim's and Pose2Sim's readers take them."""

from pathlib import Path

import numpy as np
from turning_body import sample_scene

from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.geometry.rotations import Array
from vip_factors.io.export.files import export

POSE2SIM_BODY_25B = [
    "RHip", "RKnee", "RAnkle", "RBigToe", "RSmallToe", "RHeel", "LHip", "LKnee", "LAnkle", "LBigToe", "LSmallToe",
    "LHeel", "Neck", "Head", "Nose", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist",
]  # fmt: skip


def read(path: Path) -> tuple[dict[str, str], Array, dict[str, Array]]:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0].split("\t")[:3] == ["PathFileType", "4", "(X/Y/Z)"]
    stated = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    names = [name for name in lines[3].split("\t")[2:] if name]
    assert lines[4].split("\t")[2:5] == ["X1", "Y1", "Z1"]
    table = np.array([line.split("\t") for line in lines[5:] if line.strip()], dtype=float)
    assert len(table) == int(stated["NumFrames"])
    assert len(names) == int(stated["NumMarkers"]) == len(lines[4].split("\t")[2:]) / 3
    points = table[:, 2:].reshape(len(table), -1, 3)
    return stated, table[:, 1], {name: points[:, k] for k, name in enumerate(names)}


def test_points_come_back_with_y_up(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    stated, time, points = read(export(scene, tmp_path / "walk.trc")[0])
    assert stated["Units"] == "m"
    assert float(stated["DataRate"]) == motion.rate
    assert np.abs(time - motion.time).max() < 1e-6
    for number, name in enumerate(JOINT_NAMES):
        x, y, z = motion.state.p_world_joint[:, number].T
        assert np.abs(points[name] - np.stack([x, z, -y], axis=1)).max() < 1e-6


def test_markers_have_the_names_of_pose2sim(tmp_path: Path) -> None:
    scene = sample_scene()
    _, _, points = read(export(scene, tmp_path / "walk.trc")[0])
    assert set(POSE2SIM_BODY_25B) <= set(points)
    assert np.allclose(points["LKnee"], points["left_knee"])
    knee = scene.wearers[0].motion.state.p_world_joint[:, joint_index("right_knee")]
    assert np.allclose(points["RKnee"][:, 1], knee[:, 2], atol=1e-6)
    assert np.all(points["Head"][:, 1] > points["Neck"][:, 1])
    assert np.all(points["LHeel"][:, 1] < points["LAnkle"][:, 1])
