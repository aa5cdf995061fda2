"""C3D files are written by one library and read back by another."""

import sys
from pathlib import Path

import c3d
import numpy as np
import pytest
from turning_body import FRAMES, RATE, sample_scene

from vip_factors.body.joint_angles import joint_angles
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.export import tables as c3d_points
from vip_factors.io.export.files import export

pytestmark = pytest.mark.filterwarnings("ignore:No analog data found")


def read(path: Path) -> tuple[c3d.Reader, dict[str, Array]]:
    with path.open("rb") as file:
        reader = c3d.Reader(file)
        points = np.stack([points for _, points, _ in reader.read_frames()])
    labels = [label.strip() for label in reader.point_labels]
    assert np.all(points[..., 3] >= 0)  # all points are valid
    return reader, {label: points[:, number, :3] for number, label in enumerate(labels)}


def test_points_come_back_in_millimetres(tmp_path: Path) -> None:
    scene = sample_scene()
    motion = scene.wearers[0].motion
    reader, points = read(export(scene, tmp_path / "walk.c3d")[0])
    assert reader.point_rate == pytest.approx(RATE)
    assert reader.first_frame == round(motion.start * RATE) + 1
    assert reader.last_frame - reader.first_frame + 1 == FRAMES
    assert reader.get("POINT:UNITS").string_value.strip() == "mm"
    for number, name in enumerate(JOINT_NAMES):
        assert np.abs(points[name] - 1000 * motion.state.p_world_joint[:, number]).max() < 0.001


def test_angles_come_back_in_degrees(tmp_path: Path) -> None:
    scene = sample_scene()
    reader, points = read(export(scene, tmp_path / "walk.c3d")[0])
    angles = joint_angles(scene.wearers[0].motion)
    labels = [label.strip() for label in reader.get("POINT:ANGLES").string_array]
    assert {"LKneeAngles", "RHipAngles", "PelvisAngles", "LShoulderFlexionAngles"} <= set(labels)
    assert 3 * len(labels) == len(angles.names)
    assert reader.get("POINT:ANGLE_UNITS").string_value.strip() == "deg"
    for label, joint, first in (
        ("LKneeAngles", "left_knee", "flexion"), ("RHipAngles", "right_hip", "flexion"),
        ("PelvisAngles", "pelvis", "tilt"), ("RShoulderAngles", "right_shoulder", "plane_of_elevation"),
        ("RShoulderFlexionAngles", "right_shoulder", "flexion"), ("SpineAngles", "trunk", "flexion"),
    ):  # fmt: skip
        assert np.abs(points[label][:, 0] - angles.of(f"{joint}_{first}")).max() < 1e-4
    assert np.abs(points["PelvisAngles"][:, 2] - angles.of("pelvis_rotation")).max() < 1e-4


def test_more_frames_than_the_header_counts_are_stated_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(c3d_points, "HEADER_FRAMES", FRAMES - 1)
    reader, _ = read(export(sample_scene(), tmp_path / "long.c3d")[0])
    assert reader.get("POINT:LONG_FRAMES").float_value == FRAMES
    assert reader.first_frame == 1


def test_without_the_library_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(InputError, match=r"vip-factors\[export\]"):
        export(sample_scene(), tmp_path / "walk.c3d")
    assert not list(tmp_path.iterdir())
