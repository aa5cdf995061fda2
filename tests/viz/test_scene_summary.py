"""The text beside a drawn scene."""

import numpy as np

from vip_factors.estimate import BodyEstimate, WearerEstimate
from vip_factors.simulate.gestures import gestures
from vip_factors.viz.drawn_scene import DrawnScene, DrawnWearer
from vip_factors.viz.summaries import scene_summary


def test_lengths_stand_beside_what_was_likely() -> None:
    motion, square = gestures(0.5), np.diag([1e-4, 4e-4])
    body = BodyEstimate(("thigh", "shank"), np.array([0.42, 0.41]), np.array([0.4, 0.43]), 4 * square, square)
    for found, lines in (
        (body, ["| thigh | 420.0 | 20.0 | 400.0 | 10.0 |", "| shank | 410.0 | 40.0 | 430.0 | 20.0 |"]),
        (None, []),
    ):
        estimate = WearerEstimate("walk", "VIP", motion, {}, body=found)
        told = scene_summary(DrawnScene("walk", (DrawnWearer("Ada", 0, motion, None, None, estimate),)))
        assert [line for line in told.splitlines() if line.startswith(("| thigh", "| shank"))] == lines
