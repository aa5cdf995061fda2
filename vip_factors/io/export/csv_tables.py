"""Tables for spreadsheets and pandas (.csv): joint positions and joint angles, their units in the columns' names."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vip_factors.body.joint_angles import joint_angle_sigmas, joint_angles
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.io.export.settings import ExportSettings

TABLES = ("positions", "angles")


def write_csv(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's table: of ``walk.positions.csv`` or ``walk.angles.csv`` what its name says, else both in one.

    Positions are in the world, z up. Standard deviations (``…_sd_deg``, ``…_sd_m``) follow where the estimate has them.
    """
    wearer = estimate.wearers[0]
    # The file's temporary name has the words of the one that it will get.
    named = [table for table in TABLES if table in path.name.lower().split(".")] or TABLES
    columns: dict[str, Array] = {"time_s": wearer.motion.time}
    if "positions" in named:
        columns |= _positions(wearer)
    if "angles" in named:
        columns |= _angles(wearer)
    digits = [4 if name.endswith("_deg") else 6 for name in columns]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(columns) + "\n")
        np.savetxt(file, np.column_stack(list(columns.values())), [f"%.{number}f" for number in digits], ",")


def _positions(wearer: WearerEstimate) -> Mapping[str, Array]:
    p = wearer.motion.state.p_world_joint
    columns = {f"{name}_{axis}_m": p[:, j, k] for j, name in enumerate(JOINT_NAMES) for k, axis in enumerate("xyz")}
    if wearer.covariance is not None:  # of the other joints' positions it is not known how errors go together
        sigma = np.sqrt(np.diagonal(wearer.covariance.root, axis1=1, axis2=2))
        columns |= {f"{JOINT_NAMES[0]}_{axis}_sd_m": sigma[:, k] for k, axis in enumerate("xyz")}
    return columns


def _angles(wearer: WearerEstimate) -> Mapping[str, Array]:
    angles = joint_angles(wearer.motion)
    columns = {f"{name}_deg": one for name, one in zip(angles.names, angles.degrees.T, strict=True)}
    if wearer.covariance is not None:
        sigmas = joint_angle_sigmas(wearer.motion, wearer.covariance.joints).T
        columns |= {
            f"{name}_sd_deg": one for name, one in zip(angles.names, sigmas, strict=True) if np.isfinite(one).all()
        }
    return columns
