"""Axes of the segments in biomechanics' terms: of all of them x forward, y up, z to the right in anatomical posture.

That posture is what the recommendations of the International Society of Biomechanics (ISB) count joint angles from (Wu
et al. 2002, J. Biomech. 35; 2005, 38), and OpenSim's models stand in it: upright, feet level and pointing forward, arms
hanging, palms forward. Ours at rest is the T-pose; from there the arms go down by 90° about the forward axis, by which
the palms face the thighs, and the forearms turn outward (supinate) by 90°. Where on the bone ISB would find its axes by
palpated landmarks, these are the bone's of the model, parallel in that posture.
"""

import numpy as np

from vip_factors.body.calibration_pose import calibration_pose
from vip_factors.body.motion import Motion
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES
from vip_factors.geometry.rotations import Array, rotation_y

# x forward, y up, z right, as columns in the body's axes: x left, y up, z forward.
R_BODY_ISB = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
# The same of the room, which has z up: x of the world, up, and what is to the right of who looks along x. OpenSim's
# ground is like this.
R_WORLD_ISB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])

# Turns a left segment's rotation into that of a right one, seen in a mirror: z points the other way.
_MIRROR = np.diag([1.0, 1.0, -1.0])


def _anatomical_frames() -> Array:
    R_body_bone = np.empty((JOINT_COUNT, 3, 3))
    R_body_bone[0] = np.eye(3)
    hanging = calibration_pose("n-pose")
    for bone, name in enumerate(JOINT_NAMES):
        side, _, joint = name.partition("_")
        arm = joint in ("shoulder", "elbow", "wrist", "hand")
        R_body_bone[bone] = hanging[JOINT_NAMES.index(f"{side}_shoulder")] if arm else np.eye(3)
    R_bone_segment = np.swapaxes(R_body_bone, 1, 2) @ R_BODY_ISB
    for bone, name in enumerate(JOINT_NAMES):
        side, _, joint = name.partition("_")
        if joint in ("elbow", "wrist", "hand"):  # with the palm at the thigh the forearm is pronated by 90°
            R_bone_segment[bone] = R_bone_segment[bone] @ rotation_y(-np.pi / 2 if side == "left" else np.pi / 2)
    return R_bone_segment


R_BONE_SEGMENT = _anatomical_frames()
"""``(24, 3, 3)``: each segment's anatomical axes, as columns in its bone's."""


def segment_orientations(motion: Motion) -> Array:
    """Orientations ``(T, 24, 3, 3)`` of the segments' anatomical axes in the room's (y up, :data:`R_WORLD_ISB`)."""
    return R_WORLD_ISB.T @ motion.state.R_world_bone @ R_BONE_SEGMENT


def mirrored(R: Array) -> Array:
    """Rotations ``(..., 3, 3)`` of the other side's segments, in the same axes."""
    return _MIRROR @ R @ _MIRROR
