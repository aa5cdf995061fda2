"""Model errors: contribution of systematic errors to reported standard deviations.

The covariance of the solution contains noise only. Soft tissue, joint zeros, sensor positions and body proportions
cause errors that are constant or slow. Reported standard deviations are therefore scaled, or have a variance added,
such that 90 % intervals contain nine of ten true values; see ``docs/uncertainty.md`` and
``python -m tests.studies coverage``.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES, PARENTS
from vip_factors.geometry.rotations import Array

# Joints and the bones below them, both sides alike, with a camera and without: factor of the joint's rotation, error
# along each axis relative to the middle of the hips in mm, and degrees added to mountings of sensors on that bone.
_TABLE = {
    "pelvis": ((0.75, 20, 2), (1.4, 25, 4)),
    "hip": ((0.9, 8, 4), (1.15, 10, 5)),
    "knee": ((0.8, 22, 4), (1.15, 42, 5)),
    "ankle": ((0.75, 32, 3), (1.0, 52, 5)),
    "foot": ((1.0, 32, 3), (1.0, 58, 5)),
    "spine": ((0.4, 20, 2), (0.4, 30, 4)),
    "neck": ((0.4, 20, 2), (0.45, 32, 4)),
    "head": ((0.4, 33, 2), (0.55, 46, 4)),
    "collar": ((0.35, 20, 2), (0.4, 45, 4)),
    "shoulder": ((0.45, 24, 3), (0.75, 54, 6)),
    "elbow": ((0.7, 26, 3), (1.6, 50, 6)),
    "wrist": ((0.6, 30, 3), (0.8, 80, 5)),
    "hand": ((1.0, 31, 3), (1.0, 85, 5)),
}
# Constant share of a joint angle's mean squared error over a recording: its zero.
_OFFSET_SHARE = {"pelvis": 0.6, "hip": 0.6, "knee": 0.4, "ankle": 0.5, "elbow": 0.7, "wrist": 0.9}


@dataclass(frozen=True)
class ModelErrors:
    """Model errors of a wearer's standard deviations, with or without a camera.

    Attributes:
        joint: ``(24,)`` factor of the joint's rotation.
        position: ``(24,)`` m along each axis, of the joint relative to the middle of the hips.
        mounting: ``(24,)`` rad, added about each axis to mountings on that bone.
        heading: rad, added.
        root: factor of the wearer's position.
    """

    joint: Array
    position: Array
    mounting: Array
    heading: float
    root: float

    def positions(self, bones: Collection[str]) -> Array:
        """Position errors ``(24,)`` m of joints for sensors on these bones."""
        far_from_sensors = 1.6  # factor for a limb's joint between bones without sensors
        far = [
            _group(name) in ("knee", "ankle", "elbow", "wrist") and not {name, JOINT_NAMES[above]} & set(bones)
            for name, above in zip(JOINT_NAMES, PARENTS, strict=True)
        ]
        return np.where(far, far_from_sensors, 1.0) * self.position


def _errors(column: int, heading_deg: float, root: float) -> ModelErrors:
    joint, position, mounting = np.array([_TABLE[_group(name)][column] for name in JOINT_NAMES]).T
    return ModelErrors(joint, position / 1e3, np.deg2rad(mounting), float(np.deg2rad(heading_deg)), root)


def _group(joint: str) -> str:
    return joint.rpartition("_")[2].rstrip("123")


FILMED, UNFILMED = _errors(0, heading_deg=5.0, root=1.0), _errors(1, heading_deg=3.5, root=1.5)
LENGTH = 0.014  # m, added to lengths of the body: definitions of joint centres differ


def shape_factor(joint: str) -> float:
    """Factor of an angle's standard deviation once its mean over a recording is removed."""
    return float(np.sqrt(1 - _OFFSET_SHARE.get(_group(joint), 0.0)))
