"""Acceleration: the second difference of the sensor's position against what its accelerometer says.

The residual is linear in the three positions, with coefficients ``(1, −2, 1)/step²``, each times the identity; how a
position moves with the joints is the body's (:func:`~vip_factors.body.kinematics.twists_at`). The heading turns the
force alone: ``∂(−Rz(γ) f)/∂γ = −e_z × Rz(γ) f``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.terms.equations import DifferenceEquations, JacobianBlock, Term, differenced
from vip_factors.terms.evaluation import WearerEvaluation

SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0])  # of positions before, now and after: their acceleration, times step²
GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s², world
_QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # of rows: what turns about −z, at its start


def acceleration_residual(
    p_before: Array, p_now: Array, p_after: Array, step: float, heading: float | Array, specific_force_inertial: Array
) -> Array:
    """Model less measured acceleration, ``(..., 3)`` m/s², world axes (thesis eqs. 4.24–4.26).

    ``(p(t−1) − 2 p(t) + p(t+1))/step² − (Rz(γ) f + g)``, with the positions of the sensor ``(..., 3)`` in metres and
    its specific force ``f`` in its inertial frame, averaged over the triangular window of half-width ``step``.
    """
    return (p_before - 2 * p_now + p_after) / step**2 - _turned(heading, specific_force_inertial) - GRAVITY


def acceleration_by_heading(heading: float | Array, specific_force_inertial: Array) -> Array:
    """Derivative of :func:`acceleration_residual` by the heading, ``(..., 3)`` m/s² per radian."""
    return _turned(heading, specific_force_inertial) @ _QUARTER


def _turned(heading: float | Array, specific_force_inertial: Array) -> Array:
    return (rotation_z(heading) @ specific_force_inertial[..., None])[..., 0]


def equations(at: WearerEvaluation, first: slice) -> Iterator[DifferenceEquations]:
    """One factor for each sensor, on where it sits in three frames and on its heading in the first one."""
    problem = at.problem
    if not problem.use_acceleration:
        return
    settings = problem.settings.acceleration
    body, step = at.body.at(slice(first.start, first.stop + 2)), problem.frames.step
    p, centre = at.sensor_points.on(body), slice(first.start + 1, first.stop + 1)
    headings, force = at.headings(first), problem.frames.specific_force_inertial[centre]
    residual = acceleration_residual(p[:-2], p[1:-1], p[2:], step, headings, force) / settings.sigma
    c = SECOND_DIFFERENCE / (step**2 * settings.sigma)

    def blocks() -> tuple[JacobianBlock, ...]:
        by_heading = acceleration_by_heading(headings, force) / settings.sigma
        heading = JacobianBlock(at.owner, "headings", by_heading[..., None], each=True)
        return heading, *differenced(at.sensor_blocks(body), c)

    yield DifferenceEquations(
        first.start, residual, problem.frames.acceleration_valid[centre], settings.loss, at.owner,
        problem.sensor_points.bones, at.arms(p, first), c, blocks,
    )  # fmt: skip


ACCELERATION = Term("acceleration", 2, equations)
