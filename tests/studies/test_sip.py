"""The accuracy study on a synthetic clip: small, but all the way through."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies import scenes
from tests.studies.scenes import HOLD_S, calibrated_at_first_frame, find_clips, true_calibration
from tests.studies.sip import VARIANTS, Sip, gain
from tests.studies.study import markdown, run
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.solve.levenberg_marquardt import SolveSettings

QUICK = Sip(
    motions=Path(), clips=("07_01",), seconds=2.0, pose_error_deg=3.0, frame_rate=20.0,
    settings=Settings(solve=SolveSettings(max_iterations=3)),
)  # fmt: skip


def test_every_variant_is_tried_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "07_01.bvh").touch()
    monkeypatch.setattr(scenes, "read_motion", lambda path: gestures(3.0))
    study, told = replace(QUICK, motions=tmp_path), list[float]()
    trials = run(study, lambda stage, fraction: told.append(fraction))
    assert [trial.variant for trial in trials] == list(VARIANTS)
    assert all(np.isfinite(trial.mpjpe_mm) and 0 < trial.frames <= 21 for trial in trials)
    assert told == sorted(told)
    tables = markdown(study, trials)
    assert "| SIP | zero pose, calibrated |" in tables
    assert "76.2 / 19.7" in tables


def test_first_frame_gives_the_simulators_mountings_if_nothing_errs() -> None:
    recording = replace(QUICK, sensors=SimulateSettings.noise_free()).recording(gestures(3.0), "walk", 0)
    found = true_calibration(calibrated_at_first_frame(recording))
    for sensor, calibration in true_calibration(recording).items():
        assert found[sensor].heading == calibration.heading
        assert angle_between(found[sensor].R_bone_sensor, calibration.R_bone_sensor) < 1e-6


def test_the_middle_of_a_long_clip_is_taken_and_short_ones_are_refused() -> None:
    start, end = QUICK.recording(gestures(6.0), "walk", 0).interval
    assert end - start == pytest.approx(QUICK.seconds + HOLD_S, abs=0.05)
    with pytest.raises(InputError, match=r"lasts 1\.0"):
        QUICK.recording(gestures(1.0), "walk", 0)


def test_missing_clips_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="07_01"):
        find_clips(tmp_path, ["07_01"])
    with pytest.raises(InputError, match="expected a folder"):
        find_clips(tmp_path / "absent", ["07_01"])


def test_gain_is_in_percent() -> None:
    assert gain(76.2, 52.2) == pytest.approx(31.5, abs=0.05)
