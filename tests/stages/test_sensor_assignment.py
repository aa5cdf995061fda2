"""Sensors in each other's places are found and told, and exchanged if wanted; those in their own are left there."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from filmed_gestures import filmed_gestures

from vip_factors.findings import Finding
from vip_factors.geometry.rotations import exp, rotation_z
from vip_factors.initialise.sensor_assignment import LEAST_NATS, Exchange, exchanged, exchanged_sensors
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.sensors.sources import SceneInMemory
from vip_factors.settings import Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.simulate.staging import with_initial_pose
from vip_factors.stages.sensor_assignment import exchanges_of, with_sensors_assigned

LEGS = ("pelvis", "left_thigh", "left_shank", "left_foot", "right_thigh", "right_shank", "right_foot")


@cache
def legs() -> Recording:
    motion = gestures(12.0)
    whole = preset("totalcapture13", motion.skeleton)
    placement = replace(whole, sites=tuple(site for site in whole.sites if site.sensor in LEGS))
    return simulate_recording(motion, placement, SimulateSettings(), seed=1)


def mistaken(one: str, other: str) -> Recording:
    """The recording with two sensors in each other's places, and a truth that does not know of it."""
    numbers = legs().placed.index(one), legs().placed.index(other)
    return replace(legs(), placement=exchanged(legs().placement, legs().placed, [Exchange(numbers, 0.0)]))


def test_sensors_in_their_places_are_left_there() -> None:
    source = SceneInMemory(Scene("legs", (legs(),)))
    assert with_sensors_assigned(source, Settings())[:2] == (source, ())


@pytest.mark.parametrize("pair", [("left_shank", "right_shank"), ("right_thigh", "right_shank")])
def test_exchanged_sensors_are_found(pair: tuple[str, str]) -> None:
    recording = mistaken(*pair)
    (found,) = exchanges_of(recording)
    assert {recording.placed[number] for number in found.sensors} == set(pair)
    assert found.nats > LEAST_NATS


def test_exchanged_sensors_are_told_and_exchanged_where_wanted() -> None:
    recording = mistaken("left_thigh", "right_thigh")
    settings = Settings(frame_rate=15.0, acceleration=False, covariance=False)
    told = smooth(recording, settings)
    assert [finding.kind for finding in told.findings].count("sensors exchanged") == 1
    assert "--assign " in str(told.findings[0])
    right, truth = (smooth(one, replace(settings, assign=True)).wearer().motion for one in (recording, legs()))
    np.testing.assert_allclose(right.R_parent_child, truth.R_parent_child, atol=1e-9)


def test_what_tells_nothing_accuses_nobody() -> None:
    """Sensors without accelerations, or without a neighbour."""
    assert exchanged_sensors([None] * 4, [(0, 1), (1, 2)]) == ()
    still = replace(legs(), imus={name: replace(one, specific_force=None) for name, one in legs().imus.items()})
    assert exchanges_of(still) == ()


@cache
def whole_body() -> Recording:
    motion = with_initial_pose(gestures(8.0), "t-pose")
    placement = preset("totalcapture13", motion.skeleton)
    return simulate_recording(motion, placement, SimulateSettings(), seed=1, initial_pose="t-pose")


def left_for_right(recording: Recording) -> Recording:
    at = {recording.placement.site(name).bone: number for number, name in enumerate(recording.placed)}
    pairs = [(own, at[f"right_{bone[5:]}"]) for bone, own in at.items() if bone.startswith("left_")]
    exchanges = [Exchange(pair, 0.0) for pair in pairs]
    return replace(recording, placement=exchanged(recording.placement, recording.placed, exchanges))


def told_of(recording: Recording, camera: Camera | None = None) -> list[Finding]:
    scene = Scene("whole body", (recording,), () if camera is None else (camera,))
    return list(with_sensors_assigned(SceneInMemory(scene), Settings())[1])


def test_left_for_right_is_told_by_how_the_body_bends() -> None:
    recording = whole_body()
    assert told_of(recording) == []
    (found,) = told_of(left_for_right(recording))
    assert found.kind == "sensors exchanged"
    assert all(f"'{name}'" in str(found) for name in recording.placed if name.startswith(("left", "right")))
    _, (right,), _ = with_sensors_assigned(
        SceneInMemory(Scene("whole body", (left_for_right(recording),))), replace(Settings(), assign=True)
    )
    assert right.kind == "sensors put right"


def test_left_for_right_is_told_by_the_picture_where_nothing_else_tells() -> None:
    scene = filmed_gestures(azimuth_deg=20.0)
    (wearer,) = scene.wearers
    six = ("pelvis", "left_knee", "right_knee")
    sites = tuple(site for site in wearer.placement.sites if site.bone in six)
    few = replace(wearer, placement=replace(wearer.placement, sites=sites), truth=None)
    assert told_of(few, scene.camera) == []
    assert [one.kind for one in told_of(left_for_right(few), scene.camera)] == ["sensors exchanged"]


def test_another_pose_than_the_declared_one_is_told() -> None:
    recording = whole_body()
    (found,) = told_of(replace(recording, initial_pose="n-pose"))
    assert found.kind == "other pose"
    assert "from the t-pose" in str(found)


def test_two_sensors_on_one_bone_are_told() -> None:
    thigh, turned = legs().imus["left_thigh"], exp([0.4, 1.1, 0.3])
    assert thigh.R_inertial_sensor is not None
    twin = replace(thigh, name="left_shank", R_inertial_sensor=rotation_z(1.0) @ thigh.R_inertial_sensor @ turned)
    recording = replace(legs(), imus={**legs().imus, "left_shank": twin})
    _, findings, _ = with_sensors_assigned(SceneInMemory(Scene("legs", (recording,))), Settings())
    (found,) = (finding for finding in findings if finding.kind == "two on one bone")
    assert found.subject == "left_shank"
    assert found.numbers["spread"] < 1
