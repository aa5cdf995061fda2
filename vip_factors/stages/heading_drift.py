"""How fast each sensor's heading drifts: measured from a first solution, believed by the next, and told."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.calibration import Calibration

USUAL_MINUTES = 1.0  # the usual drift counts as much as this long a look at the sensor's own
TOLD_DEG = 10.0  # over a recording: more than mountings and tissue leave open


def with_found_drift(model: WearerProblem, state: WearerState) -> WearerProblem:
    """The model that expects of each heading to drift as it was found to: a few minutes tell a calm sensor from a bad.

    Of a random walk the mean square of its steps by their minutes is the variance per minute; the usual one is added
    for a minute's worth, so that few knots do not make it nought.
    """
    if not model.headings_walk:
        return model
    minutes = np.diff(model.heading_knots)[:, None] / 60
    squares = np.sum(np.rad2deg(np.diff(state.heading_knots, axis=0)) ** 2, axis=0)
    usual = model.settings.heading_walk.drift_deg
    drift = np.sqrt((usual**2 * USUAL_MINUTES + squares) / (USUAL_MINUTES + float(minutes.sum())))
    return replace(model, heading_drift_deg=drift)


def drift_findings(who: str, calibration: Calibration) -> Iterator[str]:
    """A sentence about the headings that drifted far."""
    far = {
        name: drifted for name, one in calibration.items() if abs(drifted := _drifted_deg(one.heading_path)) > TOLD_DEG
    }
    if far:
        names = ", ".join(f"{name} by {drifted:+.0f}°" for name, drifted in far.items())
        yield f"{who}: headings drifted: {names} from the start to the end; the estimate follows them"


def _drifted_deg(path: Array) -> float:
    return float(np.rad2deg(path[-1] - path[0])) if len(path) else 0.0
