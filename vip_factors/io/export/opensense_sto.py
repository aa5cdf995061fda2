"""OpenSense tables (.sto): how the segments of the body are turned, as quaternions with the real part first."""

from pathlib import Path

import numpy as np

from vip_factors.body.joint_angles import segment_orientations
from vip_factors.body.skeleton import joint_index
from vip_factors.estimate import Estimate
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.io.export.opensim_table import write_opensim_table
from vip_factors.io.export.settings import ExportSettings

_SIDE = {
    "femur": "hip", "tibia": "knee", "calcn": "ankle", "toes": "foot", "humerus": "shoulder", "radius": "elbow",
    "hand": "wrist",
}  # fmt: skip
# Bodies of OpenSim's full-body models, and our bones.
BODIES = {"pelvis": "pelvis", "torso": "spine3", "head": "head"} | {
    f"{body}_{side[0]}": f"{side}_{bone}" for side in ("right", "left") for body, bone in _SIDE.items()
}


def write_opensense(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's segments as if each had a sensor along its anatomical axes: ``femur_r_imu`` and its like.

    In OpenSim's ground (y up): no further rotation of the sensors' space into OpenSim's is needed.
    """
    motion = estimate.wearers[0].motion
    bones = [joint_index(bone) for bone in BODIES.values()]
    quaternions = quaternion_from_matrix(segment_orientations(motion)[:, bones], Order.WXYZ)
    header = (f"DataRate={motion.rate:.6f}", "DataType=Quaternion", "version=3", "OpenSimVersion=4.6")
    rows = (
        "\t".join([f"{time:.6f}", *(",".join(f"{part:.9f}" for part in one) for one in row)])
        for time, row in zip(motion.time, np.asarray(quaternions), strict=True)
    )
    write_opensim_table(path, header, [f"{body}_imu" for body in BODIES], rows)
