"""The point between the wearers, in Rerun: not to be seen, but for the eye to follow."""

import numpy as np
import rerun as rr

from vip_factors.geometry.rotations import Array
from vip_factors.viz.rerun_body import time_column

CENTRE = "world/centre"
RADIUS_M = 0.001  # something must be drawn for Rerun to follow it


def log_centre(stream: rr.RecordingStream, time: Array, p_world_centre: Array) -> None:
    """Log where it is: seconds ``(T,)``, metres ``(T, 3)``."""
    stream.log(CENTRE, rr.Points3D([[0.0, 0.0, 0.0]], radii=RADIUS_M), static=True)
    columns = rr.Transform3D.columns(translation=p_world_centre.astype(np.float32))
    stream.send_columns(CENTRE, indexes=[time_column(time)], columns=columns)
