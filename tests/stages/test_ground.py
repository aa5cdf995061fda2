"""Which feet are taken to stand, by the joint state or by the sensors on them, and what the camera makes of it."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_priors import load_joint_limits, load_pose_prior
from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.factor_settings import ContactFrom, FactorSettings, GroundContactSettings
from vip_factors.problem.scene import KeypointView
from vip_factors.problem.state import CameraPoses, WearerState
from vip_factors.problem.wearer import BodyPoint, WearerProblem
from vip_factors.sensors.camera import CameraModel
from vip_factors.sensors.frames import ImuFrames
from vip_factors.stages.floor import ground_view, seen_feet, standing_confidence

T, STEP, SOLE = 30, 1 / 60, 0.01
SKELETON, COCO = skeleton_from_stature(1.75), keypoint_set("coco17")
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
LENS = CameraModel(1920, 1080, (1400.0, 1400.0), (960.0, 540.0))
LOOKS_DOWN_ALONG_Y = np.array([[1.0, 0, 0], [0, -0.3, 0.954], [0, -0.954, -0.3]])


def standing_then_jumping() -> tuple[WearerProblem, WearerState]:
    """Half the frames on both feet, then up and away; the right foot's sensor feels what it does."""
    R = np.tile(np.eye(3), (T, 24, 1, 1))
    R[:, 0] = UPRIGHT
    feet, _ = seen_feet(COCO, SKELETON)
    ankle = SKELETON.p_pelvis_joint[feet[0].bone, 1]
    p = np.zeros((T, 3))
    p[:, 2] = SOLE - ankle - feet[0].p_bone_sole[:, 1].min()
    up = np.maximum(np.arange(T) - 15, 0) * STEP
    p[:, 2] += 3.0 * up
    force = np.tile([0.0, 0.0, 9.81], (T, 1, 1))
    force[15:18] += [0.0, 0.0, 40.0]
    valid = np.ones((T, 1), bool)
    frames = ImuFrames(("shoe",), np.arange(T) * STEP, np.tile(np.eye(3), (T, 1, 1, 1)), valid, force, valid)
    model = WearerProblem(
        SKELETON, load_pose_prior(), load_joint_limits(), frames,
        (BodyPoint(joint_index("right_ankle"), np.zeros(3)),), np.zeros(1), np.ones(1), np.eye(3)[None], np.ones(1),
        FactorSettings(),
    )  # fmt: skip
    return model, WearerState(R, p, np.zeros(1), np.eye(3)[None], np.zeros(69))


def test_by_the_joint_state_feet_stand_until_the_jump() -> None:
    model, state = standing_then_jumping()
    feet, _ = seen_feet(COCO, SKELETON)
    confidence = standing_confidence(model, state, feet, True, GroundContactSettings())
    assert (confidence[:10] > 0.9).all()
    assert (confidence[20:] < 0.01).all()


def test_by_acceleration_a_foot_without_a_sensor_counts_while_it_is_the_lower_one() -> None:
    model, state = standing_then_jumping()
    feet, _ = seen_feet(COCO, SKELETON)
    turned = state.R_parent_child.copy()
    turned[:, joint_index("right_knee")] = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # the right foot is lifted
    settings = GroundContactSettings(contact_from=ContactFrom.ACCELERATION)
    confidence = standing_confidence(model, replace(state, R_parent_child=turned), feet, True, settings)
    np.testing.assert_allclose(confidence[:, 0], 1)
    np.testing.assert_allclose(confidence[:15, 1], 1)
    np.testing.assert_allclose(confidence[15:18, 1], 5 / 40, rtol=1e-6)


@pytest.mark.parametrize("sureness", [1.0, 0.01])
def test_the_camera_sees_standing_feet_where_it_is_sure_of_their_ankles(sureness: float) -> None:
    model, state = standing_then_jumping()
    feet, columns = seen_feet(COCO, SKELETON)
    body = forward_kinematics(SKELETON, state.R_parent_child, state.p_world_pelvis)
    points = tuple(BodyPoint(place.bone, place.p_bone_point) for place in COCO.on_body(SKELETON) if place is not None)
    poses = CameraPoses(np.tile(LOOKS_DOWN_ALONG_Y, (T, 1, 1)), np.tile([0.0, -4.0, 1.6], (T, 1)))
    p = np.stack([point.of(body) for point in points], axis=1)
    pixels = LENS.project((p - poses.p_world_camera[:, None]) @ poses.R_world_camera)
    seen = np.ones(pixels.shape[:2], bool)
    seen[3, columns[1]] = False
    view = KeypointView(
        points, pixels, np.full(seen.shape, 5.0), np.ones(seen.shape), seen, 0 * pixels, sureness * seen
    )
    settings = GroundContactSettings()
    confidence = standing_confidence(model, state, feet, True, settings)
    ground = ground_view(view, feet, columns, confidence, body, SOLE, poses, LENS, settings)
    assert ground.stands[:10, 0].all() == (sureness > 0.1)
    assert not ground.stands[3, 1]
    assert not ground.stands[20:].any()


def test_feet_stand_on_soles() -> None:
    _, state = standing_then_jumping()
    body = forward_kinematics(SKELETON, state.R_parent_child, state.p_world_pelvis)
    (foot, *_), _ = seen_feet(COCO, SKELETON)
    (p, barefoot), (_, shod) = foot.ankle(body, 0.0), foot.ankle(body, SOLE)
    np.testing.assert_allclose(shod - barefoot, SOLE)
    assert p[0] @ [0, 0, 1] == pytest.approx(shod[0], abs=1e-9)
