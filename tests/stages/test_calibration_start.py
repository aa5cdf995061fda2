"""Starts of headings and mountings on small simulated recordings: what one source has wrong another knows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from vip_factors.findings import sentences
from vip_factors.geometry.rotations import angle_between, exp, rotation_z, wrap_angle
from vip_factors.initialise.start_search import Starts
from vip_factors.sensors.calibration import Placement, preset
from vip_factors.sensors.frames import resample
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose
from vip_factors.stages.calibration_start import search_start, start_findings
from vip_factors.stages.inertial import first_calibration

LIMBS = ("left_upper_arm", "right_forearm", "left_thigh", "right_thigh", "left_shank")


@cache
def recorded(preset_name: str = "tnt10", pose: str = "n-pose", headings_deg: float = 0.0) -> Recording:
    motion = gestures(8.0)
    if pose != "none":
        motion = with_initial_pose(motion, pose, hold_s=1.0)
    sensors = replace(SimulateSettings.noise_free(heading_offset_deg=headings_deg), imu_rate=30.0)
    made = simulate_recording(motion, preset(preset_name, motion.skeleton), sensors, seed=4, initial_pose=pose)
    return replace(made, subject=Subject(skeleton=motion.skeleton))


def strapped_on_otherwise(recording: Recording, names: tuple[str, ...], degrees: float) -> Recording:
    """The same sensors, but the placement has some of them turned about their limbs."""
    body = recording.subject.body()
    sites = []
    for site in recording.placement.sites:
        limb = body.limb(site.bone_index)
        if site.sensor in names and limb is not None:
            turn = exp(np.deg2rad(degrees) * limb / np.linalg.norm(limb))
            site = replace(site, R_bone_sensor=turn @ site.R_bone_sensor)
        sites.append(site)
    return replace(recording, placement=Placement(tuple(sites)))


def searched(recording: Recording) -> tuple[Starts, tuple[str, ...]]:
    settings, frames = Settings(), resample(recording, 15.0)
    starts = search_start(recording, frames, first_calibration(recording, frames, settings), settings)
    assert starts is not None
    return starts, frames.sensors


def wrong(recording: Recording, starts: Starts | None = None) -> list[str]:
    """The sensors that start turned by more than 60°, on the bone or about the vertical."""
    starts, names = starts or searched(recording)[0], recording.placed
    assert recording.truth is not None
    assert recording.truth.calibration is not None
    true, found = recording.truth.calibration, starts.best.calibration
    off = np.array([found.headings[s] - true[name].heading for s, name in enumerate(names)])
    off = wrap_angle(off - np.angle(np.exp(1j * off).mean()))
    turned = [angle_between(true[name].R_bone_sensor, found.R_bone_sensor[s]) for s, name in enumerate(names)]
    return [name for s, name in enumerate(names) if max(turned[s], abs(off[s])) > np.deg2rad(60)]


@pytest.mark.parametrize("pose", ["n-pose", "t-pose", "none"])
def test_what_is_as_supposed_starts_right(pose: str) -> None:
    starts, names = searched(recorded(pose=pose))
    assert wrong(recorded(pose=pose), starts) == []
    assert list(start_findings("anna", names, starts)) == []


@pytest.mark.parametrize("pose", ["n-pose", "t-pose"])
def test_inertial_frames_agree_but_straps_are_turned(pose: str) -> None:
    """The usual start follows the straps and has these limbs 120° wrong."""
    recording = strapped_on_otherwise(recorded(pose=pose), LIMBS, 120.0)
    assert wrong(recording) == []


@pytest.mark.parametrize("pose", ["n-pose", "none"])
def test_straps_sit_as_placed_but_inertial_frames_point_anywhere(pose: str) -> None:
    assert wrong(recorded(pose=pose, headings_deg=180.0)) == []


def test_one_sensor_that_was_started_elsewhere_and_strapped_on_otherwise() -> None:
    recording = strapped_on_otherwise(recorded(), ("left_shank",), 120.0)
    stream = recording.imus["left_shank"]
    assert stream.R_inertial_sensor is not None
    turned = replace(stream, R_inertial_sensor=rotation_z(np.deg2rad(100.0)) @ stream.R_inertial_sensor)
    recording = replace(recording, imus={**recording.imus, "left_shank": turned})
    starts, names = searched(recording)
    mounting = starts.best.calibration.R_bone_sensor[names.index("left_shank")]
    assert recording.truth is not None
    assert recording.truth.calibration is not None
    assert angle_between(recording.truth.calibration["left_shank"].R_bone_sensor, mounting) < np.deg2rad(45)


def test_a_start_that_nothing_tells_is_flagged() -> None:
    """Six sensors strapped on anyhow, frames that point anywhere, and no pose."""
    recording = recorded("sip6", "none", 180.0)
    rng = np.random.default_rng(1)
    sites = tuple(
        replace(site, R_bone_sensor=site.R_bone_sensor @ exp(rng.normal(0, 1.5, 3)))
        for site in recording.placement.sites
    )
    starts, names = searched(replace(recording, placement=Placement(sites)))
    told = sentences(start_findings("anna", names, starts))
    assert told
    assert all("at the start" in sentence for sentence in told)


def test_mountings_that_are_known_stay() -> None:
    recording = recorded("sip6", "none")
    settings, frames = Settings(calibration=CalibrationSettings(estimate_mountings=False)), resample(recording, 15.0)
    usual = first_calibration(recording, frames, settings)
    starts = search_start(recording, frames, usual, settings)
    assert starts is not None
    assert np.array_equal(starts.best.calibration.R_bone_sensor, usual.R_bone_sensor)
    assert wrong(recording, starts) == []


def test_one_sensor_has_no_choice() -> None:
    recording = recorded()
    alone = replace(recording, placement=Placement(recording.placement.sites[:1]))
    frames = resample(alone, 15.0)
    usual = first_calibration(alone, frames, Settings())
    assert search_start(alone, frames, usual, Settings()) is None
