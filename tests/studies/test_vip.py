"""The video-inertial benchmark: what each tracker is told, and a tiny run all the way through."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies import scenes, vip
from tests.studies.scenes import (
    HOLD_S,
    calibrated_at_first_frame,
    chosen_clips,
    distorted,
    find_clips,
    nominal_start,
    start_errors,
    true_calibration,
    turned,
)
from tests.studies.study import markdown, run
from tests.studies.vip import Vip, errors_by_kind
from tests.studies.vip_variants import PUBLISHED, VARIANTS, chosen_variants, settings_of, told
from vip_factors.errors import InputError, SolveError
from vip_factors.geometry.rotations import angle_between, wrap_angle
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.solve.levenberg_marquardt import SolveSettings

SETTINGS = Settings(frame_rate=30.0, calibration_rate=10.0, solve=SolveSettings(max_iterations=2))

# A recording of a moment.
QUICK = Vip(motions=Path(), clips=("07_01",), seconds=1.6, frame_rate=30.0, iterations=2, base=SETTINGS)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return QUICK.scene(gestures(3.0), "walk", 0)


def test_the_thesis_names_its_trackers_as_we_do() -> None:
    assert set(PUBLISHED) <= set(VARIANTS)
    assert [one.name for one in chosen_variants(("VIP", "IT"))] == ["VIP", "IT"]
    with pytest.raises(InputError, match="unknown variant 'VIPER': expected some of IT, VIP"):
        chosen_variants(("VIPER",))


def test_every_variant_gets_its_share_of_the_truth(scene: Scene) -> None:
    true = scene.wearers[0].truth
    assert true is not None
    for variant in VARIANTS.values():
        settings = settings_of(variant, SETTINGS)
        given = told(scene, variant, settings, 1, true.calibration)
        wearer = given.wearers[0]
        assert len(wearer.placed) == (6 if variant.six else 13)
        assert (given.camera is None) == (not variant.camera)
        assert settings.fusion.use_camera == variant.camera
        if variant.start == "nominal pose" and not variant.distortion_deg:
            assert not settings.calibration.from_truth
            assert wearer.initial_pose == "t-pose"
        else:
            assert settings.calibration.from_truth
            assert wearer.truth is not None
            assert set(wearer.truth.calibration or {}) >= set(wearer.placed)
        if given.camera is not None:
            assert (given.camera.known_path is not None) == variant.true_camera
    assert scene.wearers[0].truth is true  # the scene itself is for the evaluation


def test_true_pixels_are_of_the_wearer_alone_and_sure(scene: Scene) -> None:
    given = told(scene, VARIANTS["VIP-2D"], SETTINGS, 0)
    assert given.camera is not None
    assert given.truth is not None
    detections = given.camera.detections
    assert np.all(given.truth.wearer == 0)
    assert set(np.unique(detections.confidence)) <= {0.0, 1.0}
    seen = detections.confidence > 0
    np.testing.assert_array_equal(detections.pixels[seen], given.truth.pixels[seen])  # type: ignore[index]


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
    assert other.R_world_bone is start.R_world_bone


def test_without_errors_the_start_is_right() -> None:
    perfect = replace(QUICK, pose_error_deg=0.0, sensors=SimulateSettings.noise_free(heading_offset_deg=90.0))
    found = start_errors(perfect.scene(gestures(3.0), "walk", 0).wearers[0], SETTINGS)
    assert max(found.heading_deg, found.mounting_deg, found.pose_alone_deg) < 1.0


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Vip:
    (tmp_path / "07_01.bvh").touch()
    monkeypatch.setattr(scenes, "read_motion", lambda path: gestures(3.0))
    return replace(QUICK, motions=tmp_path)


def test_a_run_from_clips_to_tables(study: Vip) -> None:
    study = replace(study, variants=("VIP-IT", "IT"))
    first, second = trials = run(study)
    assert [trial.variant for trial in trials] == ["VIP-IT", "IT"]  # VIP ran for the first, and is not told
    assert not first.failure
    assert first.mpjpe_mm != second.mpjpe_mm
    assert len(first.sensors) == 13
    assert sum(sensor.at_end for sensor in first.sensors) == 2
    assert first.start is not None
    tables = markdown(study, trials)
    assert "| VIP-IT |" in tables
    assert "28.2 / 12.2" in tables
    ratio = 100 * first.mpjpe_mm / second.mpjpe_mm
    assert f"- MPJPE of VIP-IT is {ratio:.1f} % of IT's" in tables
    assert "(thesis 51.3 %, -26.8 mm)" in tables


def test_what_cannot_be_solved_is_told_and_left_out(study: Vip, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(scene: Scene, settings: Settings) -> None:
        raise SolveError("the linear system is not determined")

    monkeypatch.setattr(vip, "smooth", fail)
    trials = run(replace(study, variants=("VIP",)))
    assert "not determined" in markdown(study, trials)
    assert np.isnan(errors_by_kind(trials)["mean"][0])


def test_clips_are_chosen_by_kind_and_name() -> None:
    assert list(chosen_clips(("low",))) == ["low"]
    assert chosen_clips((), ("07_01",)) == {"walking": ("07_01",)}
    with pytest.raises(InputError, match="both of kind low and named 07_01"):
        chosen_clips(("low",), ("07_01",))
    with pytest.raises(InputError, match="'99_99' is neither"):
        chosen_clips((), ("99_99",))


def test_first_frame_gives_the_simulators_mountings_if_nothing_errs() -> None:
    perfect = replace(QUICK, sensors=SimulateSettings.noise_free(heading_offset_deg=90.0))
    recording = perfect.scene(gestures(3.0), "walk", 0).wearers[0]
    found = true_calibration(calibrated_at_first_frame(recording))
    for sensor, calibration in true_calibration(recording).items():
        assert found[sensor].heading == calibration.heading
        assert angle_between(found[sensor].R_bone_sensor, calibration.R_bone_sensor) < 1e-6


def test_the_middle_of_a_long_clip_is_taken_and_short_ones_are_refused(scene: Scene) -> None:
    start, end = scene.wearers[0].interval
    assert end - start == pytest.approx(QUICK.seconds + HOLD_S, abs=0.05)
    with pytest.raises(InputError, match=r"lasts 1\.0"):
        QUICK.scene(gestures(1.0), "walk", 0)


def test_missing_clips_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="07_01"):
        find_clips(tmp_path, ["07_01"])
    with pytest.raises(InputError, match="expected a folder"):
        find_clips(tmp_path / "absent", ["07_01"])
