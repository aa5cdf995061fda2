"""How somebody moved: angles by which a leg was bent, references of gait, what a video says of a joint."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.gait import (
    BENDS,
    GaitMotion,
    agreement,
    angle_errors,
    gait_of,
    hip_flexion_of,
    opensim_angles,
    optical_angles,
    video_motion,
)
from tests.studies.gait_study import EventEnds, GaitStudy, GaitTrial, TrainGaitEvents
from tests.studies.gait_train import TrainGait
from tests.studies.gait_truth import gaitmap_truth, geneva_truth, treadmill_truth
from tests.studies.real import converted
from tests.studies.real_recordings import real_recordings
from tests.studies.study import markdown, run
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_angles import joint_angles
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.gait.events import events_of_sensor
from vip_factors.geometry.rotations import rotation_x
from vip_factors.io.export.files import export
from vip_factors.simulate.gestures import gestures


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


def test_optical_inverse_kinematics_and_its_joint_centres_agree(data_folder: Path) -> None:
    folder = data_folder / "xsens_treadmill_optical"
    angles = opensim_angles(folder / "IKoutput_20to65secs.mot")
    errors = angle_errors(optical_angles(folder / "optical_joint_centres.csv"), angles)
    assert max(error.rmse for error in errors.values()) < 0.5


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


def test_joints_that_hardly_move_or_do_not_agree_tell_of_no_lag() -> None:
    time, random = np.arange(0.0, 20.0, 1 / 30), np.random.default_rng(1)
    still = agreement("elbow", _bending(time, 0.0), _bending(time, 0.0, size=5.0))
    assert np.isnan(still.lag_s)
    assert np.isnan(still.correlation)
    assert np.isfinite(still.degrees)
    noise = {f"{side}_elbow": 50 + 30 * random.standard_normal(len(time)) for side in ("left", "right")}
    other = agreement("elbow", _bending(time, 0.0), GaitMotion(time, noise))
    assert np.isnan(other.lag_s)
    assert other.correlation < 0.4


def test_bends_are_read_from_the_videos_joints(tmp_path: Path) -> None:
    names = [f"{side}_{name}" for chain in BENDS.values() for name in chain for side in ("left", "right")]
    there = {"hip": (0, 0), "knee": (0, 400), "ankle": (400, 400), "shoulder": (0, 0), "elbow": (0, 300),
             "wrist": (0, 600)}  # fmt: skip
    header = ", ".join(f"{name}_{axis}" for name in names for axis in "xyz")
    row = ",".join(f"{x},{y},2000" for x, y in (there[name.partition("_")[2]] for name in names))
    path = tmp_path / "video.csv"
    path.write_text("\r\n".join([header, row, row, ""]))
    found = video_motion(path, begins=3.0)
    assert found.time == pytest.approx([3.0, 3.0 + 1 / 30])
    assert found.flexion["left_knee"] == pytest.approx([90.0, 90.0])
    assert found.flexion["right_elbow"] == pytest.approx([0.0, 0.0])


def test_feet_alone_strike_and_leave_when_markers_say(data_folder: Path) -> None:
    truth = gaitmap_truth(data_folder / "gaitmap_feet")
    (known,) = (one for one in real_recordings(data_folder) if one.name == "gaitmap_feet")
    recording = converted(known, data_folder)
    for site in recording.placement.sites:
        found = events_of_sensor(recording.imus[site.sensor], site.R_bone_sensor)
        true = truth.events[site.bone.partition("_")[0]]
        assert found is not None
        for own, others in ((found.strike, true.strike), (found.off, true.off)):
            away = 1000 * np.array([np.abs(own - one).min() for one in others])
            assert np.median(away) < 25
            assert np.quantile(away, 0.9) < 50


def test_references_of_gait_are_read(data_folder: Path, tmp_path: Path) -> None:
    walk = geneva_truth(data_folder / "geneva_gait" / "P02_Gait_09")
    first, second = walk.events["left"].strike[:2]
    assert 1.0 < second - first < 1.4
    assert 1.2 < walk.length("left", first + 0.3, second + 0.3) < 1.5
    assert walk.late_s["RF"] < -0.02
    belt = treadmill_truth(data_folder / "xsens_treadmill_optical")
    assert len(belt.events["left"].strike) == len(belt.events["left"].off) == 52
    assert 0.8 < belt.length("left", 30.2, 31.5) < 1.3
    assert np.isnan(belt.length("left", 3.0, 4.0))
    study = TrainGait(data=data_folder, out=tmp_path / "reference.csv")
    assert "| comfortable | 1.23 | 4 | 44 |" in markdown(study, run(study))
    shipped = Path(__file__).parents[2] / "vip_factors" / "gait" / "data" / "reference.csv"
    assert (tmp_path / "reference.csv").read_text() == shipped.read_text()


def test_a_walk_becomes_a_line() -> None:
    trial = GaitTrial("a walk", "all", (0.01, -0.03), (0.02,), 1, 0, 4, (0.002,), (0.03, np.nan))
    assert "| a | all | 1 | 20.0 / 29.0 (-10.0) |" in markdown(GaitStudy(data=Path()), [trial])


def test_shares_are_chosen_without_who_judges_them() -> None:
    """One data set wants events at the beginning of the way, the other in its middle: each is judged by the other's."""
    rows = [EventEnds("a", "strike", (0.0, 0.0), (0.1, 0.1)), EventEnds("b", "strike", (-0.05,), (0.05,))]
    told = markdown(TrainGaitEvents(data=Path()), rows)
    assert "| strike | none | 0.25 | a | 2 | 25.0 | 25.0 | 25.0 |" in told
    assert "| strike | none | 0.25 | b | 1 | -25.0 | 25.0 | 25.0 |" in told
    assert "| strike | a | 0.50 | a | 2 | 50.0 | 50.0 | 50.0 |" in told
    assert "| strike | b | 0.00 | b | 1 | -50.0 | 50.0 | 50.0 |" in told


def test_exported_knees_and_hips_are_those_of_the_motion(tmp_path: Path) -> None:
    motion = gestures(2.0)
    estimate = Estimate("walk", "IT", (WearerEstimate("ann", "IT", motion, {}, None, {}, ()),))
    found, angles = opensim_angles(export(estimate, tmp_path / "walk.mot")[0]), joint_angles(motion)
    for side in ("left", "right"):
        assert np.allclose(angles.of(f"{side}_hip_flexion"), hip_flexion_of(motion, side), atol=1e-9)
        for joint in ("knee", "hip"):
            assert found.flexion[f"{side}_{joint}"] == pytest.approx(angles.of(f"{side}_{joint}_flexion"), abs=1e-6)
