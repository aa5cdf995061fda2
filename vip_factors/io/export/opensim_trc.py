"""OpenSim marker files (.trc): joint centres and keypoints over time."""

from pathlib import Path

import numpy as np

from vip_factors.body.joint_angles import R_WORLD_ISB
from vip_factors.estimate import Estimate
from vip_factors.io.export.markers import markers
from vip_factors.io.export.settings import ExportSettings


def write_trc(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's points in metres, in OpenSim's ground (y up)."""
    motion = estimate.wearers[0].motion
    points = markers(motion)
    table = np.column_stack([p_world_point @ R_WORLD_ISB for p_world_point in points.values()])
    axes = (f"{axis}{number}" for number in range(1, len(points) + 1) for axis in "XYZ")
    stated = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame",
              "OrigNumFrames")  # fmt: skip
    rate, frames = f"{motion.rate:.6f}", str(len(motion))
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{estimate.name}.trc",
        "\t".join(stated),
        "\t".join((rate, rate, frames, str(len(points)), "m", rate, "1", frames)),
        "\t".join(("Frame#", "Time", *("\t\t".join((name, "")) for name in points))),
        "\t".join(("", "", *axes)),
        "",
    ]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(lines) + "\n")
        for number, (time, row) in enumerate(zip(motion.time, table, strict=True), 1):
            file.write("\t".join((str(number), f"{time:.6f}", *(f"{cell:.6f}" for cell in row))) + "\n")
