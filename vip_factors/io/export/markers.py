"""Points of the body that programs for markers take: joint centres, and what detectors of 2D poses point at."""

from collections.abc import Mapping

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.geometry.rotations import Array

_SIDE = {
    "Eye": "eye", "Ear": "ear", "Shoulder": "shoulder", "Elbow": "elbow", "Wrist": "wrist", "Hip": "hip",
    "Knee": "knee", "Ankle": "ankle", "Heel": "heel", "BigToe": "big_toe", "SmallToe": "small_toe",
}  # fmt: skip
KEYPOINT_MARKERS = {"Nose": "nose", "Head": "head_top", "Neck": "neck", "Hip": "mid_hip"} | {
    f"{side[0].upper()}{marker}": f"{side}_{keypoint}"
    for side in ("right", "left")
    for marker, keypoint in _SIDE.items()
}
"""Keypoints by the names that Pose2Sim's models and set-ups have for them, of COCO, BODY_25, BODY_25B and HALPE_26."""


def markers(motion: Motion) -> Mapping[str, Array]:
    """Points ``(T, 3)`` in metres, world with z up: joint centres by the skeleton's names, keypoints by Pose2Sim's.

    Toes, heels and the top of the head are left out of a skeleton that does not know them.
    """
    found = dict(zip(JOINT_NAMES, np.moveaxis(motion.state.p_world_joint, 1, 0), strict=True))
    places = KeypointSet("markers", tuple(KEYPOINT_MARKERS.values())).on_body(motion.skeleton)
    for name, place in zip(KEYPOINT_MARKERS, places, strict=True):
        if place is not None:
            found[name] = motion.state.point(place.bone, place.p_bone_point)
    return found
