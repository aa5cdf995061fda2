"""Poses that people hardly hold: each check speaks of its own, and of nothing in a motion that is as people move."""

from dataclasses import replace

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import Array, exp, rotation_x
from vip_factors.sensors.calibration import Calibration, SensorCalibration, preset
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.simulate.gestures import gestures
from vip_factors.stages.posture_findings import posture_findings


def worn(motion: Motion, turned: int = 0, pose: str = "none") -> tuple[Recording, Calibration]:
    placement = preset("totalcapture13", motion.skeleton)
    calibration = {
        site.sensor: SensorCalibration(0.0, (exp([1.5, 0, 0]) if s < turned else np.eye(3)) @ site.R_bone_sensor)
        for s, site in enumerate(placement.sites)
    }
    return Recording("made", Subject(skeleton=motion.skeleton), {}, placement=placement, initial_pose=pose), calibration


def told(motion: Motion, turned: int = 0, pose: str = "none", since_start: int = 0) -> list[str]:
    recording, calibration = worn(motion, turned, pose)
    start = np.stack([one.R_bone_sensor for one in calibration.values()])
    start[:since_start] = exp([1.5, 0, 0]) @ start[:since_start]
    return list(posture_findings("anna", recording, motion, calibration, start))


def bent(motion: Motion, joint: str, degrees: Array) -> Motion:
    R = motion.R_parent_child.copy()
    R[:, joint_index(joint)] = R[:, joint_index(joint)] @ exp(np.deg2rad(degrees))
    return replace(motion, R_parent_child=R)


def test_nothing_is_odd_about_gestures() -> None:
    assert told(gestures(3.0)) == []


def test_somebody_who_lies() -> None:
    motion = gestures(3.0)
    R = motion.R_parent_child.copy()
    R[:, 0] = rotation_x(np.pi / 2) @ R[:, 0]
    (one,) = told(replace(motion, R_parent_child=R))
    assert "lies" in one


def test_crossed_legs() -> None:
    motion = bent(bent(gestures(3.0), "left_hip", np.array([0, 0, -25])), "right_hip", np.array([0, 0, 25]))
    (one,) = told(motion)
    assert "crossed" in one


def test_an_ankle_bent_too_far() -> None:
    (one,) = told(bent(gestures(3.0), "left_ankle", np.array([0, 0, 60])))
    assert "left ankle" in one


def test_sensors_at_odds_with_their_straps() -> None:
    (one,) = told(gestures(3.0), turned=7)
    assert "7 of 13 sensors" in one
    assert told(gestures(3.0), turned=6) == []
    assert told(gestures(3.0), turned=7, pose="t-pose") == []  # the pose told of them


def test_a_sensor_that_the_motion_turns_against_the_declared_pose() -> None:
    (one,) = told(gestures(3.0), pose="t-pose", since_start=1)
    assert "head by 86°" in one
    assert "the declared pose" in one
