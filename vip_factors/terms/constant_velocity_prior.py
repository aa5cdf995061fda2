"""Constant velocity: what ties a wearer's root where nothing was measured, and so bridges a silence of the sensors.

The pelvis is tied to its neighbours in time by what sensors measure alone. Where no accelerometer says anything,
nothing else says where the root is; where no sensor says how it is turned, nothing else says which way the wearer
faces. There, and only there, two broad priors hold: a root that keeps its velocity, and a pelvis that stays turned as
it was. Residuals: the root's acceleration ``(p(t−1) − 2 p(t) + p(t+1))/step²``, m/s², world axes; the pelvis's angular
velocity ``Log(R(t)ᵀ R(t+1))/step``, rad/s, in its own axes.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import log, transpose
from vip_factors.terms.acceleration import SECOND_DIFFERENCE
from vip_factors.terms.equations import DenseEquations, DifferenceEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import WearerEvaluation
from vip_factors.terms.smoothness import turn_jacobians


def root_equations(at: WearerEvaluation, first: slice) -> Iterator[DifferenceEquations]:
    """One factor on the root in three frames, where no accelerometer says how it moves."""
    frames, centre = at.problem.frames, slice(first.start + 1, first.stop + 1)
    unmeasured = ~np.any(frames.acceleration_valid[centre], axis=1) & frames.follows[first] & frames.follows[centre]
    if not (at.problem.use_acceleration and unmeasured.any()):
        return
    # m/s², each axis: the pelvis of somebody who walks peaks at 3–5 (up and down, and at every heel strike); who runs
    # exceeds it, for a fraction of a step.
    sigma = 5.0
    p, step = at.state.p_world_pelvis[first.start : first.stop + 2, None], frames.step
    residual = (p[:-2] - 2 * p[1:-1] + p[2:]) / step**2 / sigma
    c = SECOND_DIFFERENCE / (step**2 * sigma)
    yield DifferenceEquations(first.start, residual, unmeasured[:, None], SQUARE, at.owner, (0,), np.zeros_like(p), c)


def pelvis_equations(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the pelvis in two frames, where no sensor saw it turn."""
    frames, after = at.problem.frames, slice(first.start + 1, first.stop + 1)
    seen = np.any(frames.orientation_valid[first], axis=1) & np.any(frames.orientation_valid[after], axis=1)
    unmeasured = ~seen & frames.follows[first]
    if not (at.problem.use_acceleration and unmeasured.any()):
        return
    sigma = 3.0  # rad/s, each axis: a brisk turn on the spot, half a turn in a second
    R, step = at.state.R_parent_child[first.start : first.stop + 1, 0], frames.step
    turn = log(transpose(R[:-1]) @ R[1:])

    def blocks() -> tuple[JacobianBlock, ...]:
        by_both = (J[:, None] / step / sigma for J in turn_jacobians(turn))
        return tuple(JacobianBlock(at.owner, "pelvis", J, ahead=ahead) for ahead, J in enumerate(by_both))

    rate = turn[:, None] / step / sigma
    yield DenseEquations(first.start, rate, unmeasured[:, None], SQUARE, blocks)


ROOT_VELOCITY = Term("root coasting", 2, root_equations, every_frame=False)
PELVIS_TURN = Term("pelvis turn", 1, pelvis_equations, every_frame=False)
