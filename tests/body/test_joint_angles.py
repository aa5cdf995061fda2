"""Joint angles: zero in anatomical posture, of the right sign when a joint is bent on purpose, and invertible."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_angles import (
    ANGLE_DEFINITIONS,
    joint_angle_sigmas,
    joint_angles,
    mirrored,
    segment_axes,
    segment_orientations,
)
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton, calibration_pose, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.simulate.gestures import gestures

FORWARD, LEFT, UP = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def standing(**turns: Array) -> Motion:
    """Standing with arms hanging, palms at the thighs, and the named bones turned by degrees about *room* axes.

    Turns are about axes of a body that stands: x left, y up, z forward.
    """
    R = calibration_pose("n-pose")
    motion = Motion(skeleton_from_stature(1.75), R[None], np.zeros((1, 3)), 1.0)
    for name, turn in turns.items():
        joint = joint_index(name)
        R_body_bone = R[0].T @ motion.state.R_world_bone[0, joint]
        R[joint] = R[joint] @ R_body_bone.T @ exp(np.radians(turn)) @ R_body_bone
    return Motion(motion.skeleton, R[None], np.zeros((1, 3)), 1.0)


def the_angles(motion: Motion, **turned: float) -> None:
    """All angles of the one frame are zero but these; hanging arms with palms at the thighs are pronated by 90°."""
    expected = {"left_elbow_pronation": 90.0, "right_elbow_pronation": 90.0} | turned
    found = joint_angles(motion)
    for name, value in zip(found.names, found.degrees[0], strict=True):
        assert value == pytest.approx(expected.get(name, 0.0), abs=1e-6), name


def test_standing_is_zero() -> None:
    the_angles(standing())


# Turns are right-handed about the body's axes: about LEFT, what is above goes forward and what hangs goes back.
@pytest.mark.parametrize(
    ("bone", "turn", "angle", "degrees"),
    [
        ("knee", 40 * LEFT, "knee_flexion", 40),
        ("hip", -30 * LEFT, "hip_flexion", 30),
        ("ankle", -10 * LEFT, "ankle_dorsiflexion", 10),
        ("ankle", 25 * LEFT, "ankle_dorsiflexion", -25),
        ("elbow", -70 * LEFT, "elbow_flexion", 70),
        ("shoulder", -50 * LEFT, "shoulder_flexion", 50),
    ],
)
@pytest.mark.parametrize("side", ["left", "right"])
def test_bending_forward_and_back(side: str, bone: str, turn: Array, angle: str, degrees: float) -> None:
    found = joint_angles(standing(**{f"{side}_{bone}": turn}))
    assert found.of(f"{side}_{angle}")[0] == pytest.approx(degrees)
    other = "right" if side == "left" else "left"
    assert found.of(f"{other}_{angle}")[0] == pytest.approx(0, abs=1e-9)


# What hangs goes to the left when turned about FORWARD: outward on the left side.
@pytest.mark.parametrize(
    ("bone", "turn", "angle", "degrees"),
    [
        ("hip", 20 * FORWARD, "hip_adduction", -20),
        ("knee", 5 * FORWARD, "knee_adduction", -5),
        ("hip", -15 * UP, "hip_internal_rotation", 15),
        ("knee", -8 * UP, "knee_internal_rotation", 8),
        ("ankle", -12 * UP, "ankle_internal_rotation", 12),
        ("ankle", -9 * FORWARD, "ankle_inversion", 9),  # the outer edge goes down
        ("shoulder", 60 * FORWARD, "shoulder_elevation", 60),
        ("shoulder", 60 * FORWARD, "shoulder_adduction", -60),
        ("elbow", 10 * FORWARD, "elbow_carrying_angle", 10),
        ("elbow", 50 * UP, "elbow_pronation", 40),  # turned outward from where the palm is at the thigh
        ("wrist", 35 * FORWARD, "wrist_flexion", -35),  # palms are at the thighs: away from the body is extension
        ("wrist", 15 * LEFT, "wrist_ulnar_deviation", 15),  # thumbs are in front: back is to the little finger
    ],
)
@pytest.mark.parametrize("side", ["left", "right"])
def test_sideways_and_about_itself(side: str, bone: str, turn: Array, angle: str, degrees: float) -> None:
    mirror = np.array([1.0, -1.0, -1.0])
    found = joint_angles(standing(**{f"{side}_{bone}": turn if side == "left" else mirror * turn}))
    assert found.of(f"{side}_{angle}")[0] == pytest.approx(degrees)


@pytest.mark.parametrize(
    ("turn", "plane"), [(60 * FORWARD, 0.0), (-60 * LEFT, 90.0), (60 * LEFT, -90.0)], ids=["out", "fore", "back"]
)
def test_plane_of_elevation(turn: Array, plane: float) -> None:
    found = joint_angles(standing(left_shoulder=turn))
    assert found.of("left_shoulder_plane_of_elevation")[0] == pytest.approx(plane)
    assert found.of("left_shoulder_elevation")[0] == pytest.approx(60)
    # An arm that is lifted straight forward does not turn about itself, which Y-X-Y counts as -90 after a plane of 90.
    assert found.of("left_shoulder_axial_rotation")[0] == pytest.approx(-plane)


@pytest.mark.parametrize(
    ("bone", "turn", "angle", "degrees"),
    [
        ("spine1", 30 * LEFT, "trunk_flexion", 30),
        ("spine2", 20 * FORWARD, "trunk_lateral_bending", 20),  # what is above goes to the right
        ("spine3", 25 * UP, "trunk_axial_rotation", 25),
        ("neck", 15 * LEFT, "neck_flexion", 15),
        ("head", 10 * FORWARD, "neck_lateral_bending", 10),
        ("neck", -35 * UP, "neck_axial_rotation", -35),
        ("pelvis", 12 * LEFT, "pelvis_tilt", 12),
        ("pelvis", 6 * FORWARD, "pelvis_obliquity", 6),
        ("pelvis", 80 * UP, "pelvis_rotation", 80),
    ],
)
def test_trunk_neck_and_pelvis(bone: str, turn: Array, angle: str, degrees: float) -> None:
    the_angles(standing(**{bone: turn}), **{angle: degrees})


def test_tilt_is_the_same_in_whatever_direction_somebody_faces() -> None:
    leaning = standing(pelvis=20 * LEFT)
    turned = leaning.R_parent_child.copy()
    turned[:, 0] = rotation_z(2.0) @ turned[:, 0]
    found = joint_angles(Motion(leaning.skeleton, turned, np.zeros((1, 3)), 1.0))
    assert found.of("pelvis_tilt")[0] == pytest.approx(20)
    assert found.of("pelvis_rotation")[0] == pytest.approx(np.degrees(2.0))


def test_the_pelvis_goes_on_counting_when_somebody_turns_round() -> None:
    R = np.repeat(calibration_pose("n-pose")[None], 90, axis=0)
    R[:, 0] = rotation_z(np.radians(np.arange(90) * 10.0)) @ R[:, 0]
    found = joint_angles(Motion(skeleton_from_stature(1.75), R, np.zeros((90, 3)), 30.0))
    assert np.allclose(found.of("pelvis_rotation"), np.arange(90) * 10.0)


def test_flexions_are_those_that_recordings_are_judged_by() -> None:
    motion = gestures(seconds=2.0)
    found = joint_angles(motion)
    for side in ("left", "right"):
        thigh, shank = (motion.state.R_world_bone[:, joint_index(f"{side}_{joint}")] for joint in ("hip", "knee"))
        knee = np.swapaxes(thigh, 1, 2) @ shank  # Rx(flexion) Rz(adduction) Ry(rotation)
        assert np.allclose(found.of(f"{side}_knee_flexion"), np.rad2deg(np.arctan2(knee[:, 2, 1], knee[:, 1, 1])))


angle = st.floats(-80, 80)
HINGED = {"left_hip": ("pelvis", 1), "right_knee": ("right_hip", -1), "left_ankle": ("left_knee", 1)}


@settings(max_examples=40, deadline=None)
@given(st.tuples(angle, angle, angle), st.sampled_from(sorted(HINGED)))
def test_angles_to_rotations_and_back(degrees: tuple[float, float, float], joint: str) -> None:
    above, sign = HINGED[joint]
    R_above_below = Rotation.from_euler("ZXY", [sign * degrees[0], *degrees[1:]], degrees=True).as_matrix()
    if joint.startswith("left"):
        R_above_below = mirrored(R_above_below)
    R = calibration_pose("n-pose")
    child, parent = joint_index(joint), joint_index(above)
    skeleton = skeleton_from_stature(1.75)
    axes = segment_axes(skeleton)
    R[child] = axes[parent] @ R_above_below @ axes[child].T
    found = joint_angles(Motion(skeleton, R[None], np.zeros((1, 3)), 1.0))
    at = [number for number, one in enumerate(found.definitions) if one.joint == joint]
    assert np.allclose(found.degrees[0, at], degrees, atol=1e-6)


def test_standard_deviations_are_those_of_many_draws() -> None:
    motion = standing(left_hip=-30 * LEFT, right_knee=40 * LEFT, left_elbow=-70 * LEFT)
    rng = np.random.default_rng(4)
    root = rng.normal(size=(JOINT_COUNT, 3, 3)) * 0.01
    covariance = root @ np.swapaxes(root, 1, 2)
    drawn = motion.R_parent_child @ exp((root @ rng.normal(size=(20_000, JOINT_COUNT, 3, 1)))[..., 0])
    found = joint_angle_sigmas(motion, covariance[None])[0]
    spread = joint_angles(Motion(motion.skeleton, drawn, np.zeros((20_000, 3)), 1.0)).degrees.std(axis=0)
    known = np.isfinite(found)
    assert np.allclose(found[known], spread[known], rtol=0.05)
    several = [one.joint.removeprefix("left_").removeprefix("right_") in ("trunk", "neck", "shoulder")
               for one in ANGLE_DEFINITIONS]  # fmt: skip
    assert np.array_equal(known, ~np.array(several))


def test_an_unknown_angle_is_told() -> None:
    with pytest.raises(InputError, match="left_knee_flexion"):
        joint_angles(standing()).of("knee")


def test_segments_are_parallel_to_the_room_in_anatomical_posture() -> None:
    found = segment_orientations(standing(left_elbow=90 * UP, right_elbow=-90 * UP))
    assert np.allclose(found, np.eye(3), atol=1e-12)


def test_limbs_are_straight_where_their_joint_centres_are_in_line() -> None:
    bent = standing()
    offsets = bent.skeleton.p_parent_joint.copy()
    offsets[joint_index("left_wrist")] = 0.25 * np.array([np.cos(0.4), 0.0, np.sin(0.4)])  # forward of where it was
    found = joint_angles(Motion(Skeleton(offsets), bent.R_parent_child, np.zeros((1, 3)), 1.0))
    assert found.of("left_elbow_flexion")[0] == pytest.approx(np.degrees(0.4))
    assert found.of("left_elbow_pronation")[0] == pytest.approx(90)
    assert found.of("right_elbow_flexion")[0] == pytest.approx(0, abs=1e-9)


def test_the_page_on_exports_explains_every_angle() -> None:
    page = (Path(__file__).parents[2] / "docs" / "export-biomechanics.md").read_text(encoding="utf-8")
    for one in ANGLE_DEFINITIONS:
        assert f"`{one.name.removeprefix('left_').removeprefix('right_')}`" in page
