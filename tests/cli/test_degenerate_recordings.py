"""Recordings that cannot tell a motion: each gets the true sentence, in batch and live."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import vip_factors as vip
from vip_factors.errors import RecordingError
from vip_factors.findings import Severity
from vip_factors.geometry.rotations import exp
from vip_factors.initialise.sensor_clocks import joint_signal, link_delay
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.settings import CalibrationSettings, SolveSettings, StartSettings

SMALL = vip.Settings(
    frame_rate=10.0,
    calibration_rate=10.0,
    covariance=False,
    calibration=CalibrationSettings(start=StartSettings(search=False)),
    solve=SolveSettings(max_iterations=2),
)


@cache
def moving() -> Recording:
    (wearer,) = vip.simulate(seconds=8.0, placement="totalcapture13", seed=3).wearers
    return replace(wearer, truth=None)


def changed(change: Callable[[ImuStream], ImuStream]) -> Recording:
    return replace(moving(), imus={name: change(stream) for name, stream in moving().imus.items()})


def every(stream: ImuStream, step: int) -> ImuStream:
    arrays = {name: values[::step] for name, values in vars(stream).items() if isinstance(values, np.ndarray)}
    return replace(stream, **arrays)  # type: ignore[arg-type]


def without_forces(names: set[str]) -> Recording:
    def without(stream: ImuStream) -> ImuStream:
        assert stream.specific_force is not None
        assert stream.R_inertial_sensor is not None
        free = stream.specific_force - 9.81 * stream.R_inertial_sensor[:, 2]
        return replace(stream, specific_force=free) if stream.name in names else stream

    return changed(without)


def copies() -> Recording:
    alike, pelvis = only("pelvis", "sternum", "left_thigh", "right_thigh"), moving().imus["pelvis"]
    return replace(alike, imus={name: replace(pelvis, name=name) for name in alike.imus})


def only(*sensors: str) -> Recording:
    sites = tuple(site for site in moving().placement.sites if site.sensor in sensors)
    imus = {name: moving().imus[name] for name in sensors}
    return replace(moving(), imus=imus, placement=replace(moving().placement, sites=sites))


DEGENERATE = {
    "copies": (copies, Severity.DOUBT, "are copies of one sensor"),
    "slow": (lambda: changed(lambda stream: every(stream, 60)), Severity.DOUBT, "samples a second"),
    "alone": (lambda: only("pelvis"), Severity.CARE, "1 sensor and no camera determines joints"),
    "all": (moving, Severity.CARE, "13 sensors and no camera determine joints"),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_a_recording_that_cannot_tell_a_motion_says_so(name: str) -> None:
    make, severity, words = DEGENERATE[name]
    estimate = vip.smooth(make(), SMALL)
    assert estimate.verdict.severity is severity
    assert any(words in str(finding) for finding in estimate.all_findings)


@pytest.mark.parametrize("name", ["copies", "alone"])
def test_a_stream_says_the_same(run, tmp_path, name: str) -> None:
    make, severity, words = DEGENERATE[name]
    vip.write(make(), tmp_path / "made.mcap")
    options = ("--out", tmp_path / "live.mcap", "--frame-rate", 20, "--recalibration.no-use")
    streamed = run("stream", tmp_path / "made.mcap", *options)
    assert streamed.code == 0, streamed.err
    told = " ".join((streamed.out + streamed.err).split())
    assert words in told
    assert f"verdict: {severity.value.upper()}" in told


def test_one_sensor_without_gravity_is_used_without_its_accelerations() -> None:
    estimate = vip.smooth(without_forces({"left_forearm"}), SMALL)
    assert any("'left_forearm' measures gravity as" in str(finding) for finding in estimate.all_findings)
    assert "left_forearm" in estimate.wearers[0].calibration


def test_a_recording_without_gravity_is_refused() -> None:
    with pytest.raises(RecordingError, match=r"expected 9\.81; give accelerations with gravity"):
        vip.smooth(without_forces(set(moving().imus)), SMALL)


def test_a_long_pause_is_reported() -> None:
    def paused(stream: ImuStream) -> ImuStream:
        return replace(stream, time=np.where(stream.time > 5.0, stream.time + 40.0, stream.time))

    estimate = vip.smooth(changed(paused), replace(SMALL, frame_rate=5.0, calibration_rate=5.0))
    assert any("all sensors at 5.0 s for 40.0 s" in str(finding) for finding in estimate.all_findings)


@pytest.mark.parametrize("seed", range(4))
def test_who_stands_still_shows_no_clock_offset(seed: int) -> None:
    random, time = np.random.default_rng(seed), np.arange(2000) / 100

    def still(name: str) -> ImuStream:
        force = np.array([0.0, 0.0, 9.81]) + 0.1 * random.standard_normal((len(time), 3))
        sway = exp(0.002 * random.standard_normal((len(time), 3)))
        return ImuStream(name, time, force, sway)

    parent, child = joint_signal(still("thigh")), joint_signal(still("shank"))
    assert parent is not None
    assert child is not None
    assert link_delay(parent, child) is None
