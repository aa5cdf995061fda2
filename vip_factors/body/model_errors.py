"""What models leave out of a covariance: their share of the ± that is told.

A covariance knows noise, and that frames are not independent. How tissue goes with posture, what a joint's zero means,
where sensors sit and how bodies differ is alike in every frame or slow, and it counts that as noise or not at all. So
standard deviations are told times a factor, or with some more added as variances. The numbers are ours: such that 90 %
intervals hold nine truths of ten, on people of a simulator that shares nothing with the package (the performers for
choosing) and on the walks of two people of ``geneva_gait``; ``docs/uncertainty.md`` says what the others gave, and
``python -m tests.studies coverage`` measures it.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES, PARENTS
from vip_factors.geometry.rotations import Array

# Of joints and the bones below them, both sides alike: with a camera, the factor of the joint's rotation, how far it is
# off along each axis in millimetres from the middle of the hips, and degrees added to the mountings of sensors on that
# bone; then the same without one.
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
# Of a joint angle's mean squared error over a recording, what is constant: where its zero lies.
_OFFSET_SHARE = {"pelvis": 0.6, "hip": 0.6, "knee": 0.4, "ankle": 0.5, "elbow": 0.7, "wrist": 0.9}


@dataclass(frozen=True)
class ModelErrors:
    """The models' share of the standard deviations of a wearer, with a camera or without one.

    Attributes:
        joint: ``(24,)`` factor of the joint's rotation.
        position: ``(24,)`` m along each axis, of the joint from the middle of the hips.
        mounting: ``(24,)`` rad, added about each axis to mountings on that bone.
        heading: rad, added.
        root: factor of where the wearer is.
    """

    joint: Array
    position: Array
    mounting: Array
    heading: float
    root: float

    def positions(self, bones: Collection[str]) -> Array:
        """How far joints are off, ``(24,)`` m, on a wearer with sensors on these bones."""
        far_from_sensors = 1.6  # times as far off is a limb's joint between bones that wear no sensor
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
LENGTH = 0.014  # m, added to lengths of the body: where others say that joints are


def shape_factor(joint: str) -> float:
    """What of an angle's standard deviation is left once its mean over a recording is removed."""
    return float(np.sqrt(1 - _OFFSET_SHARE.get(_group(joint), 0.0)))
