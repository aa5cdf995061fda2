"""A motion as coordinates of OpenSim's full-body model Rajagopal2016.

Rajagopal, Dembia, DeMers, Delp, Hicks, Delp (2016), "Full-body musculoskeletal model for muscle-driven simulation of
human gait", IEEE Trans. Biomed. Eng. 63. Its bodies have x forward, y up, z to the right, and stand, with all
coordinates zero, in the posture of :mod:`~vip_factors.body.joint_angles`.

Pelvis, hips, lumbar joint and shoulders turn about three axes and hold what the estimate has. The other joints have
fewer axes: ankle with subtalar, toes, and elbow with forearm get the coordinates whose rotation is nearest, knees their
flexion and wrists flexion and deviation.
"""

from collections.abc import Mapping

import numpy as np

from vip_factors.body.joint_angles import R_WORLD_ISB, mirrored, segment_orientations
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import (
    Array,
    continuous,
    exp,
    inverse_right_jacobian,
    log,
    rotation_between,
    sequence_of_rotation,
    transpose,
)

# Axes of the right side's joints in the model's bodies, all parallel where the coordinates are zero.
ANKLE_AXIS = np.array([-0.10501355, -0.17402245, 0.97912632])
SUBTALAR_AXIS = np.array([0.78717961, 0.60474746, -0.12094949])
TOES_AXIS = np.array([0.58095440, 0.0, -0.81393611])  # positive is toes down
ELBOW_AXIS = np.array([0.22604696, 0.02226900, 0.97386183])
FOREARM_AXIS = np.array([0.05639803, 0.99840646, 0.00195199])
# From the middle of the hips, x and y of the pelvis' origin over half the distance of the hips.
PELVIS_ORIGIN = np.array([0.056276, 0.07849, 0.0]) / 0.07726


# The model's elbow axis does not lie sideways in its upper arm but is turned by 13°. Ours bends about z: the model's
# upper arm is turned about itself until the axes agree, for else a bent forearm would point 13° amiss.
R_ARM_MODEL = rotation_between(ELBOW_AXIS, np.array([0.0, 0.0, 1.0]))


def opensim_coordinates(motion: Motion) -> Mapping[str, Array]:
    """Coordinates ``(T,)`` by their names in the model: degrees, and metres of ``pelvis_tx`` and its like.

    The pelvis' origin, between the foremost points of the iliac crests, lies from the hips as it does in the model,
    scaled by the distance of the hips.
    """
    R = segment_orientations(motion)
    p = motion.state.p_world_joint @ R_WORLD_ISB
    left, right = p[:, joint_index("left_hip")], p[:, joint_index("right_hip")]
    half_width = np.linalg.norm(left - right, axis=-1, keepdims=True) / 2
    origin = (left + right) / 2 + half_width * (R[:, 0] @ PELVIS_ORIGIN)
    trunk = transpose(R[:, 0]) @ R[:, joint_index("spine3")]
    angles = _turns(R[:, 0], "pelvis_tilt", "pelvis_list", "pelvis_rotation")
    angles |= _turns(trunk, "lumbar_extension", "lumbar_bending", "lumbar_rotation")
    for side in ("right", "left"):
        angles |= {f"{name}_{side[0]}": found for name, found in _side(R, side).items()}
    degrees = {name: np.rad2deg(np.unwrap(found)) for name, found in angles.items()}
    return degrees | {f"pelvis_t{axis}": origin[:, number] for number, axis in enumerate("xyz")}


def _side(R: Array, side: str) -> dict[str, Array]:
    """Coordinates ``(T,)`` of an arm and a leg in radians, by name without its side."""

    def between(above: str, below: str) -> Array:
        first, second = (
            R[:, joint_index(name if name in ("pelvis", "spine3") else f"{side}_{name}")] for name in (above, below)
        )
        found = transpose(first) @ second
        return mirrored(found) if side == "left" else found

    elbow = R_ARM_MODEL.T @ between("shoulder", "elbow")
    wrist = sequence_of_rotation(between("elbow", "wrist"), "zxy")
    return {
        **_turns(between("pelvis", "hip"), "hip_flexion", "hip_adduction", "hip_rotation"),
        "knee_angle": -sequence_of_rotation(between("hip", "knee"), "zxy")[:, 0],
        **_nearest(between("knee", "ankle"), {"ankle_angle": ANKLE_AXIS, "subtalar_angle": SUBTALAR_AXIS}),
        **_nearest(between("ankle", "foot"), {"mtp_angle": TOES_AXIS}),
        **_turns(between("spine3", "shoulder") @ R_ARM_MODEL, "arm_flex", "arm_add", "arm_rot"),
        **_nearest(elbow, {"elbow_flex": ELBOW_AXIS, "pro_sup": FOREARM_AXIS}),
        "wrist_flex": wrist[:, 0],
        "wrist_dev": wrist[:, 1],
    }


def _turns(R: Array, *names: str) -> dict[str, Array]:
    """Three coordinates of rotations ``(T, 3, 3)``: about z, x and y."""
    return dict(zip(names, continuous(sequence_of_rotation(R, "zxy")).T, strict=True))


def _nearest(R: Array, axes: Mapping[str, Array]) -> dict[str, Array]:
    """Angles about axes one after the other whose rotation is nearest to each of ``(T, 3, 3)``: Gauss-Newton."""
    angles = np.zeros((len(R), len(axes)))
    for _ in range(_STEPS):
        turned, moves = np.broadcast_to(np.eye(3), R.shape), np.zeros((len(R), 3, len(axes)))
        for number, axis in enumerate(axes.values()):
            one = exp(angles[:, [number]] * axis)
            turned, moves = turned @ one, transpose(one) @ moves
            moves[:, :, number] = axis
        missing = log(transpose(turned) @ R)
        moves = transpose(inverse_right_jacobian(missing)) @ moves  # of log(exp(-δ) exp(missing))
        normal = transpose(moves) @ moves
        angles = angles + np.linalg.solve(normal, transpose(moves) @ missing[..., None])[..., 0]
    return dict(zip(axes, angles.T, strict=True))


_STEPS = 12  # from zero to where no step is left in double precision, for all that joints can do
