"""Real recordings become rows: angles against optical references, headings, findings."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.__main__ import main
from tests.studies.leg_angles import GaitMotion, angle_errors, gait_of, opensim_angles, optical_angles
from tests.studies.real import Real, RealTrial
from tests.studies.real_recordings import real_recordings
from tests.studies.strides import StrideErrors
from tests.studies.study import markdown
from tests.studies.video_agreement import Agreement
from tests.studies.walk import AngleError
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.motion import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import rotation_x


def test_a_bent_leg_has_the_angles_it_was_bent_by() -> None:
    R = np.tile(np.eye(3), (2, 24, 1, 1))
    R[1, joint_index("left_hip")] = rotation_x(np.deg2rad(-30.0))  # the thigh goes forward
    R[1, joint_index("left_knee")] = rotation_x(np.deg2rad(50.0))  # the shank goes back
    found = gait_of(Motion(skeleton_from_stature(1.75), R, np.zeros((2, 3)), 1.0))
    assert found.flexion["left_hip"] == pytest.approx([0.0, 30.0])
    assert found.flexion["left_knee"] == pytest.approx([0.0, 50.0])
    assert found.flexion["right_knee"] == pytest.approx([0.0, 0.0])


def test_errors_are_over_the_time_that_both_have() -> None:
    ours = GaitMotion(np.arange(5.0), {"left_knee": np.array([0.0, 4.0, 8.0, 12.0, 16.0])})
    theirs = GaitMotion(np.array([0.5, 1.5, 9.0]), {"left_knee": np.array([1.0, 3.0, 99.0])})
    (error,) = angle_errors(ours, theirs).values()
    assert error.rmse == pytest.approx(np.sqrt((1**2 + 3**2) / 2))
    assert error.without_offset == pytest.approx(1.0)


def test_a_motion_file_of_opensim_is_read(tmp_path: Path) -> None:
    path = tmp_path / "walk.mot"
    path.write_text("endheader\ntime knee_angle_r knee_angle_l hip_flexion_r hip_flexion_l\n0 1 2 3 4\n0.5 5 6 7 8\n")
    found = opensim_angles(path)
    assert found.time.tolist() == [0.0, 0.5]
    assert found.flexion["left_hip"].tolist() == [4.0, 8.0]
    path.write_text("endheader\ntime knee_angle_r\n0 1\n")
    with pytest.raises(FileFormatError, match="no column 'knee_angle_l'"):
        opensim_angles(path)
    path.write_text("time\n0\n")
    with pytest.raises(FileFormatError, match="no line 'endheader'"):
        opensim_angles(path)


def test_optical_segments_without_a_quaternion_are_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "centres.csv"
    path.write_text("time_s,pelvis_qw\n0,1\n1,1\n")
    with pytest.raises(FileFormatError, match="no column 'femur_l_qw'"):
        optical_angles(path)


def test_a_row_says_what_was_measured() -> None:
    legs = {
        f"{side}_{joint}": AngleError(error, 2.0)
        for side, error in (("left", 4.0), ("right", 6.0))
        for joint in ("knee", "hip")
    }
    legs["trunk"] = AngleError(6.0, 1.0)
    parts = {"body": 30.0, "legs": 20.0, "shoulders": 25.0, "arms": 40.0}
    one = RealTrial(
        "a walk", 20.0, legs, {}, ("OpenSense", legs), (12.0, np.nan), (parts, {}),
        {"smooth": Agreement("knee", 0.1, 0.9, 8.0, 5.0, 2.0, 61.0)}, StrideErrors(57, 1.36, -0.052, 0.05),
        (7.0, 9.0), 1.0, 2.0, ("crossed legs",), (),
    )  # fmt: skip
    table = markdown(Real(data=Path()), [one])
    assert "| a walk | 20 | 5.0 (2.0) | 5.0 (2.0) | 12.0 | n/a | n/a | n/a | 7, at most 9 | 1, 0 |" in table
    assert "| — OpenSense |  | 5.0 (2.0) | 5.0 (2.0) |" in table
    assert "| mean | 6.0 (1.0) | n/a | 30.0 | 20.0 | 25.0 | 40.0 | n/a | n/a |" in table
    assert "| a walk | smooth | knee | 0.10 | 0.90 | 8.0 (5.0) | 2 to 61 |" in table
    assert "| a walk | 57 | 1.36 | -5.2 | 5.0 |" in table


def test_a_folder_without_recordings_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not list(real_recordings(tmp_path))
    assert main(["real", "--data", str(tmp_path)]) == 2
    assert "none of the public recordings in it" in capsys.readouterr().err
    assert main(["real", "--data", str(tmp_path), "--camera", "carried"]) == 2
    assert "expected geneva_gait" in " ".join(capsys.readouterr().err.split())


def test_optical_inverse_kinematics_and_its_joint_centres_agree(data_folder: Path) -> None:
    folder = data_folder / "xsens_treadmill_optical"
    angles = opensim_angles(folder / "IKoutput_20to65secs.mot")
    errors = angle_errors(optical_angles(folder / "optical_joint_centres.csv"), angles)
    assert max(error.rmse for error in errors.values()) < 0.5
