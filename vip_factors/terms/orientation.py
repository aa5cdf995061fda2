"""Orientation: the bone's orientation minus the attitude estimate of the sensor on it."""

from collections.abc import Iterator

from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, rotation_z, transpose
from vip_factors.terms.equations import BoneEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import WearerEvaluation


def orientation_residual(
    R_world_bone: Array, R_bone_sensor: Array, heading: float | Array, R_inertial_sensor: Array
) -> Array:
    """``Log(R_world_bone R_bone_sensor (Rz(γ) R_inertial_sensor)ᵀ)``, ``(..., 3)`` rad, world axes.

    Thesis eqs. 4.8–4.9 and 4.21, with the mounting as a variable instead of a function of the initial pose.
    """
    R_world_sensor = rotation_z(heading) @ R_inertial_sensor
    return log(R_world_bone @ R_bone_sensor @ transpose(R_world_sensor))


def orientation_jacobians(R_world_bone: Array, R_bone_sensor: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Derivatives of :func:`orientation_residual`.

    Returns:
        By a rotation of the bone in the world and by the mounting ``(..., 3, 3)``, by the heading ``(..., 3)``. The
        former two perturb the error on its left, the heading on its right.
    """
    right = inverse_right_jacobian(residual)
    left_inverse = transpose(right)
    return left_inverse, left_inverse @ R_world_bone @ R_bone_sensor, -right[..., 2]


def equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[BoneEquations]:
    """One factor for each sensor."""
    problem, bones = wearer.problem, wearer.problem.sensor_points.bones
    settings = problem.settings.orientation
    R, mounting = wearer.body.R_world_bone[stretch][:, bones], wearer.state.R_bone_sensor
    error = orientation_residual(R, mounting, wearer.headings(stretch), problem.frames.R_inertial_sensor[stretch])

    def derivatives() -> tuple[Array, tuple[JacobianBlock, ...]]:
        by_turn, by_mounting, by_heading = (J / settings.sigma for J in orientation_jacobians(R, mounting, error))
        return by_turn, (
            JacobianBlock(wearer.owner, "headings", by_heading[..., None], is_per_factor=True),
            JacobianBlock(wearer.owner, "R_bone_sensor", by_mounting, is_per_factor=True),
        )

    is_valid = problem.frames.orientation_valid[stretch]
    yield BoneEquations(
        stretch.start, error / settings.sigma, is_valid, settings.loss, wearer.owner, bones, derivatives
    )


ORIENTATION = Term("orientation", 0, equations)
