"""Constant velocity: broad priors on root and pelvis in frames in which no sensor measured.

Elsewhere only measurements connect the pelvis over time. Residuals: the root's acceleration
``(p(t−1) − 2 p(t) + p(t+1))/step²``, m/s², world axes, where no accelerometer measured; the pelvis's angular velocity
``Log(R(t)ᵀ R(t+1))/step``, rad/s, pelvis axes, where no orientation was measured.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import log, transpose
from vip_factors.terms.acceleration import SECOND_DIFFERENCE
from vip_factors.terms.equations import DenseEquations, DifferenceEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import WearerEvaluation
from vip_factors.terms.smoothness import turn_jacobians


def root_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[DifferenceEquations]:
    """One factor on the root in three frames, where no accelerometer measured."""
    frames, centre = wearer.problem.frames, slice(stretch.start + 1, stretch.stop + 1)
    unmeasured = ~np.any(frames.acceleration_valid[centre], axis=1) & frames.follows[stretch] & frames.follows[centre]
    if not (wearer.problem.use_acceleration and unmeasured.any()):
        return
    sigma = 5.0  # m/s², each axis: a walking pelvis peaks at 3–5, a running one briefly exceeds it
    p, step = wearer.state.p_world_pelvis[stretch.start : stretch.stop + 2, None], frames.step
    residual = (p[:-2] - 2 * p[1:-1] + p[2:]) / step**2 / sigma
    c = SECOND_DIFFERENCE / (step**2 * sigma)
    yield DifferenceEquations(
        stretch.start, residual, unmeasured[:, None], SQUARE, wearer.owner, (0,), np.zeros_like(p), c
    )


def pelvis_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """One factor on the pelvis in two frames, where no orientation was measured."""
    frames, next_frames = wearer.problem.frames, slice(stretch.start + 1, stretch.stop + 1)
    is_measured = np.any(frames.orientation_valid[stretch], axis=1) & np.any(
        frames.orientation_valid[next_frames], axis=1
    )
    unmeasured = ~is_measured & frames.follows[stretch]
    if not (wearer.problem.use_acceleration and unmeasured.any()):
        return
    sigma = 3.0  # rad/s, each axis: a brisk turn on the spot
    R, step = wearer.state.R_parent_child[stretch.start : stretch.stop + 1, 0], frames.step
    turn = log(transpose(R[:-1]) @ R[1:])

    def blocks() -> tuple[JacobianBlock, ...]:
        by_both = (J[:, None] / step / sigma for J in turn_jacobians(turn))
        return tuple(JacobianBlock(wearer.owner, "pelvis", J, ahead=ahead) for ahead, J in enumerate(by_both))

    rate = turn[:, None] / step / sigma
    yield DenseEquations(stretch.start, rate, unmeasured[:, None], SQUARE, blocks)


ROOT_VELOCITY = Term("root coasting", 2, root_equations, every_frame=False)
PELVIS_TURN = Term("pelvis turn", 1, pelvis_equations, every_frame=False)
