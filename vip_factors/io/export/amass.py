"""AMASS-style npz: SMPL-H pose vectors and root path, Z up, hands at rest."""

from pathlib import Path

import numpy as np

from vip_factors.estimate import Estimate
from vip_factors.geometry.rotations import log
from vip_factors.io.export.settings import ExportSettings
from vip_factors.io.motions.amass import BODY_JOINTS, P_MODEL_PELVIS

POSE_WIDTH = 156  # of SMPL-H: 22 joints of the body and 30 of the hands, three numbers each
BETAS, DMPLS = 16, 8
RATE_DIGITS = 6  # a rate of 59.999999999 Hz is read as 59 by programs that count in whole frames


def write_amass(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's motion as ``poses`` ``(T, 156)`` rad, ``trans`` ``(T, 3)`` m, ``betas``, ``gender`` and rate.

    The body itself is not SMPL's: ``betas`` are zero, of the mean shape, whose pelvis joint ``trans`` is counted from;
    ``joint_offsets`` ``(24, 3)`` m, which are no part of AMASS, are the wearer's own, each joint in its parent's frame.
    Turns of the two hand bones of SMPL have no place among those of SMPL-H. Soft tissue (``dmpls``) is at rest.
    """
    motion = estimate.wearers[0].motion
    poses = np.zeros((len(motion), POSE_WIDTH))
    poses[:, : 3 * BODY_JOINTS] = log(motion.R_parent_child[:, :BODY_JOINTS]).reshape(len(motion), -1)
    rate = round(motion.rate, RATE_DIGITS)
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            poses=poses,
            trans=motion.p_world_pelvis - P_MODEL_PELVIS,
            betas=np.zeros(BETAS),
            dmpls=np.zeros((len(motion), DMPLS)),
            gender=np.array("neutral"),
            mocap_framerate=np.array(rate),
            mocap_frame_rate=np.array(rate),
            joint_offsets=motion.skeleton.p_parent_joint,
        )
