"""Which angles are measured, what charts keep, and the gait of who walks."""

import json
import time
from dataclasses import replace

import numpy as np
import pytest
from simulated_walk import walk

from vip_factors.body.joint_angles import is_measured
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.gait.analysis import bones_with_sensors
from vip_factors.gait.files import curves_figure, side_table
from vip_factors.report.report_data import ReportData, ReportWearer
from vip_factors.report.sections import gait_section, time_charts
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.sensors.scene import as_scene
from vip_factors.viz.charts import Curve, thinned


def test_angles_without_sensors_are_known_as_such() -> None:
    motion = walk(0.1)
    placement = preset("totalcapture13", motion.skeleton)
    legs = replace(placement, sites=tuple(site for site in placement.sites if site.bone in (
        "pelvis", "left_hip", "right_hip", "left_knee", "right_knee")))  # fmt: skip
    sensors = tuple(site.sensor for site in legs.sites)
    estimate = WearerEstimate("legs", "SIP", motion, {}, sensors=sensors)
    bones = bones_with_sensors(estimate, Recording("legs", Subject(), {}, placement))
    told = {name: is_measured(bones, f"{name}_flexion") for name in ("hip", "knee", "ankle", "elbow", "trunk")}
    assert told == {"hip": True, "knee": True, "ankle": False, "elbow": False, "trunk": False}
    assert is_measured(None, "elbow_flexion")


def test_charts_keep_peaks_and_gaps() -> None:
    times = np.arange(20_000) / 60
    values = np.sin(times)
    values[12_345] = 5.0
    values[3_000:3_400] = np.nan
    thin = thinned(times, values)[1]
    assert len(thin) < 1000
    assert np.nanmax(thin) == 5.0
    assert np.isnan(thin).any()
    (chart,) = time_charts("t", [Curve('a "quoted" & <odd> name', times, values, "#000000")], "°")
    (curve,) = json.loads(chart.numbers)["curves"]
    assert None in curve["values"]
    assert max(value for value in curve["values"] if value is not None) == 5.0
    assert "<odd>" not in chart.svg
    assert time_charts("t", [Curve("a", times, np.full(len(times), np.nan), "#000000")]) == []


def test_who_walks_has_a_section() -> None:
    section = gait_section(ReportWearer(0, "Ada", WearerEstimate("walk", "SIP", walk(6.0), {}), None), False, "GOOD")
    assert section is not None
    assert [row[0] for row in side_table(section).rows][:3] == ["strides, n", "stride time, s", "stride length, m"]
    assert curves_figure(section) is not None
    assert (
        gait_section(ReportWearer(0, "Bea", WearerEstimate("stand", "SIP", walk(0.5), {}), None), False, "GOOD") is None
    )


@pytest.mark.parametrize(("zone", "day"), [("Pacific/Auckland", "2 May 2024"), ("America/New_York", "1 May 2024")])
def test_a_report_has_the_local_day_of_the_recording(monkeypatch: pytest.MonkeyPatch, zone: str, day: str) -> None:
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    try:
        motion = walk(0.5)
        placement = preset("sip6", motion.skeleton)
        recording = Recording("walk", Subject(), {}, placement, start_ns=1_714_590_000 * 10**9)
        estimate = Estimate.of_one(WearerEstimate("walk", "SIP", motion, {}))
        assert ReportData(estimate, as_scene(recording)).date == f"recorded {day}"
        assert ReportData(estimate).date.startswith("reported ")
    finally:
        monkeypatch.undo()
        time.tzset()
