"""The benchmark beside Kaichi et al. 2020: its scenes, what each form uses, and a tiny run all the way through."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies import scenes
from tests.studies.kaichi import PUBLISHED_CM, Form, Kaichi, KaichiTrial, Way, measured, our_settings
from tests.studies.kaichi_scenes import grounded, share_off_ground, told_headings, told_straps, with_sensors
from tests.studies.scenes import mean_angle, nominal_start, true_calibration, true_motion
from tests.studies.study import markdown, run
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between, wrap_angle
from vip_factors.live.settings import LiveSettings
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import floor_height
from vip_factors.solve.levenberg_marquardt import SolveSettings

SETTINGS = LiveSettings(frame_rate=30.0, calibration_rate=10.0, solve=SolveSettings(max_iterations=2))

# A recording of a moment.
QUICK = Kaichi(motions=Path(), clips=("07_01",), seconds=1.8, settings=SETTINGS)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return QUICK.scene(gestures(2.5), "walk", 0)


def _floating(jump_m: float) -> Motion:
    """Gestures on a floor that sinks by 6 cm, with a jump in the middle."""
    motion = gestures(4.0)
    path = motion.p_world_pelvis.copy()
    path[:, 2] += np.linspace(0.06, 0.0, len(path)) + jump_m * np.exp(-0.5 * ((motion.time - 2.0) / 0.12) ** 2)
    return Motion(motion.skeleton, motion.R_parent_child, path, motion.rate, 0.0, "floating")


def test_clips_stand_on_a_level_floor_and_jumps_stay() -> None:
    level = grounded(_floating(0.0))
    assert np.abs(floor_height(level.skeleton, level.state)).max() < 0.02
    assert share_off_ground(level) == 0
    jumping = grounded(_floating(0.4))
    height = floor_height(jumping.skeleton, jumping.state)
    assert height.max() > 0.35
    assert np.abs(height[: len(height) // 3]).max() < 0.02
    assert share_off_ground(jumping) > 0.03


def test_fewer_sensors_are_the_papers(scene: Scene) -> None:
    for count in (13, 12, 10, 8):
        wearer = with_sensors(scene, count).wearers[0]
        assert len(wearer.placed) == len(wearer.imus) == count
    assert not {"head", "left_thigh", "right_upper_arm"} & set(with_sensors(scene, 8).wearers[0].placed)
    with pytest.raises(InputError, match="9 IMUs: expected one of 13, 12, 10, 8"):
        with_sensors(scene, 9)


def test_their_calibration_is_right_if_pose_and_sensors_are() -> None:
    sensors = SimulateSettings.noise_free(heading_offset_deg=180.0)
    perfect = replace(QUICK, pose_error_deg=0.0, sensors=sensors).scene(gestures(2.5), "walk", 0)
    told = told_headings(perfect, Settings()).wearers[0]
    assert told.initial_pose == "none"
    true = true_calibration(perfect.wearers[0])
    for name, one in true_calibration(told).items():
        assert one.heading == true[name].heading
        assert angle_between(one.R_bone_sensor, true[name].R_bone_sensor) < np.deg2rad(1.0)


def test_under_told_straps_the_pose_gives_the_headings(scene: Scene) -> None:
    settings = Settings()
    known = true_calibration(told_headings(scene, settings).wearers[0])
    told = told_straps(scene, settings)
    names, start = nominal_start(told.wearers[0], settings)
    true = np.array([known[name].heading for name in names])
    turns = wrap_angle(true - start.headings)
    assert np.abs(wrap_angle(turns - mean_angle(turns))).max() < np.deg2rad(1.0)
    assert told.wearers[0].truth is scene.wearers[0].truth


def test_forms_use_what_the_papers_do() -> None:
    own = LiveSettings()
    imu, bare, unweighted, full = (our_settings(form, own) for form in Form)
    assert [one.fusion.use_camera for one in (imu, bare, unweighted, full)] == [False, True, True, True]
    assert imu.factors == own.factors  # without a camera the feet are all that holds the root
    assert [one.camera.ground_contact.use for one in (bare, unweighted, full)] == [False, True, True]
    assert [one.factors.foot_contact.use for one in (bare, unweighted, full)] == [False, True, True]
    assert [one.camera.reprojection.adaptive for one in (bare, unweighted, full)] == [True, False, True]


def test_errors_are_not_aligned_and_split_as_the_camera_looks(scene: Scene) -> None:
    motion, camera = true_motion(scene.wearers[0]), scene.truth
    away = (motion.p_world_pelvis - camera.camera.p_world_camera[0]) * [1.0, 1.0, 0.0]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    path = motion.p_world_pelvis + 0.1 * away
    off = Motion(motion.skeleton, motion.R_parent_child, path, motion.rate, motion.start, motion.name)
    blank = KaichiTrial("walking", "walk", 0, 13, Form.FULL, Way.THEIRS)
    trial = measured(blank, off, scene)
    assert trial.error_cm == pytest.approx(10.0, abs=0.01)
    assert trial.depth_bias_cm == pytest.approx(10.0, abs=0.01)
    assert max(trial.across_cm, trial.up_cm, trial.error_deg, trial.mpjpe_mm) < 1e-3
    imu = measured(KaichiTrial("walking", "walk", 0, 13, Form.IMU, Way.THEIRS), off, scene)
    assert imu.error_cm < 3.0  # the first frame's root is right, and later ones move with it


@pytest.mark.slow
def test_a_run_from_clips_to_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "07_01.bvh").touch()
    monkeypatch.setattr(scenes, "read_motion", lambda path: gestures(2.5))
    study = replace(QUICK, motions=tmp_path, imus=(13, 8), forms=("imu", "full"), ways=("theirs",))
    rows = run(study) + run(replace(study, imus=(13,), forms=("full",), ways=("newest", "smoothed")))
    assert not any(one.failure for one in rows)
    assert [one.way for one in rows[4:]] == [Way.NEWEST, Way.SMOOTHED]
    full = next(one for one in rows if one.form is Form.FULL)
    assert full.error_cm < 40
    assert len(full.joints_cm) == 16
    tables = markdown(study, rows)
    assert f"| {PUBLISHED_CM[Form.FULL]:g} |" in tables
    assert "| full | theirs, per frame |" in tables
    assert "13 IMUs | 8 IMUs" in tables
