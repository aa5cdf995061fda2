"""Steps, cadence and ranges of motions that are known."""

import json
from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.estimate import WearerEstimate
from vip_factors.geometry.rotations import rotation_x
from vip_factors.report.angles import bones_with_sensors, is_measured
from vip_factors.report.charts import Line, thinned, time_chart
from vip_factors.report.material import Wearer
from vip_factors.report.steps import walk_of
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.recording import Recording, Subject

RATE, STEP_S, STEP_LENGTH = 60.0, 0.6, 0.6
R_WORLD_STANDING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def pacing(seconds: float = 8.0) -> Motion:
    """Stiff legs like a pair of compasses: one foot rests while the other swings; 100 steps of 0.6 m a minute."""
    skeleton = skeleton_from_stature(1.75)
    leg = -skeleton.p_pelvis_joint[joint_index("left_foot"), 1]
    time = np.arange(round(seconds * RATE)) / RATE
    number, phase = np.divmod(time / STEP_S, 1.0)
    half = np.arcsin(STEP_LENGTH / 2 / leg)
    angle = half * (2 * phase - 1)  # of the resting leg, from before the body to behind it
    R = np.tile(np.eye(3), (len(time), 24, 1, 1))
    left_rests = number % 2 == 0
    for side, sign in (("left", np.where(left_rests, 1.0, -1.0)), ("right", np.where(left_rests, -1.0, 1.0))):
        R[:, joint_index(f"{side}_hip")] = rotation_x(sign * angle)
    R[:, 0] = R_WORLD_STANDING
    root = np.stack([STEP_LENGTH * number + leg * np.sin(angle), 0 * time, leg * np.cos(angle)], axis=1)
    return Motion(skeleton, R, root, RATE)


def test_steps_of_a_walk() -> None:
    walk = walk_of(pacing())
    assert walk is not None
    assert walk.cadence == pytest.approx(60 / STEP_S, rel=0.05)
    assert walk.strides["left"] == pytest.approx(2 * STEP_LENGTH, rel=0.15)
    assert walk.step_times["right"] == pytest.approx(STEP_S, abs=0.05)


def test_standing_is_no_walk() -> None:
    still = pacing()
    still = replace(still, R_parent_child=np.repeat(still.R_parent_child[:1], len(still), axis=0),
                    p_world_pelvis=np.repeat(still.p_world_pelvis[:1], len(still), axis=0))  # fmt: skip
    assert walk_of(still) is None
    assert walk_of(pacing(0.02)) is None


def test_angles_without_sensors_are_known_as_such() -> None:
    motion = pacing(0.1)
    placement = preset("totalcapture13", motion.skeleton)
    legs = replace(placement, sites=tuple(one for one in placement.sites if one.bone in (
        "pelvis", "left_hip", "right_hip", "left_knee", "right_knee")))  # fmt: skip
    sensors = tuple(one.sensor for one in legs.sites)
    estimate = WearerEstimate("legs", "SIP", motion, {}, sensors=sensors)
    bones = bones_with_sensors(Wearer(0, "a", estimate, Recording("legs", Subject(), {}, placement)))
    told = {name: is_measured(bones, f"{name}_flexion") for name in ("hip", "knee", "ankle", "elbow", "trunk")}
    assert told == {"hip": True, "knee": True, "ankle": False, "elbow": False, "trunk": False}
    assert is_measured(None, "elbow_flexion")


def test_charts_keep_peaks_and_gaps() -> None:
    time = np.arange(20_000) / 60
    values = np.sin(time)
    values[12_345] = 5.0
    values[3_000:3_400] = np.nan
    thin = thinned(time, values)[1]
    assert len(thin) < 1000
    assert np.nanmax(thin) == 5.0
    assert np.isnan(thin).any()
    chart = time_chart("t", [Line('a "quoted" & <odd> name', time, values, "#000000")], "°")
    assert chart is not None
    (curve,) = json.loads(chart.numbers)["curves"]
    assert None in curve["values"]
    assert max(value for value in curve["values"] if value is not None) == 5.0
    assert "<odd>" not in chart.svg
    assert time_chart("t", [Line("a", time, np.full(len(time), np.nan), "#000000")]) is None
