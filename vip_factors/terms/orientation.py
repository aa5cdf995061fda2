"""Orientation: the sensor's own attitude estimate against the bone it is strapped to."""

from collections.abc import Iterator

from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, rotation_z, transpose
from vip_factors.terms.equations import BoneEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import WearerEvaluation


def orientation_residual(
    R_world_bone: Array, R_bone_sensor: Array, heading: float | Array, R_inertial_sensor: Array
) -> Array:
    """``Log(R_world_bone R_bone_sensor (Rz(γ) R_inertial_sensor)ᵀ)``, ``(..., 3)`` rad, world axes.

    Thesis eqs. 4.8–4.9 and 4.21, with the mounting as a variable of its own instead of through the initial pose.
    """
    R_world_sensor = rotation_z(heading) @ R_inertial_sensor
    return log(R_world_bone @ R_bone_sensor @ transpose(R_world_sensor))


def orientation_jacobians(R_world_bone: Array, R_bone_sensor: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Derivatives of :func:`orientation_residual`.

    Returns:
        By a turn of the bone in the world and by the mounting ``(..., 3, 3)``, by the heading ``(..., 3)``.
        Perturbing anything left of the sensor turns the error on its left, the heading turns it on its right.
    """
    right = inverse_right_jacobian(residual)
    left = transpose(right)
    return left, left @ R_world_bone @ R_bone_sensor, -right[..., 2]


def equations(at: WearerEvaluation, first: slice) -> Iterator[BoneEquations]:
    """One factor for each sensor."""
    problem, bones = at.problem, at.problem.sensor_points.bones
    settings = problem.settings.orientation
    R, mounting = at.body.R_world_bone[first][:, bones], at.state.R_bone_sensor
    error = orientation_residual(R, mounting, at.headings(first), problem.frames.R_inertial_sensor[first])

    def derivatives() -> tuple[Array, tuple[JacobianBlock, ...]]:
        by_turn, by_mounting, by_heading = (J / settings.sigma for J in orientation_jacobians(R, mounting, error))
        return by_turn, (
            JacobianBlock(at.owner, "headings", by_heading[..., None], each=True),
            JacobianBlock(at.owner, "R_bone_sensor", by_mounting, each=True),
        )

    seen = problem.frames.orientation_valid[first]
    yield BoneEquations(first.start, error / settings.sigma, seen, settings.loss, at.owner, bones, derivatives)


ORIENTATION = Term("orientation", 0, equations)
