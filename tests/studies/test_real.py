"""Real recordings become rows: angles against optical references, findings.

The real walk beats the commercial result where it did when this was written; it needs the recordings.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.__main__ import main
from tests.studies.gait import TRIAL, Agreement, AngleError, vicon_angles
from tests.studies.marker_body import SIDES
from tests.studies.real import Real, RealTrial
from tests.studies.real_recordings import real_recordings
from tests.studies.study import markdown, run
from vip_factors.errors import FileFormatError


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
        {"smooth": Agreement("knee", 0.1, 0.9, 8.0, 5.0, 2.0, 61.0)}, 1.0, 2.0, ("crossed legs",), (),
    )  # fmt: skip
    table = markdown(Real(data=Path()), [one])
    assert "| a walk | 20 | 5.0 (2.0) | 5.0 (2.0) | 12.0 | n/a | n/a | n/a | 1, 0 |" in table
    assert "| — OpenSense |  | 5.0 (2.0) | 5.0 (2.0) |" in table
    assert "| mean | 6.0 (1.0) | n/a | 30.0 | 20.0 | 25.0 | 40.0 | n/a | n/a |" in table
    assert "| a walk | smooth | knee | 0.10 | 0.90 | 8.0 (5.0) | 2 to 61 |" in table


def test_a_folder_without_recordings_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not list(real_recordings(tmp_path))
    assert main(["real", "--data", str(tmp_path)]) == 2
    assert "none of the public recordings in it" in capsys.readouterr().err
    assert main(["real", "--data", str(tmp_path), "--camera", "carried"]) == 2
    assert "expected geneva_gait" in " ".join(capsys.readouterr().err.split())


def test_a_file_without_the_columns_is_named(tmp_path: Path) -> None:
    (tmp_path / "vicon").mkdir()
    (tmp_path / "vicon" / f"{TRIAL}.csv").write_text("// fs=100\nLFEP_1,LFEP_2\n0,1\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match="LFEP_3"):
        vicon_angles(tmp_path)


@pytest.mark.data
@pytest.mark.slow
def test_knees_are_nearer_to_vicon_than_mvn(data_folder: Path) -> None:
    (result,) = run(Real(data=data_folder, named="xsens_vicon_walk", live=False))
    ours, mvns = ([errors[f"{side}_knee"].rmse for side in SIDES] for errors in (result.batch, result.other[1]))
    assert np.mean(ours) < np.mean(mvns)
    assert result.centres_mm[0] < 25
