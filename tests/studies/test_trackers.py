"""The thesis's trackers and Kaichi's: what each is told of a scene, and tiny runs all the way through."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies import scenes, vip
from tests.studies.kaichi import (
    PUBLISHED_CM,
    Form,
    Kaichi,
    KaichiTrial,
    Way,
    grounded,
    measured,
    our_settings,
    share_off_ground,
    told_headings,
    with_sensors,
)
from tests.studies.scenes import HOLD_S, chosen_clips, find_clips, nominal_start, true_calibration, true_motion, turned
from tests.studies.study import markdown, run
from tests.studies.vip import (
    VARIANTS,
    Vip,
    calibrated_at_first_frame,
    chosen_variants,
    distorted,
    errors_by_kind,
    scene_for,
    settings_of,
)
from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError, SolveError
from vip_factors.geometry.rotations import angle_between, wrap_angle
from vip_factors.sensors.scene import Scene
from vip_factors.settings import LiveSettings, Settings, SolveSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import floor_height

SETTINGS = Settings(frame_rate=30.0, calibration_rate=10.0, covariance=False, solve=SolveSettings(max_iterations=2))
LIVE = LiveSettings(frame_rate=30.0, calibration_rate=10.0, solve=SolveSettings(max_iterations=2))
PERFECT = SimulateSettings.noise_free(heading_offset_deg=90.0)
# Recordings of a moment.
QUICK = Vip(motions=Path(), clips=("07_01",), seconds=1.6, frame_rate=30.0, iterations=2, base=SETTINGS)
KAICHI = Kaichi(motions=Path(), clips=("07_01",), seconds=1.8, settings=LIVE)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return QUICK.scene(gestures(3.0), "walk", 0)


@pytest.fixture
def motions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "07_01.bvh").touch()
    monkeypatch.setattr(scenes, "read_motion", lambda path: gestures(3.0))
    return tmp_path


def test_every_variant_gets_its_share_of_the_truth(scene: Scene) -> None:
    true = scene.wearers[0].truth
    for variant in VARIANTS.values():
        settings = settings_of(variant, SETTINGS)
        given = scene_for(variant, scene, settings, 1, true.calibration)
        wearer = given.wearers[0]
        assert len(wearer.placed) == (6 if variant.six else 13)
        assert (given.camera is not None) == variant.camera == settings.fusion.use_camera
        if variant.start == "nominal pose" and not variant.distortion_deg:
            assert not settings.calibration.from_truth
            assert wearer.initial_pose == "t-pose"
        else:
            assert settings.calibration.from_truth
            assert set(wearer.truth.calibration or {}) >= set(wearer.placed)
        if given.camera is not None:
            assert (given.camera.known_path is not None) == variant.true_camera
        if variant.true_pixels:
            assert np.all(given.camera.truth.wearer == 0)
            seen = given.camera.detections.confidence == 1.0
            np.testing.assert_array_equal(given.camera.detections.pixels[seen], given.camera.truth.pixels[seen])
    assert scene.wearers[0].truth is true  # the scene itself is for the evaluation
    assert [one.name for one in chosen_variants(("VIP", "IT"))] == ["VIP", "IT"]
    with pytest.raises(InputError, match="unknown variant 'VIPER': expected some of IT, VIP"):
        chosen_variants(("VIPER",))


def test_distorted_headings_keep_the_declared_pose_and_the_pelvis(scene: Scene) -> None:
    names, start = nominal_start(scene.wearers[0], SETTINGS)
    pelvis = names.index("pelvis")
    other = distorted(start, pelvis, 45.0, np.random.default_rng(0))
    turns = wrap_angle(other.headings - start.headings)
    assert turns[pelvis] == 0
    assert np.all(np.abs(turns) <= np.deg2rad(45))
    assert np.ptp(np.rad2deg(turns)) > 30
    # With the heading its mounting turns: in the declared pose every bone is where it was.
    back = turned(other, -turns)
    assert np.max(angle_between(back.R_bone_sensor, start.R_bone_sensor)) < 1e-6


def test_first_frame_gives_the_simulators_mountings_if_nothing_errs() -> None:
    recording = replace(QUICK, sensors=PERFECT).scene(gestures(3.0), "walk", 0).wearers[0]
    found = true_calibration(calibrated_at_first_frame(recording))
    for sensor, calibration in true_calibration(recording).items():
        assert found[sensor].heading == calibration.heading
        assert angle_between(found[sensor].R_bone_sensor, calibration.R_bone_sensor) < 1e-6


def test_a_run_from_clips_to_tables(motions: Path) -> None:
    study = replace(QUICK, motions=motions, variants=("VIP-IT", "IT"))
    first, second = trials = run(study)
    assert [trial.variant for trial in trials] == ["VIP-IT", "IT"]  # VIP ran for the first, and is not told
    assert not first.failure
    assert first.mpjpe_mm != second.mpjpe_mm
    assert len(first.heading_deg) == len(first.mounting_deg) == 13
    assert "28.2 / 12.2" in markdown(study, trials)


def test_what_cannot_be_solved_is_told_and_left_out(motions: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(scene: Scene, settings: Settings) -> None:
        raise SolveError("the linear system is not determined")

    monkeypatch.setattr(vip, "smooth", fail)
    study = replace(QUICK, motions=motions, variants=("VIP",))
    trials = run(study)
    assert "not determined" in markdown(study, trials)
    assert np.isnan(errors_by_kind(trials)["mean"][0])


def test_clips_are_chosen_and_found(tmp_path: Path, scene: Scene) -> None:
    assert list(chosen_clips(("low",))) == ["low"]
    assert chosen_clips((), ("07_01",)) == {"walking": ("07_01",)}
    with pytest.raises(InputError, match="both of kind low and named 07_01"):
        chosen_clips(("low",), ("07_01",))
    with pytest.raises(InputError, match="'99_99' is neither"):
        chosen_clips((), ("99_99",))
    with pytest.raises(InputError, match="07_01"):
        find_clips(tmp_path, ["07_01"])
    with pytest.raises(InputError, match="expected a folder"):
        find_clips(tmp_path / "absent", ["07_01"])
    start, end = scene.wearers[0].interval
    assert end - start == pytest.approx(QUICK.seconds + HOLD_S, abs=0.05)
    with pytest.raises(InputError, match=r"lasts 1\.0"):
        QUICK.scene(gestures(1.0), "walk", 0)


@pytest.fixture(scope="module")
def filmed() -> Scene:
    return KAICHI.scene(gestures(2.5), "walk", 0)


def _floating(jump_m: float) -> Motion:
    """Gestures on a floor that sinks by 6 cm, with a jump in the middle."""
    motion = gestures(4.0)
    path = motion.p_world_pelvis.copy()
    path[:, 2] += np.linspace(0.06, 0.0, len(path)) + jump_m * np.exp(-0.5 * ((motion.time - 2.0) / 0.12) ** 2)
    return replace(motion, p_world_pelvis=path)


def test_clips_stand_on_a_level_floor_and_jumps_stay() -> None:
    level = grounded(_floating(0.0))
    assert np.abs(floor_height(level.skeleton, level.state)).max() < 0.02
    assert share_off_ground(level) == 0
    jumping = grounded(_floating(0.4))
    height = floor_height(jumping.skeleton, jumping.state)
    assert height.max() > 0.35
    assert np.abs(height[: len(height) // 3]).max() < 0.02
    assert share_off_ground(jumping) > 0.03


def test_fewer_sensors_are_the_papers(filmed: Scene) -> None:
    for count in (13, 12, 10, 8):
        wearer = with_sensors(filmed, count).wearers[0]
        assert len(wearer.placed) == len(wearer.imus) == count
    assert not {"head", "left_thigh", "right_upper_arm"} & set(with_sensors(filmed, 8).wearers[0].placed)
    with pytest.raises(InputError, match="9 IMUs: expected one of 13, 12, 10, 8"):
        with_sensors(filmed, 9)


def test_their_calibration_is_right_if_pose_and_sensors_are() -> None:
    perfect = replace(KAICHI, pose_error_deg=0.0, sensors=PERFECT).scene(gestures(2.5), "walk", 0)
    told = told_headings(perfect, Settings()).wearers[0]
    assert told.initial_pose == "none"
    true = true_calibration(perfect.wearers[0])
    for name, one in true_calibration(told).items():
        assert one.heading == true[name].heading
        assert angle_between(one.R_bone_sensor, true[name].R_bone_sensor) < np.deg2rad(1.0)


def test_forms_use_what_the_papers_do() -> None:
    own = LiveSettings()
    imu, bare, unweighted, full = (our_settings(form, own) for form in Form)
    assert [one.fusion.use_camera for one in (imu, bare, unweighted, full)] == [False, True, True, True]
    assert imu.factors == own.factors  # without a camera the feet are all that holds the root
    assert [one.camera.ground_contact.use for one in (bare, unweighted, full)] == [False, True, True]
    assert [one.factors.foot_contact.use for one in (bare, unweighted, full)] == [False, True, True]
    assert [one.camera.reprojection.adaptive for one in (bare, unweighted, full)] == [True, False, True]


def test_errors_are_not_aligned(filmed: Scene) -> None:
    motion = true_motion(filmed.wearers[0])
    off = replace(motion, p_world_pelvis=motion.p_world_pelvis + np.array([0.06, 0.0, 0.08]))
    trial = measured(KaichiTrial("walk", 0, 13, Form.FULL, Way.THEIRS), off, filmed)
    assert trial.error_cm == pytest.approx(10.0, abs=0.01)
    assert trial.error_deg < 1e-3
    imu = measured(KaichiTrial("walk", 0, 13, Form.IMU, Way.THEIRS), off, filmed)
    assert imu.error_cm < 0.01  # the first frame's root is right, and later ones move with it


@pytest.mark.slow
def test_kaichi_from_clips_to_tables(motions: Path) -> None:
    study = replace(KAICHI, motions=motions, imus=(13, 8), forms=("imu", "full"))
    rows = run(study)
    assert not any(one.failure for one in rows)
    assert [one.way for one in rows[:3]] == list(Way)
    assert next(one for one in rows if one.form is Form.FULL).error_cm < 40
    tables = markdown(study, rows)
    assert f"| {PUBLISHED_CM[Form.FULL]:g} |" in tables
    assert "| full | theirs, per frame |" in tables
    assert "13 IMUs | 8 IMUs" in tables
