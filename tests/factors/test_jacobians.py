"""Every factor's Jacobians against central differences through GTSAM's own retract: generic, and near identity."""

from collections.abc import Callable

import gtsam
import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_limits import load_joint_limits
from vip_factors.body.pose_prior import load_pose_prior
from vip_factors.body.skeleton import joint_index
from vip_factors.factors.acceleration import AccelerationSettings, acceleration_factor
from vip_factors.factors.camera_acceleration import CameraAccelerationSettings, camera_acceleration_factor
from vip_factors.factors.camera_orientation import CameraOrientationSettings, camera_orientation_factor
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.factors.camera_velocity import CameraVelocitySettings, camera_velocity_factor
from vip_factors.factors.coasting import CoastingSettings, pelvis_turn_factor, root_coasting_factor
from vip_factors.factors.floor_contact import FloorContactSettings, floor_contact_factor
from vip_factors.factors.foot_contact import FootContactSettings, foot_contact_factor
from vip_factors.factors.gauge_prior import GaugePriorSettings, gauge_prior_factor
from vip_factors.factors.ground_contact import Foot, ground_contact_factor
from vip_factors.factors.heading_knots import HeadingAt
from vip_factors.factors.heading_prior import heading_prior_factor
from vip_factors.factors.heading_walk import heading_walk_factor
from vip_factors.factors.joint_limit import JointLimitSettings, joint_limit_factor
from vip_factors.factors.orientation import OrientationSettings, orientation_factor
from vip_factors.factors.pose_prior import PosePriorSettings, pose_mean_factor, pose_prior_factor
from vip_factors.factors.reprojection import ReprojectionSettings, reprojection_factor
from vip_factors.factors.robust import RobustLoss
from vip_factors.factors.rotation_prior import rotation_prior_factor
from vip_factors.factors.smoothness import SmoothnessSettings, smoothness_factor
from vip_factors.geometry.rotations import exp
from vip_factors.graph.keys import (
    camera_heading_key,
    camera_key,
    camera_mounting_key,
    clock_key,
    frame_keys,
    heading_key,
    joint_key,
    mounting_key,
    pose_mean_key,
    root_key,
)
from vip_factors.graph.state import GraphState
from vip_factors.sensors.camera_model import CameraModel

SKELETON = skeleton_from_stature(1.75)
WRIST = joint_index("left_wrist")
KEYS = [frame_keys(t) for t in range(3)]
SQUARE = RobustLoss()
R_MEASURED = exp([0.4, -0.8, 0.3])
POINT = np.array([0.02, -0.05, 0.1])
FORCE = np.array([1.0, -2.0, 8.0])
LENS = CameraModel(1920, 1080, (1400.0, 1390.0), (950.0, 550.0), (-0.2, 0.05, 0.001, -0.002))
PIXEL = np.array([800.0, 300.0])
BETWEEN = HeadingAt([heading_key(0), heading_key(0, knot=1)], [0.3, 0.7])
REPROJECTION = ReprojectionSettings(loss=SQUARE)
FOOT = Foot(joint_index("left_ankle"), np.array([0.01, 0.02, 0.0]), np.array([[0.0, -0.08, -0.05], [0.0, -0.07, 0.13]]))
# A camera four metres behind the origin (OpenCV axes: z forward, y down), so that the body is in front of it.
R_WORLD_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
P_WORLD_CAMERA = np.array([0.0, -4.0, 0.5])

FACTORS: dict[str, Callable[[], gtsam.NonlinearFactor]] = {
    "orientation": lambda: orientation_factor(
        SKELETON, KEYS[0], heading_key(0), mounting_key(0), WRIST, R_MEASURED, OrientationSettings(loss=SQUARE)
    ),
    "acceleration": lambda: acceleration_factor(
        SKELETON, KEYS, heading_key(0), WRIST, POINT, FORCE, 0.1, AccelerationSettings(loss=SQUARE)
    ),
    "foot contact": lambda: foot_contact_factor(
        SKELETON, KEYS[:2], joint_index("left_ankle"), POINT, 0.1, 0.7, FootContactSettings(loss=SQUARE)
    ),
    "floor contact": lambda: floor_contact_factor(
        SKELETON, KEYS[0], joint_index("left_ankle"), POINT, 0.7, FloorContactSettings(loss=SQUARE)
    ),
    "pose prior": lambda: pose_prior_factor(KEYS[0], pose_mean_key(), load_pose_prior(), PosePriorSettings(0.5)),
    "pose mean": lambda: pose_mean_factor(pose_mean_key(), load_pose_prior(), PosePriorSettings()),
    "smoothness": lambda: smoothness_factor(KEYS[0], KEYS[1], 0.1, load_pose_prior(), SmoothnessSettings()),
    "root coasting": lambda: root_coasting_factor([root_key(t) for t in range(3)], 0.1, CoastingSettings()),
    "pelvis turn": lambda: pelvis_turn_factor(joint_key(0, 0), joint_key(1, 0), 0.1, CoastingSettings()),
    "joint limit": lambda: joint_limit_factor(
        KEYS[0], joint_index("left_knee"), load_joint_limits(), JointLimitSettings(loss=SQUARE)
    ),
    "heading prior": lambda: heading_prior_factor(heading_key(0), 0.2, 0.3),
    "heading walk": lambda: heading_walk_factor(heading_key(0), heading_key(0, knot=1), 0.3),
    "orientation between knots": lambda: orientation_factor(
        SKELETON, KEYS[0], BETWEEN, mounting_key(0), WRIST, R_MEASURED, OrientationSettings(loss=SQUARE)
    ),
    "acceleration between knots": lambda: acceleration_factor(
        SKELETON, KEYS, BETWEEN, WRIST, POINT, FORCE, 0.1, AccelerationSettings(loss=SQUARE)
    ),
    "mounting prior": lambda: rotation_prior_factor("mounting prior", mounting_key(0), R_MEASURED, 0.3),
    "initial pose": lambda: rotation_prior_factor("initial pose", joint_key(0, 5), R_MEASURED, 0.1),
    "reprojection": lambda: reprojection_factor(
        SKELETON, KEYS[0], camera_key(0), WRIST, POINT, LENS, PIXEL, 5.0, REPROJECTION
    ),
    "reprojection of a known camera": lambda: reprojection_factor(
        SKELETON,
        KEYS[0],
        CameraPoses(R_WORLD_CAMERA[None], P_WORLD_CAMERA[None]),
        WRIST,
        POINT,
        LENS,
        PIXEL,
        5.0,
        REPROJECTION,
    ),
    "reprojection with a clock": lambda: reprojection_factor(
        SKELETON, KEYS[0], camera_key(0), WRIST, POINT, LENS, PIXEL, 5.0, REPROJECTION, (clock_key(), FORCE[:2])
    ),
    "ground contact": lambda: ground_contact_factor(
        SKELETON, KEYS[0], camera_key(0), FOOT, np.array([0.1, 0.4, 1.0]), 5 * R_MEASURED, SQUARE
    ),
    "camera orientation": lambda: camera_orientation_factor(
        camera_key(0),
        camera_heading_key(),
        camera_mounting_key(),
        R_MEASURED,
        0.7,
        CameraOrientationSettings(loss=SQUARE),
    ),
    "camera acceleration": lambda: camera_acceleration_factor(
        [camera_key(t) for t in range(3)],
        camera_heading_key(),
        POINT,
        FORCE,
        0.1,
        CameraAccelerationSettings(loss=SQUARE),
    ),
    "camera velocity": lambda: camera_velocity_factor(
        camera_key(0), camera_key(1), 0.1, CameraVelocitySettings(loss=SQUARE)
    ),
    "gauge prior": lambda: gauge_prior_factor(root_key(0), POINT, GaugePriorSettings()),
}


def random_values(spread: float, seed: int = 0) -> gtsam.Values:
    random = np.random.default_rng(seed)
    values = GraphState(
        exp(spread * random.standard_normal((3, 24, 3))),
        random.standard_normal((3, 3)),
        spread * random.standard_normal(1),
        exp(spread * random.standard_normal((1, 3))),
        random.standard_normal(69),
        spread * random.standard_normal((1, 1)),
    ).to_values()
    for t in range(3):
        R = R_WORLD_CAMERA @ exp(min(spread, 0.1) * random.standard_normal(3))
        values.insert(camera_key(t), gtsam.Pose3(gtsam.Rot3(R), P_WORLD_CAMERA + 0.1 * random.standard_normal(3)))
    values.insert(camera_heading_key(), spread * random.standard_normal())
    values.insert(camera_mounting_key(), gtsam.Rot3(exp(spread * random.standard_normal(3))))
    values.insert(clock_key(), 0.02)
    return values


def numerical_jacobian(factor: gtsam.NonlinearFactor, values: gtsam.Values, key: int, columns: int) -> np.ndarray:
    step, jacobian = 1e-5, []
    for axis in np.eye(columns):
        sides = []
        for sign in (1.0, -1.0):
            delta = values.zeroVectors()
            delta.update(_single(key, sign * step * axis))
            linear = factor.linearize(values.retract(delta))
            sides.append(np.array(linear.getb()))  # minus the whitened residual; copied while the factor lives
        jacobian.append((sides[1] - sides[0]) / (2 * step))
    return np.stack(jacobian, axis=1)


def _single(key: int, vector: np.ndarray) -> gtsam.VectorValues:
    values = gtsam.VectorValues()
    values.insert(key, vector)
    return values


@pytest.mark.parametrize("name", FACTORS)
@pytest.mark.parametrize("spread", [0.0, 1e-7, 1e-3, 0.5])
def test_jacobians_match_central_differences(name: str, spread: float) -> None:
    factor, values = FACTORS[name](), random_values(spread)
    linear = factor.linearize(values)
    A, _ = linear.jacobian()
    column = 0
    for key in list(linear.keys()):
        width = _dimension(key)
        expected = numerical_jacobian(factor, values, key, width)
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(A[:, column : column + width], expected, atol=2e-5 * scale)
        column += width


def _dimension(key: int) -> int:
    return {"h": 1, "g": 1, "o": 1, "c": 6, "m": 69}.get(chr(gtsam.symbolChr(key)), 3)


def test_the_joint_limit_is_silent_inside_the_range() -> None:
    limits = load_joint_limits()
    middle = (limits.lower + limits.upper) / 2
    values = gtsam.Values()
    values.insert(joint_key(0, 4), gtsam.Rot3(exp(middle[9:12])))
    factor = joint_limit_factor(KEYS[0], 4, limits, JointLimitSettings())
    assert factor.error(values) == 0


def test_poses_of_the_camera_move_as_gtsams_do() -> None:
    values, step = random_values(0.5), np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.5])
    moved = values.atPose3(camera_key(0)).retract(step)
    ours = CameraPoses.of(values, camera_key(0)).retract(step[None])
    np.testing.assert_allclose(ours.R_world_camera[0], moved.rotation().matrix(), atol=1e-12)
    np.testing.assert_allclose(ours.p_world_camera[0], moved.translation(), atol=1e-12)
