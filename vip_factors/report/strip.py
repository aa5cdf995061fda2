"""The motion as a still picture, for print and for where the page's script cannot draw."""

import numpy as np

from vip_factors.report.material import Material
from vip_factors.viz.picture import pose_picture

POSES, SIZE = 6, (180, 260)  # a row, pixels of a pose


def strip(material: Material) -> np.ndarray:
    """A row of poses for each wearer ``(height, width, 3)``, blue green red, evenly over the time."""
    rows = []
    for wearer in material.wearers:
        motion = wearer.estimate.motion
        frames = np.round(np.linspace(0.04, 0.96, POSES) * (len(motion) - 1)).astype(int)
        rows.append(np.concatenate([pose_picture(motion, int(frame), SIZE) for frame in frames], axis=1))
    return np.concatenate(rows, axis=0)
