"""The real walk beats the commercial result where it did when this was written; it needs the recordings."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.study import run
from tests.studies.walk import Walk, read_vicon
from vip_factors.errors import FileFormatError
from vip_factors.settings import Settings


def test_a_file_without_the_columns_is_named(tmp_path: Path) -> None:
    path = tmp_path / "vicon.csv"
    path.write_text("// fs=100\nPELV_1,PELV_2\n0,1\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match="PELV_3"):
        read_vicon(path)


@pytest.mark.data
@pytest.mark.slow
def test_knees_are_nearer_to_vicon_than_mvn(data_folder: Path) -> None:
    (result,) = run(Walk(folder=data_folder / "xsens_vicon_walk", settings=Settings(frame_rate=30.0)))
    assert np.mean([e.rmse for e in result.ours.values()]) < np.mean([e.rmse for e in result.mvn.values()])
    assert np.mean(list(result.centres_mm.values())) < 25
