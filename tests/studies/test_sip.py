"""The accuracy benchmark on a synthetic clip: small, but all the way through."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.studies import sip
from tests.studies.first_frame import calibrated_at_first_frame
from tests.studies.sip import SipTrials, find_clips, recording_of, run_sip
from tests.studies.sip_table import gain, sip_json, sip_table
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.solve.levenberg_marquardt import SolveSettings

QUICK = SipTrials(
    seconds=2.0, pose_error_deg=3.0, settings=Settings(frame_rate=20.0, solve=SolveSettings(max_iterations=3))
)


@pytest.fixture
def clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "walk.bvh").touch()
    monkeypatch.setattr(sip, "read_motion", lambda path: gestures(3.0))
    return tmp_path


def test_every_variant_is_tried_and_told(clip: Path) -> None:
    told: list[float] = []
    trials = run_sip(clip, QUICK, lambda stage, fraction: told.append(fraction), {"walking": ("walk",)})
    assert [trial.variant for trial in trials] == list(sip.VARIANTS)
    assert all(np.isfinite(trial.mpjpe_mm) and 0 < trial.frames <= 21 for trial in trials)
    assert told == sorted(told)
    table = sip_table(trials, QUICK)
    assert "| SIP | zero pose, calibrated |" in table
    assert "76.2 / 19.7" in table
    written = json.loads(sip_json(trials, QUICK))
    assert written["means"][0]["kinds"]["mean"]["mpjpe_mm"] == pytest.approx(trials[0].mpjpe_mm)
    assert written["settings"]["settings"]["frame_rate"] == 20.0


def test_first_frame_gives_the_simulators_mountings_if_nothing_errs() -> None:
    recording = recording_of(gestures(3.0), "walk", replace(QUICK, sensors=SimulateSettings.noise_free()), 0)
    known = calibrated_at_first_frame(recording)
    assert recording.truth is not None
    assert known.truth is not None
    for sensor, calibration in (recording.truth.calibration or {}).items():
        found = (known.truth.calibration or {})[sensor]
        assert found.heading == calibration.heading
        assert angle_between(found.R_bone_sensor, calibration.R_bone_sensor) < 1e-6


def test_the_middle_of_a_long_clip_is_taken() -> None:
    recording = recording_of(gestures(6.0), "walk", QUICK, 0)
    start, end = recording.interval
    assert end - start == pytest.approx(QUICK.seconds + sip.HOLD_S, abs=0.05)


def test_missing_clips_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="07_01"):
        find_clips(tmp_path, ["07_01"])
    with pytest.raises(InputError, match="expected a folder"):
        find_clips(tmp_path / "absent", ["07_01"])


def test_short_clips_are_refused() -> None:
    with pytest.raises(InputError, match=r"lasts 1\.0"):
        recording_of(gestures(1.0), "walk", QUICK, 0)


def test_gain_is_in_percent() -> None:
    assert gain(76.2, 52.2) == pytest.approx(31.5, abs=0.05)
