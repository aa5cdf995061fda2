"""The start of the inertial tracker: what sensors say, shared among the joints between them."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.joint_priors import PosePrior, load_pose_prior
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import ancestors, contact_points, joint_index
from vip_factors.geometry.rotations import angle_between, exp, rotation_y, rotation_z, transpose
from vip_factors.initialise.calibration import InitialCalibration, contact_confidence, first_poses, standing_path
from vip_factors.sensors.frames import ImuFrames
from vip_factors.simulate.gestures import gestures

T = 4


def frames_of(R_inertial_sensor: np.ndarray) -> ImuFrames:
    T, S = R_inertial_sensor.shape[:2]
    names = tuple(f"s{s}" for s in range(S))
    everywhere = np.ones((T, S), bool)
    return ImuFrames(names, np.arange(T) / 10, R_inertial_sensor, everywhere, np.zeros((T, S, 3)), everywhere)


def calibration_of(sensors: int, seed: int = 0) -> InitialCalibration:
    random = np.random.default_rng(seed)
    headings, mountings = random.uniform(-3, 3, sensors), exp(random.standard_normal((sensors, 3)))
    return InitialCalibration(headings, np.ones(sensors), mountings)


def measured(R_world_bone: np.ndarray, calibration: InitialCalibration) -> np.ndarray:
    """``R_inertial_sensor`` ``(T, S, 3, 3)`` of perfect sensors on the bones."""
    return transpose(rotation_z(calibration.headings)) @ R_world_bone @ calibration.R_bone_sensor


def test_instrumented_bones_are_as_their_sensors_say() -> None:
    motion = gestures(2.0).frames(slice(0, 200, 50))
    bones = [joint_index(name) for name in ("left_elbow", "head", "pelvis", "right_knee", "spine3", "left_shoulder")]
    R_true, calibration = motion.state.R_world_bone[:, bones], calibration_of(len(bones))
    R = first_poses(
        frames_of(measured(R_true, calibration)),
        bones,
        calibration.headings,
        calibration.R_bone_sensor,
        load_pose_prior(),
    )
    found = forward_kinematics(motion.skeleton, R, np.zeros((len(R), 3))).R_world_bone[:, bones]
    assert np.max(angle_between(found, R_true)) < 1e-6


def test_joints_between_two_sensors_share_the_turning() -> None:
    prior = PosePrior(np.zeros(69), np.eye(69))
    bones = [joint_index("pelvis"), joint_index("head")]
    R_world_bone = np.stack([np.broadcast_to(np.eye(3), (T, 3, 3)), np.tile(rotation_y(1.0), (T, 1, 1))], axis=1)
    calibration = calibration_of(2)
    R = first_poses(
        frames_of(measured(R_world_bone, calibration)), bones, calibration.headings, calibration.R_bone_sensor, prior
    )
    chain = ancestors(joint_index("head"))[1:]
    angles = angle_between(R[:, chain], np.eye(3))
    assert angles == pytest.approx(np.full((T, len(chain)), 1.0 / len(chain)))


@pytest.mark.parametrize("silent", [0, 1])
def test_gaps_are_interpolated(silent: int) -> None:
    bones, calibration = [joint_index("pelvis"), joint_index("left_knee")], calibration_of(2)
    turning = np.stack([rotation_y(0.3 * np.arange(T)), rotation_z(0.2 * np.arange(T))], axis=1)
    frames = frames_of(measured(turning, calibration))
    gap = replace(frames, orientation_valid=frames.orientation_valid.copy())
    gap.orientation_valid[2, silent] = False
    gap.R_inertial_sensor[2, silent] = np.eye(3)
    R = first_poses(gap, bones, calibration.headings, calibration.R_bone_sensor, load_pose_prior())
    found = forward_kinematics(gestures(0.1).skeleton, R, np.zeros((T, 3))).R_world_bone[:, bones]
    assert np.max(angle_between(found, turning)) < 1e-6


def test_a_bone_whose_sensor_measured_nothing_stays_at_the_mean() -> None:
    prior = load_pose_prior()
    bones, calibration = [joint_index("pelvis"), joint_index("left_knee")], calibration_of(2)
    frames = frames_of(measured(exp(np.random.default_rng(1).standard_normal((T, 2, 3))), calibration))
    frames.orientation_valid[:, 1] = False
    R = first_poses(frames, bones, calibration.headings, calibration.R_bone_sensor, prior)
    assert np.max(angle_between(R[:, 1:], exp(prior.mean.reshape(-1, 3)))) < 1e-6


def test_contacts_do_not_hang_on_the_last_digit_of_a_time() -> None:
    """At 15 Hz they are averaged over one and a half frames: of the same motion, a bit later, they are the same."""
    motion = gestures(6.0)
    R = motion.R_parent_child[:: round(motion.rate / 15)]
    points = contact_points(motion.skeleton)
    at_origin = forward_kinematics(motion.skeleton, R, np.zeros((len(R), 3)))
    body = forward_kinematics(motion.skeleton, R, standing_path(at_origin, points))
    steps = {float(one - other) for start in range(300) for other, one in [np.array([0.02 + start, 1.02 + start]) / 15]}
    found = [contact_confidence(body, points, step) for step in sorted(steps)]
    assert {round(0.1 / step) for step in steps} == {1, 2}
    assert found[0].max() > 0.9
    for one in found[1:]:
        np.testing.assert_allclose(one, found[0], atol=1e-6)
