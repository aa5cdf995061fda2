"""OpenSim motion files (.mot): coordinates of the model Rajagopal2016."""

from pathlib import Path

import numpy as np

from vip_factors.estimate import Estimate
from vip_factors.io.export.opensim_coordinates import opensim_coordinates
from vip_factors.io.export.opensim_table import write_opensim_table
from vip_factors.io.export.settings import ExportSettings


def write_mot(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's motion in degrees and metres, in OpenSim's ground (y up)."""
    motion = estimate.wearers[0].motion
    coordinates = opensim_coordinates(motion)
    table = np.column_stack([motion.time, *coordinates.values()])
    header = (
        "Coordinates", "version=1", f"nRows={len(table)}", f"nColumns={table.shape[1]}", "inDegrees=yes", "",
        "Coordinates of the model Rajagopal2016: degrees, and metres of pelvis_tx, pelvis_ty, pelvis_tz.", "",
    )  # fmt: skip
    write_opensim_table(path, header, tuple(coordinates), ("\t".join(f"{cell:.8f}" for cell in row) for row in table))
