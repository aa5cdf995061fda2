"""A body from optical markers, and what a camera would have seen of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies.gait import inclination_deg
from tests.studies.marker_body import (
    ARMS,
    ELBOW_M,
    FILMING,
    LEGS,
    SHOULDERS,
    MarkerBody,
    filmed,
    posed,
    read_marker_body,
)
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import rotation_z
from vip_factors.sensors.calibration import preset
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import DetectorSettings

# Markers of somebody who faces +x, forearms forward, in metres; the left side, of which the right is the mirror image.
MIDDLE = {"C7": (-0.1, 0, 1.5), "T10": (-0.1, 0, 1.2), "CLAV": (0.1, 0, 1.5), "STRN": (0.1, 0, 1.2)}
LEFT = {
    "FHD": (0.1, 0.07, 1.7), "BHD": (-0.1, 0.07, 1.7), "SHO": (0, 0.2, 1.5), "ELB": (0, 0.25, 1.1),
    "WRA": (0.25, 0.23, 1.1), "WRB": (0.25, 0.27, 1.1), "ASI": (0.1, 0.1, 1.0), "PSI": (-0.1, 0.05, 1.0),
    "HJC": (0, 0.08, 0.9), "KJC": (0, 0.08, 0.5), "AJC": (0, 0.08, 0.1),
    "TOE": (0.15, 0.08, 0.05), "FMH": (0.12, 0.12, 0.05), "HEE": (-0.06, 0.08, 0.05),
}  # fmt: skip


def _write(path: Path, without: str = "") -> Path:
    points = MIDDLE | {f"L{k}": v for k, v in LEFT.items()} | {f"R{k}": (v[0], -v[1], v[2]) for k, v in LEFT.items()}
    points.pop(without, None)
    names = ["time_s", *(f"{name}_{axis}" for name in points for axis in "xyz")]
    row = [f"{1000 * value:.1f}" for point in points.values() for value in point]
    path.write_text("\n".join([",".join(names), ",".join(["2.0", *row]), ",".join(["2.01", *row])]) + "\n")
    return path


def test_a_body_is_read_from_its_markers(tmp_path: Path) -> None:
    body = read_marker_body(_write(tmp_path / "optical.csv"), begins=-1.0)
    assert body.time == pytest.approx([3.0, 3.01])
    for side, sign in (("left", 1), ("right", -1)):
        assert body.centres[f"{side}_shoulder"][0] == pytest.approx([0, sign * 0.2, 1.5 - 0.17 * 0.4])
        assert body.centres[f"{side}_elbow"][0][1] * sign == pytest.approx(0.25 - ELBOW_M, abs=0.01)  # inwards
        assert body.centres[f"{side}_wrist"][0] == pytest.approx([0.25, sign * 0.25, 1.1])
        assert body.R_world_bone[f"{side}_hip"][0][:, 1] == pytest.approx([0, 0, 1])
        assert np.linalg.det(body.R_world_bone[f"{side}_shoulder"]) == pytest.approx(1.0)
    for bone in ("pelvis", "spine3", "head"):  # x to the left, y up, z where the person faces
        assert body.R_world_bone[bone][0] == pytest.approx(np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0.0]]), abs=1e-9)


def test_a_missing_marker_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no column 'LWRB_x'"):
        read_marker_body(_write(tmp_path / "optical.csv", without="LWRB"))


def test_the_trunk_leans_to_where_the_hips_face() -> None:
    lean = np.deg2rad(10.0)
    up, left = np.array([[np.sin(lean), 0.3, np.cos(lean)]]), np.array([[0.0, 0.2, 0.1]])
    for turn in (0.0, 2.0):
        R = rotation_z(turn)
        assert inclination_deg(up @ R.T, left @ R.T) == pytest.approx([10.0])


def _marker_body(motion: Motion) -> MarkerBody:
    state = motion.state
    centres = {name: state.p_world_joint[:, joint_index(name)] for name in (*LEGS, *SHOULDERS, *ARMS)}
    extra, feet = {"head": state.p_world_joint[:, joint_index("head")]}, ("left_foot", "right_foot")
    bones = {name: state.R_world_bone[:, joint_index(name)] for name in (*centres, *feet, "pelvis", "spine3", "head")}
    for side in ("left", "right"):
        extra[f"{side}_ball"] = state.p_world_joint[:, joint_index(f"{side}_foot")]
        for name, landmark in (("heel", "heel"), ("toe", "toe_tip")):
            there = motion.skeleton.landmarks[f"{side}_{landmark}"]
            extra[f"{side}_{name}"] = state.point(there.bone, there.p_bone_point)
    return MarkerBody(motion.time, centres, bones, extra)


def test_a_posed_body_is_the_one_that_the_markers_showed() -> None:
    motion = gestures(seconds=0.5)
    skeleton, state = posed(_marker_body(motion), motion.skeleton)
    known = [joint_index(name) for name in (*LEGS, *SHOULDERS, *ARMS, "pelvis", "neck", "head", "left_foot")]
    assert state.p_world_joint[:, known[:12]] == pytest.approx(motion.state.p_world_joint[:, known[:12]], abs=1e-6)
    assert state.p_world_joint[:, known] == pytest.approx(motion.state.p_world_joint[:, known], abs=0.05)
    for name in ("left_heel", "right_toe_tip"):
        found, true = skeleton.landmarks[name], motion.skeleton.landmarks[name]
        assert found.p_bone_point == pytest.approx(true.p_bone_point)


def test_a_filmed_body_is_where_the_detector_found_it(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = gestures(seconds=1.0)
    body, recording = _marker_body(motion), simulate_recording(motion, preset("sip6", motion.skeleton), seed=1)
    for name, settings in list(FILMING.items()):
        monkeypatch.setitem(FILMING, name, replace(settings, detector=DetectorSettings.noise_free()))
        scene = filmed(recording, body, name, seed=3)
        camera, truth = scene.camera, scene.camera.truth
        assert camera is not None
        assert truth is not None
        assert camera.moving == (name == "carried")
        assert (camera.mount is not None) == camera.moving
        assert camera.detections.rate == pytest.approx(settings.video_rate, rel=0.25)
        assert np.all(truth.wearer == 0)
        ankle = camera.detections.keypoints.keypoints.index("left_ankle")
        frames = np.searchsorted(body.time, camera.detections.time[camera.detections.frame] - 1e-9)
        path = truth.path.at(body.time[frames])
        there = camera.model.project(path.to_camera(body.centres["left_ankle"][frames][:, None]))[:, 0]
        inside = camera.model.inside(there)
        assert inside.sum() > 10
        assert camera.detections.pixels[inside, ankle] == pytest.approx(there[inside], abs=1e-6)
