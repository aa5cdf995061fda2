"""C3D files: joint centres and keypoints as points, joint angles as points of the kind that Vicon calls ANGLES."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.joint_angles import JointAngles, joint_angles
from vip_factors.estimate import Estimate
from vip_factors.geometry.rotations import Array
from vip_factors.io.export.settings import ExportSettings
from vip_factors.io.export.tables import markers

MILLIMETRES = 1000.0
# The header counts frames with 16 bits. Longer files state their length in POINT:LONG_FRAMES, which not all readers
# know, and begin at frame 1.
HEADER_FRAMES = 65_535


def write_c3d(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's points in millimetres, world with z up, and angles in degrees, three to a point."""
    import ezc3d

    wearer = estimate.wearers[0]
    motion = wearer.motion
    points = {name: MILLIMETRES * p for name, p in markers(motion).items()}
    angles, described = _angle_points(joint_angles(motion))
    names = (*points, *angles)
    file: Any = ezc3d.c3d()
    data = np.ones((4, len(names), len(motion)))
    data[:3] = np.stack([*points.values(), *angles.values()]).transpose(2, 0, 1)
    file["data"]["points"] = data
    file["parameters"]["POINT"]["RATE"]["value"] = [motion.rate]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(names)
    file["parameters"]["POINT"]["DESCRIPTIONS"]["value"] = [described.get(name, "") for name in names]
    first = round(motion.start * motion.rate)
    if first + len(motion) > HEADER_FRAMES:
        first = 0
        file.add_parameter("POINT", "LONG_FRAMES", [float(len(motion))])
    file["header"]["points"]["first_frame"] = first
    for group, name, value in (
        ("POINT", "ANGLES", list(angles)),
        ("POINT", "ANGLE_UNITS", ["deg"]),
        ("POINT", "TYPE_GROUPS", ["ANGLES"]),
        ("POINT", "X_SCREEN", ["+X"]),
        ("POINT", "Y_SCREEN", ["+Z"]),  # up, for programs that draw the points
        ("SUBJECTS", "USED", [1]),
        ("SUBJECTS", "NAMES", [wearer.name]),
        ("MANUFACTURER", "SOFTWARE", ["vip-factors"]),
    ):
        file.add_parameter(group, name, value)
    file.write(str(path))


# Vicon's points have no name for the second set of a shoulder's angles, nor for these three of the middle.
_NAMES = {"pelvis": "Pelvis", "trunk": "Spine", "neck": "Neck"}


def _angle_points(found: JointAngles) -> tuple[Mapping[str, Array], Mapping[str, str]]:
    """Triples of angles ``(T, 3)`` in degrees by label, ``LKneeAngles``, and what each of the three is."""
    points, described = dict[str, Array](), dict[str, str]()
    for first in range(0, len(found.definitions), 3):
        three = found.definitions[first : first + 3]
        side, _, joint = three[0].joint.rpartition("_")
        label = f"{side[:1].upper()}{_NAMES.get(joint, joint.capitalize())}Angles"
        if label in points:
            label = label.replace("Angles", "FlexionAngles")
        at = [first, first + 1, first + 2]
        if joint == "pelvis":  # sagittal plane first, as of the other joints
            at, three = at[::-1], three[::-1]
        points[label] = found.degrees[:, at]
        described[label] = ", ".join(one.name.removeprefix(f"{one.joint}_") for one in three)
    return points, described
