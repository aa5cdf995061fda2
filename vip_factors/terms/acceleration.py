"""Acceleration: second difference of the sensor's position minus the accelerometer's measurement.

The residual is linear in the three positions, with coefficients ``(1, −2, 1)/step²``, each times the identity; how a
position moves with the joints is the body's (:func:`~vip_factors.body.kinematics.twists_at`). The heading turns the
force alone: ``∂(−Rz(γ) f)/∂γ = −e_z × Rz(γ) f``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.terms.equations import DifferenceEquations, JacobianBlock, Term, finite_difference
from vip_factors.terms.evaluation import WearerEvaluation

SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0])  # of three successive positions: acceleration times step²
GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s², world
_QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # derivative of a rotation of row vectors


def acceleration_residual(
    p_before: Array, p_now: Array, p_after: Array, step: float, heading: float | Array, specific_force_inertial: Array
) -> Array:
    """Modelled minus measured acceleration, ``(..., 3)`` m/s², world axes (thesis eqs. 4.24–4.26).

    ``(p(t−1) − 2 p(t) + p(t+1))/step² − (Rz(γ) f + g)``, with the positions of the sensor ``(..., 3)`` in metres and
    its specific force ``f`` in its inertial frame, averaged over the triangular window of half-width ``step``.
    """
    return (p_before - 2 * p_now + p_after) / step**2 - _in_world(heading, specific_force_inertial) - GRAVITY


def acceleration_by_heading(heading: float | Array, specific_force_inertial: Array) -> Array:
    """Derivative of :func:`acceleration_residual` by the heading, ``(..., 3)`` m/s² per radian."""
    return _in_world(heading, specific_force_inertial) @ _QUARTER


def _in_world(heading: float | Array, specific_force_inertial: Array) -> Array:
    return (rotation_z(heading) @ specific_force_inertial[..., None])[..., 0]


def equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[DifferenceEquations]:
    """One factor for each sensor, on its position in three frames and its heading in the first one."""
    problem = wearer.problem
    if not problem.use_acceleration:
        return
    settings = problem.settings.acceleration
    body, step = wearer.body.at(slice(stretch.start, stretch.stop + 2)), problem.frames.step
    p, centre = wearer.sensor_points.on(body), slice(stretch.start + 1, stretch.stop + 1)
    headings, force = wearer.headings(stretch), problem.frames.specific_force_inertial[centre]
    residual = acceleration_residual(p[:-2], p[1:-1], p[2:], step, headings, force) / settings.sigma
    c = SECOND_DIFFERENCE / (step**2 * settings.sigma)

    def blocks() -> tuple[JacobianBlock, ...]:
        by_heading = acceleration_by_heading(headings, force) / settings.sigma
        heading = JacobianBlock(wearer.owner, "headings", by_heading[..., None], is_per_factor=True)
        return heading, *finite_difference(wearer.sensor_blocks(body), c)

    is_valid, bones = problem.frames.acceleration_valid[centre], problem.sensor_points.bones
    arms = wearer.arms(p, stretch)
    yield DifferenceEquations(stretch.start, residual, is_valid, settings.loss, wearer.owner, bones, arms, c, blocks)


ACCELERATION = Term("acceleration", 2, equations)
