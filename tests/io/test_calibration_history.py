"""What a live estimate's file knows of its calibrations over time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from live_answers import answers, live_scene, setup_of
from scene_sample import estimate_of, scene_sample

from vip_factors.errors import InputError
from vip_factors.io.live_mcap import LiveMcapSink
from vip_factors.io.mcap_estimate import read_calibration_history
from vip_factors.io.mcap_estimate_writer import write_estimate


def test_headings_come_back_with_the_times_at_which_they_were_believed(tmp_path: Path) -> None:
    scene, heading = live_scene(2.2), {}
    with LiveMcapSink(tmp_path / "e.mcap", setup_of(scene), 60.0) as sink:
        for one in answers(scene):
            turned = []
            for wearer in one.wearers:
                head = replace(wearer.calibration["head"], heading=0.1 * one.time)
                turned.append(replace(wearer, calibration={**wearer.calibration, "head": head}))
            heading[round(one.time, 3)] = 0.1 * one.time
            sink.write(replace(one, wearers=tuple(turned)))
    histories = read_calibration_history(tmp_path / "e.mcap")
    assert len(histories) == 2
    for times, calibrations in histories:
        assert len(times) == len(calibrations) >= 4
        assert (np.diff(times) > 0).all()
        for time, calibration in zip(times, calibrations, strict=True):
            assert calibration["head"].heading == pytest.approx(heading[round(float(time), 3)], abs=1e-6)


def test_an_estimate_of_the_whole_has_one_entry(tmp_path: Path) -> None:
    scene = scene_sample(0.2)
    write_estimate(estimate_of(scene), tmp_path / "e.mcap")
    histories = read_calibration_history(tmp_path / "e.mcap")
    assert [len(times) for times, _ in histories] == [1, 1]
    with pytest.raises(InputError):
        read_calibration_history(tmp_path / "none.mcap")
