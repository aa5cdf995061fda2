"""Accelerometers that are wrong by themselves, on a real recording with two of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vip_factors.initialise.sensor_faults import accelerometer_scale, is_scale_wrong
from vip_factors.io.convert import read_log

ORDER = ("torso", "pelvis", "tibia_r", "femur_r", "tibia_l", "femur_l", "toes_r", "toes_l")


@pytest.mark.data
def test_the_two_that_are_wrong_on_the_treadmill(data_folder: Path) -> None:
    """Walking without a rest; the file's own header says in which order its columns are."""
    folder = data_folder / "xsens_treadmill_optical"
    force = np.loadtxt(folder / "OpenSim_Sub02_CSBaseline_Accel.trc", skiprows=6)[:, 2:].reshape(-1, len(ORDER), 3)
    streams = read_log(folder / "OpenSim_Sub02_CSBaseline_Orientations.sto").imus
    wrong = {}
    for number, bone in enumerate(ORDER):
        stream = next(one for name, one in streams.items() if name.startswith(bone))
        found = accelerometer_scale(replace(stream, specific_force=force[: len(stream), number]))
        assert found is not None
        if is_scale_wrong(*found):
            wrong[bone] = found[0]
    assert wrong == pytest.approx({"torso": 1.157, "toes_l": 1.224}, abs=0.005)
