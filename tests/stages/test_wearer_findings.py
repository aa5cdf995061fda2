"""What is told of wearers: by whole scenes in which it is so, of poses that people hardly hold, of unlikely bodies."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from filmed_gestures import HASTY, QUICK, filmed_gestures, with_detections

from vip_factors.body.anthropometry import likely_body, skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import LENGTHS, lengths_of
from vip_factors.body.skeleton import JOINT_COUNT, joint_index
from vip_factors.estimate import BodyEstimate
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import Array, exp, rotation_x
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import Calibration, SensorCalibration, preset
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.recording import Recording, Subject
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.stages.findings import body_findings, common_scale, knee_findings, posture_findings


@cache
def before_two_known_cameras() -> Scene:
    """Where two cameras of known pose see somebody, the pictures tell how large that person is."""
    motion = gestures(3.0)
    settings = SceneSettings(camera="fixed", cameras=2, azimuth_deg=20.0)
    return simulate_scene([Performer("anna", motion, preset("tnt10", motion.skeleton))], settings, seed=1)


def of_stature(scene: Scene, stature_m: float) -> Scene:
    (wearer,) = scene.wearers
    subject = replace(wearer.subject, stature_m=stature_m, skeleton=None)
    return replace(scene, wearers=(replace(wearer, subject=subject),))


@pytest.mark.parametrize(("stature_m", "told"), [(1.60, "larger than one of 1.60 m"), (1.75, None)])
def test_a_wrong_stature(stature_m: float, told: str | None) -> None:
    findings = sentences(smooth(of_stature(before_two_known_cameras(), stature_m), QUICK).findings)
    of_bodies = [finding for finding in findings if "stature and video disagree" in finding]
    assert bool(of_bodies) == (told is not None), findings
    assert told is None or told in of_bodies[0]


def test_somebody_who_is_seen_for_a_moment() -> None:
    scene = with_detections(
        filmed_gestures(azimuth_deg=20.0), lambda found: found.select(found.time[found.frame] < 1.5)
    )
    (told,) = sentences(smooth(scene, replace(HASTY, calibration=QUICK.calibration)).findings)
    assert re.search(r"'anna': seen for 1\.[45] s only", told)


def test_few_keypoints_are_enough_for_the_whole_pipeline() -> None:
    def few(joints: tuple[str, ...]) -> Scene:
        def dropped(found: Detections) -> Detections:
            names = found.keypoints.keypoints
            gone = [number for number, name in enumerate(names) if name.split("_")[-1] not in joints]
            confidence = found.confidence.copy()
            confidence[:, gone] = 0.0
            return replace(found, confidence=confidence)

        return with_detections(filmed_gestures(azimuth_deg=20.0), dropped)

    assert smooth(few(("shoulder", "hip", "knee", "ankle")), HASTY).method == "VIP"
    refused = smooth(few(("shoulder", "hip")), HASTY)
    assert refused.method == "SIP"
    assert "add knee and ankle" in str(refused.findings[0])
    assert not any("clock" in sentence for sentence in sentences(refused.findings))


def worn(motion: Motion, turned: int = 0, pose: str = "none") -> tuple[Recording, Calibration]:
    placement = preset("totalcapture13", motion.skeleton)
    calibration = {
        site.sensor: SensorCalibration(0.0, (exp([1.5, 0, 0]) if s < turned else np.eye(3)) @ site.R_bone_sensor)
        for s, site in enumerate(placement.sites)
    }
    return Recording("made", Subject(skeleton=motion.skeleton), {}, placement=placement, initial_pose=pose), calibration


def told(motion: Motion, turned: int = 0, pose: str = "none", since_start: int = 0) -> list[str]:
    recording, calibration = worn(motion, turned, pose)
    start = np.stack([calibration.R_bone_sensor for calibration in calibration.values()])
    start[:since_start] = exp([1.5, 0, 0]) @ start[:since_start]
    return list(sentences(posture_findings("anna", recording, motion, calibration, start)))


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


def test_ankles_past_one_another_are_what_people_do() -> None:
    motion = bent(bent(gestures(3.0), "left_hip", np.array([0, 0, -12])), "right_hip", np.array([0, 0, 12]))
    assert told(motion) == []


def test_an_ankle_bent_too_far() -> None:
    (one,) = told(bent(gestures(3.0), "left_ankle", np.array([0, 0, 60])))
    assert "left ankle" in one


def test_sensors_at_odds_with_their_straps() -> None:
    (one,) = told(gestures(3.0), turned=7)
    assert one.count(" by 86°") == 7
    assert "the placement" in one
    assert told(gestures(3.0), turned=6) == []
    assert told(gestures(3.0), turned=7, pose="t-pose") == []  # the pose told of them


def test_a_sensor_that_the_motion_turns_against_the_declared_pose() -> None:
    (one,) = told(gestures(3.0), pose="t-pose", since_start=1)
    assert "head by 86°" in one
    assert "the declared pose" in one


USUAL = skeleton_from_stature(1.75)


def found(changes: dict[str, float], scale: float = 0.0) -> BodyEstimate:
    variation, prior = likely_body(USUAL.stature).variation, lengths_of(USUAL)
    covariance: Array = np.linalg.inv(variation.whitening.T @ variation.whitening).astype(np.float64)
    lengths = (1 + scale) * prior + [changes.get(name, 0.0) for name in LENGTHS]
    return BodyEstimate(LENGTHS, prior, lengths, covariance, covariance / 4)


def test_what_is_expected_is_not_told() -> None:
    assert not list(body_findings("Ada", found({"thigh": 0.02, "trunk": -0.02}), 1.75))
    given = replace(found({}), names=(), prior=np.zeros(0), posterior=np.zeros(0))
    assert not list(body_findings("Ada", given, 1.75))


def test_a_length_that_is_far_from_expected_is_named() -> None:
    [told, *_] = sentences(body_findings("Ada", found({"forearm": -0.05}), 1.75))
    assert "stature and video disagree about forearm 2" in told
    assert "thigh" not in told


def test_a_common_scale_is_told_as_one() -> None:
    body = found({}, scale=0.06)
    assert common_scale(body)[0] == pytest.approx(0.06)
    told = sentences(body_findings("Ada", body, 1.75))
    assert any("about all lengths: together they suggest a body 6 % larger than one of 1.75 m" in one for one in told)
    assert not list(body_findings("Ada", found({}, scale=0.015), 1.75))


def test_knees_that_bend_backwards_are_a_finding() -> None:
    R = np.broadcast_to(np.eye(3), (40, JOINT_COUNT, 3, 3)).copy()
    R[:15, joint_index("left_knee")] = rotation_x(-0.4)
    R[:5, joint_index("right_knee")] = rotation_x(-0.4)
    motion = Motion(USUAL, R, np.zeros((40, 3)), 30.0)
    (sentence,) = sentences(knee_findings("Ada", motion, {}))
    assert "left knee bends backwards in 38 %" in sentence


@pytest.mark.parametrize("degrees", [-14.0, 6.0, 14.0])
def test_a_shank_that_stays_turned_against_its_thigh_is_a_finding(degrees: float) -> None:
    motion = bent(gestures(3.0), "right_knee", np.array([0, degrees, 0]))
    worn = {"right_hip": "RT", "right_knee": "RS"}
    found = list(sentences(knee_findings("Ada", motion, worn)))
    assert len(found) == (abs(degrees) > 9)
    assert all("heading or mounting of 'RT' or 'RS'" in one for one in found)
    assert not list(knee_findings("Ada", motion, {"right_knee": "RS"}))  # nobody measures how the thigh is turned
    assert all("the right shank is turned about itself against the thigh, by 1" in one for one in found)


def test_what_is_in_order_but_for_the_scale_is_not_told_one_by_one() -> None:
    [told] = sentences(body_findings("Ada", found({}, scale=0.15), 1.75))
    assert "15 % larger" in told
    assert "check the stature" in told
    [told] = sentences(body_findings("Ada", found({"forearm": -0.07}, scale=0.15), 1.75))
    scale, length = told.split("; and about ")
    assert "all lengths" in scale
    assert "forearm" in length
    assert "thigh" not in length
    assert "the wearer is built so" in length
